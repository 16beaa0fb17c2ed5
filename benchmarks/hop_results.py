"""What an estimator said of a simulated hop, and the figures that many such hops give."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.hop_cases import SimulatedHop
from benchmarks.hop_draws import HopCase
from flight.evaluation import evaluate_hop
from flight.record import HopRecord, HopRecorder

WRONG_SIGMAS = 5.0
COVERED_SIGMAS = 1.959964


@dataclass(frozen=True)
class Answer:
    """Times in s, energy in J; NaN where the estimator gave none. Sigma NaN where it states none.

    `flagged`: accepted, but told to be doubtful.
    """

    accepted: bool
    flight_s: float = math.nan
    flight_sigma_s: float = math.nan
    energy_j: float = math.nan
    energy_sigma_j: float = math.nan
    reason: str = ""
    flagged: bool = False


@dataclass(frozen=True)
class Outcome:
    """One hop's answer beside its truth. `cost_s`: processor time spent on it."""

    index: int
    nominal: bool
    case: HopCase
    answer: Answer
    true_flight_s: float
    true_energy_j: float
    samples: int
    cost_s: float
    bound_s: float = math.nan

    @property
    def flight_error_ms(self) -> float:
        return 1e3 * (self.answer.flight_s - self.true_flight_s)

    @property
    def energy_error_percent(self) -> float:
        return 100.0 * (self.answer.energy_j / self.true_energy_j - 1.0)

    @property
    def flight_sigmas(self) -> float:
        return abs(self.answer.flight_s - self.true_flight_s) / self.answer.flight_sigma_s

    @property
    def energy_sigmas(self) -> float:
        return abs(self.answer.energy_j - self.true_energy_j) / self.answer.energy_sigma_j


def record_of(hop: SimulatedHop) -> HopRecord:
    """The hop's FIFO batches through the recorder that flies."""
    recorder = HopRecorder()
    for tick in hop.ticks:
        recorder.add(tick.force, tick.spring, tick.magnet, tick.now_s)
    return recorder.record(0.0)


def flown(hop: SimulatedHop) -> tuple[Answer, float]:
    """What the flight software says, from batches to energy, and the processor time that it took [s]."""
    start = time.process_time()
    seen = evaluate_hop(record_of(hop), hop.settings, 0)
    cost_s = time.process_time() - start
    verdict = seen.flight.verdict
    reason = "; ".join(seen.flight.reasons)
    if verdict == "rejected" or seen.potential_j is None or seen.time_of_flight_s is None:
        return Answer(False, reason=reason), cost_s
    flight, energy = seen.time_of_flight_s, seen.potential_j
    return Answer(
        True, flight.value, flight.sigma, energy.value, energy.sigma, reason, verdict != "valid"
    ), cost_s


def figures(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """The figures of a set of hops; NaN where nothing was accepted or no sigma is stated."""
    accepted = [o for o in outcomes if o.answer.accepted]
    if not accepted:
        return {"accepted_percent": 0.0}
    flight = np.array([o.flight_error_ms for o in accepted])
    energy = np.array([o.energy_error_percent for o in accepted])
    sigmas = np.array([(o.flight_sigmas, o.energy_sigmas) for o in accepted])
    wrong = (np.max(sigmas, axis=1) > WRONG_SIGMAS) & ~np.array([o.answer.flagged for o in accepted])
    found = {
        "accepted_percent": 100.0 * len(accepted) / len(outcomes),
        "tof_rms_ms": float(np.sqrt(np.mean(flight**2))),
        "tof_median_ms": float(np.median(np.abs(flight))),
        "energy_rms_percent": float(np.sqrt(np.mean(energy**2))),
        "energy_bias_percent": float(np.mean(energy)),
        "us_per_sample": 1e6 * sum(o.cost_s for o in outcomes) / sum(o.samples for o in outcomes),
    }
    if not np.isnan(sigmas).any():
        found |= {
            "tof_coverage95_percent": 100.0 * float(np.mean(sigmas[:, 0] < COVERED_SIGMAS)),
            "energy_coverage95_percent": 100.0 * float(np.mean(sigmas[:, 1] < COVERED_SIGMAS)),
            "coverage95_percent": 100.0 * float(np.mean(sigmas < COVERED_SIGMAS)),
            "wrong_unflagged_percent": 100.0 * float(np.sum(wrong)) / len(outcomes),
        }
    return found
