"""How a diagnosis of a blind case is judged, as the practice cases' scorer does it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.blind.cases import BlindCase, Hidden
from benchmarks.blind.sight import channel_sigmas, mask, simulate
from ground.diagnose.result import Diagnosis, Finding
from sim_hal.plant.simulate import Plant, SimulationError

DRIVE = frozenset({"tensioning", "hold", "whole_run"})
HOP = frozenset({"stance", "flight", "landing", "whole_run"})
PHASES = {
    "electrical": DRIVE,
    "drive_torque": DRIVE,
    "transmission": DRIVE,
    "spring_force": DRIVE | HOP,
    "magnet": frozenset({"release", "whole_run"}),
    "latch": frozenset({"release", "stance"}),
    "body_momentum": HOP,
    "leg_momentum": HOP,
    "ground_contact": frozenset({"stance", "landing", "whole_run"}),
    "ballistic": frozenset({"flight", "whole_run"}),
}
"""Phases in which an effect of an equation may be said to show; of a rig without phases, and of a channel, any."""
EQUATIONS = {
    "ballistic": frozenset({"ballistic", "body_momentum"}),
    "body_momentum": frozenset({"body_momentum", "leg_momentum"}),
}
LEAST_EXCESS = 0.02
"""In squared sigmas; less than this is no excess that could be removed."""
TOP = 3


@dataclass(frozen=True)
class Judged:
    """What of a case's answer is right. Shares are over what is hidden, None in a null case."""

    verdict: bool
    top1: float | None
    top1_or_alike: float | None
    top3: float | None
    phase: float | None
    equation: float | None
    brier: tuple[tuple[float, bool], ...]


def names_of(finding: Finding) -> list[str]:
    """The name given and its two best rivals."""
    rivals = sorted(finding.alternatives, key=lambda rival: -rival.probability)
    return [finding.physics_id, *(rival.physics_id for rival in rivals[: TOP - 1])]


def judge(case: BlindCase, found: Diagnosis) -> Judged:
    """Compare findings with what is hidden; each hidden thing is paired with one finding."""
    verdict = found.verdict == ("mismatch" if case.hidden else "consistent")
    hidden_names = {one.physics_id for one in case.hidden}
    brier = tuple((f.probability, f.physics_id in hidden_names) for f in found.findings)
    if not case.hidden:
        return Judged(verdict, None, None, None, None, None, brier)
    pairs = list(zip(case.hidden, paired(case.hidden, found.findings), strict=True))

    def share(right: Sequence[bool]) -> float:
        return sum(right) / len(right)

    return Judged(
        verdict,
        top1=share([f is not None and f.physics_id == h.physics_id for h, f in pairs]),
        top1_or_alike=share(
            [f is not None and f.physics_id in (h.physics_id, *h.lookalikes) for h, f in pairs]
        ),
        top3=share([f is not None and h.physics_id in names_of(f) for h, f in pairs]),
        phase=share([f is not None and phase_right(h, f, case.plant) for h, f in pairs]),
        equation=share([f is not None and equation_right(h, f) for h, f in pairs]),
        brier=brier,
    )


def paired(hidden: Sequence[Hidden], findings: Sequence[Finding]) -> list[Finding | None]:
    """One finding for each hidden thing: by name, then by name among the rivals, then by equation, then in order."""
    left = list(findings)
    found: list[Finding | None] = [None] * len(hidden)
    tests = (
        lambda h, f: f.physics_id == h.physics_id,
        lambda h, f: h.physics_id in names_of(f),
        equation_right,
        lambda _h, _f: True,
    )
    for test in tests:
        for number, one in enumerate(hidden):
            match = next((f for f in left if test(one, f)), None) if found[number] is None else None
            if match is not None:
                found[number] = match
                left.remove(match)
    return found


def phase_right(hidden: Hidden, finding: Finding, plant: Plant) -> bool:
    """Whether the phase named is one in which this shows."""
    if plant.kind in ("axis", "drop") or hidden.kind != "physics":
        return True
    return finding.phase in PHASES.get(hidden.equation, DRIVE | HOP)


def equation_right(hidden: Hidden, finding: Finding) -> bool:
    """Whether the equation named is where this enters."""
    if hidden.equation == "any":
        return True
    return finding.equation in EQUATIONS.get(hidden.equation, frozenset({hidden.equation}))


def chi_on_test(case: BlindCase, plant: Plant) -> dict[str, float]:
    """Reduced residual (rms in sigmas) of a plant by channel on the held-out runs; infinite where it cannot run."""
    names = tuple(case.plant.structure.outputs)
    sigmas = np.array(list(channel_sigmas(case.plant).values()))
    try:
        tables = simulate(plant, case.test)
    except SimulationError:
        return dict.fromkeys(names, float("inf"))
    rows = []
    for run, table in zip(case.test, tables, strict=True):
        read = np.column_stack([run.channels[name] for name in names])
        rows.append(((read - table) / sigmas)[mask(case.truth, run)])
    return dict(zip(names, np.sqrt(np.mean(np.vstack(rows) ** 2, axis=0)).tolist(), strict=True))


def removed(refit: dict[str, float], extended: dict[str, float], oracle: dict[str, float]) -> float | None:
    """Share of the refit's excess over the truth's that the extended plant removes, over all channels, in [-1, 1].

    A channel that was right and is spoilt counts against it. None where the refit leaves no excess.
    """
    excess = left = 0.0
    for name, before in refit.items():
        floor = oracle[name] ** 2
        room, after = before**2 - floor, min(extended[name] ** 2, 1e6)
        if room < LEAST_EXCESS or before < 1.0:
            left += max(0.0, after - max(before**2, floor, 1.1))
            continue
        left += min(after - floor, 2.0 * room)
        excess += room
    return float(np.clip(1.0 - left / excess, -1.0, 1.0)) if excess > 0.0 else None
