"""What makes an evaluated flight doubtful although it counts: in words, for the verdict `degraded`."""

from __future__ import annotations

from flight.edge_model import E
from flight.flown import FlightFit
from flight.graze import Graze

_RUBBING_M_S2 = 0.02  # dry friction over the body's mass that is told
_RINGS_CHI = 3.0
_BOUNCES_COST = 1.5  # of a sample: beyond, a closer look at the bounces has not explained them either
_SIGMA_S = 2e-3
_GROUND_PULL = 3.0  # of the ground's stiffness from one end to the other, in sigmas
_BEYOND = 5.0  # sigmas, where nothing may lie that
_LIKELY = 0.01  # is as likely as this


def doubts(
    fit: FlightFit, hard: bool, chi: float, sigma_s: float, again: Graze | None, body_mass_kg: float
) -> list[str]:
    """Reasons, none for a flight to rely on.

    `hard` ground, `chi` of the ringing, `sigma_s` of the time of flight, `again`: a touch after take-off.
    """
    found = []
    rubs = max(abs(float(edge.parameters[E.FRICTION])) for edge in (fit.take_off, fit.touchdown))
    if rubs > _RUBBING_M_S2:
        found.append(f"dry friction of about {rubs * body_mass_kg:.1f} N in the spring's guide")
    if chi > _RINGS_CHI:
        found.append(f"the ringing is explained to {chi:.1f} sigma only")
    if hard and fit.take_off.cost_per_sample > _BOUNCES_COST:
        found.append(
            f"the foot's bounces are explained to {fit.take_off.cost_per_sample**0.5:.1f} sigma only"
        )
    if sigma_s > _SIGMA_S:
        found.append(f"time of flight known to {sigma_s * 1e3:.1f} ms only")
    if again is not None and again.after_s > _BEYOND * sigma_s and _LIKELY < again.odds < 1.0 - _LIKELY:
        found.append(again.words)
    unlike = fit.touchdown.pull(E.STIFF)
    if unlike > _GROUND_PULL:
        found.append(f"the ground at touchdown is another than at take-off, by {unlike:.1f} sigma")
    return found
