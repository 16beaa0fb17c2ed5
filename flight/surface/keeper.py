"""The memory's record of the ground: read at power-up, written after each hop, whole or as it was."""

from __future__ import annotations

from flight.states import Event
from flight.surface.known import SurfaceSettings
from flight.surface.learner import GroundRecord, from_text, to_text
from flight.surface.settings import SurfaceLearning
from hal.devices import Memory
from hal.errors import DeviceError, ReadFailed


class GroundKeeper:
    """Keeps what is known of the ground; losing it costs knowledge, never safety."""

    def __init__(self, memory: Memory, surfaces: SurfaceSettings, settings: SurfaceLearning) -> None:
        self._memory, self._surfaces, self._settings = memory, surfaces, settings
        self._kept = ""

    def found(self) -> tuple[GroundRecord, Event]:
        """What the memory holds; one that is missing or damaged counts as nothing known, and is said to be."""
        try:
            self._kept = self._memory.read()
            if not self._kept:
                return GroundRecord(), Event("ground_record", {"known": False})
            record = from_text(self._kept, self._surfaces, self._settings)
        except (ReadFailed, ValueError) as error:
            return GroundRecord(), Event("ground_record", {"known": False, "error": str(error)})
        hops = record.tracker.hops if record.tracker else 0
        return record, Event("ground_record", {"known": True, "learned": len(record.learned), "hops": hops})

    def keep(self, record: GroundRecord) -> Event | None:
        """Put it on record, if it has changed; an event when that failed."""
        text = to_text(record)
        if text == self._kept:
            return None
        try:
            self._memory.write(text)
        except DeviceError as error:
            return Event("ground_record_unwritten", {"error": str(error)})
        self._kept = text
        return None
