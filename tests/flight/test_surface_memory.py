"""What outlives the power: surfaces learned, and the belief to the bit; and what happens when it is damaged."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flight import settings as flight_settings
from flight.surface.belief import belief_of
from flight.surface.keeper import GroundKeeper
from flight.surface.known import UNKNOWN, load_surfaces
from flight.surface.learner import GroundRecord, from_text, learned_from, models_of, to_text
from flight.surface.mixture import arrays_of
from flight.surface.priors import loss_of
from flight.surface.tracker import HopSeen, Tracker
from flight.surface.watch import GroundWatch, common_sigma, hop_seen
from flight.uncertain import Uncertain
from hal.memory import FileMemory, VolatileMemory

SETTINGS = flight_settings.load()
SURFACES = load_surfaces()
STRANGE = (0.7, math.log(2.2e4))


def hop(c3: float, log_stiffness: float, energy_j: float = 12.0) -> HopSeen:
    return HopSeen(energy_j, loss_of(c3), 0.005, log_stiffness, 0.04)


def tracker_after(*rows: tuple[float, float]) -> Tracker:
    tracker = Tracker.begin(models_of(SURFACES, SETTINGS.surface, "1", 0.0, ()), (0.0, 0.02))
    for row in rows:
        tracker = tracker.after(hop(*row))
    return tracker


def same(one: Tracker, other: Tracker) -> bool:
    """To the last bit."""
    if (one.dose, one.hops, len(one.runs)) != (other.dose, other.hops, len(other.runs)):
        return False
    return all(
        (a.start, a.dose, a.log_weight) == (b.start, b.dose, b.log_weight)
        and all(
            x.tobytes() == y.tobytes()
            for x, y in zip(arrays_of(a.mixture).values(), arrays_of(b.mixture).values(), strict=True)
        )
        for a, b in zip(one.runs, other.runs, strict=True)
    )


@settings(max_examples=8, deadline=None)
@given(st.lists(st.tuples(st.floats(-0.05, 0.9), st.floats(9.3, 14.8)), min_size=0, max_size=4))
def test_a_restart_keeps_the_belief_to_the_bit(rows: list[tuple[float, float]]) -> None:
    tracker = tracker_after(*rows)
    found = from_text(to_text(GroundRecord((), tracker, "1", 0.0)), SURFACES, SETTINGS.surface).tracker
    assert found is not None
    assert same(tracker, found)
    following = hop(0.3, 11.4)
    assert same(tracker.after(following), found.after(following))


def test_new_ground_is_learned_and_met_again() -> None:
    tracker = tracker_after(STRANGE, STRANGE, STRANGE)
    assert belief_of(tracker, 12.0).said == UNKNOWN
    learned = learned_from(tracker, "1", 0.0, ())
    assert [surface.name for surface in learned] == ["new_surface_1"]
    ground = models_of(SURFACES, SETTINGS.surface, "1", 0.0, learned)
    again = tracker.on_new_place(ground)
    for c3 in (0.72, 0.69):
        again = again.after(hop(c3, STRANGE[1] + 0.08))
    assert belief_of(again, 12.0).said == "new_surface_1"
    twice = learned_from(again, "1", 0.0, learned)
    assert [(surface.name, surface.places) for surface in twice] == [("new_surface_1", 2)]
    one, two = (each[0].model(SETTINGS.surface) for each in (learned, twice))
    assert two.loss_std < one.loss_std
    elsewhere = tracker.on_new_place(ground).after(hop(0.36, math.log(9.042e4)))
    assert belief_of(elsewhere, 12.0).said == "quartz_sand"


def test_nothing_is_learned_of_known_ground_or_of_one_hop() -> None:
    sand = (0.36, math.log(9.042e4))
    assert learned_from(tracker_after(sand, sand, sand), "1", 0.0, ()) == ()
    assert learned_from(tracker_after(STRANGE), "1", 0.0, ()) == ()


def test_a_keeper_keeps_and_says_what_it_found(tmp_path: Path) -> None:
    tracker = tracker_after(STRANGE, STRANGE)
    record = GroundRecord(learned_from(tracker, "1", 0.0, ()), tracker, "1", 0.0)
    path = tmp_path / "ground"
    keeper = GroundKeeper(FileMemory(path), SURFACES, SETTINGS.surface)
    assert keeper.found()[1].details == {"known": False}
    assert keeper.keep(record) is None
    found, event = GroundKeeper(FileMemory(path), SURFACES, SETTINGS.surface).found()
    assert event.details == {"known": True, "learned": 1, "hops": 2}
    assert found.learned == record.learned
    assert found.tracker is not None
    assert same(found.tracker, tracker)


@pytest.mark.parametrize("damage", ["{}", "no json", '{"format": 9}', '{"format": 1, "learned": [1]}'])
def test_a_damaged_record_counts_as_nothing_known_and_is_said_to_be(damage: str) -> None:
    memory = VolatileMemory()
    memory.write(damage)
    record, event = GroundKeeper(memory, SURFACES, SETTINGS.surface).found()
    assert record == GroundRecord()
    assert event.details["known"] is False
    assert event.details["error"]


def test_a_record_of_other_surfaces_is_refused() -> None:
    content = json.loads(to_text(GroundRecord((), tracker_after(STRANGE), "1", 0.0)))
    content["tracker"]["names"][0] = "cheese"
    with pytest.raises(ValueError, match="other surfaces"):
        from_text(json.dumps(content), SURFACES, SETTINGS.surface)


def test_a_memory_that_cannot_be_written_is_an_event(tmp_path: Path) -> None:
    keeper = GroundKeeper(FileMemory(tmp_path / "nowhere" / "ground"), SURFACES, SETTINGS.surface)
    event = keeper.keep(GroundRecord())
    assert event is not None
    assert event.name == "ground_record_unwritten"


def test_a_watch_goes_from_place_to_place_and_back() -> None:
    watch = GroundWatch(SURFACES, SETTINGS)
    sand = hop(0.36, math.log(9.042e4))
    first = watch.see("A", 0.0, sand, 0.01, "direct")
    watch.see("B", 0.0, hop(0.11, math.log(2.4e5)), 0.01, "direct")
    back = watch.see("A", 0.0, sand, 0.01, "direct")
    assert (first.hops, back.hops) == (1, 2)
    assert back.probabilities["quartz_sand"] > first.probabilities["quartz_sand"]
    assert not [event for event in watch.events if event.name == "ground_changed"]


def test_a_change_that_nobody_announced_is_told() -> None:
    watch = GroundWatch(SURFACES, SETTINGS)
    for _ in range(3):
        watch.see("A", 0.0, hop(0.36, math.log(9.042e4)), 0.01, "direct")
    watch.see("A", 0.0, hop(0.1, math.log(2.4e5)), 0.01, "direct")
    assert [event.name for event in watch.events] == ["ground_changed"]


def test_a_watch_learns_when_it_leaves_and_remembers_over_a_restart() -> None:
    watch = GroundWatch(SURFACES, SETTINGS)
    for _ in range(3):
        watch.see("A", 0.0, hop(*STRANGE), 0.01, "direct")
    watch.see("B", 0.0, hop(0.36, math.log(9.042e4)), 0.01, "direct")
    assert [event.name for event in watch.events] == ["ground_learned"]
    other = GroundWatch(SURFACES, SETTINGS)
    other.restore(from_text(to_text(watch.record()), SURFACES, SETTINGS.surface))
    other.see("Z", 0.0, hop(0.12, math.log(2.4e5)), 0.01, "direct")  # carried off while it was off
    belief = other.see("Y", 0.0, hop(*STRANGE), 0.01, "direct")
    assert belief.probabilities["new_surface_1"] > 0.5


def test_a_hops_own_error_is_told_from_the_common_one() -> None:
    c3 = Uncertain(0.4, {"take_off#3": 0.003, "take_off#0": 0.004, "c2_ref_repeatability": 0.003})
    seen = hop_seen(c3, 12.0, None, 3)
    assert seen.loss == pytest.approx(-math.log(0.6))
    assert seen.loss_sigma == pytest.approx(0.003 / 0.6)
    assert common_sigma(c3, 3) == pytest.approx(0.005 / 0.6)
    assert np.isfinite(hop_seen(Uncertain(1.0, {"x#3": 0.1}), 12.0, None, 3).loss)
