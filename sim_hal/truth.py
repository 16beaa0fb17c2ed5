"""What really happened in a hop: the figures that flight has to estimate, from the plant itself.

Each hop is run once more from its start, with closer looks and no sensors, and once on the steel reference,
so that the share of energy which the ground took (C3) is known without the estimator's model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_hal.hop import FIRE, OPENED, SimulationFault
from sim_hal.plant.expressions import Name
from sim_hal.plant.simulate import Plant, Run, Simulator, compile_plant
from sim_hal.settings import Spot

Floats = NDArray[np.float64]

LOOK_S = 1e-4
"""Time between two looks; crossings are interpolated between them."""

REFERENCE = "steel"
SYMBOLS = ("z_b", "z_l", "ground_force")


@dataclass(frozen=True)
class Trace:
    """A hop, look by look, for longer than its flight can last; times [s] from the fire command.

    All arrays (n,): height of the centre of mass above its start and of the foot above the undisturbed ground
    [m], contact force [N].
    """

    times_s: Floats
    com_m: Floats
    foot_m: Floats
    contact_n: Floats
    opening_s: float


@dataclass(frozen=True)
class HopTruth:
    """The truth of one hop; times on the board's clock.

    `hop_height_m`: apex of the centre of mass above its height before the release. Energies as the paper has
    them: E_used = ½k(f_grav + s)² − ½k f_grav², E_pot = (m_b + m_l) g h. `c3` = 1 − E_pot/(E_pot of the same
    start on steel). `sinkage_m`: deepest foot penetration while pushing off. What never happened is None.
    """

    hop: int
    spot: Spot
    spring_compression_m: float
    energy_used_j: float
    fire_s: float
    opening_s: float
    take_off_s: float | None
    touchdown_s: float | None
    time_of_flight_s: float | None
    hop_height_m: float
    energy_potential_j: float
    reference_energy_potential_j: float
    c3: float
    sinkage_m: float


def trace_hop(plant: Plant, conditions: Mapping[str, float | str], compression_m: float) -> Trace:
    """Simulate one hop from rest. Raises `SimulationFault` when the lock does not open."""
    known = {"spring_compression_m": compression_m}
    opening_s = _opening_s(plant, conditions, known)
    times_s = np.arange(0.0, opening_s + _longest_flight_s(plant, compression_m), LOOK_S)
    run = Run(times_s=times_s, events={FIRE: 0.0}, known=known, conditions=conditions)
    compiled = compile_plant(plant, extra={name: Name(name) for name in SYMBOLS})
    outputs = dict(zip(compiled.output_names, compiled.run(compiled.values, run).T, strict=True))
    body_kg, leg_kg = (plant.parameters[name].value for name in ("m_b", "m_l"))
    body_m, leg_m = _heights_m(plant, outputs["z_b"]), _heights_m(plant, outputs["z_l"])
    com_m = (body_kg * body_m + leg_kg * leg_m) / (body_kg + leg_kg)
    return Trace(times_s, com_m - com_m[0], outputs["z_l"], outputs["ground_force"], opening_s)


def _opening_s(plant: Plant, conditions: Mapping[str, float | str], known: Mapping[str, float]) -> float:
    simulator = Simulator(plant, conditions=conditions, known=known, events={FIRE: 0.0}, definitions=False)
    simulator.advance(1.0)
    opening_s = simulator.flag_time_s(OPENED)
    if opening_s is None:
        raise SimulationFault("the lock has not opened within 1 s of the fire command")
    return opening_s


def _longest_flight_s(plant: Plant, compression_m: float) -> float:
    """A time by which the foot must be back, were all the energy to go into the flight [s]."""
    weight_n, stiffness_n_m, body_n = _statics(plant)
    height_m = (0.5 * stiffness_n_m * compression_m + body_n) * compression_m / weight_n
    return 0.5 + 2.0 * math.sqrt(2.0 * height_m / plant.parameters["g"].value)


def _heights_m(plant: Plant, along_m: Floats) -> Floats:
    """Height of a coordinate: itself, or on the arm that of an arc of radius L_CoM."""
    if plant.geometry != "arm":
        return along_m
    radius_m = plant.parameters["L_CoM"].value
    return radius_m * np.sin(along_m / radius_m)


def flight_of(trace: Trace) -> tuple[int, float, float] | None:
    """The flight over the first apex: its look, take-off and touchdown [s]; None where the foot stays.

    The foot leaves where the contact force vanishes. Soil that was pressed down stays down, so that the foot
    is back when it has the height at which it left.
    """
    falling = np.flatnonzero((np.diff(trace.com_m) < 0.0) & (trace.contact_n[1:] == 0.0))
    if not len(falling):
        return None
    apex = int(falling[0])
    last = int(np.flatnonzero(trace.contact_n[:apex] > 0.0)[-1])
    # the force falls to zero on a line: extrapolated from its own side, where it is one
    fall_n = trace.contact_n[last - 1] - trace.contact_n[last]
    share = min(1.0, trace.contact_n[last] / fall_n) if fall_n > 0.0 else 1.0
    take_off_s = float(trace.times_s[last] + share * LOOK_S)
    left_m = float(np.interp(take_off_s, trace.times_s, trace.foot_m))
    back = apex + int(np.flatnonzero(trace.contact_n[apex:] > 0.0)[0])
    drop_m = trace.foot_m[back - 1] - trace.foot_m[back]
    share = float(np.clip((trace.foot_m[back - 1] - left_m) / drop_m, 0.0, 1.0))
    return apex, take_off_s, float(trace.times_s[back - 1] + share * LOOK_S)


def apex_m(trace: Trace) -> float:
    """Highest centre of mass before the first touchdown, above its start [m]."""
    flight = flight_of(trace)
    return float(trace.com_m[: flight[0] + 1].max() if flight else trace.com_m.max())


def hop_truth(
    plant: Plant,
    conditions: Mapping[str, float | str],
    compression_m: float,
    *,
    hop: int,
    spot: Spot,
    fire_s: float,
) -> HopTruth:
    """The truth of one hop that began from rest with a given compression at `fire_s`."""
    own = trace_hop(plant, conditions, compression_m)
    steel = {**conditions, "surface": REFERENCE, "tilt_deg": 0.0, "hop_index": 0.0}
    weight_n, stiffness_n_m, body_n = _statics(plant)
    own_j = weight_n * apex_m(own)
    reference_j = weight_n * apex_m(trace_hop(plant, steel, compression_m))
    flight = flight_of(own)
    leaving = own.times_s <= flight[1] if flight else np.ones(len(own.times_s), dtype=bool)
    return HopTruth(
        hop=hop,
        spot=spot,
        spring_compression_m=compression_m,
        energy_used_j=0.5 * stiffness_n_m * compression_m**2 + body_n * compression_m,
        fire_s=fire_s,
        opening_s=fire_s + own.opening_s,
        take_off_s=fire_s + flight[1] if flight else None,
        touchdown_s=fire_s + flight[2] if flight else None,
        time_of_flight_s=flight[2] - flight[1] if flight else None,
        hop_height_m=own_j / weight_n,
        energy_potential_j=own_j,
        reference_energy_potential_j=reference_j,
        c3=1.0 - own_j / reference_j if reference_j > 0.0 else 0.0,
        sinkage_m=float(-own.foot_m[leaving].min()),
    )


def _statics(plant: Plant) -> tuple[float, float, float]:
    """Weight of the robot [N], spring stiffness [N/m], weight of the body = k f_grav [N]."""
    body_kg, leg_kg, gravity_m_s2, stiffness_n_m = (
        plant.parameters[name].value for name in ("m_b", "m_l", "g", "k")
    )
    return (body_kg + leg_kg) * gravity_m_s2, stiffness_n_m, body_kg * gravity_m_s2
