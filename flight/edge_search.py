"""Each end of the flight: where the ringing stops to explain the record, and the ground that explains the rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flight.edge_fit import Edge, fit_edges, mixed, starts
from flight.edge_model import TAKE_OFF, TOUCHDOWN, E, EdgeData, pushed
from flight.flight_search import Expectation, NoFlight, Stretch
from flight.heartbeat import Heartbeat
from flight.local_ringing import LocalRinging, fit_ringing
from flight.settings import GroundSettings

Array = NDArray[np.float64]

_LOCAL_PERIODS = 1.5  # of the ringing that is fitted next to an edge
_CLEAR_S = {TAKE_OFF: 0.008, TOUCHDOWN: 0.005}  # the windows of the search may reach so far into the contact
_STRANGE_SIGMAS = 6.0
_PLAINLY_STRANGE = 10.0  # times what is strange: one such sample is enough
# Stretch of contact that is modelled, beyond the strange sample: on soft and on hard ground; there the foot has
# bounced before take-off.
_INTO_S = {(False, False): 0.0035, (False, True): 0.001, (True, False): 0.0025, (True, True): 0.0015}
# Edges that are tried, from the strange sample towards the flight: last one and their distance.
_TRIED_S = {False: (7e-3, 3.5e-4), True: (1.5e-3, 2e-4)}
_TRIED_ON_STEEL_S = 1.2e-4  # where the foot bounces, its last touch is a blow
_BACKWARDS_M_S, _BACKWARDS_SIGMAS = 0.01, 3.0  # of the foot at an edge: what its speed may be wrong by
_SEEN_TO_MOVE, _PLAINLY_MOVES = 3.0, 10.0  # its speed, in sigmas
_AT_ONCE = 2  # steps after the edge by which a foot that touches there is pushed
_PLAINLY_WORSE = 9.0  # by so much in cost a fit does not take the place of one whose foot hardly moves
_STIFF_LOGS = (12.0, 13.2, 14.4)
_SPEEDS = (1.6, 5)  # of the foot, up to so many sigmas either way and how many, tried where it has bounced
_NOT_YET = 1.5  # cost of a sample beyond which bounces are looked for once more,
_FINER, _MOST_MORE_STARTS = 2, 30  # so many times as finely
_MOST_STARTS, _APART_S = (12, 10), (3e-4, 2.2e-4)  # of the fits of one end, and how far apart they start
_EDGE_STD_S = 4e-3  # how far the search may have missed the edge
_SPEED_STD = (0.015, 0.01)  # of the foot: share of its own ringing, and [m/s]
_HARD_LOG_STD = 0.25  # of the logarithm of a hard ground's stiffness
_YIELD_LOG_STD = 0.5
_SAME_GROUND_LOG_STD = 0.4  # of the ground's figures from take-off to touchdown
_SAME_OMEGA, _SAME_DECAY_1_S = 2e-3, 0.3  # of the ringing: share of its frequency, and its decay
_FRICTION_STD_M_S2 = 1.0
_TEMPER = 3.0  # of several fits on one ground
_LEVEL_STD_M_S2 = 0.05
_NOT_SEEN = {TAKE_OFF: "the robot was not seen to leave the ground", TOUCHDOWN: "no impact after the flight"}


@dataclass(frozen=True)
class EndOfFlight:
    """One end: the ringing next to it, and the sample nearest to the flight that it does not explain."""

    way: float
    local: LocalRinging
    inner_s: tuple[float, float]
    strange_s: float


@dataclass(frozen=True)
class Scene:
    """What both ends share: samples, noise, the robot and its ground."""

    times_s: Array
    motion_m_s2: Array
    noise_m_s2: float
    expected: Expectation
    ground: GroundSettings
    load_n: float  # the most that the ground bore at rest and in the push, roughly
    heartbeat: Heartbeat

    @cached_property
    def step_s(self) -> float:
        """From one sample to the next."""
        return float(np.median(np.diff(self.times_s)))


def look_at_end(scene: Scene, stretch: Stretch, way: float, omega_std: float) -> EndOfFlight:
    """Fit the ringing next to one end, and follow it outwards until it fails."""
    t, y, expected = scene.times_s, scene.motion_m_s2, scene.expected
    length = _LOCAL_PERIODS * 2.0 * math.pi / expected.omega_rad_s
    clear = min(_CLEAR_S[way], 0.15 * (stretch.last_s - stretch.first_s))
    first, last = stretch.first_s + clear, stretch.last_s - clear
    first, last = (first, min(last, first + length)) if way == TAKE_OFF else (max(first, last - length), last)
    inner = (t >= first) & (t <= last)
    if int(inner.sum()) < 9:
        raise NoFlight("too few samples in flight")
    decay = (expected.decay_1_s, expected.decay_std)
    local = fit_ringing(
        t[inner],
        y[inner],
        (expected.omega_rad_s, omega_std),
        decay,
        scene.noise_m_s2,
        first if way == TAKE_OFF else last,
    )
    allowed = _STRANGE_SIGMAS * max(scene.noise_m_s2, local.rms_m_s2) + abs(local.friction_m_s2)
    outside = np.flatnonzero(t < first)[::-1] if way == TAKE_OFF else np.flatnonzero(t > last)
    excess = np.abs(y[outside] - local.motion_m_s2(t[outside])) / allowed
    # One sample may be a glitch; but a strong one may be the last before the sensor clips.
    twice = (excess[:-1] > 1.0) & ((excess[1:] > 1.0) | (excess[:-1] > _PLAINLY_STRANGE))
    if not twice.any():
        raise NoFlight(_NOT_SEEN[way])
    return EndOfFlight(way, local, (first, last), float(t[outside[int(np.argmax(twice))]]))


def best_edge(
    scene: Scene,
    end: EndOfFlight,
    hard: bool,
    speed_m_s: float,
    speed_at_s: float,
    other: Edge | None = None,
    enough: float = math.inf,
) -> Edge | None:
    """The best fit of this end on hard or on soft ground; None where none leads anywhere.

    `other`: the end already fitted, on the same ground. `enough`: what a sample costs on the other ground; a fit
    that costs more is not worth looking further. Where several fits explain the samples about as well, the edge's
    variance is that of all of them.
    """
    data = _edge_data(scene, end, hard, speed_m_s, speed_at_s, other)
    bounced = hard and end.way == TAKE_OFF
    begins = starts(data, _tried(data, end, scene.step_s, other), _MOST_STARTS[bounced], _APART_S[bounced])
    edges = fit_edges(data, begins, scene.heartbeat)
    if bounced and edges:
        more = _closer(data, end, scene.step_s, min(edges, key=lambda edge: edge.cost), enough)
        edges += fit_edges(data, more, scene.heartbeat) if more is not None else []
    least = min((edge.cost_per_sample for edge in edges), default=math.inf)
    if not edges:
        return None
    chosen = _plausible(edges)
    also = _left_unfelt(edges, min(chosen, key=lambda edge: edge.evidence)) if bounced else []
    together = chosen + also
    # A misfit says that the samples tell less than their noise would allow.
    temper = _TEMPER * max(1.0, least)
    return mixed(together, [edge.evidence for edge in together], temper, len(chosen))


def _closer(data: EdgeData, end: EndOfFlight, step_s: float, best: Edge, enough: float) -> Array | None:
    """Starts (s, 11) of a closer look where the foot has bounced; None where the best fit so far needs none.

    It needs one where it explains the samples badly, and where the foot hardly moves at its edge.
    """
    cost = best.cost_per_sample
    unfelt = best.foot_speed_sigmas < _PLAINLY_MOVES
    if cost >= enough or not (unfelt or cost > _NOT_YET):
        return None
    finely = _tried(data, end, step_s, None, _FINER)
    begins = starts(data, finely, _MOST_MORE_STARTS, _APART_S[True] / _FINER)
    earlier = _left_before(best) if unfelt else None
    return begins if earlier is None else np.vstack((begins, earlier))


def _left_before(edge: Edge) -> Array | None:
    """Parameters (11,) of the take-off before this one, had the foot not touched any more; None where it rose to it.

    The same motion of all but the same: what nobody feels pushes hardly at all.
    """
    tau, push = pushed(edge.data, edge.parameters)
    begins = np.flatnonzero(np.diff((push > 0.0).astype(np.int8)) > 0)
    begins = begins[begins > _AT_ONCE]  # the others are of the touch at the edge itself
    if not begins.size:
        return None
    earlier = edge.parameters.copy()
    earlier[E.TIME] += edge.data.way * tau[begins[0]]
    return earlier


def _tried(
    data: EdgeData, end: EndOfFlight, step_s: float, other: Edge | None, finer: int = 1
) -> dict[E, Sequence[float]]:
    """What is tried for the ground's parameters, so many times as finely where the foot has bounced."""
    touchdown, known = end.way != TAKE_OFF, data.prior_mean
    bounced = data.hard and not touchdown
    last_s, apart_s = _TRIED_S[touchdown]
    apart_s = _TRIED_ON_STEEL_S / finer if bounced else apart_s
    tried: dict[E, Sequence[float]] = {
        E.TIME: (end.strange_s - end.way * np.arange(-2e-4, last_s + 1.2 * step_s, apart_s)).tolist(),
        E.STIFF: _STIFF_LOGS,
    }
    if bounced:
        tried[E.STIFF] = (known[E.STIFF],)
        speeds = np.linspace(-_SPEEDS[0], _SPEEDS[0], (_SPEEDS[1] - 1) * finer + 1)
        tried[E.SPEED] = (speeds * data.prior_std[E.SPEED]).tolist()
    elif data.hard or other:
        tried[E.STIFF] = [known[E.STIFF] + more for more in (-0.4, 0.0, 0.4)]
    if touchdown and not data.hard:
        tried[E.YIELD] = [known[E.YIELD] + more for more in (0.0, 0.6)]
        tried[E.SOFT] = [known[E.SOFT] + more for more in (-0.7, 0.7)]
    return tried


def _plausible(edges: list[Edge]) -> list[Edge]:
    """Those at which the foot goes the right way; all where none does.

    A foot that goes down does not leave the ground, nor does one that rises meet it. One that hardly moves is not
    seen to touch: whether it did, after it had left before, `flight.graze` asks of each such take-off.
    """
    least = min((edge.cost for edge in edges), default=0.0) + _PLAINLY_WORSE
    moving = [edge for edge in edges if edge.foot_speed_sigmas > _SEEN_TO_MOVE and edge.cost < least]
    forwards = [
        edge
        for edge in edges
        if edge.foot_speed_m_s > -_BACKWARDS_M_S or edge.foot_speed_sigmas > -_BACKWARDS_SIGMAS
    ]
    return moving or forwards or edges


def _left_unfelt(edges: list[Edge], best: Edge) -> list[Edge]:
    """Those that leave before the best one, hardly moving, and explain the samples about as well.

    The touch after them, which the best one has, is then no more seen than it is excluded. Touches after the best
    one are the concern of `flight.graze`.
    """
    return [
        edge
        for edge in edges
        if edge.time_s < best.time_s
        and edge.cost < best.cost + _PLAINLY_WORSE
        and -_BACKWARDS_SIGMAS < edge.foot_speed_sigmas <= _SEEN_TO_MOVE
    ]


def _edge_data(
    scene: Scene, end: EndOfFlight, hard: bool, speed_m_s: float, speed_at_s: float, other: Edge | None
) -> EdgeData:
    touchdown = end.way != TAKE_OFF
    t, expected, ground = scene.times_s, scene.expected, scene.ground
    edge_s = end.strange_s
    into = max(_INTO_S[touchdown, hard], 1.6 * scene.step_s)
    low, high = end.inner_s
    low, high = (low, end.strange_s + into) if touchdown else (end.strange_s - into, high)
    chosen = (t >= low) & (t <= high)
    local = end.local.ringing.seen_from(edge_s)
    leg_kg, free = expected.leg_mass_kg, math.inf
    stiff = ground.hard_stiffness_n_m if hard else ground.soft_stiffness_n_m
    foot = (1.0 - expected.robot.leg_share) * abs(local.compression(edge_s, expected.robot)[1])
    prior = {
        E.TIME: (edge_s, _EDGE_STD_S),
        E.STIFF: (math.log(stiff / leg_kg), _HARD_LOG_STD if hard else ground.stiffness_log_std),
        E.SPEED: (0.0, _SPEED_STD[0] * foot + _SPEED_STD[1]),
        E.YIELD: (math.log(scene.load_n / leg_kg), _YIELD_LOG_STD),
        E.SOFT: (math.log(ground.loading_stiffness_n_m / leg_kg), ground.stiffness_log_std),
        E.OMEGA: (local.omega_rad_s, 0.02 * local.omega_rad_s),
        E.DECAY: (expected.decay_1_s, expected.decay_std),
        E.COSINE: (local.cosine_m_s2, free),
        E.SINE: (local.sine_m_s2, free),
        E.OFFSET: (end.local.level_m_s2, _LEVEL_STD_M_S2),
        E.FRICTION: (end.local.friction_m_s2, _FRICTION_STD_M_S2 if end.local.friction_m_s2 else 1e-9),
    }
    if other is not None:  # the foot comes back to the ground that it has pressed
        for name in (E.STIFF, E.SOFT):
            sigma = math.sqrt(other.covariance[name, name])
            prior[name] = (float(other.parameters[name]), math.hypot(_SAME_GROUND_LOG_STD, sigma))
        # It is the same spring too, and after a long flight it rings no more that could tell.
        for name, std in ((E.OMEGA, _SAME_OMEGA * local.omega_rad_s), (E.DECAY, _SAME_DECAY_1_S)):
            sigma = math.sqrt(other.covariance[name, name])
            prior[name] = (float(other.parameters[name]), math.hypot(std, sigma))
    table = np.array([prior[name] for name in E], dtype=np.float64)
    return EdgeData(
        t[chosen],
        scene.motion_m_s2[chosen],
        max(scene.noise_m_s2, 1e-6),
        end.way,
        hard,
        expected.robot,
        speed_m_s,
        speed_at_s,
        other.ringing if other else local,
        table[:, 0],
        table[:, 1],
    )
