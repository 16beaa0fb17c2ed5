"""MCAP files of other makers: each number of a message is a variable `/TOPIC.FIELD`, the messages' times `log_time`.

Messages in JSON, and those of ROS 2 (CDR), are read. Topics need not share their times: the samples are those of all
topics that are asked for, and a variable whose topic has no message at a sample is missing there (NaN).
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.decoder import DecoderFactory
from mcap.exceptions import DecoderNotFoundError, McapError
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory as Ros2Decoder

from ground.recordings.model import Floats, RecordingError

TIME = "log_time"
ELEMENTS = 64
"""Longer arrays in a message are pictures or scans, no channels."""

Samples = dict[int, float]


class JsonDecoder(DecoderFactory):
    """Messages in JSON, whatever their schema says."""

    def decoder_for(self, message_encoding: str, schema: Schema | None) -> Any:
        """The decoder of such messages, None for others."""
        return json.loads if message_encoding == "json" else None


def read_mcap_variables(path: Path, wanted: Collection[str]) -> dict[str, Floats]:
    """Numbers of the messages by name, (samples,) each, and `log_time` [s] from the first message that counts.

    The samples are those of the topics of `wanted`; of other topics only the first message is looked at, so that a
    refusal can say what the file has. Raises `RecordingError` naming the file.
    """
    try:
        with path.open("rb") as stream:
            return _on_one_time(_collected(stream, wanted), wanted)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    except (FileNotFoundError, PermissionError) as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror})") from error
    except DecoderNotFoundError as error:
        raise RecordingError(f"{path}: {error}; messages in json and cdr (ROS 2) are read") from error
    except Exception as error:  # decoders raise whatever a damaged message makes of them
        says = str(error) or type(error).__name__
        kind = "is cut or damaged" if isinstance(error, McapError | OSError) else "holds a damaged message"
        raise RecordingError(f"{path}: {kind} ({says})") from error


def _collected(stream: BinaryIO, wanted: Collection[str]) -> dict[str, Samples]:
    found: dict[str, Samples] = {}
    for topic, time_ns, message in _messages(stream, wanted):
        for name, value in _numbers(topic, message):
            if time_ns in found.setdefault(name, {}):
                raise RecordingError(f"{topic} has two messages at the same time ({time_ns} ns)")
            found[name][time_ns] = value
    return found


def _messages(stream: BinaryIO, wanted: Collection[str]) -> Iterator[tuple[str, int, Any]]:
    """Topic, time [ns] and content of each message that counts, in the order of time."""
    reader = make_reader(stream, decoder_factories=[JsonDecoder(), Ros2Decoder()])
    summary = reader.get_summary()
    topics = {channel.topic for channel in summary.channels.values()} if summary else set()
    asked = {topic for topic in topics if any(name.startswith(topic + ".") for name in wanted)}
    for topic in sorted(topics - asked):  # pictures in between are not unpacked
        for _, channel, message, content in reader.iter_decoded_messages([topic]):
            yield channel.topic, message.log_time, content
            break
    for _, channel, message, content in reader.iter_decoded_messages(sorted(asked)) if asked else ():
        yield channel.topic, message.log_time, content


def _numbers(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Every number in a message, with the path to it."""
    if isinstance(value, bool | int | float):
        yield name, float(value)
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from _numbers(f"{name}.{key}", part)
    elif isinstance(value, list | tuple | np.ndarray):
        for index, part in enumerate(value if len(value) <= ELEMENTS else ()):
            yield from _numbers(f"{name}[{index}]", part)
    elif hasattr(value, "__slots__"):  # a message of ROS 2
        for key in value.__slots__:
            yield from _numbers(f"{name}.{key.lstrip('_')}", getattr(value, key))


def _on_one_time(found: dict[str, Samples], wanted: Collection[str]) -> dict[str, Floats]:
    counted = [samples for name, samples in found.items() if name in wanted] or list(found.values())
    times = sorted(set().union(*counted)) if counted else []
    variables = {
        name: np.array([samples.get(time, math.nan) for time in times]) for name, samples in found.items()
    }
    return {TIME: np.array([1e-9 * (time - times[0]) for time in times]), **variables}
