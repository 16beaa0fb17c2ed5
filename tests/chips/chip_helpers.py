"""Opening the emulated board with changes, and parts of it alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hal.config import build_settings, config_path, read_yaml
from hal.raspberry_pi.settings import PiSettings
from sim_hal.chips.board import EmulatedBoard, open_emulated
from sim_hal.chips.faults import I2C_BLOCKS, WireFaults
from sim_hal.chips.i2c import FUNCTIONS, Chip, EmulatedBus
from sim_hal.sensors import Sample

Opener = Callable[..., EmulatedBoard]

TICK_S = 0.005


def emulated_settings(**changes: Any) -> dict[str, Any]:
    """The shipped settings, without the self-test at opening (which takes 0.4 s) unless asked for."""
    found: dict[str, Any] = read_yaml(config_path("boards", "raspberry_pi_emulated.yaml"))
    wiring = dict(changes.pop("wiring", {}))
    wiring["accelerometer"] = {"self_test": False, **wiring.get("accelerometer", {})}
    return {**found, **changes, "wiring": wiring}


def opened(**changes: Any) -> EmulatedBoard:
    return open_emulated(emulated_settings(**changes))


def pi_settings() -> PiSettings:
    """The robot's own settings."""
    return build_settings(
        read_yaml(config_path("boards", "raspberry_pi.yaml")), PiSettings, "raspberry_pi.yaml"
    )


def run_ticks(board: EmulatedBoard, ticks: int, voltage_v: float | None = None) -> None:
    """Let time pass as flight does, watchdog stroked, motor commanded where a voltage is given."""
    for _ in range(ticks):
        board.watchdog.stroke()
        if voltage_v is not None:
            board.motor.set_voltage_v(voltage_v)
        board.clock.sleep_until_s(board.clock.now_s() + TICK_S)


class Bench:
    """One chip on a bus of its own, a signal that the test sets, and a clock that it turns."""

    def __init__(self, funcs: Any = FUNCTIONS) -> None:
        self.time_s = 0.0
        self.faults = WireFaults({"part": I2C_BLOCKS})
        self._funcs = funcs
        self._samples: list[Sample] = []
        self.value = 0.0
        self.rate_hz = 100.0
        self._sampled_s = 0.0

    # as a signal
    @property
    def now_s(self) -> float:
        return self.time_s

    def set_rate_hz(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz

    def take(self) -> list[Sample]:
        taken, self._samples = self._samples, []
        return taken

    def newest(self) -> float:
        return self.value

    # as a clock
    class _Clock:
        def __init__(self, bench: Bench) -> None:
            self._bench = bench

        def now_s(self) -> float:
            return self._bench.time_s

        def sleep_until_s(self, time_s: float) -> None:
            self._bench.run_until(time_s)

    @property
    def clock(self) -> Any:
        return Bench._Clock(self)

    def run_until(self, time_s: float) -> None:
        while self._sampled_s + 1.0 / self.rate_hz <= time_s:
            self._sampled_s += 1.0 / self.rate_hz
            self._samples.append(Sample(self._sampled_s, self.value, False))
        self.time_s = time_s

    def bus(self, address: int, chip: Chip) -> EmulatedBus:
        return EmulatedBus(
            [(address, "part", chip)], self.faults, lambda _: False, lambda: self.time_s, self._funcs
        )


class ManualSampler:
    """Runs the entered tasks when the test says so."""

    def __init__(self) -> None:
        self.tasks: list[Callable[[float], None]] = []

    def every(self, rate_hz: float, task: Callable[[float], None]) -> Callable[[], None]:
        self.tasks = [task]
        return self.tasks.clear

    def once(self, at_s: float, task: Callable[[float], None]) -> Callable[[], None]:
        self.tasks = [task]
        return self.tasks.clear

    def close(self) -> None:
        self.tasks.clear()

    def run(self, now_s: float) -> None:
        for task in list(self.tasks):
            task(now_s)
