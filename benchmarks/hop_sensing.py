"""What the sensors' FIFOs deliver of a simulated hop: noise, steps, range, lost samples, clocks of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.hop_draws import HopCase
from flight.settings import FlightSettings
from hal.readings import MagnetCurrent, SpecificForce, SpringCompression

Float = NDArray[np.float64]

STEP_M_S2, G_M_S2 = 0.00957, 9.80665
REST_S = 0.3  # recorded before the fire command
SPRING_NOISE_M, SPRING_STEP_M = 50e-6, 5e-6
MAGNET_NOISE_A, MAGNET_STEP_A = 5e-3, 1e-3
TICK_S = 0.005


@dataclass(frozen=True)
class Tick:
    """What one tick of the board reads."""

    now_s: float
    force: SpecificForce
    spring: SpringCompression
    magnet: MagnetCurrent


def sensed(
    case: HopCase,
    settings: FlightSettings,
    rng: np.random.Generator,
    force_s: Float,
    force: Float,
    spring_s: Float,
    spring: Float,
    magnet: Float,
    end_s: float,
) -> tuple[Tick, ...]:
    """The batches: noise, step, range, lost samples, each sensor's own clock."""
    noise = case.noise_factor * settings.sensors.accelerometer_noise_m_s2
    limit = case.range_g * G_M_S2
    seen = force + noise * rng.normal(size=force.size)
    seen = np.clip(np.round(seen / STEP_M_S2) * STEP_M_S2, -limit, limit)
    spring = spring + SPRING_NOISE_M * rng.normal(size=spring.size)
    spring = np.clip(np.round(spring / SPRING_STEP_M) * SPRING_STEP_M, -0.06, 0.06)
    magnet = np.round((magnet + MAGNET_NOISE_A * rng.normal(size=magnet.size)) / MAGNET_STEP_A)
    magnet = magnet * MAGNET_STEP_A
    kept = rng.random(force.size) >= case.missing_share
    force_s, seen = force_s[kept], seen[kept]
    kept = rng.random(spring.size) >= case.missing_share
    spring_s, spring, magnet = spring_s[kept], spring[kept], magnet[kept]
    skews = (case.clock_skew, case.clock_skew * rng.uniform(-1.0, 1.0))
    starts = rng.uniform(-0.05, 0.05, 2) if case.clock_skew else np.zeros(2)
    stamps = [
        start + (1.0 + skew) * t for start, skew, t in zip(starts, skews, (force_s, spring_s), strict=True)
    ]
    reads = np.arange(-REST_S, end_s, TICK_S)
    reads = reads + rng.uniform(0.0, 3e-4, reads.size)
    ticks, old = [], (0, 0)
    for now_s in reads.tolist():
        new = (int(np.searchsorted(force_s, now_s)), int(np.searchsorted(spring_s, now_s)))
        mine, other = slice(old[0], new[0]), slice(old[1], new[1])
        values = seen[mine]
        times = tuple(stamps[1][other].tolist())
        ticks.append(
            Tick(
                now_s,
                SpecificForce(
                    tuple(stamps[0][mine].tolist()),
                    tuple(values.tolist()),
                    tuple((np.abs(values) >= limit).tolist()),
                ),
                SpringCompression(times, tuple(spring[other].tolist())),
                MagnetCurrent(times, tuple(magnet[other].tolist())),
            )
        )
        old = new
    return tuple(ticks)
