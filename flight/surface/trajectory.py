"""Where a leap leads: height and range with intervals, on any gravity, from what is believed of the ground.

Eqs. (4)-(6) of Wisniewski et al. 2021 with the loss as the belief has it: E_pot = E_pot_analysis (1 - C2_ref)
exp(-u). The leg points `tilt` away from the vertical; the centre of mass rises along it on the spring, then flies.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flight.rig import RigSettings
from flight.settings import FlightSettings
from flight.surface.forecast import LossForecast
from flight.tensioning import compression_for_energy_m

Array = NDArray[np.float64]

INTERVAL = (0.025, 0.5, 0.975)


@dataclass(frozen=True)
class Jumper:
    """The robot as the prediction needs it: masses [kg], stiffness [N/m], and the gravity [m/s^2] it leaps in."""

    body_mass_kg: float
    leg_mass_kg: float
    stiffness_n_m: float
    gravity_m_s2: float

    @staticmethod
    def of(rig: RigSettings) -> Jumper:
        """The rig where it stands."""
        return Jumper(rig.body_mass_kg, rig.leg_mass_kg, rig.spring_stiffness_n_m, rig.gravity_m_s2)

    @property
    def mass_kg(self) -> float:
        """Of body and leg."""
        return self.body_mass_kg + self.leg_mass_kg

    def rise_m(self, compression_m: float) -> float:
        """Rise of the centre of mass on the spring until the foot lifts."""
        stretched = compression_m + self.mass_kg * self.gravity_m_s2 / self.stiffness_n_m
        return self.body_mass_kg / self.mass_kg * stretched

    def analysis_j(self, compression_m: float) -> float:
        """E_pot_analysis of the loss-free hop (flight/energy.py)."""
        m_b, total, k, g = self.body_mass_kg, self.mass_kg, self.stiffness_n_m, self.gravity_m_s2
        s = compression_m
        return m_b * g * s + 0.5 * (m_b / total) * k * s**2 + 0.5 * m_b * total * g**2 / k


@dataclass(frozen=True)
class Reach:
    """A quantity of the leap: its middle value and the 95 % interval."""

    low: float
    middle: float
    high: float


@dataclass(frozen=True)
class LeapForecast:
    """Apex of the centre of mass above its start [m], range on level ground [m], and what to keep in mind."""

    height_m: Reach
    range_m: Reach
    notes: tuple[str, ...]

    def as_payload(self) -> dict[str, Any]:
        """As JSON-able data: intervals as low, middle, high."""
        return {
            "height_m": list(astuple(self.height_m)),
            "range_m": list(astuple(self.range_m)),
            "notes": list(self.notes),
        }


def predict_leap(
    loss: LossForecast,
    energy_j: float,
    settings: FlightSettings,
    c2_ref: float,
    *,
    tilt_deg: float = 0.0,
    measured_tilt_deg: float = 0.0,
    gravity_m_s2: float | None = None,
) -> LeapForecast:
    """A leap of usable energy `energy_j` off the ground where the rig stands, its loss measured at some tilt.

    Raises `ValueError` for a tilt beyond the leg's.
    """
    planner, learning = settings.surface.planner, settings.surface.learning
    if abs(tilt_deg) > planner.most_tilt_deg:
        raise ValueError(f"tilt_deg = {tilt_deg:g} is beyond the leg's {planner.most_tilt_deg:g} deg")
    here, notes = Jumper.of(settings.rig), []
    there = here if gravity_m_s2 is None else replace(here, gravity_m_s2=gravity_m_s2)
    if abs(there.gravity_m_s2 / here.gravity_m_s2 - 1.0) > 0.01:
        loss = loss.widened(planner.other_gravity_std)
        notes.append(
            f"C3 was measured at {here.gravity_m_s2:.2f} m/s², not at {there.gravity_m_s2:.2f}: the loss is taken "
            f"to be the same, and {100.0 * planner.other_gravity_std:.0f} % less sure"
        )
    if abs(tilt_deg - measured_tilt_deg) > 0.5:
        factor = learning.tilt_factor_20deg ** ((abs(tilt_deg) - abs(measured_tilt_deg)) / 20.0)
        loss = loss.scaled(factor).widened(learning.carried_std)
        notes.append(
            f"C3 was measured at a tilt of {measured_tilt_deg:g}°: the loss is taken {factor:.2f} times as large, "
            f"and {100.0 * learning.carried_std:.0f} % less sure"
        )
    compression_m = compression_for_energy_m(energy_j, settings.rig)
    losses = loss.quantiles(INTERVAL)[::-1]
    paths = [_path(there, compression_m, float(u), c2_ref, tilt_deg) for u in losses]
    return LeapForecast(
        Reach(*(height for height, _ in paths)), Reach(*(along for _, along in paths)), tuple(notes)
    )


def _path(
    jumper: Jumper, compression_m: float, loss: float, c2_ref: float, tilt_deg: float
) -> tuple[float, float]:
    """Height and range at one loss; a foot that does not lift goes nowhere."""
    upright_m = height_of_loss_m(jumper, compression_m, loss, c2_ref)
    rise_m, tilt = jumper.rise_m(compression_m), math.radians(tilt_deg)
    flown_m = upright_m - rise_m * math.cos(tilt)  # v^2/2g
    if flown_m <= 0.0:
        return max(upright_m, 0.0), 0.0
    height_m = rise_m * math.cos(tilt) + flown_m * math.cos(tilt) ** 2
    return height_m, range_of_height_m(jumper, compression_m, upright_m, tilt_deg)


def range_of_height_m(jumper: Jumper, compression_m: float, upright_m: float, tilt_deg: float) -> float:
    """Range on level ground of a push that would reach `upright_m` without the tilt."""
    rise_m, tilt = jumper.rise_m(compression_m), math.radians(abs(tilt_deg))
    flown_m = max(upright_m - rise_m * math.cos(tilt), 0.0)
    return rise_m * math.sin(tilt) + 2.0 * flown_m * math.sin(2.0 * tilt) if flown_m else 0.0


def height_of_loss_m(jumper: Jumper, compression_m: float, loss: float, c2_ref: float) -> float:
    """Height of an upright leap, E_pot/(M g)."""
    kept = (1.0 - c2_ref) * math.exp(-loss)
    return kept * jumper.analysis_j(compression_m) / (jumper.mass_kg * jumper.gravity_m_s2)


def upright_for_range_m(jumper: Jumper, compression_m: float, range_m: float, tilt_deg: float) -> float:
    """The height that the same push would reach upright when, tilted, it has this range: the inverse of the path."""
    tilt, rise_m = math.radians(abs(tilt_deg)), jumper.rise_m(compression_m)
    flown_m = max(range_m - rise_m * math.sin(tilt), 0.0) / (2.0 * math.sin(2.0 * tilt))
    return flown_m + rise_m * math.cos(tilt)


def upright_for_height_m(jumper: Jumper, compression_m: float, height_m: float, tilt_deg: float) -> float:
    """The height that the same push would reach upright when, tilted, its apex is at this height."""
    tilt, rise_m = math.radians(abs(tilt_deg)), jumper.rise_m(compression_m)
    flown_m = max(height_m - rise_m * math.cos(tilt), 0.0) / math.cos(tilt) ** 2
    return flown_m + rise_m * math.cos(tilt)
