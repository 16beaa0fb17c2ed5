"""Simulated hops for judging the estimator: the rig as it really is, its truth, and what the sensors deliver."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.hop_draws import GRAVITIES, HIDDEN, HopCase, draw_case
from benchmarks.hop_sensing import REST_S, Tick, sensed
from benchmarks.hop_truth import LOOK_S, HopTruth, truth_of
from flight.rig import VerticalRig
from flight.settings import FlightSettings, GroundSettings, load
from hal.config import config_path
from sim_hal.plant.expressions import Name
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, Run, catalogue, compile_plant, load_plant
from sim_hal.truth import SYMBOLS

Float = NDArray[np.float64]

AFTER_S = 0.25  # recorded after touchdown
SPRING_HZ = 1666.0


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
    truth = truth_of(plant, looks_s, {name: seen[name][np.searchsorted(every, looks_s)] for name in SYMBOLS})
    if truth is None or truth.touchdown_s + AFTER_S > length_s:
        return None
    force = seen["body_acceleration_m_s2"][np.searchsorted(every, force_s)]
    at = np.searchsorted(every, spring_s)
    spring, magnet = seen["spring_compression_m"][at], seen["magnet_current_a"][at]
    end = truth.touchdown_s + AFTER_S
    ticks = sensed(case, settings, rng, force_s, force, spring_s, spring, magnet, end)
    kept = force_s < end
    return SimulatedHop(case, truth, settings, ticks, int(kept.sum()), plant, force_s[kept], force[kept])


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
    truth = truth_of(plant, times, seen)
    ends = (math.nan, math.nan) if truth is None else (truth.take_off_s, truth.touchdown_s)
    return times, seen["body_acceleration_m_s2"], *ends


def _longest_s(plant: Plant, compression_m: float) -> float:
    value = {name: parameter.value for name, parameter in plant.parameters.items()}
    weight_n = (value["m_b"] + value["m_l"]) * value["g"]
    height_m = (0.5 * value["k"] * compression_m + value["m_b"] * value["g"]) * compression_m / weight_n
    return 0.4 + 2.0 * math.sqrt(2.0 * height_m / value["g"])
