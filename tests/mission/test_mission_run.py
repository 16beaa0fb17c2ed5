"""A mission flown from the ground's side: what is on file afterwards, and what is not."""

from __future__ import annotations

import errno
import json
import os
import signal
from html.parser import HTMLParser
from pathlib import Path

import pytest

from flight import settings as flight_settings
from flight.executive import Progress
from flight.log import read_log
from flight.mission import HopPlan, MissionPlan
from flight.settings import FlightSettings
from ground.mission_run import hop_rows, plan_mission, run_mission
from ground.mission_summary import HOP_HEADERS, MissionRun, comparisons, plus_minus, verdict_sentence
from ground.recordings import load_recording
from ground.replay import replay_log
from hal.errors import BoardUnavailable, ConfigError

ENERGY_J = 6.0  # little, so that tensioning is short


@pytest.fixture(scope="module")
def settings() -> FlightSettings:
    return flight_settings.load()


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, settings: FlightSettings) -> MissionRun:
    plan = plan_mission("quartz_sand", 1, ENERGY_J, settings, references=0)
    return run_mission(plan, tmp_path_factory.mktemp("missions") / "one", seed=5)


def test_a_mission_leaves_all_its_files_and_no_other(flown: MissionRun) -> None:
    assert sorted(entry.name for entry in flown.folder.iterdir()) == [
        "flight.mcap",
        "hop_00.drive.csv.gz",
        "hop_00.drive.yaml",
        "hop_00.hop.csv.gz",
        "hop_00.hop.yaml",
        "mission.json",
        "report.html",
    ]
    assert [entry.name for entry in flown.folder.parent.iterdir()] == ["one"]


def test_the_summary_says_what_was_found(flown: MissionRun) -> None:
    content = json.loads((flown.folder / "mission.json").read_text(encoding="utf-8"))
    (hop,) = content["hops"]
    report = flown.hops[0].report
    assert report.energies.used_j is not None
    assert hop["energy_used_j"]["value"] == report.energies.used_j.value
    assert hop["truth"]["spot"]["surface"] == "quartz_sand"
    assert content["seed"] == 5
    assert content["completed"] is True
    assert content["notes"] == []
    assert content["summary"] == verdict_sentence(flown)


def test_estimates_agree_with_the_truth_within_their_uncertainty(flown: MissionRun) -> None:
    """Five quantities of one hop: none may be off by four of its own standard uncertainties."""
    found = comparisons(flown)
    assert [figure.name for figure in found] == ["E_used", "time of flight", "E_pot", "height", "C3"]
    for figure in found:
        assert figure.error_sigmas is not None
        assert abs(figure.error_sigmas) < 4.0, figure


def test_the_recordings_are_those_of_the_hop(flown: MissionRun) -> None:
    outcome = flown.hops[0]
    assert outcome.drive is not None
    assert outcome.hop is not None
    for recording in (outcome.drive, outcome.hop):
        assert recording.source is not None
        assert load_recording(recording.source).same_content(recording)
    assert outcome.hop.event_time_s("fire_command") is not None
    assert outcome.hop.conditions["surface"] == "quartz_sand"


def test_the_log_tells_what_was_flown_with(flown: MissionRun) -> None:
    metadata = read_log(flown.folder / "flight.mcap").metadata
    assert metadata["board"] == "sim"
    assert metadata["seed"] == "5"
    assert "quartz_sand" in metadata["mission"]


class _Words(HTMLParser):
    """The visible text of a page, and what it would fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.text = ""
        self.fetched: list[str] = []
        self._hidden = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._hidden = tag in ("script", "style")
        self.fetched += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        self._hidden = False

    def handle_data(self, data: str) -> None:
        self.text += "" if self._hidden else data


def test_the_page_carries_verdict_and_figures_and_fetches_nothing(flown: MissionRun) -> None:
    page = _Words()
    html = (flown.folder / "report.html").read_text(encoding="utf-8")
    page.feed(html)
    assert verdict_sentence(flown) in page.text
    for cell in hop_rows(flown)[0]:
        assert cell in page.text
    assert not page.fetched
    assert html.count('data-for="figure-') == 6  # overview, C3, belief, surfaces, tensioning, hop


def test_rows_fit_their_headers(flown: MissionRun) -> None:
    (row,) = hop_rows(flown)
    assert len(row) == len(HOP_HEADERS)
    assert row[:3] == ("1", "quartz sand", "valid")


def test_one_seed_flies_the_same_mission_to_the_bit(
    flown: MissionRun, settings: FlightSettings, tmp_path: Path
) -> None:
    again = run_mission(flown.result.plan, tmp_path / "again", seed=5)
    for name in ("mission.json", "flight.mcap"):
        assert (again.folder / name).read_bytes() == (flown.folder / name).read_bytes(), name


def test_a_mission_stopped_by_hand_keeps_its_log_which_replays_to_there(
    settings: FlightSettings, tmp_path: Path
) -> None:
    """Ctrl-C comes at some instant of a tick; the flight ends with that tick, and twice so in two folders."""

    def stop(progress: Progress) -> None:
        if progress.time_s > 0.5:
            os.kill(os.getpid(), signal.SIGINT)

    folder = tmp_path / "deep" / "out"
    before = signal.getsignal(signal.SIGINT)
    for name in ("out.stopped", "out.stopped-2"):
        with pytest.raises(KeyboardInterrupt) as stopped:
            run_mission(plan_mission("syar", 1, ENERGY_J, settings), folder, watch=stop)
        log = folder.with_name(name) / "flight.mcap"
        assert stopped.value.__notes__ == [f"the log of the flight is kept: {log}"]
        assert [path.name for path in log.parent.iterdir()] == [log.name]
        replayed = replay_log(log)
        assert replayed.same
        assert replayed.compared > 500
        assert log_ends_with_outputs_off(log)
    assert signal.getsignal(signal.SIGINT) is before
    assert {path.name for path in folder.parent.iterdir()} == {"out.stopped", "out.stopped-2"}


def log_ends_with_outputs_off(log: Path) -> bool:
    messages = read_log(log).messages
    last = {m.topic: m.payload for m in messages if m.payload.get("method") != "close"}
    return last["magnet"]["method"] == "switch_off" and last["motor"]["arguments"] == {"voltage_v": 0.0}


def test_a_failure_after_the_flight_keeps_its_log(
    settings: FlightSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "report.html")

    monkeypatch.setattr("ground.mission_run.write_mission_page", full)
    plan = plan_mission("quartz_sand", 1, 1.0, settings, references=0)
    with pytest.raises(OSError, match="No space left") as failed:
        run_mission(plan, tmp_path / "out")
    log = tmp_path / "out.stopped" / "flight.mcap"
    assert failed.value.__notes__ == [f"the log of the flight is kept: {log}"]
    assert read_log(log).messages[-1].topic
    assert [path.name for path in tmp_path.iterdir()] == ["out.stopped"]


def test_a_mission_refused_before_it_flies_leaves_no_folder(settings: FlightSettings, tmp_path: Path) -> None:
    plan = plan_mission("syar", 1, ENERGY_J, settings)
    with pytest.raises(BoardUnavailable):
        run_mission(plan, tmp_path / "a" / "b" / "out", board="raspberry_pi")
    assert not list(tmp_path.iterdir())


def test_a_mission_that_fails_is_on_file_with_its_reason(settings: FlightSettings, tmp_path: Path) -> None:
    """A magnet without power: the robot does not hop, relaxes its spring and says why."""
    plan = plan_mission("quartz_sand", 1, ENERGY_J, settings, references=0)
    silent = [{"device": "magnet", "kind": "silent", "from_s": 0.0}]
    run = run_mission(plan, tmp_path / "out", changes={"faults": silent})
    assert not run.result.completed
    assert not run.hops
    content = json.loads((tmp_path / "out" / "mission.json").read_text(encoding="utf-8"))
    assert content["end_reason"] == "magnet_open"
    assert content["spring_loaded"] is False
    assert content["summary"].startswith("The mission ended after 0 of 1 hops: magnet_open")
    assert "magnet_open" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_another_kind_of_folder_is_never_replaced(settings: FlightSettings, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work", encoding="utf-8")
    with pytest.raises(ConfigError, match="holds something else"):
        run_mission(plan_mission("syar", 1, ENERGY_J, settings), tmp_path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(("hops", "energy_j", "references"), [(0, 6.0, 1), (1, 500.0, 1), (1, 6.0, -1)])
def test_a_mission_that_cannot_be_flown_is_refused(
    settings: FlightSettings, hops: int, energy_j: float, references: int
) -> None:
    with pytest.raises(ConfigError):
        plan_mission("syar", hops, energy_j, settings, references=references)


@pytest.mark.parametrize("energy_j", [float("nan"), float("inf"), 0.0])
def test_an_energy_that_is_none_is_refused(settings: FlightSettings, energy_j: float) -> None:
    with pytest.raises(ConfigError, match="energy_j"):
        plan_mission("syar", 1, energy_j, settings)


def test_a_simulation_must_know_the_ground(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"hops\[0\]\.surface is missing"):
        run_mission(MissionPlan("blind", (HopPlan(ENERGY_J),)), tmp_path / "out")


def test_the_robot_is_never_replaced_by_a_simulation(settings: FlightSettings, tmp_path: Path) -> None:
    for board in ("raspberry_pi", "nonsense"):
        with pytest.raises(BoardUnavailable, match=board):
            run_mission(plan_mission("syar", 1, ENERGY_J, settings), tmp_path / "out", board=board)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (290.0873, 0.1557, "290.09 ± 0.16"),
        (17.98, 0.3289, "17.98 ± 0.33"),
        (1234.5, 99.0, "1234 ± 99"),
        (-0.00012, 0.0000051, "-0.0001200 ± 0.0000051"),
        (3.25, 0.0, "3.25"),
    ],
)
def test_values_are_rounded_to_two_digits_of_their_uncertainty(value: float, sigma: float, text: str) -> None:
    assert plus_minus(value, sigma) == text
