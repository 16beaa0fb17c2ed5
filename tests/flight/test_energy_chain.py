"""The energy chain against closed forms, an exact simulation and Monte Carlo; the surface belief."""

from __future__ import annotations

import math

import numpy as np
import pytest
from two_mass import STEEL, TwoMassHop

from flight import energy
from flight import settings as flight_settings
from flight.energy import RigConstants
from flight.uncertain import Uncertain, mean_of

SETTINGS = flight_settings.load()
RIG = RigConstants.of(SETTINGS.rig)


def test_analysis_energy_is_what_an_exact_loss_free_hop_reaches() -> None:
    compression = 0.028
    hop = TwoMassHop(compression, STEEL, damping=0.0, duration_s=0.4)
    mass_kg = hop.body_kg + hop.leg_kg
    expected = energy.analysis_energy(Uncertain(compression), RIG).value
    # On steel of 5e7 N/m the foot chatters before it leaves, which shifts half a per cent of the energy.
    assert mass_kg * hop.gravity * hop.height_m == pytest.approx(expected, rel=8e-3)


def test_analysis_is_close_to_the_momentum_argument() -> None:
    """Eq. (1) against Eq. (2): the paper's C1 of the analysis is a little below the expected one."""
    compression = Uncertain(0.03)
    used = energy.used_energy(compression, RIG)
    c1 = energy.c1_analysis(energy.analysis_energy(compression, RIG), used)
    assert energy.c1_expected(RIG).value == pytest.approx(0.284, abs=0.001)
    assert 0.24 < c1.value < energy.c1_expected(RIG).value


def test_a_compression_that_cannot_lift_the_robot_is_refused() -> None:
    with pytest.raises(ValueError, match="does not lift"):
        energy.analysis_energy(Uncertain(0.002), RIG)


def test_the_chain_closes() -> None:
    """Eq. (5) with the coefficients of Eqs. (2)-(4) gives back the measured energy, Eq. (6) its height."""
    compression = Uncertain(0.03)
    used, analysis = energy.used_energy(compression, RIG), energy.analysis_energy(compression, RIG)
    test = Uncertain(6.0)
    c1, c2 = energy.c1_analysis(analysis, used), Uncertain(0.05)
    c3 = energy.c3_surface(test, analysis, c2)
    assert energy.predicted_energy(used, c1, c2, c3).value == pytest.approx(6.0)
    through = energy.equivalent_input_energy(used, c2, c3)
    assert ((1.0 - c1) * through).value == pytest.approx(6.0)
    height = energy.height_of_energy_m(test, RIG)
    assert (height * RIG.total_mass_kg * RIG.gravity_m_s2).value == pytest.approx(6.0)
    assert energy.c2_reference(test, analysis).value == pytest.approx(1.0 - 6.0 / analysis.value)


def drawn(value: Uncertain, errors: dict[str, np.ndarray]) -> np.ndarray:
    shape = next(iter(errors.values())).shape
    return value.value + sum((part * errors[name] for name, part in value.parts.items()), np.zeros(shape))


def test_propagated_sigma_meets_monte_carlo() -> None:
    rng = np.random.Generator(np.random.PCG64(5))
    compression = Uncertain.of(0.03, 1e-4, "s")
    test_j, c2 = Uncertain.of(7.0, 0.05, "t"), Uncertain.of(0.05, 0.02, "c2")
    sources = [*energy.COMMON_SOURCES, "s", "t", "c2"]
    errors = {name: rng.normal(size=40000) for name in sources}
    s, m_b, m_l = (drawn(v, errors) for v in (compression, RIG.body_mass_kg, RIG.leg_mass_kg))
    k, g, test, c2_drawn = (drawn(v, errors) for v in (RIG.stiffness_n_m, RIG.gravity_m_s2, test_j, c2))
    total = m_b + m_l
    analysis = m_b * g * s + 0.5 * m_b / total * k * s**2 + 0.5 * m_b * total * g**2 / k
    used = 0.5 * k * s**2 + m_b * g * s
    said = {
        "used": (energy.used_energy(compression, RIG), used),
        "analysis": (energy.analysis_energy(compression, RIG), analysis),
        "c1": (
            energy.c1_analysis(
                energy.analysis_energy(compression, RIG), energy.used_energy(compression, RIG)
            ),
            1.0 - analysis / used,
        ),
        "c3": (
            energy.c3_surface(test_j, energy.analysis_energy(compression, RIG), c2),
            1.0 - test / (analysis * (1.0 - c2_drawn)),
        ),
    }
    for name, (value, sample) in said.items():
        assert value.sigma == pytest.approx(float(np.std(sample)), rel=0.03), name
        assert value.value == pytest.approx(float(np.mean(sample)), abs=0.1 * value.sigma), name


def test_a_common_error_cancels_in_a_ratio_and_does_not_average_out() -> None:
    a, b = Uncertain(2.0, {"k": 0.2, "a": 0.01}), Uncertain(4.0, {"k": 0.4, "b": 0.02})
    assert (a / b).parts["k"] == pytest.approx(0.0, abs=1e-15)
    many = [Uncertain(1.0, {"k": 0.1, f"own#{n}": 0.1}) for n in range(100)]
    assert mean_of(many).parts["k"] == pytest.approx(0.1)
    assert mean_of(many).sigma == pytest.approx(math.hypot(0.1, 0.01))
    with pytest.raises(ValueError, match="no values"):
        mean_of([])


def test_uncertain_arithmetic_with_plain_numbers() -> None:
    x = Uncertain.of(4.0, 0.1, "x")
    assert (3.0 - x).value == -1.0
    assert (-x).parts == {"x": -0.1}
    assert (8.0 / x).parts["x"] == pytest.approx(-0.05)
    assert (x**0.5).sigma == pytest.approx(0.025)
    assert x.with_part("y", 0.2).sigma_of(["y"]) == 0.2
