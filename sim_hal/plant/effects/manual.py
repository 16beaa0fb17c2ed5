"""The catalogue as the table of docs/plants.md: `python -m sim_hal.plant.effects.manual` prints it."""

from __future__ import annotations

import re

from sim_hal.plant.effects import catalogue
from sim_hal.plant.effects.base import Effect, Form

_LATER_STEP = re.compile(r".*_([2-9]|\d\d+)")


def rows() -> list[str]:
    """One line of the table for each effect, in the catalogue's order."""
    return [_row(effect) for effect in catalogue().values()]


def _row(effect: Effect) -> str:
    forms = " or ".join(dict.fromkeys(_acts(form) for form in effect.forms))
    return f"| `{effect.physics_id}` | {effect.equation} | {forms} |"


def _acts(form: Form) -> str:
    """What a form does, in formulas."""
    parts = []
    if form.force:
        parts.append(f"force `{form.force}`")
    if form.dry:
        parts.append(f"dry friction `{form.dry[0]}`")
    if form.inertia:
        parts.append(f"inertia `{form.inertia}`")
    parts += [f"`{port} + ({text})`" for port, text in form.terms.items()]
    parts += [f"`{port} · ({text})`" for port, text in form.factors.items()]
    parts += [f"reads `{text}`" for text in (form.sensor,) if text]
    parts += [f"reads `y(t - {text})`" for text in (form.delay,) if text]
    parts += [f"reads `y(t - ({text}) * elapsed)`" for text in (form.skew,) if text]
    return "; ".join([*parts, *_inner(form)])


def _inner(form: Form) -> list[str]:
    """States, memories and names of parts; of steps that only repeat, the first two."""
    parts = [f"dfiltered/dt = `(y - filtered) / {text}`" for text in (form.low_pass,) if text]
    parts += [f"d{name}/dt = `{state.rate}`" for name, state in form.states.items()]
    for name, memory in form.memories.items():
        limits = (
            f"within [`{memory.lower}`, `{memory.upper}`]"
            if memory.upper
            else f"the largest `{memory.lower}`"
        )
        parts.append(f"{name} {limits}")
    return parts + [
        f"{name} = `{text}`" for name, text in form.local.items() if not _LATER_STEP.fullmatch(name)
    ]


if __name__ == "__main__":
    print("\n".join(rows()))
