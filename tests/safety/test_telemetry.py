"""What the robot says of itself on the link: every channel of the dictionary, packed, and back as it was."""

from __future__ import annotations

import itertools
import json
import math
from typing import Any

import pytest

from flight import settings as flight_settings
from flight.states import Machine, Outputs, Phase, Snapshot
from flight.telemetry import Telemetry
from hal.dictionary import dictionary
from hal.link.channels import pack_channels, unpack_channels
from hal.link.packets import BadPacket


def message(**snap: Any) -> dict[str, Any]:
    telemetry = Telemetry()
    snapshot = Snapshot(time_s=12.25, **snap)
    telemetry.take(snapshot)
    machine = Machine(phase=Phase.ARMED, compression_m=0.0312, hop_index=3)
    return telemetry.message(machine, snapshot, Outputs(voltage_v=1.5), flight_settings.load())


def test_the_message_has_exactly_the_channels_of_the_dictionary() -> None:
    assert set(message()) == {"time_s", "phase", "hop_index", *dictionary().channels}
    assert list(dictionary().phases) == [str(phase) for phase in Phase]


def test_packed_and_unpacked_it_is_the_same_to_the_resolution_of_a_single() -> None:
    told = message(motor_current_a=0.4321, supply_v=None, latch_closed=True)
    back = json.loads(unpack_channels(pack_channels(json.dumps(told))))
    assert back.keys() == told.keys()
    assert back["motor_current.supply_v"] is None
    assert (back["phase"], back["hop_index"], back["time_s"]) == ("armed", 3, 12.25)
    assert back["switches.latch_closed"] is True
    for name in dictionary().channels:
        if told[name] is not None:
            assert math.isclose(back[name], told[name], rel_tol=1e-7)


def test_a_shock_between_two_messages_is_told() -> None:
    telemetry, settings = Telemetry(), flight_settings.load()
    for low, high in ((9.0, 10.0), (-80.0, 250.0), (9.5, 9.9)):
        snap = Snapshot(time_s=1.0, specific_force_low_m_s2=low, specific_force_high_m_s2=high)
        telemetry.take(snap)
    told = telemetry.message(Machine(), snap, Outputs(), settings)
    assert (told["accelerometer.lowest_m_s2"], told["accelerometer.highest_m_s2"]) == (-80.0, 250.0)
    telemetry.take(snap)
    told = telemetry.message(Machine(), snap, Outputs(), settings)
    assert (told["accelerometer.lowest_m_s2"], told["accelerometer.highest_m_s2"]) == (9.5, 9.9)


def test_messages_come_no_more_often_than_asked_for() -> None:
    telemetry = Telemetry()
    ticks_s = [0.005 * number for number in range(2000)]
    told_s = [now_s for now_s in ticks_s if telemetry.due(now_s, 0.2)]
    assert all(0.2 <= later - sooner < 0.2051 for sooner, later in itertools.pairwise(told_s))
    assert 48 <= len(told_s) <= 50


def test_channels_that_are_cut_or_unknown_are_refused() -> None:
    packed = pack_channels(json.dumps(message()))
    with pytest.raises(BadPacket, match=f"channels of {len(packed) - 1} bytes"):
        unpack_channels(packed[:-1])
    with pytest.raises(BadPacket, match="phase 99 is not in the dictionary"):
        unpack_channels(packed[:8] + bytes([99]) + packed[9:])
    with pytest.raises(BadPacket, match="cannot be packed: KeyError 'time_s'"):
        pack_channels("{}")
