"""Fuzzes the robot's end of the link with mutated frames.

    python -m benchmarks.link [--json FILE] [--frames N] [--seed N]

Each frame starts as a good, signed command and is then changed: bits flipped, bytes put in, taken out or doubled,
frames cut, signed with another key or for another session, replayed. None may be accepted. Good frames are sent now
and then: all of these must arrive, so that the robot is known to listen.
"""

from __future__ import annotations

import argparse
import random
import time
from pathlib import Path

from benchmarks.figures import write_figures
from hal.config import config_path, load_settings
from hal.dictionary import dictionary
from hal.link.framing import framed
from hal.link.keys import Key
from hal.link.messages import Command, encode_command
from hal.link.robot import LinkSettings, RobotLink
from hal.link.streams import loopback

GOOD_EVERY = 1000
UNENDED_EVERY = 3  # of the frames that lack their end, how many stay so: the next one runs into it


class Clock:
    """Time goes on by itself, so that the limit of the rate refuses no command."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def now_s(self) -> float:
        self.time_s += 1.0
        return self.time_s

    def sleep_until_s(self, time_s: float) -> None:
        self.time_s = time_s


class Fuzzer:
    """Makes frames that must not be accepted, from one seed."""

    def __init__(self, seed: int, key: Key, session: bytes) -> None:
        self._random = random.Random(seed)
        self._key, self._session = key, session
        self._other = Key(self._random.randbytes(32))
        self.sequence = 0
        self._names = list(dictionary().commands)
        self._sent: list[bytes] = []

    def packet(self, key: Key | None = None, session: bytes | None = None, ahead: int = 1) -> bytes:
        """A command that nobody has sent yet."""
        name = self._random.choice(self._names)
        arguments = (("energy_j", self._random.uniform(0.0, 50.0)),) if name == "tension" else ()
        command = Command(self.sequence + ahead, name, arguments)
        return encode_command(command, session or self._session, key or self._key)

    def good(self) -> bytes:
        """A frame that must be accepted."""
        frame = framed(self.packet())
        self.sequence += 1
        self._sent = [*self._sent[-50:], frame]
        return frame

    def bad(self) -> bytes:
        """A frame that must be refused."""
        choice = self._random.randrange(8)
        if choice == 0 and self._sent:
            return self._random.choice(self._sent)  # replayed
        if choice == 1:
            return framed(self.packet(key=self._other))
        if choice == 2:
            return framed(self.packet(session=self._random.randbytes(8)))
        if choice == 3:
            return framed(self._changed(self.packet()))  # a good check sum over a changed packet
        if choice == 4:
            return self._random.randbytes(self._random.randrange(1, 200)) + b"\0"
        good = framed(self.packet())
        while (changed := self._changed(good)).strip(b"\0") == good.strip(b"\0"):
            pass
        return changed if good[:-1] not in changed else b"\0"

    def _changed(self, data: bytes) -> bytes:
        """Some bytes changed, put in, taken out, or the end cut off."""
        out = bytearray(data)
        while bytes(out) == data:
            for _ in range(self._random.randrange(1, 6)):
                at = self._random.randrange(len(out) or 1)
                kind = self._random.randrange(5)
                if kind == 0 and out:
                    out[at] ^= 1 << self._random.randrange(8)
                elif kind == 1:
                    out.insert(at, self._random.randrange(256))
                elif kind == 2 and len(out) > 1:
                    del out[at]
                elif kind == 3 and len(out) > 2:
                    del out[at + 1 :]
                else:
                    out[at:at] = out[: self._random.randrange(20)]
        return bytes(out)


def run(frames: int, seed: int) -> dict[str, float]:
    """Send so many mutated frames; returns the figures."""
    settings = load_settings(config_path("link.yaml"), LinkSettings)
    key, session = Key(random.Random(seed + 1).randbytes(32)), b"session0"
    far, near = loopback(1 << 20)
    robot = RobotLink(near, key, session, Clock(), settings)
    fuzzer = Fuzzer(seed, key, session)
    figures = dict.fromkeys(("frames_mutated", "accepted", "crashes", "good_sent", "good_accepted"), 0.0)
    largest = 0
    start = time.perf_counter()
    for number in range(frames):
        frame = fuzzer.bad()
        far.write(frame if frame.endswith(b"\0") or number % UNENDED_EVERY == 0 else frame + b"\0")
        figures["frames_mutated"] += 1
        try:
            figures["accepted"] += len(robot.receive())
            if number % GOOD_EVERY == 0:
                far.write(b"\0" + fuzzer.good())
                figures["good_sent"] += 1
                figures["good_accepted"] += len(robot.receive())
        except Exception as error:
            figures["crashes"] += 1
            print(f"crash: {type(error).__name__}: {error} on {frame.hex()}")
        far.read(1 << 20)
        largest = max(largest, robot.held_bytes)
    figures["largest_held_bytes"] = float(largest)
    figures["frames_per_s"] = frames / (time.perf_counter() - start)
    return figures


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description="Fuzz the command link.")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    figures = run(options.frames, options.seed)
    units = {"largest_held_bytes": "B", "frames_per_s": "1/s"}
    for name, value in figures.items():
        print(f"{name}: {value:g} {units.get(name, '')}")
    if options.json:
        write_figures(options.json, {name: (value, units.get(name, "1")) for name, value in figures.items()})
    raise SystemExit(1 if figures["accepted"] or figures["crashes"] else 0)


if __name__ == "__main__":
    main()
