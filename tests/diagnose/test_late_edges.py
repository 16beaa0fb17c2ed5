"""A late channel full of edges: between two samples an edge tells nothing, and the delay is found all the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pushed_mass import pushed_mass

from ground.diagnose.pipeline import diagnose
from ground.recordings.model import Recording, SensorSpec

RATE_HZ, NOISE_M_S2, NOISE_M = 200.0, 0.02, 2e-5


def recordings(delay_samples: int, mass_kg: float = 2.06) -> list[Recording]:
    """Pushes to and fro on a free mass, by the closed form of a constant force between samples."""
    random = np.random.default_rng(3)
    times = np.arange(600) / RATE_HZ
    found = []
    for number in range(4):
        push = np.repeat(random.uniform(-8.0, 8.0, 30), 20)
        a = push / mass_kg
        v = np.concatenate([[0.0], np.cumsum(a[:-1]) / RATE_HZ])
        q = np.concatenate([[0.0], np.cumsum(v[:-1] / RATE_HZ + 0.5 * a[:-1] / RATE_HZ**2)])
        late = np.concatenate([np.full(delay_samples, a[0]), a[: a.size - delay_samples]])
        channels = {
            "push_n": push,
            "position_m": q + NOISE_M * random.standard_normal(q.size),
            "acceleration_m_s2": late + NOISE_M_S2 * random.standard_normal(a.size),
        }
        sensors = {"position_m": SensorSpec(NOISE_M), "acceleration_m_s2": SensorSpec(NOISE_M_S2)}
        found.append(
            Recording(times, channels, run=f"run_{number}", rig="pushed_mass", kind="bench", sensors=sensors)
        )
    return found


def test_a_delay_of_several_samples_is_found_through_edges(tmp_path: Path) -> None:
    found = diagnose(recordings(3), pushed_mass(tmp_path), processes=1).diagnosis
    (finding,) = found.findings
    assert (finding.physics_id, finding.channels) == ("sensor_delay", ("acceleration_m_s2",))
    assert finding.probability > 0.9
    assert finding.parameters["delay"].value == pytest.approx(3.0 / RATE_HZ, abs=1.0 / RATE_HZ)


def test_a_channel_in_time_is_left_alone(tmp_path: Path) -> None:
    found = diagnose(recordings(0), pushed_mass(tmp_path), processes=1).diagnosis
    assert found.verdict == "consistent"
