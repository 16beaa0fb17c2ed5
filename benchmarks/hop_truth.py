"""What really happened in a simulated hop: opening, sharp ends of the flight, height and energy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_hal.plant.simulate import Plant
from sim_hal.truth import Trace, apex_m, flight_of

Float = NDArray[np.float64]

LOOK_S = 1e-4
SHORTEST_FLIGHT_S = 0.08


@dataclass(frozen=True)
class HopTruth:
    """What happened; times on the board's clock, fire command at 0."""

    take_off_s: float
    touchdown_s: float
    height_m: float
    potential_j: float
    opening_s: float

    @property
    def time_of_flight_s(self) -> float:
        return self.touchdown_s - self.take_off_s


def truth_of(plant: Plant, looks_s: Float, seen: Mapping[str, Float]) -> HopTruth | None:
    m_b, m_l, g = (plant.parameters[name].value for name in ("m_b", "m_l", "g"))
    body, leg = seen["z_b"], seen["z_l"]
    if plant.geometry == "arm":
        radius_m = plant.parameters["L_CoM"].value
        body, leg = radius_m * np.sin(body / radius_m), radius_m * np.sin(leg / radius_m)
    com = (m_b * body + m_l * leg) / (m_b + m_l)
    moved = np.flatnonzero(np.abs(seen["z_b"] - seen["z_b"][0]) > 1e-9)
    if not moved.size:
        return None
    opening_s = float(looks_s[moved[0]])
    trace = Trace(looks_s, com - com[0], seen["z_l"], seen["ground_force"], opening_s)
    try:
        flight = flight_of(trace)
    except IndexError:  # the run ends before the foot is back
        return None
    if flight is None or flight[2] - flight[1] < SHORTEST_FLIGHT_S:
        return None
    height_m = apex_m(trace)
    take_off_s, touchdown_s = _sharp_edges(trace, flight)
    return HopTruth(take_off_s, touchdown_s, height_m, (m_b + m_l) * g * height_m, opening_s)


def _sharp_edges(trace: Trace, flight: tuple[int, float, float]) -> tuple[float, float]:
    """Take-off and touchdown between two looks, where the foot's free path crosses the height at which it was let go.

    That height is where the contact force, on the line of its last two looks, falls to zero.
    """
    _, take_off_s, touchdown_s = flight
    pressed = np.flatnonzero((trace.times_s <= take_off_s) & (trace.contact_n > 0.0))[-2:]
    forces, feet = trace.contact_n[pressed], trace.foot_m[pressed]
    if forces.size < 2 or pressed[1] != pressed[0] + 1 or forces[0] <= forces[1]:
        return take_off_s, touchdown_s
    left_m = float(feet[1] + (feet[1] - feet[0]) * forces[1] / (forces[0] - forces[1]))
    free = np.flatnonzero(
        (trace.times_s > take_off_s) & (trace.times_s < touchdown_s) & (trace.contact_n == 0.0)
    )
    edges = []
    for rough_s, three in ((take_off_s, free[:3]), (touchdown_s, free[-3:])):
        path = np.polyfit(trace.times_s[three] - rough_s, trace.foot_m[three] - left_m, 2)
        crossings = np.roots(path)
        near = float(crossings[np.argmin(np.abs(crossings))].real)
        edges.append(rough_s + near if abs(near) < 3.0 * LOOK_S else rough_s)
    return edges[0], edges[1]
