"""A layout for the field's MCAP viewers (Foxglove, Lichtblick): a flight log as plots, phases, events and hops."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ground.files import write_atomic

PLOTS = {
    "Spring compression [m]": ("outputs.compression_m", "spring.result.compression_m[0]"),
    "Motor voltage [V] and current [A]": ("outputs.voltage_v", "motor_current.result.current_a"),
    "Specific force [m/s²]": ("accelerometer.result.specific_force_m_s2[0]",),
    "Magnet current [A]": ("magnet_current.result.current_a[0]",),
}
"""Title of each plot, and the fields of the log's messages that it shows."""
PHASES = "state.to"
TABLES = ("event", "hop")


def layout() -> dict[str, Any]:
    """The layout as the viewers import it."""
    panels: dict[str, Any] = {
        f"Plot!{number}": {
            "title": title,
            "paths": [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths],
            "showLegend": True,
            "isSynced": True,
            "xAxisVal": "timestamp",
        }
        for number, (title, paths) in enumerate(PLOTS.items())
    }
    panels["StateTransitions!phases"] = {
        "paths": [{"value": PHASES, "timestampMethod": "receiveTime", "label": "phase"}],
        "isSynced": True,
    }
    for topic in TABLES:
        panels[f"RawMessages!{topic}"] = {"topicPath": topic, "diffEnabled": False}
    left = _stack([name for name in panels if name.startswith(("Plot", "State"))])
    right = _stack([f"RawMessages!{topic}" for topic in TABLES])
    split = {"direction": "row", "first": left, "second": right, "splitPercentage": 70}
    return {"configById": panels, "globalVariables": {}, "userNodes": {}, "layout": split}


def _stack(names: list[str]) -> Any:
    """Panels one below the other, as the viewers nest them."""
    if len(names) == 1:
        return names[0]
    share = 100.0 / len(names)
    return {
        "direction": "column",
        "first": names[0],
        "second": _stack(names[1:]),
        "splitPercentage": share,
    }


def write_layout(path: Path) -> Path:
    """Write the layout, whole or not at all. Returns `path`."""
    return write_atomic(path, json.dumps(layout(), indent=1, ensure_ascii=False) + "\n")
