"""What the memory keeps of the spring, so that a cut of the power at any instant leaves a truth.

It is written before the spring is loaded, before the robot is armed, and only after sensors have shown that
nothing is stored. It never makes the spring count as unloaded: that is for sensors to show.
"""

from __future__ import annotations

import json
from typing import NamedTuple

from flight.states import Event, Machine, Phase, Target
from hal.devices import Memory
from hal.errors import DeviceError, ReadFailed


class SpringRecord(NamedTuple):
    """Whether the spring may hold energy, whether the robot may be armed, and the energy [J] that was asked for."""

    loaded: bool = True
    armed: bool = False
    energy_j: float = 0.0

    @classmethod
    def of(cls, machine: Machine) -> SpringRecord:
        """What is to be kept of a machine."""
        armed = machine.phase in (Phase.ARMED, Phase.FIRING)
        target_j = machine.target.energy_used_j if machine.target and machine.loaded else 0.0
        return cls(machine.loaded, armed, target_j)


class SpringKeeper:
    """Keeps the memory's record in step with the machine."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._kept: SpringRecord | None = None
        self._seen: tuple[bool, Phase, Target | None] | None = None  # what the record is made of
        self.failed = False

    def found(self) -> Event:
        """What the memory says at power-up; a record that is missing or damaged counts as a loaded spring."""
        try:
            text = self._memory.read()
            if not text:
                return Event("spring_record", {"known": False, "loaded": True})
            return Event("spring_record", {"known": True, **SpringRecord(**json.loads(text))._asdict()})
        except (ReadFailed, ValueError, TypeError) as error:
            return Event("spring_record", {"known": False, "loaded": True, "error": str(error)})

    def keep(self, machine: Machine) -> Event | None:
        """Put a change on record, before anything is done about it; an event when that failed."""
        seen = machine.loaded, machine.phase, machine.target
        if seen == self._seen:  # nearly always
            return None
        record = SpringRecord.of(machine)
        if record == self._kept:
            self._seen = seen
            return None
        try:
            self._memory.write(json.dumps(record._asdict()))
        except DeviceError as error:
            was, self.failed = self.failed, True
            return None if was else Event("spring_record_unwritten", {"error": str(error)})
        self._kept, self._seen, self.failed = record, seen, False
        return None
