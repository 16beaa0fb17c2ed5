"""The least error that any unbiased estimator of the same signal model could have: the Cramér-Rao bound.

The model of an end of the flight (`flight.edge_fit`) is put on the noise-free signal of the same hop at the same
sample times, its edge at the true moment; its Fisher information there, with what is known of rig and ground
beforehand (van Trees), gives the least variance of that end. Both ends rest on samples of their own, so their
variances add up. The bound is that of an end that is where it is: whether the foot touched once more is told by the
samples, or it is not, and no derivative of theirs knows of it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from benchmarks.hop_cases import SimulatedHop
from flight.edge_fit import Edge, fit_edges
from flight.edge_model import E, model
from flight.flight_time import FlightFit
from flight.heartbeat import Heartbeat

_AT_TRUTH_S = 1e-7  # by which the edge may move while the other parameters are fitted


def flight_bound_s(hop: SimulatedHop, fit: FlightFit) -> float:
    """Least standard deviation of the time of flight [s], for a hop whose samples kept their true times."""
    rig = hop.settings.rig
    rest = float(np.mean(hop.clean_m_s2[hop.times_s < 0.0]))
    motion = (hop.clean_m_s2 - rest) / rig.sensor_gain + rig.gravity_m_s2
    noise = math.hypot(
        hop.case.noise_factor * hop.settings.sensors.accelerometer_noise_m_s2,
        hop.settings.sensors.accelerometer_step_m_s2 / math.sqrt(12.0),
    )

    def variance(edge: Edge, true_s: float) -> float:
        at = np.searchsorted(hop.times_s, edge.data.times_s - 1e-9)
        ringing = edge.ringing.seen_from(true_s)
        mean, start = edge.data.prior_mean.copy(), edge.parameters.copy()
        mean[E.TIME] = start[E.TIME] = true_s
        start[E.COSINE], start[E.SINE] = ringing.cosine_m_s2, ringing.sine_m_s2
        data = replace(edge.data, motion_m_s2=motion[at], noise_m_s2=noise / rig.sensor_gain, prior_mean=mean)
        held = data.prior_std.copy()
        held[E.TIME] = _AT_TRUTH_S
        there = fit_edges(replace(data, prior_std=held), start[None], Heartbeat())[0].parameters
        jacobian = model(data, there[None])[1][0]
        information = jacobian @ jacobian.T + np.diag(data.prior_std**-2.0)
        scale = np.sqrt(np.diag(information))
        return float(np.linalg.inv(information / np.outer(scale, scale))[E.TIME, E.TIME] / scale[E.TIME] ** 2)

    truth = hop.truth
    return math.sqrt(variance(fit.take_off, truth.take_off_s) + variance(fit.touchdown, truth.touchdown_s))
