"""Recordings for the tests: one of a hop, and a Hypothesis strategy for any."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from ground.recordings import Event, Recording, SensorSpec, Table

SHARED = Path(__file__).resolve().parents[2] / "../shared"


def small_hop() -> Recording:
    """Five samples of a hop, one missing."""
    return Recording(
        np.array([0.0, 0.0006, 0.0012, 0.0018, 0.0025]),
        {
            "body_acceleration_m_s2": np.array([8.9, -310.25, 1e-300, -0.0, 0.1 + 0.2]),
            "magnet_current_a": np.array([0.0, 0.5, np.nan, 1.0, 1.5]),
        },
        run="bb0b-004",
        rig="bb0b",
        kind="hop",
        sensors={"magnet_current_a": SensorSpec(0.005, 0.001, (-3.2, 3.2))},
        conditions={"surface": "quartz_sand", "foot": 1, "gravity_m_s2": 8.874, "hop_index": 3, "place": "A"},
        events=(Event("fire_command", 0.001),),
        state={"spring_compression_m": 0.0362},
        notes="first light: 1e-5",
        extra_tables={
            "drive": Table(np.array([-30.0, -29.995]), {"motor_voltage_v": np.array([12.0, 11.5])})
        },
    )


finite = st.floats(allow_nan=False, allow_infinity=False)
names = st.from_regex(r"[a-z][a-z0-9]{0,5}(_[a-z0-9]{1,3})?", fullmatch=True)
texts = st.text(max_size=20)
filled_texts = texts.filter(lambda text: text.strip())


@st.composite
def tables(draw: st.DrawFn, low_s: float = -1e6, high_s: float = 1e6) -> Table:
    """Any table."""
    count = draw(st.integers(1, 6))
    times = draw(
        st.lists(st.floats(low_s, high_s), min_size=count, max_size=count, unique_by=lambda time: time + 0.0)
    )
    values = hnp.arrays(np.float64, count, elements=finite | st.just(float("nan")))
    units = st.sampled_from(["m", "m_s2", "a", "v", "rad_s", "n", "n_m"])
    channels = draw(st.dictionaries(st.builds("{}_{}".format, names, units), values, min_size=1, max_size=3))
    channels.pop("time_s", None)
    return Table(np.array(sorted(times)), channels)


specs = st.builds(
    SensorSpec,
    st.none() | st.floats(0.0, 1e300),
    st.none() | st.floats(0.0, 1e300),
    st.none() | st.tuples(st.floats(-1e300, -1e-300), st.floats(0.0, 1e300)),
)


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    """Any recording."""
    table = draw(tables())
    conditions: dict[str, float | str] = {
        "surface": draw(filled_texts),
        "foot": draw(st.integers(0, 4)),
        "gravity_m_s2": draw(finite),
        "payload_kg": draw(finite),
        "operator": draw(texts),
    }
    return Recording(
        table.times_s,
        table.channels,
        run=draw(filled_texts),
        rig=draw(filled_texts),
        kind=draw(names),
        sensors={channel: draw(specs) for channel in table.channels},
        conditions=conditions,
        events=tuple(draw(st.lists(st.builds(Event, filled_texts, finite), max_size=2))),
        state=draw(st.dictionaries(texts, finite, max_size=2)),
        notes=draw(texts),
        extra_tables=draw(st.dictionaries(names.filter(lambda name: name != "yaml"), tables(), max_size=2)),
    )
