"""What the evaluation of a flight leaves: its ends with their errors, a verdict, and the fit behind them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flight.ballistics import FreeFall, Level
from flight.edge_fit import Edge
from flight.ringing import TwoMass
from flight.spring_check import LegShare

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FlightFit:
    """What the fit of a flight leaves for heights and energies; times from the fire command."""

    take_off: Edge
    touchdown: Edge
    robot: TwoMass
    share: LegShare
    fall: FreeFall
    level: Level
    motion_m_s2: Array  # (n,) at the record's times: the body's specific force along the leg, bias taken off
    rest_m_s2: float  # that motion at rest
    noise_m_s2: float


@dataclass(frozen=True)
class FlightTime:
    """A flight as seen by the accelerometer. Times on the record's clock.

    Take-off and touchdown are where the foot leaves the ground and is back at the height at which it left.
    `verdict` is `valid`, `degraded` (usable, with the reasons) or `rejected`. Compressions of the spring and
    their rates, at both ends, come from the fitted ringing. `chi`: misfit of the ringing in noise sigmas.
    `leaving_sigma_s`: of the take-off that heights are counted from; a last graze of the ground changes no height.
    """

    verdict: str
    reasons: tuple[str, ...]
    take_off_s: float = math.nan
    touchdown_s: float = math.nan
    take_off_sigma_s: float = math.nan
    touchdown_sigma_s: float = math.nan
    static_m_s2: float = math.nan
    static_sigma_m_s2: float = math.nan
    offset_m_s2: float = math.nan
    offset_sigma_m_s2: float = math.nan
    compression_m: tuple[float, float] = (math.nan, math.nan)
    compression_rate_m_s: tuple[float, float] = (math.nan, math.nan)
    chi: float = math.nan
    contact: str = ""
    leaving_sigma_s: float = math.nan
    fit: FlightFit | None = field(default=None, repr=False, compare=False)

    @property
    def time_of_flight_s(self) -> float:
        return self.touchdown_s - self.take_off_s

    @property
    def time_of_flight_sigma_s(self) -> float:
        """The two ends are fitted to samples of their own: their errors are independent."""
        return math.hypot(self.take_off_sigma_s, self.touchdown_sigma_s)
