"""The ringing of a part of the flight: dry friction in the spring's guide is seen where it is, and only there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flight.local_ringing import LocalRinging, fit_ringing, rubbing_sigmas

OMEGA_RAD_S, DECAY_1_S, LEG_SHARE = 140.0, 6.0, 0.284
STEP_S, EVERY, SAMPLES = 5e-6, 140, 96  # of the stepping; samples lie 0.7 ms apart
OMEGA, DECAY = (OMEGA_RAD_S, 3.0), (DECAY_1_S, 2.0)


def rung(friction_m_s2: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and specific force (n,) of the body on a ringing spring, by stepping; friction over its mass."""
    stiffness = OMEGA_RAD_S**2 + DECAY_1_S**2
    delta, rate, seen = 0.0, -1.0, []
    for index in range(EVERY * SAMPLES):
        pull = stiffness * delta + 2.0 * DECAY_1_S * rate
        rubs = math.copysign(friction_m_s2, rate)
        if index % EVERY == 0:
            seen.append(LEG_SHARE * pull + rubs)
        rate -= STEP_S * (pull + rubs / LEG_SHARE)
        delta += STEP_S * rate
    return STEP_S * EVERY * np.arange(SAMPLES), np.array(seen)


def fitted(times: np.ndarray, seen: np.ndarray, noise_m_s2: float) -> LocalRinging:
    return fit_ringing(times, seen, OMEGA, DECAY, noise_m_s2, float(times[0]))


def test_without_friction_what_is_left_of_it_is_standard_normal() -> None:
    times, clean = rung(0.0)
    rng, noise = np.random.default_rng(1), 0.1
    found, rubs = [], []
    for _ in range(200):
        seen = clean + noise * rng.normal(size=SAMPLES)
        ringing = fitted(times, seen, noise)
        found.append(rubbing_sigmas(ringing, times, seen, noise))
        rubs.append(ringing.friction_m_s2)
    assert abs(float(np.mean(found))) < 0.25
    assert 0.85 < float(np.std(found)) < 1.15
    assert not any(rubs)


@pytest.mark.parametrize("noise_m_s2", [0.02, 0.07])
def test_friction_is_seen_and_measured_that_leaves_hardly_more_than_the_noise(noise_m_s2: float) -> None:
    times, clean = rung(0.1)
    rng = np.random.default_rng(2)
    rubs = []
    for _ in range(40):
        seen = clean + noise_m_s2 * rng.normal(size=SAMPLES)
        ringing = fitted(times, seen, noise_m_s2)
        assert ringing.rms_m_s2 < 1.3 * noise_m_s2
        assert rubbing_sigmas(ringing, times, seen, noise_m_s2) < 4.0
        rubs.append(ringing.friction_m_s2)
    assert np.count_nonzero(rubs) > 38
    assert float(np.mean(rubs)) == pytest.approx(0.1, rel=0.1)
