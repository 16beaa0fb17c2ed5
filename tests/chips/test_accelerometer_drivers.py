"""The accelerometer drivers against the chips' registers: identity, settings, FIFO, self-test, times."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from chip_helpers import Bench, pi_settings
from hypothesis import given
from hypothesis import strategies as st
from smbus2 import I2cFunc

from hal.errors import BadChecksum, CommandRefused, DeviceError, SelfTestFailed, WrongDevice
from hal.raspberry_pi.adxl375 import Adxl375
from hal.raspberry_pi.lsm6dso32 import Lsm6dso32
from hal.raspberry_pi.sample_times import SampleTimes
from hal.raspberry_pi.wire import I2cBus, I2cPart
from sim_hal.chips.accelerometers import Adxl375Chip, Lsm6dso32Chip
from sim_hal.chips.i2c import FUNCTIONS

LSM = replace(pi_settings().accelerometer, self_test=False)
ADXL = replace(LSM, part="adxl375", range_g=200, rate_hz=200.0)
KINDS = {"lsm6dso32": (Lsm6dso32Chip, Lsm6dso32, LSM), "adxl375": (Adxl375Chip, Adxl375, ADXL)}


def rig(kind: str, bench: Bench, **changes: Any) -> tuple[Any, Any]:
    """Chip and driver on the bench; `changes` of the driver's settings."""
    make_chip, make_driver, settings = KINDS[kind]
    settings = replace(settings, **changes)
    chip = make_chip(bench, settings.axis, settings.sign)
    part = I2cPart(I2cBus(bench.bus(settings.address, chip)), settings.address, "accelerometer")
    return chip, make_driver("accelerometer", part, bench.clock, settings)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("kind", KINDS)
def test_the_leg_s_axis_and_sign(kind: str, axis: str, sign: int) -> None:
    bench = Bench()
    _, driver = rig(kind, bench, axis=axis, sign=sign)
    bench.value = 50.0
    bench.run_until(0.1)
    values = driver.read().specific_force_m_s2
    assert values
    assert values[-1] == pytest.approx(50.0, abs=0.5 * driver.resolution_m_s2)


@pytest.mark.parametrize(("range_g", "digit_mg"), [(4, 0.122), (8, 0.244), (16, 0.488), (32, 0.976)])
def test_each_range_is_set_with_its_digit(range_g: int, digit_mg: float) -> None:
    bench = Bench()
    _, driver = rig("lsm6dso32", bench, range_g=range_g)
    assert driver.resolution_m_s2 == pytest.approx(digit_mg * 1e-3 * 9.80665)
    bench.value = 1000.0
    bench.run_until(0.05)
    bench.value = -30.0
    bench.run_until(0.1)
    reading = driver.read()
    assert reading.saturated[0]
    assert not reading.saturated[-1]
    assert reading.specific_force_m_s2[-1] == pytest.approx(-30.0, abs=driver.resolution_m_s2)


@pytest.mark.parametrize("kind", KINDS)
def test_another_part_at_the_address_is_refused(kind: str) -> None:
    bench = Bench()
    make_chip, make_driver, settings = KINDS[kind]
    chip = make_chip(bench, "z", 1)
    chip.registers[0x00] = chip.registers[0x0F] = 0x6B
    part = I2cPart(I2cBus(bench.bus(settings.address, chip)), settings.address, "accelerometer")
    with pytest.raises(WrongDevice, match="reads 0x6b"):
        make_driver("accelerometer", part, bench.clock, settings)


@pytest.mark.parametrize("kind", KINDS)
def test_a_setting_that_does_not_stay_is_an_error(kind: str) -> None:
    bench = Bench()
    chip, driver = rig(kind, bench)
    chip.read_only = frozenset(range(256))
    with pytest.raises(DeviceError, match="register"):
        driver.set_rate_hz(800.0 if kind == "adxl375" else 104.0)


@pytest.mark.parametrize("kind", KINDS)
def test_the_self_test_passes_a_whole_part_and_fails_a_broken_one(kind: str) -> None:
    rig(kind, Bench(), self_test=True)
    bench = Bench()
    make_chip, make_driver, settings = KINDS[kind]
    chip = make_chip(bench, "z", 1)
    chip.SELF_TEST_G = 0.0
    part = I2cPart(I2cBus(bench.bus(settings.address, chip)), settings.address, "accelerometer")
    with pytest.raises(SelfTestFailed, match="self-test moves axis"):
        make_driver("accelerometer", part, bench.clock, replace(settings, self_test=True))


def test_the_adxl375_offers_no_rate_of_unclear_format() -> None:
    _, driver = rig("adxl375", Bench())
    with pytest.raises(CommandRefused, match="100, 200, 400, 800"):
        driver.set_rate_hz(1600.0)


@pytest.mark.parametrize("funcs", [FUNCTIONS, FUNCTIONS & ~I2cFunc.I2C], ids=["i2c", "smbus only"])
def test_batches_come_the_same_over_either_kind_of_adapter(funcs: I2cFunc) -> None:
    bench = Bench(funcs)
    _, driver = rig("lsm6dso32", bench)
    seen: list[float] = []
    for step in range(1, 40):
        bench.value = float(step)
        bench.run_until(step * 0.01)
        seen.extend(driver.read().specific_force_m_s2)
    expected = [round(step / driver.resolution_m_s2) * driver.resolution_m_s2 for step in range(1, 40)]
    assert [value for value, _ in itertools.groupby(seen)] == pytest.approx(expected)


def test_a_fifo_word_that_is_not_the_accelerometer_s_is_refused() -> None:
    bench = Bench()
    chip, driver = rig("lsm6dso32", bench)
    bench.run_until(0.05)
    chip.read(1)
    chip._sample()
    chip._fifo[1] = bytes((0x08,)) + chip._fifo[1][1:]  # a word of the gyroscope
    with pytest.raises(BadChecksum, match="FIFO word 1 has tag 0x01"):
        driver.read()


def test_a_fifo_word_that_is_missing_is_seen() -> None:
    bench = Bench()
    chip, driver = rig("lsm6dso32", bench)
    bench.run_until(0.1)
    chip._sample()
    del chip._fifo[2]
    with pytest.raises(BadChecksum, match="word 2 does not follow"):
        driver.read()


@given(
    off=st.floats(-0.04, 0.04),
    phase=st.floats(0.0, 1.0),
    late=st.lists(st.floats(0.0, 2e-3), min_size=1, max_size=8),
)
def test_sample_times_follow_an_oscillator_that_is_off(off: float, phase: float, late: list[float]) -> None:
    """A part some per cent fast or slow, read at 200 Hz with delays: times are right to a period, never ahead."""
    nominal_s = 1.0 / 1666.67
    true_s = nominal_s * (1.0 + off)
    times, taken = SampleTimes(nominal_s, 0.05), 0
    worst_s, spacing_s = 0.0, 0.0
    for tick in range(1, 1200):
        read_s = tick * 0.005 + late[tick % len(late)]
        reached = int((read_s - phase * true_s) / true_s)
        stamps = times.batch(reached - taken, read_s)
        truths = [(phase + taken + 1 + index) * true_s for index in range(reached - taken)]
        taken = reached
        assert all(stamp <= read_s for stamp in stamps)
        if tick > 400:
            worst_s = max(worst_s, *(abs(a - b) for a, b in zip(stamps, truths, strict=True)))
            spacing_s = max(spacing_s, float(np.ptp(np.diff(stamps))))
    assert worst_s < 1.05 * true_s
    assert spacing_s < 1e-9
    assert times.period_s == pytest.approx(true_s, rel=2e-3)
