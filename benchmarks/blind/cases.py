"""One blind case: a rig drawn within its tolerances, what is hidden in it, and what its sensors read.

Everything comes from the seed, the kind and the number. The recordings say of a run what a laboratory knows; what is
hidden stands in `BlindCase.hidden` alone.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from benchmarks.blind.excite import runs_of
from benchmarks.blind.explanations import (
    OUT_OF_TOLERANCE,
    Explanation,
    Shaped,
    drawn,
    explanations,
    shaped,
    typical_scales,
)
from benchmarks.blind.sight import Seen, Sight, hop_contacts, simulate, touchdown_s
from ground.recordings.model import Recording
from hal.config import config_path
from sim_hal.plant.simulate import Plant, PlantError, SimulationError, load_plant

Float = NDArray[np.float64]

KINDS = ("hop", "drive", "axis", "drop")
SHARES = {"null": 0.2, "single": 0.6, "pair": 0.2}
TEST_RUNS = 2
WITHIN_SIGMAS = 2.0
"""True parameters are drawn normally within their tolerances, and again when farther off than this."""
VISIBLE = (0.5, 30.0)
"""Range of what shows of an effect, in sigmas (rms in the channel that shows it most), drawn log-uniformly."""
WHOLE_VISIBLE = 100.0
"""The same for what acts as a whole, and whose size therefore cannot be chosen."""
CLOSE = 1.3
ALIKE = 0.9995
"""Cosine between what two explanations show, beyond which they count as the same."""
EXPLANATIONS_TRIED = 12
TRIES = 60
_RIGS = {
    "hop": lambda: config_path("plant", "bb0b_hop.yaml"),
    "drive": lambda: config_path("plant", "bb0b_drive.yaml"),
    "axis": lambda: Path(__file__).parents[1] / "rigs" / "axis.yaml",
    "drop": lambda: Path(__file__).parents[1] / "rigs" / "drop.yaml",
}


@dataclass(frozen=True)
class Hidden:
    """Something hidden: what and where, how large, and how much of it shows in the recordings to diagnose from."""

    physics_id: str
    kind: str
    equation: str
    place: str | None
    parameters: Mapping[str, float]
    rms: Mapping[str, float]
    chi2: float
    lookalikes: tuple[str, ...]

    @property
    def visible(self) -> float:
        """In sigmas, in the channel that shows it most."""
        return max(self.rms.values())


@dataclass(frozen=True)
class BlindCase:
    """`plant` and `train` are what a diagnosis is given; the rest is for who judges it.

    `clean` are the test runs' true readings, (samples, outputs) each.
    """

    name: str
    plant: Plant
    train: tuple[Recording, ...]
    test: tuple[Recording, ...]
    clean: tuple[Float, ...]
    hidden: tuple[Hidden, ...]
    truth: Plant


def nominal_plant(kind: str) -> Plant:
    """The nominal plant of a kind."""
    return load_plant(_RIGS[kind]())


def draw_case(kind: str, number: int, seed: int) -> BlindCase:
    """The case of this kind, number and seed; the same to the bit whenever it is drawn."""
    random = np.random.Generator(
        np.random.PCG64(np.random.SeedSequence([seed, zlib.crc32(kind.encode()), number]))
    )
    nominal = nominal_plant(kind)
    wanted = int(random.choice([0, 1, 2], p=list(SHARES.values())))
    for _ in range(TRIES):
        runs = runs_of(nominal, int(random.integers(4, 7)) + TEST_RUNS, random)
        own = within_tolerances(nominal, runs, random)
        try:
            if not all(well_posed(own, run) for run in runs):
                continue
            found = hide(own, nominal, runs[:-TEST_RUNS], wanted, random)
            if found is None or not all(well_posed(found[0], run) for run in runs):
                continue
            truth, hidden = found
            clean = simulate(truth, runs)
        except SimulationError:
            continue
        read = [measured(run, table, nominal, random) for run, table in zip(runs, clean, strict=True)]
        parts = tuple(read[:-TEST_RUNS]), tuple(read[-TEST_RUNS:]), tuple(clean[-TEST_RUNS:])
        return BlindCase(f"{kind}-{number}", nominal, *parts, hidden, truth)
    raise RuntimeError(f"{kind}-{number}, seed {seed}: no case came about in {TRIES} tries")


def within_tolerances(nominal: Plant, runs: Sequence[Recording], random: Generator) -> Plant:
    """A rig as built: every parameter somewhere within its tolerance."""
    values = {}
    for name, parameter in nominal.flat().items():
        away = random.normal()
        while abs(away) > WITHIN_SIGMAS:
            away = random.normal()
        values[name] = parameter.value + away * parameter.std
    surfaces = {name: value for name, value in values.items() if name.endswith(".chi")}
    return nominal.with_values(
        values | {name: min(max(value, 0.0), 0.97) for name, value in surfaces.items()}
    )


def hide(
    own: Plant, nominal: Plant, runs: Sequence[Recording], wanted: int, random: Generator
) -> tuple[Plant, tuple[Hidden, ...]] | None:
    """Put `wanted` things into the rig, each of a size that shows as much as drawn; None when one cannot be seen."""
    if wanted == 0:
        return own, ()
    sight, scales = Sight(own, runs, nominal), typical_scales(own, runs)
    options = explanations(nominal, runs)
    truth, hidden, shown = own, list[Hidden](), list[Seen]()
    for _ in range(EXPLANATIONS_TRIED):
        if len(hidden) == wanted:
            break
        names = {one.physics_id for one in hidden}
        explanation = drawn([option for option in options if option.physics_id not in names], random)
        form = shaped(explanation, own, scales, random)
        target = float(np.exp(random.uniform(*np.log(VISIBLE))))
        found = sized(form, own, nominal, sight, target) if form is not None else None
        if form is None or found is None or any(found[1].alike(other) > ALIKE for other in shown):
            continue
        size, seen = found
        truth = form.hidden_in(truth, nominal, size)
        shown.append(seen)
        hidden.append(
            Hidden(
                *(explanation.physics_id, explanation.kind, explanation.equation, explanation.place),
                parameters=parameters_of(form, truth, size),
                rms=seen.rms,
                chi2=seen.chi2,
                lookalikes=lookalikes(explanation, seen, own, nominal, sight, options, scales),
            )
        )
    return (truth, tuple(hidden)) if len(hidden) == wanted else None


def lookalikes(
    hidden: Explanation,
    seen: Seen,
    own: Plant,
    nominal: Plant,
    sight: Sight,
    options: Sequence[Explanation],
    scales: Mapping[str, Mapping[str, float]],
) -> tuple[str, ...]:
    """Other names under which these recordings would show the same, to first order: no diagnosis can tell them apart.

    Only what has a strength and nothing else is tried, so the list may be too short, never too long.
    """
    found = set[str]()
    for option in options:
        form = shaped(option, own, scales, np.random.default_rng(0))
        if (
            option.physics_id == hidden.physics_id
            or form is None
            or set(form.values) - set(form.scaled) - {"rho"}
        ):
            continue
        like = sized(form, own, nominal, sight, seen.most, steps=3)
        if like is not None and like[1].alike(seen) > ALIKE:
            found.add(option.physics_id)
    return tuple(sorted(found))


def parameters_of(form: Shaped, truth: Plant, size: float) -> dict[str, float]:
    """The hidden effect's parameters, or the true value of the parameter that is off."""
    if form.explanation.physics_id == OUT_OF_TOLERANCE:
        place = str(form.explanation.place)
        return {place: truth.flat()[place].value}
    return form.parameters(size)


def sized(
    form: Shaped, own: Plant, nominal: Plant, sight: Sight, target: float, steps: int = 8
) -> tuple[float, Seen] | None:
    """The size at which about `target` sigmas show; the nearest one plausible; None where too little ever shows.

    What acts as a whole has no size and is taken as drawn, unless far more of it shows than is ever asked for.
    """
    off = form.explanation.place if form.explanation.physics_id == OUT_OF_TOLERANCE else None
    base = sight.base if off is None else sight.scaled(form.hidden_in(own, nominal, 0.0))
    size, best = min(1.0, form.largest), None
    for _ in range(steps if off or form.scaled else 1):
        try:
            seen = sight.seen(sight.scaled(form.hidden_in(own, nominal, size)) - base, without=off)
        except (SimulationError, PlantError):  # beyond what integrates, or what such an effect can be
            size /= 5.0
            continue
        factor = target / max(seen.most, 1e-9)
        if best is None or abs(np.log(factor)) < abs(np.log(target / max(best[1].most, 1e-9))):
            best = size, seen
        factor = float(np.clip(factor, 1e-2, 1e2))
        if 1.0 / CLOSE < factor < CLOSE or (factor > 1.0 and size >= form.largest):
            break
        size = min(size * factor, form.largest)
    most = best[1].most if best is not None else 0.0
    too_much = off is None and not form.scaled and most > WHOLE_VISIBLE
    return None if too_much or most < VISIBLE[0] / CLOSE else best


def well_posed(plant: Plant, run: Recording) -> bool:
    """Whether no grazing contact, slack string or blocked motor decides the run: a slightly other rig does alike."""
    if plant.kind == "drive":
        table = simulate(plant, [run])[0]
        names = tuple(plant.structure.outputs)
        current, travel = table[:, names.index("motor_current_a")], table[:, names.index("nut_position_m")]
        return bool(np.abs(current).max() < 3.0 and travel.min() > -1e-4 and travel.max() < 0.042)
    if plant.kind != "hop":
        return True
    patterns = set()
    for factor in (0.99, 1.0, 1.01):
        stiffer = plant.with_values({"k": plant.flat()["k"].value * factor})
        _, contacts = hop_contacts(stiffer, run)
        landed = touchdown_s(contacts)
        if landed is None or landed + 0.1 > run.times_s[-1]:
            return False
        patterns.add(int(np.sum(contacts < landed + 0.08)))
    return len(patterns) == 1


def measured(run: Recording, table: Float, nominal: Plant, random: Generator) -> Recording:
    """The run with what its sensors read: white noise added, rounded to the step, then limited to the range."""
    channels = dict(run.channels)
    for column, name in enumerate(nominal.structure.outputs):
        sensor = nominal.sensors[name]
        values = table[:, column] + sensor.noise_std * random.standard_normal(table.shape[0])
        if sensor.resolution:
            values = np.round(values / sensor.resolution) * sensor.resolution
        channels[name] = np.clip(values, *sensor.range) if sensor.range else values
    return replace(run, channels=channels)
