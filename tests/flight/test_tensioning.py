"""Tensioning: closed forms, the stuck band, the power limit."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from flight import settings as flight_settings
from flight import tensioning

SETTINGS = flight_settings.load()


@given(st.floats(0.01, 26.0))
@hypothesis_settings(deadline=None)
def test_compression_and_energy_are_inverse(energy_j: float) -> None:
    compression_m = tensioning.compression_for_energy_m(energy_j, SETTINGS.rig)
    assert tensioning.energy_used_j(compression_m, SETTINGS.rig) == pytest.approx(energy_j, rel=1e-9)


def test_used_energy_is_the_difference_of_spring_energies() -> None:
    rig, s = SETTINGS.rig, 0.03
    k, f_grav = rig.spring_stiffness_n_m, rig.body_mass_kg * rig.gravity_m_s2 / rig.spring_stiffness_n_m
    assert tensioning.energy_used_j(s, rig) == pytest.approx(0.5 * k * ((f_grav + s) ** 2 - f_grav**2))


@given(st.floats(0.002, 0.042))
@hypothesis_settings(deadline=None)
def test_hold_voltage_keeps_the_motor_torque_inside_the_stuck_band(compression_m: float) -> None:
    drive = SETTINGS.drive
    torque = drive.torque_constant_n_m_a * tensioning.hold_voltage_v(compression_m, SETTINGS)
    torque /= drive.resistance_ohm
    screw = drive.travel_per_radian_m * tensioning.string_force_n(compression_m, SETTINGS.rig)
    low = screw * drive.back_driving_efficiency - drive.coulomb_friction_n_m
    high = screw / drive.tensioning_efficiency + drive.coulomb_friction_n_m
    assert low < torque < high
    assert torque - low == pytest.approx(high - torque)


@given(st.floats(0.0, 0.042), st.floats(0.0, 3.0), st.floats(-0.001, 0.0033))
@hypothesis_settings(deadline=None)
def test_tensioning_power_stays_below_the_limit(s: float, current_a: float, speed_m_s: float) -> None:
    drive = SETTINGS.drive
    voltage = tensioning.drive_voltage_v(drive.tensioning_speed_m_s, speed_m_s, s, current_a, SETTINGS)
    assert voltage * current_a < drive.power_limit_w
    assert abs(voltage) <= drive.max_voltage_v


def test_the_encoder_alone_carries_the_estimate_while_the_spring_sensor_is_silent() -> None:
    ratio = SETTINGS.rig.travel_per_compression
    moved = tensioning.fused_compression_m(0.01, None, 0.001 * ratio, True, SETTINGS)
    assert moved == pytest.approx(0.011)
    assert tensioning.fused_compression_m(0.0, None, 0.001, False, SETTINGS) == 0.0


def test_slew_limits_the_change_of_voltage_both_ways() -> None:
    assert tensioning.slew_limited_v(12.0, 0.0, 0.005, SETTINGS.drive) == pytest.approx(0.3)
    assert tensioning.slew_limited_v(-12.0, 0.0, 0.005, SETTINGS.drive) == pytest.approx(-0.3)
    assert tensioning.slew_limited_v(0.1, 0.0, 0.005, SETTINGS.drive) == pytest.approx(0.1)
