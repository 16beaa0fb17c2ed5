"""The link as XTCE describes it, by an XTCE reader that is not ours."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from flight import settings as flight_settings
from flight.states import Machine, Outputs, Phase, Snapshot
from flight.telemetry import Telemetry as Gathered
from ground.xtce import NAMESPACE, parameter_name, write_xtce
from hal.dictionary import dictionary
from hal.link.keys import Key
from hal.link.messages import Telemetry, encode_telemetry

reader = pytest.importorskip(
    "space_packet_parser", reason="space-packet-parser is not installed (extra 'dev')"
)
KEY, SESSION = Key(bytes(range(32))), b"session7"


@pytest.fixture(scope="module")
def definition(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = write_xtce(dictionary(), tmp_path_factory.mktemp("xtce") / "hopper.xml")
    return reader.xtce.definitions.XtcePacketDefinition.from_xtce(path, root_container_name="packet")


def decoded(definition: Any, topic: str, text: str) -> dict[str, Any]:
    packet = encode_telemetry(Telemetry(topic, text), 77, SESSION, KEY)
    return dict(definition.parse_bytes(packet))


def told() -> dict[str, Any]:
    gathered, snap = Gathered(), Snapshot(time_s=93.125, motor_current_a=0.4375, latch_closed=True)
    gathered.take(snap)
    machine = Machine(phase=Phase.TENSIONING, compression_m=0.025, hop_index=4)
    return gathered.message(machine, snap, Outputs(voltage_v=9.75), flight_settings.load())


def test_every_channel_is_decoded_as_it_was_sent(definition: Any) -> None:
    message = told()
    found = decoded(definition, "channels", json.dumps(message))
    assert (found["apid"], found["sequence_count"], found["topic"]) == (0x48, 77, "channels")
    assert bytes(found["session"]) == SESSION
    assert (found["time_s"], found["phase"], found["hop_index"]) == (93.125, "tensioning", 4)
    assert found["outputs_voltage_v"] == 9.75
    for channel in dictionary().channels:
        sent, got = message[channel], found[parameter_name(channel)]
        if sent is None:
            assert math.isnan(got)
        else:
            assert math.isclose(float(got == "yes" if isinstance(got, str) else got), sent, rel_tol=1e-7)


@pytest.mark.parametrize("topic", [name for name in dictionary().topics if name != "channels"])
def test_text_of_any_length_is_decoded_whole(definition: Any, topic: str) -> None:
    for text in ("{}", json.dumps({"name": "fault", "why": "ä" * 700})):
        found = decoded(definition, topic, text)
        assert (found["topic"], found["text"]) == (topic, text)
        assert len(bytes(found["signature"])) == 16


def test_the_description_has_units_words_and_names_that_xtce_allows(tmp_path: Path) -> None:
    root = ElementTree.parse(write_xtce(dictionary(), tmp_path / "x.xml")).getroot()
    names = [each.attrib["name"] for each in root.iter(f"{{{NAMESPACE}}}Parameter")]
    assert len(names) == len(set(names))
    assert not any(set(name) & set("./:[] ") for name in names)
    units = {each.text for each in root.iter(f"{{{NAMESPACE}}}Unit")}
    assert units >= {"m", "A", "V", "J", "N", "m/s²"}
