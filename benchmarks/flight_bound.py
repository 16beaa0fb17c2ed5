"""The least error that any unbiased estimator of the same signal model could have: the Cramér-Rao bound.

The model of an end of the flight (`flight.edge_fit`) is put on the noise-free signal of the same hop at the same
sample times; its Fisher information there, with what is known of rig and ground beforehand (van Trees), gives the
least variance of that end. Both ends rest on samples of their own, so their variances add up.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from benchmarks.hop_cases import SimulatedHop
from flight.edge_fit import Edge, fit_edges
from flight.edge_model import E
from flight.flight_time import FlightFit
from flight.heartbeat import Heartbeat


def flight_bound_s(hop: SimulatedHop, fit: FlightFit) -> float:
    """Least standard deviation of the time of flight [s], for a hop whose samples kept their true times."""
    rig = hop.settings.rig
    rest = float(np.mean(hop.clean_m_s2[hop.times_s < 0.0]))
    motion = (hop.clean_m_s2 - rest) / rig.sensor_gain + rig.gravity_m_s2
    noise = math.hypot(
        hop.case.noise_factor * hop.settings.sensors.accelerometer_noise_m_s2,
        hop.settings.sensors.accelerometer_step_m_s2 / math.sqrt(12.0),
    )

    def variance(edge: Edge) -> float:
        at = np.searchsorted(hop.times_s, edge.data.times_s - 1e-9)
        data = replace(edge.data, motion_m_s2=motion[at], noise_m_s2=noise / rig.sensor_gain)
        return float(fit_edges(data, edge.parameters[None], Heartbeat())[0].covariance[E.TIME, E.TIME])

    return math.sqrt(variance(fit.take_off) + variance(fit.touchdown))
