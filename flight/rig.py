"""The rig as flight knows it: masses, springs, geometry, on a vertical line or on a rotating arm."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

from hal.config import Limits

Positive = Annotated[float, Limits(1e-12, 1e12)]
NotNegative = Annotated[float, Limits(0.0, 1e12)]
Share = Annotated[float, Limits(0.0, 1.0)]


@dataclass(frozen=True)
class VerticalRig:
    """Two masses that move along a vertical line."""

    body_mass_kg: Positive
    leg_mass_kg: Positive
    gravity_m_s2: Positive


@dataclass(frozen=True)
class ArmRig:
    """A robot on a rotating arm: radius of its centre of mass, of the accelerometer, and what moves."""

    com_radius_m: Positive
    sensor_radius_m: Positive
    local_gravity_m_s2: Positive
    moving_mass_without_foot_kg: Positive


@dataclass(frozen=True)
class Foot:
    """One foot of Table 3: mass, moments of inertia with it, and its reference dissipation C2_ref."""

    mass_kg: NotNegative
    leg_inertia_kg_m2: Positive
    total_inertia_kg_m2: Positive
    c2_ref_mean: Share
    c2_ref_std: Share


@dataclass(frozen=True)
class RigSettings:
    """Masses, springs and geometry. Masses and gravity are the (equivalent) ones of a vertical motion."""

    name: str
    geometry: str
    foot: str
    feet: dict[str, Foot]
    mass_std_share: Share
    gravity_std_share: Share
    spring_stiffness_n_m: Positive
    spring_stiffness_std_share: Share
    spring_damping_n_s_m: Positive
    spring_damping_std_share: Share
    series_stiffness_n_m: Positive
    series_stiffness_std_share: Share
    release_current_a: Positive
    release_current_std_share: Share
    vertical: VerticalRig | None = None
    arm: ArmRig | None = None

    @cached_property
    def equivalent(self) -> VerticalRig:
        """The two masses and the gravity of the motion along the leg.

        On an arm: m_l = I_leg/L^2, m_b = (I_total - I_leg)/L^2, g = M g_local L^2/I_total.
        """
        if self.geometry == "vertical":
            assert self.vertical is not None
            return self.vertical
        return self.arm_equivalent

    @property
    def arm_equivalent(self) -> VerticalRig:
        assert self.arm is not None
        foot, square = self.feet[self.foot], self.arm.com_radius_m**2
        moving_kg = self.arm.moving_mass_without_foot_kg + foot.mass_kg
        return VerticalRig(
            (foot.total_inertia_kg_m2 - foot.leg_inertia_kg_m2) / square,
            foot.leg_inertia_kg_m2 / square,
            moving_kg * self.arm.local_gravity_m_s2 * square / foot.total_inertia_kg_m2,
        )

    @cached_property
    def body_mass_kg(self) -> float:
        return self.equivalent.body_mass_kg

    @property
    def leg_mass_kg(self) -> float:
        return self.equivalent.leg_mass_kg

    @cached_property
    def gravity_m_s2(self) -> float:
        return self.equivalent.gravity_m_s2

    @property
    def sensor_gain(self) -> float:
        """Accelerometer reading per acceleration of the body: rho/L on an arm, 1 on a vertical line."""
        if self.geometry == "vertical" or self.arm is None:
            return 1.0
        return self.arm.sensor_radius_m / self.arm.com_radius_m

    @cached_property
    def static_reading_m_s2(self) -> float:
        """What the accelerometer reads at rest."""
        if self.geometry == "vertical" or self.arm is None:
            return self.gravity_m_s2
        return self.arm.local_gravity_m_s2

    @cached_property
    def travel_per_compression(self) -> float:
        """Nut travel per spring compression, x/s = 1 + k/k_m."""
        return 1.0 + self.spring_stiffness_n_m / self.series_stiffness_n_m


def rig_problem(rig: RigSettings) -> str:
    if rig.geometry not in ("vertical", "arm"):
        return f"rig.geometry = {rig.geometry!r} must be 'vertical' or 'arm'"
    if getattr(rig, rig.geometry) is None:
        return f"rig.geometry = {rig.geometry!r} needs the block rig.{rig.geometry}"
    if rig.foot not in rig.feet:
        return f"rig.foot = {rig.foot!r} is not among rig.feet ({', '.join(rig.feet)})"
    for name, foot in rig.feet.items():
        if foot.leg_inertia_kg_m2 >= foot.total_inertia_kg_m2:
            return (
                f"rig.feet.{name}: leg_inertia_kg_m2 = {foot.leg_inertia_kg_m2:g} must be below "
                f"total_inertia_kg_m2 = {foot.total_inertia_kg_m2:g}"
            )
    return _equivalence_problem(rig) if rig.vertical and rig.arm else ""


def _equivalence_problem(rig: RigSettings) -> str:
    """Two descriptions of one rig must agree; 0.5 % leaves room for rounded figures."""
    assert rig.vertical is not None
    for key in ("body_mass_kg", "leg_mass_kg", "gravity_m_s2"):
        said, follows = getattr(rig.vertical, key), getattr(rig.arm_equivalent, key)
        if abs(said / follows - 1.0) > 0.005:
            return (
                f"rig.vertical.{key} = {said:g} contradicts rig.arm with foot {rig.foot}, "
                f"which give {follows:.4g}"
            )
    return ""
