"""The devices of `hal.devices` on the simulated rig."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

from hal.errors import CommandRefused, DeviceClosed, DeviceError, ReadFailed
from hal.readings import (
    GroundCommand,
    MagnetCurrent,
    MotorCurrent,
    NutPosition,
    SpecificForce,
    SpringCompression,
    Switches,
)
from sim_hal.rig import Rig


class SimDevice:
    """What all simulated devices share: a name, the rig, and being closed once and for all."""

    def __init__(self, name: str, rig: Rig) -> None:
        self._name = name
        self._rig = rig
        self._closed = False

    def close(self) -> None:
        """Leave the device safe and unusable. May be called again."""
        if not self._closed:
            self._make_safe()
        self._closed = True

    def _make_safe(self) -> None:
        """Take the power from an actuator; sensors have nothing to do."""

    def _require_open(self) -> None:
        if self._closed:
            raise DeviceClosed(f"{self._name}: used after it was closed")

    def _require_reading(self) -> None:
        if not (self._closed or self._rig.faults.planted):
            return  # nearly always
        self._require_open()
        if not self._rig.answers(self._name):
            raise ReadFailed(f"{self._name}: no answer at {self._rig.now_s:.4f} s")

    def _require_obedience(self) -> None:
        if not (self._closed or self._rig.faults.planted):
            return
        self._require_open()
        if not self._rig.answers(self._name):
            raise DeviceError(f"{self._name}: command not acknowledged at {self._rig.now_s:.4f} s")


class SimMotor(SimDevice):
    """The tensioning motor."""

    def __init__(self, name: str, rig: Rig, max_voltage_v: float) -> None:
        super().__init__(name, rig)
        self._max_voltage_v = max_voltage_v

    @property
    def max_voltage_v(self) -> float:
        """Largest magnitude of voltage that can be commanded."""
        return self._max_voltage_v

    def set_voltage_v(self, voltage_v: float) -> None:
        """Apply the voltage until the next command; positive tensions."""
        self._require_obedience()
        if not (math.isfinite(voltage_v) and abs(voltage_v) <= self._max_voltage_v):
            raise CommandRefused(f"motor: {voltage_v!r} V is outside ±{self._max_voltage_v:g} V")
        self._rig.command_voltage_v(float(voltage_v))

    def _make_safe(self) -> None:
        self._rig.command_voltage_v(0.0)


class SimMagnet(SimDevice):
    """The electromagnet of the lock."""

    def switch_on(self) -> None:
        """Apply the supply to the coil."""
        self._require_obedience()
        self._rig.command_magnet(True)

    def switch_off(self) -> None:
        """Take the supply from the coil."""
        self._require_obedience()
        self._rig.command_magnet(False)

    def _make_safe(self) -> None:
        self._rig.command_magnet(False)


class _Sampled(SimDevice):
    """A device that reads one of the rig's sampled sensors."""

    def __init__(self, name: str, rig: Rig) -> None:
        super().__init__(name, rig)
        self._sensor = rig.sensors[name]


class SimNutEncoder(_Sampled):
    """Nut travel from its position at power-up."""

    def read(self) -> NutPosition:
        """The latest position."""
        self._require_reading()
        return NutPosition(*self._sensor.poll())


class SimMotorCurrentSensor(_Sampled):
    """Current of the tensioning motor."""

    def read(self) -> MotorCurrent:
        """The latest current."""
        self._require_reading()
        time_s, current_a = self._sensor.poll()
        return MotorCurrent(time_s, current_a, self._rig.supply_v)


class SimSwitches(SimDevice):
    """Home switch and latch sensor."""

    def __init__(self, name: str, rig: Rig) -> None:
        super().__init__(name, rig)
        self._last: Switches | None = None

    def read(self) -> Switches:
        """The state of both contacts now."""
        self._require_reading()
        rig = self._rig
        fault = rig.faults.active(self._name, rig.now_s) if rig.faults.planted else None
        world = rig.world
        if fault not in ("stick", "silent") or self._last is None:
            self._last = Switches(rig.now_s, world.at_home, world.latch_closed)
            return self._last
        if fault == "silent" or (self._last.at_home, self._last.latch_closed) != (
            world.at_home,
            world.latch_closed,
        ):
            self._rig.note_effect(self._name)
        if fault == "stick":
            self._last = Switches(self._rig.now_s, self._last.at_home, self._last.latch_closed)
        return self._last


class _Streamed(_Sampled):
    """A sensor with a FIFO."""

    def set_rate_hz(self, rate_hz: float) -> None:
        """Sample at this rate from now on. Raises `CommandRefused` for a rate the part does not have."""
        self._require_reading()
        self._sensor.set_rate_hz(rate_hz)


class SimSpringSensor(_Streamed):
    """Spring compression beyond the body's own weight."""

    def read(self) -> SpringCompression:
        """All samples since the last read; may be empty."""
        self._require_reading()
        times_s, values, _, overrun = self._sensor.take()
        return SpringCompression(times_s, values, overrun)


class SimMagnetCurrentSensor(_Streamed):
    """Magnet current."""

    def read(self) -> MagnetCurrent:
        """All samples since the last read; may be empty."""
        self._require_reading()
        times_s, values, _, overrun = self._sensor.take()
        return MagnetCurrent(times_s, values, overrun)


class SimAccelerometer(_Streamed):
    """Accelerometer on the body."""

    @property
    def range_m_s2(self) -> float:
        """Largest magnitude that can be read."""
        return self._sensor.mode.high

    @property
    def resolution_m_s2(self) -> float:
        """Size of one digital step."""
        return self._sensor.step

    def read(self) -> SpecificForce:
        """All samples since the last read; may be empty."""
        self._require_reading()
        times_s, values, saturated, overrun = self._sensor.take()
        return SpecificForce(times_s, values, saturated, overrun)


class SimWatchdog(SimDevice):
    """Cuts all actuator power, for good, when it is not stroked in time."""

    @property
    def timeout_s(self) -> float:
        """Longest allowed time between two strokes."""
        return self._rig.watchdog_timeout_s

    def stroke(self) -> None:
        """Say that the flight software is alive."""
        self._require_open()
        self._rig.stroke()


class LoopbackLink(SimDevice):
    """A ground link whose ground side sits in the same process: `command` and `telemetry`."""

    def __init__(self, name: str, rig: Rig, depth: int) -> None:
        super().__init__(name, rig)
        self._commands: list[GroundCommand] = []
        self.telemetry: deque[tuple[float, str, str]] = deque(maxlen=depth)
        """What flight sent, oldest first: time [s], topic, payload."""

    def command(
        self, name: str, arguments: Mapping[str, float] | None = None, *, authenticated: bool = True
    ) -> None:
        """Ground side: send a command; flight receives it with its next call."""
        pairs = tuple((arguments or {}).items())
        self._commands.append(GroundCommand(self._rig.now_s, name, pairs, authenticated))

    def receive(self) -> tuple[GroundCommand, ...]:
        """The commands that arrived since the last call, oldest first."""
        self._require_open()
        arrived, self._commands = tuple(self._commands), []
        return arrived

    def send(self, topic: str, payload: str) -> None:
        """Hand one telemetry message (JSON text) to the ground. Never blocks."""
        self._require_open()
        self.telemetry.append((self._rig.now_s, topic, payload))
