"""Simulated hops for judging the estimator: drawn cases, their truth, and what the sensors' FIFOs deliver.

A `nominal` hop is the configured rig on the vertical line within its tolerances, sensors as on their data sheets.
A `broad` hop is drawn over rigs, gravities, feet, surfaces, tilts, energies, sample rates, noise, lost samples, clock
error and range, often with physics that the estimator is not told of.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from flight.rig import VerticalRig
from flight.settings import FlightSettings, GroundSettings, load
from hal.config import config_path
from hal.readings import MagnetCurrent, SpecificForce, SpringCompression
from sim_hal.plant.expressions import Name
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, catalogue, compile_plant, load_plant
from sim_hal.truth import SYMBOLS, Trace, apex_m, flight_of

Float = NDArray[np.float64]

STEP_M_S2, G_M_S2 = 0.00957, 9.80665
REST_S, AFTER_S = 0.3, 0.25  # recorded before the fire command and after touchdown
SPRING_HZ, SPRING_NOISE_M, SPRING_STEP_M = 1666.0, 50e-6, 5e-6
MAGNET_NOISE_A, MAGNET_STEP_A = 5e-3, 1e-3
TICK_S = 0.005
LOOK_S = 1e-4
SHORTEST_FLIGHT_S = 0.08
SURFACES = ("steel", "syar", "quartz_sand", "expanded_clay", "quartz_aggregate")
GRAVITIES = {"moon": 1.62, "mars": 3.71, "earth": 9.81}

#: Physics the estimator does not know: median and largest strength of each, by parameter; drawn log-uniformly
#: from a fifth of the median to the largest.
#: Effects that the catalogue does not have are left out.
HIDDEN: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "sleeve_friction": {"F_f": (3.0, 10.0)},
    "soil_rate_dependence": {"c_g": (30.0, 200.0)},
    "soil_hardening": {"n": (0.1, 0.4)},
    "latch_drag": {"F_d": (10.0, 60.0), "t_f": (0.005, 0.015)},
    "release_delay": {"delay": (0.001, 0.004)},
    "aerodynamic_drag_quadratic": {"cd_a": (0.05, 0.2)},
    "aerodynamic_drag_linear": {"d": (0.1, 0.5)},
    "buoyancy": {"B": (0.1, 0.6)},
}

_OF_AIR = ("aerodynamic_drag_quadratic", "aerodynamic_drag_linear", "buoyancy")
_OF_SOIL = ("soil_rate_dependence", "soil_hardening")


@dataclass(frozen=True)
class HopCase:
    """What was drawn. `hidden`: names of effects switched on. `cell` names what a case is grouped by."""

    rig: str
    body: str
    surface: str
    foot: str
    tilt_deg: float
    compression_m: float
    rate_hz: float
    noise_factor: float
    missing_share: float
    clock_skew: float
    range_g: float
    hidden: tuple[str, ...]

    def cells(self) -> dict[str, str]:
        """The groups in which worst cells are looked for."""
        bounds = (400.0, 800.0, 1600.0, 3201.0)
        low = max(b for b in bounds[:-1] if b <= self.rate_hz)
        return {
            "rig": self.rig,
            "gravity": self.body,
            "surface": self.surface,
            "foot": self.foot,
            "tilt": f"{self.tilt_deg:g} deg",
            "rate": f"{low:g}-{bounds[bounds.index(low) + 1]:g} Hz",
            "noise": "x0.5-1" if self.noise_factor < 1.0 else "x1-2" if self.noise_factor < 2.0 else "x2-4",
            "range": f"{self.range_g:g} g",
            "hidden": "+".join(self.hidden) or "nothing",
        }


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


@dataclass(frozen=True)
class Tick:
    """What one tick of the board reads."""

    now_s: float
    force: SpecificForce
    spring: SpringCompression
    magnet: MagnetCurrent


@dataclass(frozen=True)
class SimulatedHop:
    """A hop: its case, truth, what flight knows of the rig, and what its sensors delivered."""

    case: HopCase
    truth: HopTruth
    settings: FlightSettings
    ticks: tuple[Tick, ...]
    samples: int
    plant: Plant
    times_s: Float  # of the accelerometer's samples, true, on the board's clock
    clean_m_s2: Float  # what it would read without noise, step and range


def draw_case(rng: np.random.Generator, nominal: bool) -> HopCase:
    """One case; the nominal ones differ in surface and energy alone."""
    surface = str(rng.choice(SURFACES))
    compression_m = float(rng.uniform(0.022, 0.038))
    if nominal:
        return HopCase("bb0b", "earth_arm", surface, "1", 0.0, compression_m, 1666.0, 1.0, 0.0, 0.0, 32.0, ())
    rig = str(rng.choice(("bb0b", "bb0b_arm", "hopter"), p=(0.5, 0.25, 0.25)))
    body = "earth_arm" if rig == "bb0b_arm" else str(rng.choice(list(GRAVITIES)))
    return HopCase(
        rig,
        body,
        surface,
        "3x1" if rig == "hopter" else str(rng.choice(("0", "1", "2", "3", "4"))),
        float(rng.choice((0.0, 10.0, 20.0))),
        compression_m,
        float(math.exp(rng.uniform(math.log(400.0), math.log(3200.0)))),
        float(math.exp(rng.uniform(math.log(0.5), math.log(4.0)))),
        0.02,
        float(rng.uniform(-0.03, 0.03)),
        float(rng.choice((16.0, 32.0))),
        _hidden(rng, body, surface),
    )


def _hidden(rng: np.random.Generator, body: str, surface: str) -> tuple[str, ...]:
    """Effects that are there; those of the air and of soil only where there is some."""
    absent = (() if "earth" in body else _OF_AIR) + (_OF_SOIL if surface == "steel" else ())
    known = sorted(name for name in HIDDEN if name in catalogue() and name not in absent)
    count = int(rng.choice((0, 1, 2), p=(0.4, 0.4, 0.2)))
    return tuple(sorted(str(name) for name in rng.choice(known, count, replace=False)))


def _three_feet(ground: GroundSettings) -> GroundSettings:
    """The ground under three feet at once."""
    return replace(
        ground,
        soft_stiffness_n_m=3.0 * ground.soft_stiffness_n_m,
        hard_stiffness_n_m=3.0 * ground.hard_stiffness_n_m,
        loading_stiffness_n_m=3.0 * ground.loading_stiffness_n_m,
    )


@cache
def _base() -> FlightSettings:
    """The configured flight settings."""
    return load()


def _settings_of(rig: str, body: str, foot: str, rate_hz: float) -> FlightSettings:
    """What flight is told: the nominal rig and the sensors' data sheets."""
    base = _base()
    own = base.rig
    if rig == "bb0b_arm":
        own = replace(own, geometry="arm", foot=foot)
    elif rig == "hopter":
        hopter = _nominal_plant("hopter_hop.yaml").parameters
        own = replace(
            own,
            geometry="vertical",
            vertical=VerticalRig(hopter["m_b"].value, hopter["m_l"].value, GRAVITIES[body]),
            arm=None,
            spring_stiffness_n_m=hopter["k"].value,
            spring_damping_n_s_m=hopter["c"].value,
        )
        base = replace(base, evaluation=replace(base.evaluation, ground=_three_feet(base.evaluation.ground)))
    else:
        on_arm = replace(own, foot=foot).arm_equivalent
        gravity = GRAVITIES.get(body, on_arm.gravity_m_s2)
        vertical = VerticalRig(on_arm.body_mass_kg, on_arm.leg_mass_kg, gravity)
        own = replace(own, geometry="vertical", vertical=vertical, arm=None, foot=foot)
    return replace(base, rig=own, sensors=replace(base.sensors, accelerometer_rate_hz=rate_hz))


_FILES = {"bb0b": "bb0b_hop.yaml", "bb0b_arm": "bb0b_hop_arm.yaml", "hopter": "hopter_hop.yaml"}


@cache
def _nominal_plant(file: str) -> Plant:
    return load_plant(config_path("plant", file))


def _plant_of(case: HopCase, settings: FlightSettings, rng: np.random.Generator) -> Plant:
    """The rig as it really is: within its tolerances, on the case's ground, with the hidden physics."""
    plant = _nominal_plant(_FILES[case.rig])
    known = {
        "m_b": settings.rig.body_mass_kg,
        "m_l": settings.rig.leg_mass_kg,
        "g": settings.rig.gravity_m_s2,
    }
    shares = {
        "m_b": settings.rig.mass_std_share,
        "m_l": settings.rig.mass_std_share,
        "g": settings.rig.gravity_std_share,
    }
    values = {}
    for name, parameter in plant.flat().items():
        value = known.get(name, parameter.value)
        std = shares[name] * value if name in shares else parameter.std
        values[name] = value + std * float(rng.normal())
    ground = case.surface
    values[f"{ground}.chi"] = min(max(values[f"{ground}.chi"], 0.0), 0.97)
    if ground != "steel":  # a tilted foot presses on less soil; published C3 rises 1.5-fold at 20 deg
        values[f"{ground}.k_l"] /= 1.0 + case.tilt_deg / 20.0 * 0.5
    for name in case.hidden:
        plant = plant.with_effect(_use(plant, name, rng))
    return plant.with_values({name: value for name, value in values.items() if name in plant.flat()})


def _use(plant: Plant, physics_id: str, rng: np.random.Generator) -> EffectUse:
    effect = catalogue()[physics_id]
    equation, channel = plant.places(effect)[0]
    form = plant.form(effect, plant.balance(effect, equation))
    assert form is not None
    strengths = {}
    for parameter in form.parameters:
        if parameter.constant:
            value = float(parameter.start)
        else:
            median, largest = HIDDEN[physics_id][parameter.name]
            value = math.exp(rng.uniform(math.log(0.2 * median), math.log(largest)))
        strengths[parameter.name] = Parameter(value, 0.0, parameter.unit)
    return EffectUse(physics_id, equation, channel, strengths)


def simulate(seed: int, index: int, nominal: bool) -> SimulatedHop:
    """Hop `index` of a seed; draws that do not really fly are drawn again."""
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence((seed, index, int(nominal)))))
    while True:
        hop = _fly(draw_case(rng, nominal), rng)
        if hop is not None:
            return hop


def _fly(case: HopCase, rng: np.random.Generator) -> SimulatedHop | None:
    settings = _settings_of(case.rig, case.body, case.foot, case.rate_hz)
    plant = _plant_of(case, settings, rng)
    length_s = _longest_s(plant, case.compression_m)
    force_s = np.arange(-REST_S + rng.uniform(0.0, 1.0) / case.rate_hz, length_s, 1.0 / case.rate_hz)
    spring_s = np.arange(-REST_S + rng.uniform(0.0, 1.0) / SPRING_HZ, length_s, 1.0 / SPRING_HZ)
    looks_s = np.arange(0.0, length_s, LOOK_S)
    every = np.unique(np.concatenate((force_s, spring_s, looks_s)))
    compiled = compile_plant(plant, extra={name: Name(name) for name in SYMBOLS})
    run = Run(
        every,
        events={"fire_command": 0.0},
        known={"spring_compression_m": case.compression_m},
        conditions={"surface": case.surface, "foot": 1.0, "tilt_deg": 0.0, "hop_index": 0.0},
    )
    seen = dict(zip(compiled.output_names, compiled.run(compiled.values, run).T, strict=True))
    truth = _truth(plant, looks_s, {name: seen[name][np.searchsorted(every, looks_s)] for name in SYMBOLS})
    if truth is None or truth.touchdown_s + AFTER_S > length_s:
        return None
    force = seen["body_acceleration_m_s2"][np.searchsorted(every, force_s)]
    at = np.searchsorted(every, spring_s)
    spring, magnet = seen["spring_compression_m"][at], seen["magnet_current_a"][at]
    end = truth.touchdown_s + AFTER_S
    sensed = _sensed(case, settings, rng, force_s, force, spring_s, spring, magnet, end)
    kept = force_s < end
    return SimulatedHop(case, truth, settings, sensed, int(kept.sum()), plant, force_s[kept], force[kept])


def nominal_signal(
    rig: str, body: str, foot: str, surface: str, compression_m: float
) -> tuple[Float, Float, float, float]:
    """The nominal hop without noise: times and motion (n,) of the body along the leg, take-off and touchdown [s].

    An arm's sensor is taken to sit on the vertical line. Where the nominal hop does not fly, its ends are NaN.
    """
    settings = _settings_of(rig, body, foot, 1666.0)
    values = {
        "m_b": settings.rig.body_mass_kg,
        "m_l": settings.rig.leg_mass_kg,
        "g": settings.rig.gravity_m_s2,
    }
    plant = _nominal_plant(_FILES["bb0b" if rig == "bb0b_arm" else rig]).with_values(values)
    times: Float = np.arange(0.0, _longest_s(plant, compression_m), LOOK_S)
    compiled = compile_plant(plant, extra={name: Name(name) for name in SYMBOLS})
    run = Run(
        times,
        events={"fire_command": 0.0},
        known={"spring_compression_m": compression_m},
        conditions={"surface": surface},
    )
    seen = dict(zip(compiled.output_names, compiled.run(compiled.values, run).T, strict=True))
    truth = _truth(plant, times, seen)
    ends = (math.nan, math.nan) if truth is None else (truth.take_off_s, truth.touchdown_s)
    return times, seen["body_acceleration_m_s2"], *ends


def _longest_s(plant: Plant, compression_m: float) -> float:
    value = {name: parameter.value for name, parameter in plant.parameters.items()}
    weight_n = (value["m_b"] + value["m_l"]) * value["g"]
    height_m = (0.5 * value["k"] * compression_m + value["m_b"] * value["g"]) * compression_m / weight_n
    return 0.4 + 2.0 * math.sqrt(2.0 * height_m / value["g"])


def _truth(plant: Plant, looks_s: Float, seen: Mapping[str, Float]) -> HopTruth | None:
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


def _sensed(
    case: HopCase,
    settings: FlightSettings,
    rng: np.random.Generator,
    force_s: Float,
    force: Float,
    spring_s: Float,
    spring: Float,
    magnet: Float,
    end_s: float,
) -> tuple[Tick, ...]:
    """The batches: noise, step, range, lost samples, each sensor's own clock."""
    noise = case.noise_factor * settings.sensors.accelerometer_noise_m_s2
    limit = case.range_g * G_M_S2
    seen = force + noise * rng.normal(size=force.size)
    seen = np.clip(np.round(seen / STEP_M_S2) * STEP_M_S2, -limit, limit)
    spring = spring + SPRING_NOISE_M * rng.normal(size=spring.size)
    spring = np.clip(np.round(spring / SPRING_STEP_M) * SPRING_STEP_M, -0.06, 0.06)
    magnet = np.round((magnet + MAGNET_NOISE_A * rng.normal(size=magnet.size)) / MAGNET_STEP_A)
    magnet = magnet * MAGNET_STEP_A
    kept = rng.random(force.size) >= case.missing_share
    force_s, seen = force_s[kept], seen[kept]
    kept = rng.random(spring.size) >= case.missing_share
    spring_s, spring, magnet = spring_s[kept], spring[kept], magnet[kept]
    skews = (case.clock_skew, case.clock_skew * rng.uniform(-1.0, 1.0))
    starts = rng.uniform(-0.05, 0.05, 2) if case.clock_skew else np.zeros(2)
    stamps = [
        start + (1.0 + skew) * t for start, skew, t in zip(starts, skews, (force_s, spring_s), strict=True)
    ]
    reads = np.arange(-REST_S, end_s, TICK_S)
    reads = reads + rng.uniform(0.0, 3e-4, reads.size)
    ticks, old = [], (0, 0)
    for now_s in reads.tolist():
        new = (int(np.searchsorted(force_s, now_s)), int(np.searchsorted(spring_s, now_s)))
        mine, other = slice(old[0], new[0]), slice(old[1], new[1])
        values = seen[mine]
        times = tuple(stamps[1][other].tolist())
        ticks.append(
            Tick(
                now_s,
                SpecificForce(
                    tuple(stamps[0][mine].tolist()),
                    tuple(values.tolist()),
                    tuple((np.abs(values) >= limit).tolist()),
                ),
                SpringCompression(times, tuple(spring[other].tolist())),
                MagnetCurrent(times, tuple(magnet[other].tolist())),
            )
        )
        old = new
    return tuple(ticks)
