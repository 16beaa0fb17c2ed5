"""The catalogue of effects as a table of docs/physics.md: `python -m ground.physics_table` brings it up to date."""

from __future__ import annotations

from pathlib import Path

from ground.files import write_atomic
from sim_hal.plant.simulate import catalogue

PAGE = Path(__file__).resolve().parents[1] / "docs" / "physics.md"
HEAD = "| effect | enters | what it is | source |\n| --- | --- | --- | --- |\n"


def catalogue_table() -> str:
    """All effects of this installation that come with hopper, by the equation they enter."""
    effects = sorted(catalogue().values(), key=lambda effect: (effect.equation, effect.physics_id))
    rows = (f"| `{e.physics_id}` | {e.equation} | {e.says} | {e.citation} |\n" for e in effects)
    return HEAD + "".join(rows)


def with_table(page: str) -> str:
    """The page with the table of now, from its head to the next empty line."""
    start = page.index(HEAD)
    end = page.find("\n\n", start)
    return page[:start] + catalogue_table().rstrip("\n") + (page[end:] if end >= 0 else "\n")


if __name__ == "__main__":
    write_atomic(PAGE, with_table(PAGE.read_text(encoding="utf-8")))
