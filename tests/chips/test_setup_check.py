"""`hopper setup` on made-up computers: one in order, and each thing that can be wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from chip_helpers import pi_settings

from hal.raspberry_pi.setup_check import Computer, check_computer, main, report


class MadeUp(Computer):
    """A computer in a folder."""

    limit = math.inf
    libc: tuple[int, ...] = (2, 36)
    libraries: tuple[str, ...] = ("lgpio",)

    def priority_limit(self) -> float:
        return self.limit

    def glibc(self) -> tuple[int, ...]:
        return self.libc

    def has_library(self, name: str) -> bool:
        return name in self.libraries


FILES = {
    "proc/device-tree/model": b"Raspberry Pi 4 Model B Rev 1.4\0",
    "dev/i2c-1": b"",
    "dev/i2c-3": b"",
    "sys/class/i2c-adapter/i2c-1/of_node/clock-frequency": (400_000).to_bytes(4, "big"),
    "sys/class/i2c-adapter/i2c-3/of_node/clock-frequency": (400_000).to_bytes(4, "big"),
    "dev/ttyACM0": b"",
    "dev/gpiochip0": b"",
    "dev/watchdog": b"",
    "dev/spidev0.0": b"",
    "sys/class/pwm/pwmchip0/npwm": b"2\n",
    "sys/class/pwm/pwmchip0/export": b"",
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": b"performance\n",
    "sys/devices/platform/soc/soc:firmware/get_throttled": b"0\n",
    "run/systemd/timesync/synchronized": b"",
}


@pytest.fixture
def ready(tmp_path: Path) -> MadeUp:
    for name, content in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return MadeUp(tmp_path)


def wrong(computer: Computer) -> list[str]:
    return [finding.name for finding in check_computer(pi_settings(), computer) if not finding.good]


def test_a_computer_in_order_is_ready(ready: MadeUp) -> None:
    assert wrong(ready) == []
    assert report(check_computer(pi_settings(), ready)).endswith("this computer is ready")


def without(name: str) -> Callable[[MadeUp], None]:
    return lambda computer: computer.path(name).unlink()


def holding(name: str, content: bytes) -> Callable[[MadeUp], None]:
    return lambda computer: computer.path(name).write_bytes(content) and None


def changed(**attributes: object) -> Callable[[MadeUp], None]:
    return lambda computer: computer.__dict__.update(attributes)


@pytest.mark.parametrize(
    ("spoil", "name", "mend"),
    [
        (holding("proc/device-tree/model", b"QEMU"), "computer", "Raspberry Pi 3, 4 and 5"),
        (without("dev/i2c-1"), "I2C bus 1", "dtparam=i2c_arm=on"),
        (without("dev/i2c-3"), "I2C bus 3", "dtoverlay=i2c3"),
        (
            holding("sys/class/i2c-adapter/i2c-1/of_node/clock-frequency", (100_000).to_bytes(4, "big")),
            "I2C bus 1 speed",
            "dtparam=i2c_arm_baudrate=400000",
        ),
        (without("dev/ttyACM0"), "motor controller", "group dialout"),
        (holding("sys/class/pwm/pwmchip0/npwm", b"0"), "PWM of magnet", "dtoverlay=pwm-2chan"),
        (without("dev/gpiochip0"), "pins", "pin driver"),
        (changed(libraries=()), "library lgpio", "hopper-flight[rpi]"),
        (changed(libc=(2, 31)), "library lgpio", "glibc 2.34"),
        (without("dev/watchdog"), "watchdog", "dtparam=watchdog=on"),
        (changed(limit=0.0), "real-time limit", "hopper@.service"),
        (
            holding("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", b"ondemand"),
            "processor speed",
            "default_governor=performance",
        ),
        (without("run/systemd/timesync/synchronized"), "date and time", "timedatectl"),
        (
            holding("sys/devices/platform/soc/soc:firmware/get_throttled", b"50005"),
            "supply of the computer",
            "5.1 V",
        ),
    ],
)
def test_each_thing_that_is_wrong_is_named_with_its_remedy(
    ready: MadeUp, spoil: Callable[[MadeUp], None], name: str, mend: str
) -> None:
    spoil(ready)
    assert wrong(ready) == [name]
    text = report(check_computer(pi_settings(), ready))
    assert f"WRONG  {name}" in text
    assert mend in text
    assert "1 of" in text


def test_a_bridge_wants_its_own_things(ready: MadeUp) -> None:
    settings = pi_settings()
    bridged = replace(settings, motor=replace(settings.motor, stage="h_bridge"))
    names = [finding.name for finding in check_computer(bridged, ready)]
    assert "quadrature counter" in names
    assert "PWM of motor" in names
    assert "motor controller" not in names


def test_this_computer_is_told_in_words_and_bad_wiring_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([]) in (0, 1)
    assert "computer:" in capsys.readouterr().out
    bad = tmp_path / "wiring.yaml"
    bad.write_text("pins: 3\n", encoding="utf-8")
    assert main(["--board-settings", str(bad)]) == 2
    assert "unknown key pins" in capsys.readouterr().err
