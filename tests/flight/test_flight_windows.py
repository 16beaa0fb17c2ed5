"""The sliding windows in which a flight is looked for, against a least squares of each window alone."""

from __future__ import annotations

import numpy as np
import pytest

from flight.flight_search import NoFlight, slide

POLE, STEP_S = complex(-6.0, 140.0), 6e-4


def test_each_window_is_a_least_squares_of_its_own() -> None:
    rng = np.random.default_rng(4)
    times = 0.3 + STEP_S * np.arange(200)
    values = 0.4 + (np.exp(POLE * (times - 0.3)) * (20.0 - 8.0j)).real + 0.1 * rng.normal(size=times.size)
    found = slide(STEP_S, times, values, POLE, 0.6)
    assert found.width == round(0.6 * 2.0 * np.pi / POLE.imag / STEP_S)
    assert found.level_m_s2.shape == found.rms_m_s2.shape == (times.size - found.width + 1,)
    np.testing.assert_array_equal(found.starts_s, times[: found.level_m_s2.size])
    tau = (np.arange(found.width) - 0.5 * (found.width - 1)) * STEP_S
    wave, drift = np.exp(POLE * tau), tau / (0.5 * found.width * STEP_S)
    shapes = np.column_stack((np.ones_like(tau), wave.real, wave.imag, drift * wave.real, drift * wave.imag))
    for first in (0, 37, found.level_m_s2.size - 1):
        own = values[first : first + found.width]
        fitted = np.linalg.lstsq(shapes, own, rcond=None)[0]
        left = own - shapes @ fitted
        assert found.level_m_s2[first] == pytest.approx(fitted[0], abs=1e-9)
        assert found.amplitude_m_s2[first] == pytest.approx(np.hypot(fitted[1], fitted[2]), abs=1e-9)
        assert found.rms_m_s2[first] == pytest.approx(np.sqrt(left @ left / (found.width - 5)), abs=1e-6)
    assert found.level_per_noise == pytest.approx(np.sqrt(np.linalg.inv(shapes.T @ shapes)[0, 0]))


def test_a_record_no_longer_than_a_window_holds_no_flight() -> None:
    with pytest.raises(NoFlight, match="too short"):
        slide(STEP_S, STEP_S * np.arange(20), np.zeros(20), POLE, 0.6)
