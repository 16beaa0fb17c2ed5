"""What the robot records of one hop, from arming to standing still again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hal.readings import MagnetCurrent, SpecificForce, SpringCompression

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HopRecord:
    """Samples of one hop on the board's clock; each sensor has its own times, increasing.

    Shapes: accelerometer arrays (n,), spring arrays (m,). `fire_s` is when the magnet was energised.
    `complete` is False when a sensor lost samples within the record.
    """

    fire_s: float
    times_s: Array
    specific_force_m_s2: Array
    saturated: NDArray[np.bool_]
    spring_times_s: Array
    compression_m: Array
    complete: bool = True


@dataclass
class HopRecorder:
    """Collects the batches of one hop as they come from the FIFOs."""

    _accelerometer: list[SpecificForce] = field(default_factory=list)
    _spring: list[SpringCompression] = field(default_factory=list)
    _magnet: list[MagnetCurrent] = field(default_factory=list)

    def clear(self) -> None:
        self._accelerometer.clear()
        self._spring.clear()
        self._magnet.clear()

    def add(
        self, force: SpecificForce | None, spring: SpringCompression | None, magnet: MagnetCurrent | None
    ) -> None:
        """Keep one tick's batches; a batch that could not be read is None."""
        if force is not None:
            self._accelerometer.append(force)
        if spring is not None:
            self._spring.append(spring)
        if magnet is not None:
            self._magnet.append(magnet)

    def record(self, fire_s: float) -> HopRecord:
        """The hop so far, as arrays."""
        flags = [
            batch.saturated if batch.saturated else (False,) * len(batch.times_s)
            for batch in self._accelerometer
        ]
        return HopRecord(
            fire_s=fire_s,
            times_s=_joined([batch.times_s for batch in self._accelerometer]),
            specific_force_m_s2=_joined([batch.specific_force_m_s2 for batch in self._accelerometer]),
            saturated=np.array([flag for batch in flags for flag in batch], dtype=np.bool_),
            spring_times_s=_joined([batch.times_s for batch in self._spring]),
            compression_m=_joined([batch.compression_m for batch in self._spring]),
            # An overrun told by the first batch concerns samples from before the record.
            complete=not any(
                [batch.overrun for batch in self._accelerometer[1:]]
                + [batch.overrun for batch in self._spring[1:]]
            ),
        )


def _joined(batches: Sequence[tuple[float, ...]]) -> Array:
    return np.array([value for batch in batches for value in batch], dtype=np.float64)
