"""Which samples of a hop a fit must not lean on.

At the opening the acceleration steps by hundreds of m/s² within one sample, so an error of a fraction of a sample in
time reads as a huge residual; after the landing's first contact, rebounds blow up whatever small difference came
before. Both stretches say more about the instant than about the physics, and are left out.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from ground.recordings.model import Recording
from sim_hal.plant.expressions import Name
from sim_hal.plant.simulate import Plant, Run, SimulationError, compile_plant

Float = NDArray[np.float64]

FIRE = "fire_command"
ACCELERATION = "body_acceleration_m_s2"
OPENING_WITHIN_S = 0.05
OPENING_SIDE_S = 0.0015
AFTER_TOUCHDOWN_S = 0.08
LEAST_FLIGHT_S = 0.03


def hop_mask(recording: Recording, plant: Plant, run: Run) -> NDArray[np.bool_]:
    """True for the samples (samples,) to use: all but the opening's surroundings and what follows the landing."""
    use = np.ones(run.times_s.size, dtype=bool)
    fire = recording.event_time_s(FIRE)
    if fire is None:
        return use
    opening = opening_time_s(recording, fire)
    if opening is not None:
        use &= np.abs(run.times_s - opening) > OPENING_SIDE_S
    touchdown = touchdown_time_s(plant, run, fire)
    if touchdown is not None:
        use &= run.times_s < touchdown + AFTER_TOUCHDOWN_S
    return use


def opening_time_s(recording: Recording, fire_s: float) -> float | None:
    """The instant soon after the fire command at which the measured acceleration steps most; None if not measured."""
    values = recording.channels.get(ACCELERATION)
    if values is None:
        return None
    seen = (
        np.isfinite(values) & (recording.times_s > fire_s) & (recording.times_s < fire_s + OPENING_WITHIN_S)
    )
    times, steps = recording.times_s[seen], np.abs(np.diff(values[seen]))
    if steps.size == 0:
        return None
    at = int(np.argmax(steps))
    return float(0.5 * (times[at] + times[at + 1]))


def touchdown_time_s(plant: Plant, run: Run, fire_s: float) -> float | None:
    """When the foot meets the ground again, as the plant as given has it; None when it does not fly or land."""
    compiled = compile_plant(plant, extra={"ground": Name("ground_force")})
    try:
        ground = compiled.run(compiled.values, run)[:, -1]
    except SimulationError:
        return None
    aloft = (ground <= 0.0) & (run.times_s > fire_s)
    change = np.flatnonzero(np.diff(aloft.astype(np.int8)))
    for start, stop in itertools.pairwise(change):
        if not aloft[start] and run.times_s[stop] - run.times_s[start] > LEAST_FLIGHT_S:
            return float(run.times_s[stop])
    return None
