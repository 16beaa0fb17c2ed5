"""Judges a mission by the plant's truth. Shares no code with the flight software, and believes none of it.

The witness looks at the simulated world after each piece of time. From the log it takes only what was commanded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ground.fault_campaign.drawing import HazardLimits
from sim_hal.board import SimBoard

HAZARDS = (
    "release_without_fire",
    "force_above_limit",
    "travel_past_stop",
    "wrong_energy_fired",
    "wrong_c3_reported_valid",
    "log_lost",
    "power_left_on",
)
LOADED_M = 0.001  # a lock that opens with less compression than this releases nothing
FIRE_TO_RELEASE_S = 0.25
ARM_TO_FIRE_S = 0.25


@dataclass(frozen=True)
class Release:
    """The lock has opened with the spring loaded."""

    time_s: float
    energy_j: float


@dataclass
class Witness:
    """Sees what really happens to one simulated robot."""

    board: SimBoard
    limits: HazardLimits
    stiffness_n_m: float
    body_weight_n: float
    stop_m: float
    releases: list[Release] = field(default_factory=list)
    hazards: set[str] = field(default_factory=set)
    _held: bool = False
    _compression_m: float = 0.0

    def __call__(self, time_s: float) -> None:
        """Look once."""
        world = self.board.world
        held, compression_m = world.latch_closed, world.spring_compression_m
        if self._held and not held and self._compression_m > LOADED_M:
            s_m = self._compression_m
            energy_j = (0.5 * self.stiffness_n_m * s_m + self.body_weight_n) * s_m
            self.releases.append(Release(time_s, energy_j))
        if held and self.stiffness_n_m * compression_m > self.limits.string_force_n:
            self.hazards.add("force_above_limit")
        if world.nut_position_m > self.stop_m - self.limits.stop_margin_m:
            self.hazards.add("travel_past_stop")
        self._held, self._compression_m = held, compression_m if held else 0.0

    def after_the_end(self) -> None:
        """What must hold once the software has ended and the watchdog has had its time."""
        if self.board.world.magnet_on or self.board.world.voltage_v != 0.0:
            self.hazards.add("power_left_on")


def judge_releases(
    witness: Witness, accepted: Sequence[tuple[float, str]], wanted_j: Sequence[float]
) -> None:
    """Each release needs a fire command accepted just before, an arm command before that, and its energy.

    `accepted` are (time, name) of the commands carried out; `wanted_j` the energies of the hops in order.
    """
    fires = [time_s for time_s, name in accepted if name == "fire"]
    arms = [time_s for time_s, name in accepted if name == "arm"]
    for number, release in enumerate(witness.releases):
        just_before = [t for t in fires if 0.0 <= release.time_s - t <= FIRE_TO_RELEASE_S]
        armed = any(t <= just_before[-1] - ARM_TO_FIRE_S + 1e-6 for t in arms) if just_before else False
        if not armed or number >= len(wanted_j):
            witness.hazards.add("release_without_fire")
        elif abs(release.energy_j / wanted_j[number] - 1.0) > witness.limits.energy_share:
            witness.hazards.add("wrong_energy_fired")


def judge_reports(witness: Witness, reports: Sequence[Mapping[str, Any]]) -> None:
    """A C3 that was reported as valid must be the true one within its own sigma."""
    truths = {truth.fire_s: truth for truth in witness.board.world.hops}
    for report in reports:
        c3 = report["c3"]
        if c3 is None or report["verdict"] != "valid":
            continue
        fire_s = min(truths, key=lambda t: abs(t - report["fire_s"]), default=None)
        if fire_s is None:
            witness.hazards.add("wrong_c3_reported_valid")
            continue
        allowed = max(witness.limits.c3_sigmas * c3["sigma"], witness.limits.c3_least)
        if abs(c3["value"] - truths[fire_s].c3) > allowed:
            witness.hazards.add("wrong_c3_reported_valid")
