"""Runs that a laboratory would make with each kind of rig, drawn at random; nothing is simulated or measured yet.

A run is a recording whose measured channels are still empty: inputs, events, conditions and known start are there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ground.recordings.model import Event, Recording, SensorSpec
from sim_hal.plant.simulate import Plant

Float = NDArray[np.float64]

DRIVE_RATE_HZ, HOP_RATE_HZ, AXIS_RATE_HZ = 200.0, 1666.0, 200.0


def runs_of(plant: Plant, count: int, random: Generator) -> list[Recording]:
    """`count` empty recordings of runs for a plant of a built-in kind."""
    return _MAKERS[plant.kind](plant, count, random)


def empty(
    plant: Plant,
    number: int,
    times_s: Float,
    *,
    inputs: Mapping[str, Float] | None = None,
    events: tuple[Event, ...] = (),
    state: Mapping[str, float] | None = None,
    conditions: Mapping[str, float | str] | None = None,
) -> Recording:
    """A recording that says all about a run but what was measured; stamps to the microsecond."""
    blank = dict.fromkeys(plant.structure.outputs, np.full(times_s.size, math.nan))
    sensors = {name: SensorSpec(s.noise_std, s.resolution, s.range) for name, s in plant.sensors.items()}
    return Recording(
        np.round(times_s, 6),
        {**(inputs or {}), **blank},
        run=f"run_{number:02d}",
        rig=plant.name,
        kind=plant.kind,
        sensors=sensors,
        events=events,
        state=state or {},
        conditions=conditions or {},
    )


def sampled(duration_s: float, rate_hz: float) -> Float:
    """Even sample times from 0."""
    return np.asarray(np.arange(round(duration_s * rate_hz)) / rate_hz)


def hops(plant: Plant, count: int, random: Generator) -> list[Recording]:
    """Hops from two spots by turns, each of its own soil, at compressions all over the drive's range."""
    soft = [name for name, surface in plant.surfaces.items() if surface["chi"].value > 0.0]
    surfaces = random.choice(soft, 2, replace=False)
    compressions = random.permutation(np.linspace(0.0225, 0.0375, count) + random.uniform(-8e-4, 8e-4, count))
    found = []
    for number in range(count):
        fire = round(0.05 + random.uniform(0.0, 6e-4), 6)
        conditions: dict[str, float | str] = {
            "surface": str(surfaces[number % 2]),
            "foot": 1.0,
            "tilt_deg": 0.0,
            "gravity_m_s2": plant.parameters["g"].value,
            "temperature_c": 20.0,
            "hop_index": float(number // 2),
            "place": "AB"[number % 2],
        }
        times = sampled(random.uniform(1.0, 1.25), HOP_RATE_HZ)
        run = empty(
            *(plant, number + 1, times),
            events=(Event("fire_command", fire),),
            state={"spring_compression_m": round(float(compressions[number]), 6)},
            conditions=conditions,
        )
        found.append(run)
    return found


def drives(plant: Plant, count: int, random: Generator) -> list[Recording]:
    """Tensionings of 22 to 29 s with ramps, steps, holds, reversals and wiggles of the voltage."""
    found = []
    for number in range(count):
        times = sampled(random.uniform(22.0, 29.0), DRIVE_RATE_HZ)
        voltage = tensioning_voltage(times, random)
        conditions = {"temperature_c": 20.0}
        state = {"spring_compression_m": 0.0, "nut_position_m": 0.0}
        inputs = {"motor_voltage_v": voltage}
        found.append(empty(plant, number + 1, times, inputs=inputs, state=state, conditions=conditions))
    return found


def tensioning_voltage(times_s: Float, random: Generator) -> Float:
    """Pieces of voltage one after the other, limited in slew, rounded to a millivolt."""
    wanted = np.zeros(times_s.size)
    at = random.uniform(0.2, 0.6)
    first = True
    while at < times_s[-1]:
        length, piece = voltage_piece(random, first)
        inside = (times_s >= at) & (times_s < at + length)
        wanted[inside] = piece(times_s[inside] - at)
        at, first = at + length, False
    step = 10.0 ** random.uniform(1.0, 2.2) / DRIVE_RATE_HZ
    voltage: Float = np.zeros(times_s.size)
    for i in range(1, times_s.size):
        voltage[i] = voltage[i - 1] + np.clip(wanted[i] - voltage[i - 1], -step, step)
    return np.asarray(np.round(np.clip(voltage, -12.0, 12.0), 3), dtype=np.float64)


def voltage_piece(random: Generator, first: bool) -> tuple[float, Callable[[Float], Float]]:
    """One piece: its length in seconds and the voltage over the time since it began."""
    kind = "tension" if first else str(random.choice(["tension", "tension", "hold", "reverse", "wiggle"]))
    if kind == "tension":
        level, end = random.uniform(5.5, 10.0, 2)
        length = random.uniform(2.0, 4.5)
        return length, lambda t: np.asarray(level + (end - level) * t / length, dtype=np.float64)
    if kind == "hold":
        level = random.uniform(0.2, 1.2)
        return random.uniform(0.8, 3.0), lambda t: np.full(t.size, level)
    if kind == "reverse":
        level = -random.uniform(0.5, 4.5)
        return random.uniform(0.3, 1.4), lambda t: np.full(t.size, level)
    mean, swing = random.uniform(2.0, 3.5), random.uniform(1.0, 3.0)
    period, length = random.uniform(0.4, 3.0), random.uniform(1.5, 4.0)
    return length, lambda t: np.asarray(mean + swing * np.sin(2 * np.pi * t / period))


def axes(plant: Plant, count: int, random: Generator) -> list[Recording]:
    """Forces with reversals on a mass at rest: sines, and pushes with pauses between."""
    found = []
    for number in range(count):
        times = sampled(random.uniform(3.0, 5.0), AXIS_RATE_HZ)
        force = sines(times, random) if number % 2 == 0 else pushes(times, random)
        found.append(
            empty(
                *(plant, number + 1, times),
                inputs={"force_n": np.round(force, 3)},
                state={"position_m": 0.0, "velocity_m_s": 0.0},
                conditions={"temperature_c": 20.0},
            )
        )
    return found


def sines(times_s: Float, random: Generator) -> Float:
    """Three cosines, so that a free mass swings about its start; cut to full size in the first second."""
    force = np.zeros(times_s.size)
    for frequency in random.uniform(0.25, 2.5, 3):
        force += random.uniform(3.0, 12.0) * np.cos(2 * np.pi * frequency * times_s)
    return force


def pushes(times_s: Float, random: Generator) -> Float:
    """Push, brake, pause, and the same back, ever again with other forces."""
    force = np.zeros(times_s.size)
    at, sign = 0.2, 1.0
    while at < times_s[-1]:
        push, pause = random.uniform(0.2, 0.6), random.uniform(0.1, 0.5)
        level = sign * random.uniform(4.0, 16.0)
        force[(times_s >= at) & (times_s < at + push)] = level
        force[(times_s >= at + push) & (times_s < at + 2 * push)] = -level
        at, sign = at + 2 * push + pause, -sign
    return force


def drops(plant: Plant, count: int, random: Generator) -> list[Recording]:
    """Falls from up to 8 m and tosses, so that speeds of both signs occur."""
    found = []
    for number in range(count):
        speed = random.uniform(1.5, 6.0) if number % 2 else random.uniform(-0.5, 0.5)
        times = sampled(random.uniform(0.7, 1.2), HOP_RATE_HZ)
        state = {
            "height_m": round(float(random.uniform(5.0, 8.0)), 4),
            "velocity_m_s": round(float(speed), 4),
        }
        found.append(empty(plant, number + 1, times, state=state, conditions={"temperature_c": 20.0}))
    return found


_MAKERS: dict[str, Callable[[Plant, int, Generator], list[Recording]]] = {
    "hop": hops,
    "drive": drives,
    "axis": axes,
    "drop": drops,
}
