"""Each kind of fault that the campaign plants, alone: that it changes the flight is shown by the flight's log.

    python -m benchmarks.fault_effects [--json FILE] [--seed N]

The same mission is flown without a fault and with each kind (of middle size, from one second on, for good), and the
logs are compared message by message. `unseen`: kinds that say they had an effect and left the log as it was, or the
reverse; `silent`: kinds that had none, because this mission gave them no occasion.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.figures import write_figures
from flight.log import LogSettings, McapLog
from ground.fault_campaign import flying
from ground.fault_campaign.drawing import CampaignSettings, FaultCase, PlantedFault, load_campaign
from ground.fault_campaign.flying import CaseResult, fly_case

ENERGY_J = 0.8
FROM_S = 1.0


class Heard(McapLog):
    """The log of a case, whose messages are kept as well."""

    messages: list[str]

    def __init__(self, path: Path, metadata: Mapping[str, str], limits: LogSettings | None = None) -> None:
        super().__init__(path, metadata, limits)
        Heard.messages = []

    def write(self, topic: str, time_s: float, payload: Mapping[str, Any]) -> None:
        """Record one message, and keep it as text."""
        super().write(topic, time_s, payload)
        Heard.messages.append(f"{topic} at {time_s:.3f} s: {json.dumps(payload, default=dict)}")


def flown(settings: CampaignSettings, seed: int, *faults: PlantedFault) -> tuple[CaseResult, list[str]]:
    """What came of the mission with these faults, and its log."""
    case = FaultCase(0, seed, "quartz_sand", ENERGY_J, 0.0, False, faults)
    result = fly_case(settings, case)
    return result, Heard.messages


def first_difference(one: list[str], other: list[str]) -> str:
    """The first message that only `other` has, shortened; empty when there is none."""
    for index, message in enumerate(other):
        if index >= len(one) or one[index] != message:
            return message[:60]
    return "the log ends" if len(other) < len(one) else ""


def look(seed: int) -> dict[str, int]:
    """Fly each kind, print what came of it, and count."""
    settings = load_campaign()
    flying.McapLog = Heard  # type: ignore[attr-defined]
    without, plain = flown(settings, seed)
    print(f"without a fault: {without.end_reason}, {len(plain)} messages")
    counts = {"kinds": 0, "seen": 0, "silent": 0, "unseen": 0, "hazards": 0}
    for device, kind, low, high in settings.kinds:
        # between its middle and its largest: the middle of a range about none is none
        fault = PlantedFault(device, kind, FROM_S, None, 0.25 * low + 0.75 * high)
        result, log = flown(settings, seed, fault)
        said, differs = bool(result.effects_s), first_difference(plain, log)
        counts["kinds"] += 1
        counts["seen"] += said and bool(differs)
        counts["silent"] += not said and not differs
        counts["unseen"] += said != bool(differs)
        counts["hazards"] += bool(result.hazards)
        at = f"{result.effects_s[0]:.2f} s" if said else "none"
        dangers = f"HAZARD {', '.join(result.hazards)}; " if result.hazards else ""
        print(f"{device:15s} {kind:8s} effect {at:8s} {result.end_reason:28s} {dangers}{differs}")
    return counts


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts = look(options.seed)
    print(", ".join(f"{name}: {value}" for name, value in counts.items()))
    if options.json:
        write_figures(options.json, {name: (value, "1") for name, value in counts.items()})
    raise SystemExit(1 if counts["unseen"] or counts["hazards"] else 0)


if __name__ == "__main__":
    main()
