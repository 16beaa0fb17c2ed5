"""Units mixed up: a channel that moves as the plant says it should, but a thousand times as far."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ground.diagnose.segments import Segment
from sim_hal.plant.simulate import Plant, SimulationError, compile_plant
from sim_hal.plant.structure import bare_numbers
from sim_hal.plant.units import channel_unit

PARTS = {1e3: "thousandths", 1e6: "millionths", 100.0: "hundredths"}
"""How much larger a reading in a part of the unit is."""
DEGREES = 180.0 / math.pi
NEAR = 1.25
"""A ratio this near to a conversion, as a factor, is taken for it: no plant file is so far off by chance."""
FOLLOWS = 0.5
"""Correlation above which a channel moves as it was predicted."""


def unlike_units(plant: Plant, whole: Sequence[Segment]) -> tuple[str, ...]:
    """What a reader should check: channels that follow the plant as given on another scale, by a unit's factor."""
    notes = []
    for column, channel in enumerate(compile_plant(plant).output_names):
        ratio = median_ratio([pair for s in whole if (pair := moves(plant, s, column)) is not None])
        unit = channel_unit(channel)
        for factor, words in mistakes(unit):
            if ratio is not None and abs(math.log(ratio / factor)) < math.log(NEAR):
                notes.append(
                    f"Channel {channel} reads about {ratio:.3g} times what the plant as given predicts, in step "
                    f"with it: are these {words}, not {unit}? A mapping converts units (`hopper import`)."
                )
    return tuple(notes)


def unstated_units(plant: Plant) -> tuple[str, ...]:
    """What a reader should check: numbers in the plant's formulas that stand for something with a unit."""
    return tuple(
        f"The plant file has a number without a unit, taken as it stands in SI units ({place}); as a parameter it "
        "would be checked, and could have a tolerance."
        for place in bare_numbers(plant.structure)
    )


def mistakes(unit: str) -> Iterator[tuple[float, str]]:
    """Factors by which a reading in a wrong unit is off, with that unit in words."""
    for factor, part in PARTS.items():
        yield factor, f"{part} of {unit}"
        yield 1.0 / factor, f"multiples of {factor:.0f} {unit}"
    if "rad" in unit:
        yield DEGREES, unit.replace("rad", "deg")


def moves(plant: Plant, segment: Segment, column: int) -> tuple[float, float] | None:
    """How far a channel was predicted to move and did (standard deviations); None where one follows not the other.

    The plant runs from rest where its start is open: a start that is read in the wrong unit would carry it along.
    """
    compiled = compile_plant(plant)
    start = compiled.initial_values(compiled.values, segment.run)
    open_at_zero = {name: 0.0 if name in segment.open_scales else value for name, value in start.items()}
    try:
        predicted = compiled.run(compiled.values, segment.run, open_at_zero)[:, column]
    except SimulationError:
        return None
    measured = segment.observed[:, column]
    seen = np.isfinite(measured) & np.isfinite(predicted)
    if seen.sum() < 3 or np.ptp(measured[seen]) == 0.0 or np.ptp(predicted[seen]) == 0.0:
        return None
    if abs(np.corrcoef(predicted[seen], measured[seen])[0, 1]) < FOLLOWS:
        return None
    return float(np.std(predicted[seen])), float(np.std(measured[seen]))


def median_ratio(pairs: Sequence[tuple[float, float]]) -> float | None:
    """Median over recordings of measured over predicted movement."""
    return float(np.median([measured / predicted for predicted, measured in pairs])) if pairs else None
