"""The dictionary as XTCE (OMG, version 1.2), by which a mission control system decodes the link's telemetry packets.

Frames and their check sums (`hal/link/framing.py`) are taken off before. The signature is shown, not checked, which
takes the key. Commands are not described: without its signature none would be taken.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from ground.files import write_atomic
from hal.dictionary import Dictionary
from hal.link.channels import TOPIC
from hal.link.messages import APID, SESSION_BYTES, SIGNATURE_BYTES, TOPIC_BYTES

NAMESPACE = "http://www.omg.org/spec/XTCE/20180204"
HEADER = (
    ("packet_version", 3),
    ("packet_type", 1),
    ("secondary_header", 1),
    ("apid", 11),
    ("sequence_flags", 2),
    ("sequence_count", 14),
    ("packet_length", 16),
)
"""The fields of the CCSDS primary header (133.0-B-2, section 4.1), in bits."""


def write_xtce(dictionary: Dictionary, path: Path) -> Path:
    """Write the telemetry of the dictionary as XTCE, whole or not at all. Returns `path`."""
    root = xtce(dictionary)
    ElementTree.indent(root)
    return write_atomic(path, ElementTree.tostring(root, "unicode", xml_declaration=True) + "\n")


def xtce(dictionary: Dictionary) -> Element:
    """The description of all telemetry packets."""
    root = Element("SpaceSystem", {"name": "hopper", "xmlns": NAMESPACE})
    SubElement(root, "Header", version="1", validationStatus="Working")
    telemetry = SubElement(root, "TelemetryMetaData")
    types, parameters, containers = (
        SubElement(telemetry, name) for name in ("ParameterTypeSet", "ParameterSet", "ContainerSet")
    )
    declare = _Declarations(types, parameters)
    _add_header(declare, containers, dictionary)
    _add_channels(declare, containers, dictionary)
    declare.text("text")
    for topic, number in dictionary.topics.items():
        if topic != TOPIC:
            _add_container(containers, topic, ("text", "signature"), number)
    return root


def parameter_name(channel: str) -> str:
    """The name of a channel in XTCE, where dots part paths."""
    return channel.replace(".", "_")


class _Declarations:
    """Declares parameters, each with a type of its own."""

    def __init__(self, types: Element, parameters: Element) -> None:
        self._types, self._parameters = types, parameters

    def integer(self, name: str, bits: int, words: str = "") -> None:
        kind = self._kind("IntegerParameterType", name, words, signed="false")
        SubElement(kind, "IntegerDataEncoding", sizeInBits=str(bits), encoding="unsigned")

    def number(self, name: str, bits: int, unit: str, words: str = "") -> None:
        kind = self._kind("FloatParameterType", name, words, sizeInBits=str(bits))
        if unit != "1":
            SubElement(SubElement(kind, "UnitSet"), "Unit").text = unit
        SubElement(kind, "FloatDataEncoding", sizeInBits=str(bits), encoding="IEEE754_1985")

    def boolean(self, name: str, words: str) -> None:
        kind = self._kind("BooleanParameterType", name, words, oneStringValue="yes", zeroStringValue="no")
        SubElement(kind, "IntegerDataEncoding", sizeInBits="8", encoding="unsigned")

    def enumerated(self, name: str, bits: int, numbers: dict[str, int]) -> None:
        kind = self._kind("EnumeratedParameterType", name, "")
        SubElement(kind, "IntegerDataEncoding", sizeInBits=str(bits), encoding="unsigned")
        listed = SubElement(kind, "EnumerationList")
        for label, value in numbers.items():
            SubElement(listed, "Enumeration", value=str(value), label=label)

    def octets(self, name: str, count: int) -> None:
        kind = self._kind("BinaryParameterType", name, "")
        size = SubElement(SubElement(kind, "BinaryDataEncoding"), "SizeInBits")
        SubElement(size, "FixedValue").text = str(8 * count)

    def text(self, name: str) -> None:
        """Text that takes what the packet's length leaves: JSON."""
        kind = self._kind("StringParameterType", name, "JSON")
        encoding = SubElement(kind, "StringDataEncoding", encoding="UTF-8")
        dynamic = SubElement(SubElement(encoding, "Variable", maxSizeInBits="524288"), "DynamicValue")
        SubElement(dynamic, "ParameterInstanceRef", parameterRef="packet_length", useCalibratedValue="false")
        others = SESSION_BYTES + TOPIC_BYTES + SIGNATURE_BYTES - 1  # the header's length is one less
        SubElement(dynamic, "LinearAdjustment", slope="8", intercept=str(-8 * others))

    def _kind(self, tag: str, name: str, words: str, **attributes: str) -> Element:
        described = {"shortDescription": words} if words else {}
        SubElement(
            self._parameters, "Parameter", {"name": name, "parameterTypeRef": f"{name}_type", **described}
        )
        return SubElement(self._types, tag, {"name": f"{name}_type", **attributes})


def _add_header(declare: _Declarations, containers: Element, dictionary: Dictionary) -> None:
    """The packet's header, and what every packet of the robot begins and ends with."""
    for name, bits in HEADER:
        declare.integer(name, bits)
    declare.octets("session", SESSION_BYTES)
    declare.enumerated("topic", 8 * TOPIC_BYTES, dict(dictionary.topics))
    declare.octets("signature", SIGNATURE_BYTES)
    _entries(
        SubElement(containers, "SequenceContainer", name="packet", abstract="true"), [n for n, _ in HEADER]
    )
    telemetry = SubElement(containers, "SequenceContainer", name="telemetry", abstract="true")
    _entries(telemetry, ["session", "topic"])
    _based_on(telemetry, "packet", {"packet_type": "0", "apid": str(APID)})


def _add_channels(declare: _Declarations, containers: Element, dictionary: Dictionary) -> None:
    """The packed channels (`hal/link/channels.py`)."""
    declare.number("time_s", 64, "s", "the robot's clock")
    declare.enumerated("phase", 8, dict(dictionary.phases))
    declare.integer("hop_index", 16, "hops made")
    for channel, entry in dictionary.channels.items():
        name = parameter_name(channel)
        if entry.unit == "bool":
            declare.boolean(name, entry.text)
        else:
            declare.number(name, 32, entry.unit, entry.text)
    names = [parameter_name(channel) for channel in dictionary.channels]
    fields = ("time_s", "phase", "hop_index", *names, "signature")
    _add_container(containers, TOPIC, fields, dictionary.topics[TOPIC])


def _add_container(containers: Element, topic: str, fields: tuple[str, ...], number: int) -> None:
    container = SubElement(containers, "SequenceContainer", name=re.sub(r"\W", "_", topic))
    _entries(container, fields)
    _based_on(container, "telemetry", {"topic": str(number)})


def _entries(container: Element, names: list[str] | tuple[str, ...]) -> None:
    entries = SubElement(container, "EntryList")
    for name in names:
        SubElement(entries, "ParameterRefEntry", parameterRef=name)


def _based_on(container: Element, base: str, conditions: dict[str, str]) -> None:
    criteria = SubElement(SubElement(container, "BaseContainer", containerRef=base), "RestrictionCriteria")
    where = SubElement(criteria, "ComparisonList")
    for name, value in conditions.items():
        SubElement(where, "Comparison", parameterRef=name, value=value, useCalibratedValue="false")
