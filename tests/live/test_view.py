"""What the console shows of each message."""

from __future__ import annotations

import json

from live_helpers import channels

from flight.states import Phase
from ground.live.view import Told, View, answer_text, command_list


def test_an_armed_robot_is_shown_as_armed_and_no_other() -> None:
    view = View()
    for phase in Phase:
        view.take(channels(str(phase), 1.0))
        assert view.content()["armed"] == (phase in (Phase.ARMED, Phase.FIRING))


def test_what_is_not_known_of_the_spring_counts_as_loaded() -> None:
    view = View()
    assert view.loaded
    view.take(channels("ready", 1.0, outputs__loaded=False))
    assert not view.loaded


def test_time_in_a_phase_counts_from_its_first_message() -> None:
    view = View()
    view.take(channels("hold", 10.0))
    view.take(channels("hold", 12.5))
    assert view.content()["in_phase_s"] == 2.5
    view.take(
        Told(None, "state", {"time_s": 13.0, "from": "hold", "to": "armed", "reason": "", "hop_index": 2})
    )
    content = view.content()
    assert (content["phase"], content["in_phase_s"], content["hop_index"]) == ("armed", 0.0, 2)


def test_decisions_events_and_answers_go_where_they_belong() -> None:
    view = View()
    event = {"time_s": 1.0, "severity": "info"}
    view.take(Told(None, "event", {**event, "name": "decision", "sentence": "Leap."}))
    view.take(Told(None, "event", {**event, "name": "fault", "severity": "fault", "reason": "stall"}))
    refused = {"name": "command_refused", "severity": "warning", "command": "fire", "phase": "hold"}
    view.take(Told(None, "acknowledgement", {**refused, "time_s": 2.0, "why": ["not accepted in hold"]}))
    content = view.content()
    assert [each["sentence"] for each in content["decisions"]] == ["Leap."]
    assert [each["name"] for each in content["events"]] == ["fault", "command_refused"]
    assert content["answers"][0]["words"] == "fire: refused in hold: not accepted in hold"
    json.dumps(content, allow_nan=False)


def test_only_samples_that_are_new_are_told_again() -> None:
    view = View()
    for time_s in (1.0, 2.0, 3.0):
        view.take(channels("hold", time_s, motor_current__current_a=time_s / 10))
    assert [row[0] for row in view.content(after_s=1.5)["samples"]] == [2.0, 3.0]
    assert view.content(2.5)["samples"][0][2] == 0.3


def test_commands_say_why_the_robot_would_refuse_them() -> None:
    def refusals(phase: str) -> dict[str, str]:
        return {each["name"]: each["refusal"] for each in command_list(phase)}

    assert refusals("hold")["arm"] == ""
    assert refusals("hold")["fire"] == "not accepted in hold"
    assert refusals("ready")["tension"] == ""
    assert refusals("safe")["reset"] == ""
    assert set(refusals("").values()) == {"the robot has not been heard yet"}


def test_answers_of_the_link_are_words_too() -> None:
    link = {"name": "link", "command": "fire", "sequence": 3}
    assert answer_text({**link, "why": ""}) == "fire: received"
    assert answer_text({**link, "why": "too many commands"}) == "fire: refused by the link: too many commands"
    assert answer_text({"name": "command_accepted", "command": "arm"}) == "arm: carried out"
