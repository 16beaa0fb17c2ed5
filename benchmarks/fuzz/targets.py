"""What is fuzzed: each reader of what comes from outside, what it may refuse with, and the corpus that it has met.

A target takes bytes. It may refuse them with the errors that its reader's documentation names; any other exception is
a crash. What it reads must keep its promises: numbers are finite, a text that is written again reads as the same.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.link import Clock
from flight import settings as flight_settings
from flight.log import read_log
from flight.mission import load_mission
from flight.settings import FlightSettings
from ground.importing import import_recordings
from ground.recordings import RecordingError, load_recording, save_recording
from ground.station import GroundStation
from hal.config import config_path, config_root, load_settings
from hal.errors import ConfigError, DeviceError
from hal.link.framing import Deframer, framed
from hal.link.keys import Key
from hal.link.messages import Command, _signed, decode_command, decode_telemetry, encode_command
from hal.link.packets import BadPacket, SpacePacket
from hal.link.robot import LinkSettings, RobotLink
from hal.link.streams import loopback
from hal.log import LogError
from hal.raspberry_pi.roboclaw import RoboClaw
from hal.raspberry_pi.settings import RoboClawSettings
from sim_hal.plant.simulate import load_plant, save_plant

CORPUS = Path(__file__).resolve().parents[2] / "tests" / "corpus"
KEY, SESSION = Key(bytes(range(32))), b"session0"
BOUNDS = load_settings(config_path("link.yaml"), LinkSettings)
SETTINGS = flight_settings.load()
CLAW = RoboClawSettings(
    port="fuzzed", baud=38400, address=128, watchdog_s=0.1, reply_timeout_s=0.02, retries=1
)
SIDECAR = "format: 1\nrun: a\nrig: cart\nkind: axis\n"
TABLE = "time_s,x_m,v_m_s\n0.0,1.0,2.0\n0.1,,2.5\n0.2,1.75,2.75\n"
MAPPING = """\
format: 1
time: {variable: t}
channels:
  position_m: {variable: x, unit: mm}
  force_n: {variable: u, scale: 10.0}
sidecar: {rig: cart, kind: axis}
"""


@dataclass(frozen=True)
class Target:
    """A reader to fuzz. `read` gets the bytes and an empty folder; `refuses` are its documented errors.

    `shipped` are files of the configuration, which the corpus need not keep as well.
    """

    read: Callable[[bytes, Path], None]
    refuses: tuple[type[Exception], ...] = ()
    longest_bytes: int = 2048
    shipped: tuple[Path, ...] = ()


class Replies:
    """A serial line that answers each question with the next so many of the given bytes, the first of which says."""

    def __init__(self, data: bytes) -> None:
        self._left, self._answer = data, b""

    def write(self, data: bytes, /) -> int:
        count, self._left = (self._left[0], self._left[1:]) if self._left else (0, b"")
        self._answer, self._left = self._left[:count], self._left[count:]
        return len(data)

    def read(self, size: int = 1, /) -> bytes:
        got, self._answer = self._answer[:size], self._answer[size:]
        return got

    def reset_input_buffer(self) -> None:
        self._answer = b""

    def close(self) -> None:
        """Nothing to give back."""


def link_frames(data: bytes, _: Path) -> None:
    """Both ends of the link hear any bytes; the robot must still hear the next good frame."""
    far, near = loopback(1 << 20)
    robot = RobotLink(near, KEY, SESSION, Clock(), BOUNDS)
    ground = GroundStation(far, KEY, BOUNDS.longest_packet_bytes)
    far.write(data)
    assert robot.receive() == ()
    near.write(data)
    assert ground.poll() == []
    far.write(b"\0" + framed(encode_command(Command(1, "ping"), SESSION, KEY)))
    assert [command.name for command in robot.receive()] == ["ping"]


def signed_packets(data: bytes, _: Path) -> None:
    """Whatever stands in a packet that is signed: a command for the robot, or telemetry for the ground."""
    telecommand, body = bool(data[:1] > b"\x7f"), data[1:]
    session = SESSION if telecommand else body[:8].ljust(8, b"\0")
    body = body if telecommand else session + body[8:]
    packet = _signed(telecommand, 1, body, session, KEY)
    assert list(Deframer(BOUNDS.longest_packet_bytes).feed(framed(packet))) == [packet]
    if telecommand:
        assert all(math.isfinite(value) for _, value in decode_command(packet, SESSION, KEY).arguments)
    else:
        decode_telemetry(packet, KEY)
    assert SpacePacket.decode(packet).encode() == packet


def roboclaw_replies(data: bytes, _: Path) -> None:
    """Whatever a motor controller answers, from its opening on."""
    claw = RoboClaw(Replies(data), CLAW)
    for ask in (claw.encoder_count, claw.battery_v, claw.motor_current_a, lambda: claw.drive(100)):
        found = ask()
        assert found is None or math.isfinite(found)


def flight_yaml(data: bytes, folder: Path) -> None:
    """The settings of the flight software."""
    (folder / "flight.yaml").write_bytes(data)
    flight_settings.load(folder / "flight.yaml")


def mission_yaml(data: bytes, folder: Path) -> None:
    """A mission file."""
    (folder / "mission.yaml").write_bytes(data)
    load_mission(folder / "mission.yaml", SETTINGS)


def plant_yaml(data: bytes, folder: Path) -> None:
    """A plant file; what was read is written, and read again as the same."""
    (folder / "plant.yaml").write_bytes(data)
    plant = load_plant(folder / "plant.yaml")
    save_plant(plant, folder / "again.yaml")
    assert load_plant(folder / "again.yaml").flat() == plant.flat()


def recording_table(data: bytes, folder: Path) -> None:
    """The table of a recording."""
    (folder / "a.yaml").write_text(SIDECAR, encoding="utf-8")
    (folder / "a.csv").write_bytes(data)
    assert np.isfinite(load_recording(folder / "a.csv").times_s).all()


def recording_sidecar(data: bytes, folder: Path) -> None:
    """The sidecar of a recording."""
    (folder / "a.csv").write_text(TABLE, encoding="utf-8")
    (folder / "a.yaml").write_bytes(data)
    found = load_recording(folder / "a.csv")
    save_recording(found, folder / "b.csv")
    assert load_recording(folder / "b.csv").same_content(found)


def foreign_table(data: bytes, folder: Path) -> None:
    """A table of any lab, by a mapping."""
    _import(data, folder, "lab.csv")


def matlab_file(data: bytes, folder: Path) -> None:
    """A MATLAB file, by a mapping."""
    _import(data, folder, "lab.mat")


def _import(data: bytes, folder: Path, name: str) -> None:
    (folder / "map.yaml").write_text(MAPPING, encoding="utf-8")
    (folder / name).write_bytes(data)
    for found in import_recordings(folder / name, folder / "map.yaml"):
        assert np.isfinite(found.times_s).all()


def mapping_yaml(data: bytes, folder: Path) -> None:
    """A mapping of foreign files."""
    (folder / "map.yaml").write_bytes(data)
    (folder / "lab.csv").write_text("t,x,u\n0,1,2\n1,2,3\n2,4,5\n", encoding="utf-8")
    import_recordings(folder / "lab.csv", folder / "map.yaml")


def mcap_log(data: bytes, folder: Path) -> None:
    """A flight log, or what is whole of it; then the same bytes as a recording."""
    path = folder / "flight.mcap"
    path.write_bytes(data)
    for recover in (True, False):
        with suppress(RecordingError):
            load_recording(path, recover)
        with suppress(LogError, ConfigError):
            read_log(path, recover).part("settings", FlightSettings)


def _all(folder: str) -> tuple[Path, ...]:
    return tuple(sorted((config_root() / folder).glob("*.yaml")))


TARGETS: Mapping[str, Target] = {
    "link_frames": Target(link_frames, longest_bytes=400),
    "signed_packets": Target(signed_packets, (BadPacket,), longest_bytes=400),
    "roboclaw_replies": Target(roboclaw_replies, (DeviceError,), longest_bytes=200),
    "flight_yaml": Target(flight_yaml, (ConfigError,), 20_000, (config_path("flight.yaml"),)),
    "mission_yaml": Target(mission_yaml, (ConfigError,), shipped=_all("missions")),
    "plant_yaml": Target(plant_yaml, (ConfigError,), 6000, _all("plant")),
    "recording_table": Target(recording_table, (RecordingError,)),
    "recording_sidecar": Target(recording_sidecar, (RecordingError,)),
    "foreign_table": Target(foreign_table, (RecordingError,)),
    "matlab_file": Target(matlab_file, (RecordingError,)),
    "mapping_yaml": Target(mapping_yaml, (RecordingError, ConfigError), shipped=_all("imports")),
    "mcap_log": Target(mcap_log, longest_bytes=8192),
}


def inputs_of(name: str) -> list[Path]:
    """All files that a target has met: its part of the corpus, and what is shipped."""
    return sorted((CORPUS / name).iterdir()) + list(TARGETS[name].shipped)


def feed(name: str, data: bytes) -> bool:
    """Give a target some bytes: whether it took them, or refused them as it may. Anything else raises."""
    target = TARGETS[name]
    with tempfile.TemporaryDirectory(dir=_fast_folder()) as made:
        try:
            target.read(data, Path(made))
        except target.refuses:
            return False
    return True


def _fast_folder() -> str | None:
    """A folder in memory where there is one."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None
