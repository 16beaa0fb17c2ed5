"""What a hop tells of the robot's own masses and spring: the ringing in flight weighs them against each other.

The two sensors see one ringing: the ratio of their amplitudes is m_l/M (`flight.spring_check`), and its frequency
is omega_0^2 = k (1/m_b + 1/m_l). Both tie errors of the data sheet together that were independent before, so that
sums and ratios of the masses are known better than each mass was.
"""

from __future__ import annotations

import math
from dataclasses import replace

from flight.edge_model import E
from flight.energy import RigConstants, c1_expected
from flight.flight_time import FlightFit
from flight.uncertain import Uncertain, learnt

_BELIEVED_SIGMAS = 5.0  # further from the data sheet than this, something else than a tolerance is at work
_FREQUENCY_MODEL_SHARE = 1e-3  # of omega_0^2: what a linear spring without mass leaves out


def weighed(rig: RigConstants, fit: FlightFit, hop_index: int) -> RigConstants:
    """The rig's constants, corrected by the ringing of one flight; errors stay tied to their common sources."""
    share = Uncertain.of(fit.share.measured, fit.share.measured_sigma, f"leg_share#{hop_index}")
    if math.isfinite(share.sigma):
        rig = _corrected(rig, c1_expected(rig), share)
    edge = fit.take_off
    omega, squared = edge.ringing.omega_rad_s, edge.ringing.stiffness_1_s2
    spread = 2.0 * math.sqrt(float(edge.covariance[E.OMEGA, E.OMEGA])) / omega
    seen = Uncertain.of(squared, squared * math.hypot(spread, _FREQUENCY_MODEL_SHARE), f"ringing#{hop_index}")
    return _corrected(rig, rig.stiffness_n_m / rig.body_mass_kg + rig.stiffness_n_m / rig.leg_mass_kg, seen)


def _corrected(rig: RigConstants, predicted: Uncertain, seen: Uncertain) -> RigConstants:
    apart = seen - predicted
    if abs(apart.value) > _BELIEVED_SIGMAS * apart.sigma:
        return rig
    body, leg, stiffness = learnt((rig.body_mass_kg, rig.leg_mass_kg, rig.stiffness_n_m), predicted, seen)
    return replace(rig, body_mass_kg=body, leg_mass_kg=leg, stiffness_n_m=stiffness)
