"""How much of a hidden effect shows: the change of the readings that the rig's own parameters cannot take up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ground.recordings.model import Recording
from ground.recordings.plant_run import to_run
from sim_hal.plant.expressions import Name
from sim_hal.plant.simulate import Plant, compile_plant

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOLERANCE = 1e-9
"""Relative error per integration step: tighter than what a diagnosis integrates with."""
STEP_SIGMAS = 0.01
ENCODER_SIGMA = 1e-5
"""An encoder has no noise to speak of; its readings count as good to this much, in metres."""
OPENING_SIDE_S, AFTER_TOUCHDOWN_S, LEAST_FLIGHT_S = 0.0015, 0.08, 0.03
"""Of a hop the moment of the opening and what follows the landing's first contact are left out of all figures."""


def simulate(plant: Plant, runs: Sequence[Recording]) -> list[Float]:
    """Outputs (samples, outputs) of each run; raises `SimulationError`."""
    compiled = compile_plant(plant, relative_tolerance=TOLERANCE)
    return [compiled.run(compiled.values, to_run(run, plant)) for run in runs]


def channel_sigmas(plant: Plant) -> dict[str, float]:
    """Noise and rounding of each output; what has neither counts as an encoder."""
    found = {}
    for name in plant.structure.outputs:
        sensor = plant.sensors[name]
        sigma = float(np.hypot(sensor.noise_std, (sensor.resolution or 0.0) / np.sqrt(12.0)))
        found[name] = sigma if sensor.noise_std > 0.0 else max(sigma, ENCODER_SIGMA)
    return found


def hop_contacts(plant: Plant, run: Recording) -> tuple[float, Float]:
    """When the latch opens, and the instants at which the foot leaves or meets the ground [s]."""
    extra = {"ground": Name("ground_force"), "free": Name("opened")}
    compiled = compile_plant(plant, extra=extra)
    table = compiled.run(compiled.values, to_run(run, plant))
    ground, free = table[:, -2] > 0.0, table[:, -1] > 0.0
    opening = float(run.times_s[int(np.argmax(free))]) if free.any() else float("inf")
    changes = np.flatnonzero(np.diff(ground.astype(np.int8))) + 1
    return opening, run.times_s[changes]


def touchdown_s(contacts: Float) -> float | None:
    """The end of the first real flight; None when there is none."""
    for left, met in pairwise(contacts):
        if met - left > LEAST_FLIGHT_S:
            return float(met)
    return None


def mask(plant: Plant, run: Recording) -> Mask:
    """Samples (samples,) that count, with the true plant."""
    use = np.ones(run.times_s.size, dtype=bool)
    if plant.kind == "hop":
        opening, contacts = hop_contacts(plant, run)
        use &= np.abs(run.times_s - opening) > OPENING_SIDE_S
        landed = touchdown_s(contacts)
        if landed is not None:
            use &= run.times_s < landed + AFTER_TOUCHDOWN_S
    return use


@dataclass(frozen=True)
class Seen:
    """What of a change remains beyond the rig's own parameters: rms by channel in sigmas, and chi-square."""

    rms: Mapping[str, float]
    chi2: float
    left: Float

    def alike(self, other: Seen) -> float:
        """Cosine between this change and another, whatever their signs."""
        return float(abs(self.left @ other.left) / np.sqrt(self.chi2 * other.chi2))

    @property
    def most(self) -> float:
        """In the channel that shows it most."""
        return max(self.rms.values())


class Sight:
    """Looks at changes of the readings of given runs, about the true plant without anything hidden.

    A cheap linear measure: the change, less the best that the nominal parameters' sensitivities can do within their
    tolerances. It ranks and scales; no fit is done.
    """

    def __init__(self, plant: Plant, runs: Sequence[Recording], nominal: Plant) -> None:
        self._runs = runs
        self._sigmas = np.array(list(channel_sigmas(plant).values()))
        self._names = tuple(plant.structure.outputs)
        self._masks = [mask(plant, run) for run in runs]
        self.base = self.scaled(plant)
        surfaces = {str(run.conditions.get("surface", "")) for run in runs}
        self.free = tuple(
            name
            for name, parameter in nominal.flat().items()
            if parameter.std > 0.0 and ("." not in name or name.split(".")[0] in surfaces)
        )
        self._jacobian = np.column_stack([self._slope(plant, nominal, name) for name in self.free])

    def scaled(self, plant: Plant) -> Float:
        """All readings that count, in sigmas, one after the other, channel by channel."""
        tables = simulate(plant, self._runs)
        kept = [table[use] / self._sigmas for table, use in zip(tables, self._masks, strict=True)]
        return np.vstack(kept).T.ravel()

    def seen(self, changed: Float, without: str | None = None) -> Seen:
        """What remains of a change (as `scaled` gives it, less a base); `without` keeps one parameter out."""
        keep = [i for i, name in enumerate(self.free) if name != without]
        jacobian = self._jacobian[:, keep]
        normal = jacobian.T @ jacobian + np.eye(len(keep))
        left = changed - jacobian @ np.linalg.solve(normal, jacobian.T @ changed)
        by_channel = left.reshape(len(self._names), -1)
        rms = {n: float(np.sqrt(np.mean(row**2))) for n, row in zip(self._names, by_channel, strict=True)}
        return Seen(rms, float(left @ left), left)

    def _slope(self, plant: Plant, nominal: Plant, name: str) -> Float:
        """Sensitivity of the readings to a parameter, per sigma of its tolerance."""
        step = STEP_SIGMAS * nominal.flat()[name].std
        moved = self.scaled(plant.with_values({name: plant.flat()[name].value + step}))
        return np.asarray((moved - self.base) / STEP_SIGMAS)
