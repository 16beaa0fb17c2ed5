"""Falls of a rigid body: planted release and touchdown, coverage of their sigma, and what is no fall."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.falling_phone import G_M_S2, Fall, NoFall, find_fall, read

DATA = Path(__file__).resolve().parents[2] / "../shared/data/falling-smartphone"
RATE_HZ, NOISE_M_S2 = 198.6, 0.022


def planted(
    rng: np.random.Generator, power: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
    """Times, specific force (n, 3), release and touchdown: hand and cushion push as powers of time."""
    times = np.arange(0.0, 2.0, 1.0 / RATE_HZ) + rng.uniform(0.0, 1.0 / RATE_HZ)
    release, touchdown = 0.7 + rng.uniform(0.0, 0.01), 1.25 + rng.uniform(0.0, 0.1)
    hand = G_M_S2 * np.clip((release - times) / rng.uniform(0.015, 0.04), 0.0, 1.0) ** power
    cushion = 150.0 * np.clip((times - touchdown) / rng.uniform(0.012, 0.03), 0.0, 1.0) ** power
    speed = G_M_S2 * np.clip(np.minimum(times, touchdown) - release, 0.0, None)
    along = hand + cushion + 0.03 * speed**2
    axis = rng.normal(size=3)
    force = along[:, None] * axis / np.linalg.norm(axis) + rng.normal(0.0, 0.5, 3)
    return times, force + NOISE_M_S2 * rng.normal(size=force.shape), release, touchdown


def test_planted_falls_are_found_within_their_sigma() -> None:
    rng = np.random.Generator(np.random.PCG64(3))
    errors = []
    for _ in range(200):
        times, force, release, touchdown = planted(rng, rng.uniform(1.0, 2.0))
        fall = find_fall(times, force)
        errors.append((fall.flight_s - (touchdown - release)) / fall.flight_sigma_s)
    within = np.abs(errors)
    assert float(np.mean(within < 1.96)) > 0.9
    assert float(within.max()) < 6.0


def test_a_phone_at_rest_does_not_fall() -> None:
    times = np.arange(0.0, 5.0, 1.0 / RATE_HZ)
    with pytest.raises(NoFall, match="nothing falls"):
        find_fall(times, np.tile((0.0, 0.0, G_M_S2), (times.size, 1)))


def test_a_recording_that_ends_in_the_fall_is_refused() -> None:
    times, force, _, touchdown = planted(np.random.Generator(np.random.PCG64(1)), 1.0)
    part = times < touchdown - 0.05
    with pytest.raises(NoFall, match="ends in the fall"):
        find_fall(times[part], force[part])


@pytest.mark.skipif(not DATA.is_dir(), reason=f"no recordings at {DATA}")
def test_every_published_fall_is_found() -> None:
    falls: list[Fall] = [find_fall(*read(path)) for path in sorted((DATA / "raw_csv").glob("*.csv"))]
    assert len(falls) == 22
    for fall in falls:
        assert 0.4 < fall.flight_s < 0.8
        assert fall.flight_sigma_s < 0.01
        assert 0.0 < fall.release_speed_m_s < 0.5
    with pytest.raises(NoFall):
        find_fall(*read(DATA / "accel_static.txt"))
