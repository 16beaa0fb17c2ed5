"""Runs inside the emulated computer: drivers on its kernel's own /dev/i2c-*, /dev/gpiochip*, /dev/watchdog and tty.

i2c-stub is a part whose registers are memory: what a driver writes it reads back, and what a measurement should show
is put there first. One line for each check, then the watchdog is left to starve, which resets the computer.
"""

from __future__ import annotations

import errno
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import serial
import smbus2

from hal.config import build_settings, config_path, read_yaml
from hal.errors import DeviceReset, NoAcknowledge, WrongDevice
from hal.raspberry_pi.ads1x15 import Ads1x15Spring
from hal.raspberry_pi.clock import MonotonicClock, ThreadSampler
from hal.raspberry_pi.ina226 import Ina226, Ina226MagnetCurrent, Ina226MotorCurrent
from hal.raspberry_pi.kernel import KernelWatchdog, LgpioPins, SysfsFiles
from hal.raspberry_pi.lsm6dso32 import Lsm6dso32
from hal.raspberry_pi.roboclaw import RoboClaw
from hal.raspberry_pi.settings import PiSettings, SwitchSettings, WatchdogSettings
from hal.raspberry_pi.switches import GpioSwitches
from hal.raspberry_pi.watchdog import PiWatchdog
from hal.raspberry_pi.wire import I2cBus, I2cPart

SETTINGS = build_settings(
    read_yaml(config_path("boards", "raspberry_pi.yaml")), PiSettings, "raspberry_pi.yaml"
)
ACCELEROMETER, CURRENT, SPRING = 0x6A, 0x40, 0x48
SWITCH_PINS, WATCHDOG_PINS = (0, 1), (4, 5)  # line 3 is the machine's power key
PIN_CHIP = "9030000.pl061"


def bus_number() -> int:
    """The adapter that i2c-stub made."""
    for path in Path("/sys/class/i2c-adapter").iterdir():
        if "stub" in (path / "name").read_text(encoding="ascii").lower():
            return int(path.name.removeprefix("i2c-"))
    raise OSError("no adapter of i2c-stub")


class Registers:
    """The other side of the stub: puts into registers what a real part would show there."""

    def __init__(self, bus: int, address: int) -> None:
        self._bus, self._address = smbus2.SMBus(bus), address

    def byte(self, register: int, value: int) -> None:
        self._bus.write_byte_data(self._address, register, value)

    def word(self, register: int, value: int) -> None:
        self._bus.write_word_data(self._address, register, (value & 0xFF) << 8 | value >> 8)


class ResettingClock(MonotonicClock):
    """A clock that, whenever the driver waits, does what the chip would do meanwhile."""

    def __init__(self, meanwhile: Callable[[], None]) -> None:
        super().__init__()
        self._meanwhile = meanwhile

    def sleep_until_s(self, time_s: float) -> None:
        super().sleep_until_s(time_s)
        self._meanwhile()


def part(address: int, name: str) -> I2cPart:
    return I2cPart(I2cBus(smbus2.SMBus(bus_number())), address, name)


def accelerometer() -> str:
    chip = Registers(bus_number(), ACCELEROMETER)
    settings = replace(SETTINGS.accelerometer, self_test=False)
    clock = ResettingClock(lambda: chip.byte(0x12, 0x04))
    try:
        Lsm6dso32("accelerometer", part(ACCELEROMETER, "accelerometer"), clock, settings)
        raise AssertionError("a part that does not know its name was taken")
    except WrongDevice:
        pass
    chip.byte(0x0F, 0x6C)
    driver = Lsm6dso32("accelerometer", part(ACCELEROMETER, "accelerometer"), clock, settings)
    driver.set_rate_hz(1666.0)
    chip.byte(0x3A, 1)
    for register, value in zip(range(0x78, 0x7F), (0x11, 0, 0, 0, 0, 0xE8, 0x03), strict=True):
        chip.byte(register, value)
    reading = driver.read()
    assert abs(reading.specific_force_m_s2[0] - 1000 * driver.resolution_m_s2) < 1e-9, reading
    chip.byte(0x10, 0)
    try:
        driver.read()
        raise AssertionError("a part that lost its rate was read")
    except DeviceReset:
        pass
    driver.close()
    return f"{reading.specific_force_m_s2[0]:.3f} m/s2"


def currents() -> str:
    chip = Registers(bus_number(), CURRENT)
    chip.word(0xFE, 0x5449)
    chip.word(0xFF, 0x2260)
    settings = SETTINGS.motor_current
    motor = Ina226MotorCurrent(
        "motor_current",
        Ina226("motor_current", part(CURRENT, "motor_current"), settings),
        MonotonicClock(),
        settings,
    )
    chip.word(0x06, 0x0008)
    chip.word(0x04, 0x10000 - 4210)
    reading = motor.read()
    assert abs(reading.current_a + 0.421) < 1e-9, reading
    settings = SETTINGS.magnet_current
    clock = MonotonicClock()
    sampler = ThreadSampler(clock)
    magnet = Ina226MagnetCurrent(
        "magnet_current",
        Ina226("magnet_current", part(CURRENT, "magnet_current"), settings),
        sampler,
        settings,
    )
    chip.word(0x04, 15000)
    clock.sleep_until_s(clock.now_s() + 0.5)
    batch = magnet.read()
    assert batch.current_a and abs(batch.current_a[-1] - 1.5) < 1e-9, batch
    chip.word(0x05, 0)
    try:
        magnet.read()
        raise AssertionError("a part without calibration was read")
    except DeviceReset:
        pass
    magnet.close()
    sampler.close()
    return f"{reading.current_a:.3f} A; {len(batch.current_a)} samples by the thread in 0.5 s"


def spring() -> str:
    chip = Registers(bus_number(), SPRING)
    clock = MonotonicClock()
    sampler = ThreadSampler(clock)
    driver = Ads1x15Spring("spring", part(SPRING, "spring"), sampler, SETTINGS.spring)
    chip.word(0x00, 0x3E80)  # 1 V of 2.048 V
    clock.sleep_until_s(clock.now_s() + 0.5)
    reading = driver.read()
    assert abs(reading.compression_m[-1] - 0.030) < 1e-9, reading.compression_m[-1]
    driver.close()
    sampler.close()
    return f"{reading.compression_m[-1] * 1e3:.1f} mm, {len(reading.times_s)} samples"


def nobody() -> str:
    try:
        part(0x29, "nobody").read(0, 1)
    except NoAcknowledge as error:
        return str(error)
    raise AssertionError("an address without a part answered")


def pins() -> str:
    ours = LgpioPins((PIN_CHIP,))
    switches = GpioSwitches("switches", ours, MonotonicClock(), SwitchSettings(*SWITCH_PINS))
    seen = switches.read()
    ours.claim_output(WATCHDOG_PINS[0], False)
    levels = []
    for level in (True, False, True):
        ours.write(WATCHDOG_PINS[0], level)
        levels.append(ours.read(WATCHDOG_PINS[0]))
    assert levels == [True, False, True], levels
    try:
        LgpioPins((PIN_CHIP,)).claim_output(WATCHDOG_PINS[0], False)
        raise AssertionError("a pin in use was given away")
    except OSError as error:
        refused = str(error)
    ours.close()
    return f"{seen}; in use: {refused}"


def controller() -> str:
    line = serial.Serial("/dev/ttyS0", 115200, timeout=5.0, write_timeout=5.0, exclusive=True)
    settings = SETTINGS.motor.roboclaw
    assert settings is not None
    driver = RoboClaw(line, replace(settings, reply_timeout_s=5.0))
    driver.drive(12345)
    count, volt = driver.encoder_count(), driver.battery_v()
    driver.drive(0)
    driver.close()
    assert abs(volt - 12.0) < 1e-9, volt
    return f"count {count}, {volt:.1f} V"


def pwm() -> str:
    try:
        SysfsFiles().write("class/pwm/pwmchip0/export", "0")
    except OSError as error:
        assert error.errno == errno.ENOENT, error
        return "this machine has none; its absence is an OSError"
    return "exported"


def watchdog() -> str:
    ours = LgpioPins((PIN_CHIP,))
    device = KernelWatchdog("/dev/watchdog", 3)
    settings = WatchdogSettings(*WATCHDOG_PINS, 0.1, "/dev/watchdog", 3)
    driver = PiWatchdog("watchdog", ours, device, settings)
    state = Path("/sys/class/watchdog/watchdog0/state")
    end_s = time.monotonic() + 5.0
    while time.monotonic() < end_s:
        driver.stroke()
        time.sleep(0.05)
    active = state.read_text(encoding="ascii").strip()
    driver.close()
    closed = state.read_text(encoding="ascii").strip()
    assert (active, closed) == ("active", "inactive"), (active, closed)
    ours.close()
    return "kept alive for 5 s of a 3 s watchdog, then disarmed"


def starve() -> None:
    """Open the watchdog and stroke it no more: the kernel must reset the computer."""
    KernelWatchdog("/dev/watchdog", 3)
    print("STARVING", flush=True)
    time.sleep(60)
    print("STILL ALIVE", flush=True)


CHECKS: tuple[Callable[[], Any], ...] = (
    accelerometer,
    currents,
    spring,
    nobody,
    pins,
    controller,
    pwm,
    watchdog,
)


def main() -> int:
    failed = 0
    for check in CHECKS:
        try:
            print(f"CHECK {check.__name__}: good: {check()}", flush=True)
        except Exception:
            failed += 1
            print(f"CHECK {check.__name__}: FAILED\n{traceback.format_exc()}", flush=True)
    print(f"CHECKS {len(CHECKS) - failed} of {len(CHECKS)} good", flush=True)
    starve()
    return failed


if __name__ == "__main__":
    sys.exit(main())
