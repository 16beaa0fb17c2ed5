"""The energy chain of a hop: what was stored, what a loss-free hop would give, what was lost where.

Equations (1)-(7) are those of Wisniewski et al., Energies 2021, 14, 4282. Every quantity is an `Uncertain`
whose sources are named, so that errors which hops share (springs, masses, gravity) are never averaged away.
"""

from __future__ import annotations

from dataclasses import dataclass

from flight.rig import RigSettings
from flight.uncertain import Uncertain

# Sources that all hops of a rig share.
COMMON_SOURCES = ("spring_stiffness", "body_mass", "leg_mass", "gravity")


@dataclass(frozen=True)
class RigConstants:
    """The rig's masses [kg], stiffness [N/m] and gravity [m/s^2] with their common errors."""

    body_mass_kg: Uncertain
    leg_mass_kg: Uncertain
    stiffness_n_m: Uncertain
    gravity_m_s2: Uncertain

    @staticmethod
    def of(rig: RigSettings) -> RigConstants:
        def known(value: float, share: float, source: str) -> Uncertain:
            return Uncertain.of(value, share * value, source)

        return RigConstants(
            known(rig.body_mass_kg, rig.mass_std_share, "body_mass"),
            known(rig.leg_mass_kg, rig.mass_std_share, "leg_mass"),
            known(rig.spring_stiffness_n_m, rig.spring_stiffness_std_share, "spring_stiffness"),
            known(rig.gravity_m_s2, rig.gravity_std_share, "gravity"),
        )

    @property
    def total_mass_kg(self) -> Uncertain:
        return self.body_mass_kg + self.leg_mass_kg


def used_energy(compression_m: Uncertain, rig: RigConstants) -> Uncertain:
    """E_used = E_spr - E_grav [J] at compression s beyond the weight's own."""
    weight_n = rig.body_mass_kg * rig.gravity_m_s2
    return 0.5 * rig.stiffness_n_m * compression_m**2 + weight_n * compression_m


def analysis_energy(compression_m: Uncertain, rig: RigConstants) -> Uncertain:
    """E_pot_analysis [J]: apex energy above the start of the loss-free two-mass jump off a rigid floor.

    The body rises on the spring until the leg's weight hangs on it (k delta = -m_l g), where
    m_b v_b^2/2 = k s^2/2 - (M g)^2/(2 k); then v = (m_b/M) v_b and the rest is ballistic. Summed up:
    E = m_b g s + (m_b/M) (k s^2/2) + m_b M g^2/(2 k). Holds where the jump leaves the ground, k s > M g.
    """
    m_b, total, k, g = rig.body_mass_kg, rig.total_mass_kg, rig.stiffness_n_m, rig.gravity_m_s2
    if k.value * compression_m.value <= total.value * g.value:
        raise ValueError(f"a compression of {compression_m.value:g} m does not lift the robot off the ground")
    return m_b * g * compression_m + 0.5 * (m_b / total) * k * compression_m**2 + 0.5 * m_b * total * g**2 / k


def c1_expected(rig: RigConstants) -> Uncertain:
    """Eq. (1): C1 = m_legs/M, the share that stays with the leg when it is picked up."""
    return rig.leg_mass_kg / rig.total_mass_kg


def c1_analysis(analysis_j: Uncertain, used_j: Uncertain) -> Uncertain:
    """Eq. (2): C1 = 1 - E_pot_analysis/E_used."""
    return 1.0 - analysis_j / used_j


def c2_reference(test_j: Uncertain, analysis_j: Uncertain) -> Uncertain:
    """Eq. (3): C2_ref = 1 - E_pot_test/E_pot_analysis, of a jump off a rigid surface."""
    return 1.0 - test_j / analysis_j


def c3_surface(test_j: Uncertain, analysis_j: Uncertain, c2_ref: Uncertain) -> Uncertain:
    """Eq. (4): C3 = 1 - E_pot_test/(E_pot_analysis (1 - C2_ref))."""
    return 1.0 - test_j / (analysis_j * (1.0 - c2_ref))


def predicted_energy(used_j: Uncertain, c1: Uncertain, c2: Uncertain, c3: Uncertain) -> Uncertain:
    """Eq. (5): E_pot = (1 - C1)(1 - C2)(1 - C3) E_used."""
    return (1.0 - c1) * (1.0 - c2) * (1.0 - c3) * used_j


def height_of_energy_m(energy_j: Uncertain, rig: RigConstants) -> Uncertain:
    """Eq. (6): h = E_pot/(M g)."""
    return energy_j / (rig.total_mass_kg * rig.gravity_m_s2)


def equivalent_input_energy(used_j: Uncertain, c2: Uncertain, c3: Uncertain) -> Uncertain:
    """Eq. (7): E_in = (1 - C2)(1 - C3) E_used, to be fed into the loss-free analysis."""
    return (1.0 - c2) * (1.0 - c3) * used_j
