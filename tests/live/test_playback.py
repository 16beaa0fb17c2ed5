"""A log shows in the console what the flight showed."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from flight.log import read_log
from ground.live.playback import Recorded, read_recorded, thinned
from ground.live.shows import RecordedShow
from ground.live.sources import ConsoleError
from hal.log import LogError


@pytest.fixture(scope="module")
def recorded(flown_log: Path) -> Recorded:
    return read_recorded(flown_log)


def test_the_phase_at_each_time_is_the_logs(recorded: Recorded, flown_log: Path) -> None:
    changes = [(m.time_s, m.payload["to"]) for m in read_log(flown_log).messages if m.topic == "state"]
    assert len(changes) > 15
    for (time_s, phase), (next_s, _) in itertools.pairwise(changes):
        if next_s > time_s:
            assert recorded.at(0.5 * (time_s + next_s)).phase == phase
    assert recorded.at(recorded.end_s).reason == "stowed"


def test_the_compression_is_the_energy_that_was_asked_for(recorded: Recorded) -> None:
    fire_s = next(m.time_s for m in recorded.told if m.payload.get("to") == "firing")
    view = recorded.at(fire_s)
    assert view.channels["outputs.energy_used_j"] == pytest.approx(4.0, rel=0.02)
    assert view.armed


def test_thinning_keeps_the_extremes() -> None:
    rng = np.random.default_rng(1)
    times_s = np.arange(50_000) / 1000.0
    values = rng.normal(size=times_s.size)
    values[[17, 40_001]] = 9.0, -9.0
    thin_t, thin_v = thinned(times_s, values, 1000)
    assert thin_t.size == 1000
    assert (thin_v.max(), thin_v.min()) == (9.0, -9.0)
    assert np.all(np.diff(thin_t) > 0)


def test_a_stretch_of_a_line_is_finer_than_the_whole(recorded: Recorded) -> None:
    whole = recorded.series(recorded.start_s, recorded.end_s)["force_m_s2"]
    fire_s = next(m.time_s for m in recorded.told if m.payload.get("to") == "firing")
    part = recorded.series(fire_s, fire_s + 0.3)["force_m_s2"]
    assert np.median(np.diff(part["t"])) < 0.001 < np.median(np.diff(whole["t"]))


def test_a_recording_takes_no_command(recorded: Recorded) -> None:
    with pytest.raises(ConsoleError, match="abort: not sent: this is a recording"):
        RecordedShow(recorded).command("abort", {})


def test_a_file_that_is_no_flight_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"something else")
    with pytest.raises(LogError, match="is no MCAP file"):
        read_recorded(tmp_path / "a.mcap")
