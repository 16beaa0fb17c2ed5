"""Settings are checked on load: bad values and contradictions are refused with file, key and limit."""

from __future__ import annotations

from pathlib import Path

import pytest

from flight import settings as flight_settings
from flight.mission import load_mission
from flight.surface.known import load_surfaces
from hal.config import config_path
from hal.errors import ConfigError

SETTINGS = config_path("flight.yaml").read_text(encoding="utf-8")


def edited(tmp_path: Path, old: str, new: str) -> Path:
    assert SETTINGS.count(old) == 1, f"{old!r} must stand once in flight.yaml"
    path = tmp_path / "flight.yaml"
    path.write_text(SETTINGS.replace(old, new), encoding="utf-8")
    return path


def test_shipped_settings_load_and_describe_one_rig_twice_alike() -> None:
    rig = flight_settings.load().rig
    assert rig.arm_equivalent.gravity_m_s2 == pytest.approx(8.874, rel=1e-3)
    assert rig.arm_equivalent.leg_mass_kg == pytest.approx(2.139, rel=1e-3)
    assert rig.arm_equivalent.body_mass_kg == pytest.approx(5.393, rel=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("geometry: vertical ", "geometry: sideways ", "rig.geometry = 'sideways'"),
        ('foot: "1"', 'foot: "7"', "rig.foot = '7'"),
        ("gravity_m_s2: 8.874", "gravity_m_s2: 9.81", "rig.vertical.gravity_m_s2 = 9.81 contradicts"),
        ("max_energy_j: 26.0", "max_energy_j: 60.0", "tension.max_energy_j = 60 is beyond"),
        ("min_energy_j: 0.5", "min_energy_j: 30.0", "tension.min_energy_j must be below"),
        (
            "over_travel:          {above: 0.052",
            "over_travel: {above: 0.040",
            "monitors.over_travel.above = 0.04 does not reach",
        ),
        ("homing_speed_m_s: 0.0028", "homing_speed_m_s: 0.01", "beyond the drive's no-load speed"),
        ("creep_speed_m_s: 0.0002", "creep_speed_m_s: 0.00002", "drive.creep_speed_m_s must be above"),
        ("arm_min_s: 0.25", "arm_min_s: 9.0", "timeouts.arm_min_s must be below"),
        ("firing_age_s: 0.02", "firing_age_s: 0.004", "safety.firing_age_s = 0.004 is below two ticks"),
        ("latch_check_start_m: 0.0004", "latch_check_start_m: 0.01", "safety.latch_check_start_m"),
        (
            "above: 1.5, for_ticks: 12",
            "above: 1.5, for_ticks: 0",
            "monitors.motor_disobeys.for_ticks = 0 is outside its limits",
        ),
        ("resistance_ohm: 3.3", "resistance_ohm: -3.3", "drive.resistance_ohm = -3.3 is outside its limits"),
        ("resistance_ohm: 3.3", "resistance_ohm: .nan", "drive.resistance_ohm = nan must be finite"),
        ("resistance_ohm: 3.3", "resistence_ohm: 3.3", "unknown key drive.resistence_ohm"),
    ],
)
def test_bad_settings_are_refused_in_words(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = edited(tmp_path, old, new)
    with pytest.raises(ConfigError) as refused:
        flight_settings.load(path)
    assert str(path) in str(refused.value)
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name: m\nhops: []\n", "at least one hop"),
        ("name: m\nhops:\n  - {energy_j: 99.0}\n", "hops[0].energy_j = 99"),
        ("name: m\nhops:\n  - {energy_j: fast}\n", "hops[0].energy_j = 'fast'"),
        ("name: m\nhops:\n  - {energy: 9.0}\n", "unknown key hops[0].energy"),
        ("name: m\n", "at least one hop or one goal"),
    ],
)
def test_bad_missions_are_refused_in_words(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "mission.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"mission\.yaml") as refused:
        load_mission(path, flight_settings.load())
    assert said in str(refused.value)


def test_a_surface_whose_mean_is_outside_its_range_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "surfaces.yaml"
    text = config_path("surfaces.yaml").read_text(encoding="utf-8")
    path.write_text(text.replace("c3_mean: 0.182", "c3_mean: 0.5"), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"surfaces\[1\]: c3_mean = 0\.5 must lie within"):
        load_surfaces(path)
