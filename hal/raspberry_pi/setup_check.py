"""Is this computer ready to be the robot? `hopper setup`, or `python -m hal.raspberry_pi.setup_check` on the robot.

Each check says what it found and, where that is wrong, how to mend it. Nothing is changed and no output is driven.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path

from hal.config import config_path, load_settings
from hal.errors import HalError
from hal.raspberry_pi.settings import PiSettings, PwmSettings, check_wiring

MODELS = ("Raspberry Pi 3", "Raspberry Pi 4", "Raspberry Pi 5", "Raspberry Pi Compute Module")
LEAST_I2C_HZ = 400_000
LEAST_PRIORITY = 50
LEAST_GLIBC = (2, 34)
CONFIG_TXT = "/boot/firmware/config.txt"


@dataclass(frozen=True)
class Finding:
    """One thing looked at; `mend` says what to do when it is not `good`."""

    name: str
    good: bool
    found: str
    mend: str = ""


class Computer:
    """Files and limits of a computer, below `root`."""

    def __init__(self, root: Path = Path("/")) -> None:
        self._root = root

    def path(self, absolute: str) -> Path:
        """A path of that computer."""
        return self._root / absolute.lstrip("/")

    def text(self, absolute: str) -> str:
        """Content of a file without zeros and spaces at its end; empty when it is not there."""
        try:
            return self.path(absolute).read_text(encoding="utf-8", errors="replace").rstrip("\0\n ")
        except OSError:
            return ""

    def usable(self, absolute: str) -> str:
        """Whether this user may read and write a device, in words; empty when so."""
        path = self.path(absolute)
        if not path.exists():
            return "is not there"
        return "" if os.access(path, os.R_OK | os.W_OK) else "may not be read and written by this user"

    def priority_limit(self) -> float:
        """Highest real-time priority that this user may take."""
        if os.geteuid() == 0:
            return float("inf")
        limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[1]
        return float("inf") if limit == resource.RLIM_INFINITY else float(limit)

    def glibc(self) -> tuple[int, ...]:
        """Version of the C library; empty when it is another."""
        name = os.confstr("CS_GNU_LIBC_VERSION") or ""
        return tuple(int(part) for part in name.removeprefix("glibc ").split(".") if part.isdigit())

    def has_library(self, name: str) -> bool:
        """Whether Python finds a package."""
        return find_spec(name) is not None


def check_computer(settings: PiSettings, computer: Computer) -> list[Finding]:
    """All findings, in the order in which they are best mended."""
    return [
        _model(computer),
        *_i2c(settings, computer),
        *_motor(settings, computer),
        _pwm("magnet", settings.magnet.pwm, computer),
        *_pins(computer),
        _device(
            "watchdog",
            settings.watchdog.device,
            f"dtparam=watchdog=on in {CONFIG_TXT}, group of the device",
            computer,
        ),
        *_real_time(computer),
        _clock(computer),
        _supply(computer),
    ]


def _model(computer: Computer) -> Finding:
    model = computer.text("/proc/device-tree/model")
    good = model.startswith(MODELS)
    return Finding(
        "computer", good, model or "no Raspberry Pi", "the drivers are made for Raspberry Pi 3, 4 and 5"
    )


def _i2c(settings: PiSettings, computer: Computer) -> Iterator[Finding]:
    users = ("accelerometer", "motor_current", "magnet_current", "spring")
    for bus in sorted({getattr(settings, user).bus for user in users}):
        line = "dtparam=i2c_arm=on" if bus == 1 else f"dtoverlay=i2c{bus}"
        mend = f"{line} in {CONFIG_TXT}, i2c-dev in /etc/modules, user in group i2c"
        yield _device(f"I2C bus {bus}", f"/dev/i2c-{bus}", mend, computer)
        raw = computer.path(f"/sys/class/i2c-adapter/i2c-{bus}/of_node/clock-frequency")
        speed_hz = int.from_bytes(raw.read_bytes(), "big") if raw.is_file() else 0
        yield Finding(
            f"I2C bus {bus} speed",
            speed_hz >= LEAST_I2C_HZ,
            f"{speed_hz} Hz" if speed_hz else "not known",
            f"{'dtparam=i2c_arm_baudrate' if bus == 1 else line + ',baudrate'}={LEAST_I2C_HZ} in {CONFIG_TXT}",
        )


def _motor(settings: PiSettings, computer: Computer) -> Iterator[Finding]:
    motor = settings.motor
    if motor.stage == "roboclaw" and motor.roboclaw is not None:
        mend = "plug the controller in; user in group dialout"
        yield _device("motor controller", motor.roboclaw.port, mend, computer)
    elif motor.h_bridge is not None:
        yield _pwm("motor", motor.h_bridge.pwm, computer)
        mend = f"dtparam=spi=on in {CONFIG_TXT}, user in group spi"
        yield _device("quadrature counter", motor.h_bridge.spi_device, mend, computer)


def _pwm(name: str, pwm: PwmSettings, computer: Computer) -> Finding:
    chip = f"/sys/class/pwm/pwmchip{pwm.chip}"
    channels = int(computer.text(f"{chip}/npwm") or 0)
    trouble = computer.usable(f"{chip}/export") if channels > pwm.channel else f"has {channels} channels"
    return Finding(
        f"PWM of {name}",
        not trouble,
        f"{chip}, channel {pwm.channel}" + (f": {trouble}" if trouble else ""),
        f"dtoverlay=pwm-2chan in {CONFIG_TXT}; user in group gpio",
    )


def _pins(computer: Computer) -> Iterator[Finding]:
    chips = sorted(path.name for path in computer.path("/dev").glob("gpiochip*"))
    trouble = [name for name in chips if computer.usable(f"/dev/{name}")]
    yield Finding(
        "pins",
        bool(chips) and not trouble,
        ", ".join(chips) or "no /dev/gpiochip*",
        f"not usable: {', '.join(trouble)}; user in group gpio"
        if trouble
        else "a kernel with its pin driver",
    )
    glibc = computer.glibc()
    named = ".".join(map(str, glibc)) or "not known"
    yield Finding(
        "library lgpio",
        computer.has_library("lgpio") and glibc >= LEAST_GLIBC,
        f"{'found' if computer.has_library('lgpio') else 'missing'}, glibc {named}",
        "pip install 'hopper-flight[rpi]' on a system with glibc 2.34 or later (Raspberry Pi OS 12)",
    )


def _real_time(computer: Computer) -> Iterator[Finding]:
    limit = computer.priority_limit()
    yield Finding(
        "real-time limit",
        limit >= LEAST_PRIORITY,
        f"priority {limit:g}",
        f"start it by hopper@.service, or '@hopper - rtprio {LEAST_PRIORITY}' in /etc/security/limits.d/hopper.conf",
    )
    governor = computer.text("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
    yield Finding(
        "processor speed",
        governor == "performance",
        f"governor {governor or 'not known'}",
        "cpufreq.default_governor=performance in /boot/firmware/cmdline.txt",
    )


def _clock(computer: Computer) -> Finding:
    good = computer.path("/run/systemd/timesync/synchronized").exists()
    return Finding(
        "date and time",
        good,
        "set by a time server" if good else "not set by a time server since the start",
        "timedatectl set-ntp true; flight itself needs no date, the names of its logs do",
    )


def _supply(computer: Computer) -> Finding:
    """Bits 0 and 16 of the firmware's word: under-voltage now, and since the start."""
    word = computer.text("/sys/devices/platform/soc/soc:firmware/get_throttled")
    bad = bool(word) and bool(int(word, 16) & 0x10001)
    return Finding(
        "supply of the computer",
        not bad,
        "under-voltage seen" if bad else ("in order" if word else "not known"),
        "a supply that holds 5.1 V under load",
    )


def _device(name: str, device: str, mend: str, computer: Computer) -> Finding:
    trouble = computer.usable(device)
    return Finding(name, not trouble, f"{device} {trouble}" if trouble else device, mend)


def report(findings: Sequence[Finding]) -> str:
    """Findings as text: a line each, and below what is wrong how to mend it."""
    lines = []
    for finding in findings:
        lines.append(f"{'good ' if finding.good else 'WRONG'}  {finding.name}: {finding.found}")
        if not finding.good:
            lines.append(f"         mend: {finding.mend}")
    wrong = sum(not finding.good for finding in findings)
    lines.append(f"{wrong} of {len(findings)} checks are wrong" if wrong else "this computer is ready")
    return "\n".join(lines)


def look(settings_path: Path | None = None) -> list[Finding]:
    """Check this computer for the wiring of a settings file (the shipped one unless given).

    Raises `ConfigError` when that file is refused.
    """
    path = settings_path or config_path("boards", "raspberry_pi.yaml")
    settings = load_settings(path, PiSettings)
    check_wiring(settings, str(path))
    return check_computer(settings, Computer())


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code 0: ready; 1: something is wrong; 2: the settings are refused."""
    parser = argparse.ArgumentParser(prog="python -m hal.raspberry_pi.setup_check", description=__doc__)
    parser.add_argument("--board-settings", type=Path, help="instead of config/boards/raspberry_pi.yaml")
    parser.add_argument("--json", action="store_true", help="print the findings as JSON, for machines")
    options = parser.parse_args(arguments)
    try:
        findings = look(options.board_settings)
    except HalError as error:
        print(f"setup: {error}", file=sys.stderr)
        return 2
    print(
        json.dumps([asdict(finding) for finding in findings], indent=1) if options.json else report(findings)
    )
    return 0 if all(finding.good for finding in findings) else 1


if __name__ == "__main__":
    raise SystemExit(main())
