"""The campaign flown: each set-up a mission of the real flight code on the simulated rig, on several processes."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flight.energy import RigConstants
from flight.executive import fly
from flight.mission import HopPlan, HopReport, MissionPlan
from flight.settings import FlightSettings
from flight.uncertain import Uncertain
from ground.calibration.hop_model import PLANT, foot_values, on_arm
from ground.calibration.targets import middles
from ground.pools import end_with_parent
from ground.reproduce.chain import CampaignRun
from ground.reproduce.mechanism import Mechanisms
from ground.reproduce.plan import CampaignPlan, SetupPlan, SoilTest
from hal.board import open_board
from hal.config import config_path, read_yaml
from hal.errors import HalError
from hal.log import NullLog
from sim_hal.board import world_of
from sim_hal.soils import Soils, ground_of
from sim_hal.truth import REFERENCE, HopTruth

Show = Callable[[str, float], None]

_FLIGHT_TIMEOUT = "flight_timeout"


class CampaignFailed(HalError, RuntimeError):
    """A set-up was not flown to its end; the message says which and why."""


@dataclass(frozen=True)
class Hop:
    """One hop as it is to be flown: what the pilot is told, the ground that it meets, what the mechanism loses."""

    plan: HopPlan
    test: SoilTest | None
    values: Mapping[str, float]
    c2_ref: float
    probe: bool = False


@dataclass(frozen=True)
class Mission:
    """A set-up drawn and ready to fly."""

    setup: SetupPlan
    hops: tuple[Hop, ...]
    seed: int
    plan: CampaignPlan


@dataclass(frozen=True)
class FlownHop:
    """One hop with its report and its truth."""

    setup: SetupPlan
    hop: Hop
    report: HopReport
    truth: HopTruth


def drawn_missions(plan: CampaignPlan, soils: Soils, settings: FlightSettings, seed: int) -> list[Mission]:
    """All set-ups with their grounds and losses drawn: the same seed gives the same missions.

    The places of a row of Table 5 are drawn one from each stratum of the soil's distribution, in random order.
    """
    looseness = _looseness(plan, seed)
    missions = []
    for number, setup in enumerate(plan.setups):
        chance = np.random.default_rng(np.random.SeedSequence([seed, 1, number]))
        hops = tuple(_hops(plan, soils, settings, setup, looseness, chance))
        missions.append(Mission(setup, hops, int(chance.integers(2**31)), plan))
    return missions


def _looseness(plan: CampaignPlan, seed: int) -> dict[tuple[str, str], float]:
    """The latent draw of each place, by set-up and place."""
    rows = dict.fromkeys((t.surface, s.foot, t.tilt_deg) for s in plan.setups for t in s.tests)
    found: dict[tuple[str, str], float] = {}
    for number, row in enumerate(rows):
        places = list(dict.fromkeys((setup.name, test.place) for setup, test in plan.row(row)))
        order = np.random.default_rng(np.random.SeedSequence([seed, 2, number])).permutation(len(places))
        values = middles(len(places))
        found |= {place: values[index] for place, index in zip(places, order.tolist(), strict=True)}
    return found


def _hops(
    plan: CampaignPlan,
    soils: Soils,
    settings: FlightSettings,
    setup: SetupPlan,
    looseness: Mapping[tuple[str, str], float],
    chance: np.random.Generator,
) -> Iterator[Hop]:
    rig = on_arm(settings.rig, setup.foot)

    def used_j(spring_j: float) -> float:
        return spring_j - 0.5 * (rig.body_mass_kg * rig.gravity_m_s2) ** 2 / rig.spring_stiffness_n_m

    def c2() -> float:
        return max(setup.c2_ref + plan.repeatability * float(chance.standard_normal()), 0.0)

    at_rest = HopPlan(used_j(setup.reference_energy_j), REFERENCE, "reference", True)
    yield Hop(at_rest, None, {}, c2())
    hops: dict[str, int] = {}
    for test in setup.tests:
        soil = soils.soils[test.surface]
        energies = [test.energy_j]
        if soil.kept_by_hop == 1.0 and test.place not in hops:
            energies.insert(0, plan.probe_energy_j)
        for number, energy_j in enumerate(energies, start=1):
            ground = ground_of(
                soils,
                test.surface,
                setup.foot,
                test.tilt_deg,
                earlier_hops=hops.get(test.place, 0),
                looseness=looseness[setup.name, test.place],
                hop_change=float(chance.standard_normal()),
            )
            told = HopPlan(used_j(energy_j), test.surface, test.place, False, test.tilt_deg)
            yield Hop(told, test, ground.values(test.surface), c2(), number < len(energies))
            hops[test.place] = hops.get(test.place, 0) + 1


def fly_campaign(
    missions: Sequence[Mission], settings: FlightSettings, show: Show, processes: int = 1
) -> list[FlownHop]:
    """Fly all missions; the answer does not depend on the number of processes.

    Raises `CampaignFailed` when a mission does not end as planned.
    """
    flown: list[FlownHop] = []
    done = 0
    for mission, hops in zip(missions, _each(missions, settings, processes), strict=True):
        flown += hops
        done += len(hops)
        show(f"flown: {mission.setup.name}", float(done))
    return flown


def _each(missions: Sequence[Mission], settings: FlightSettings, processes: int) -> Iterator[list[FlownHop]]:
    if processes <= 1:
        yield from (fly_setup(mission, settings) for mission in missions)
        return
    # spawn: this process may have threads (a progress line), and a fork would copy their locks
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, spawn, end_with_parent) as pool:
        try:
            yield from pool.map(fly_setup, missions, [settings] * len(missions))
        finally:
            pool.shutdown(cancel_futures=True)


def fly_setup(mission: Mission, settings: FlightSettings) -> list[FlownHop]:
    """Fly one set-up with the flight code on its arm. Raises `CampaignFailed`."""
    settings = campaign_settings(settings, mission.plan, mission.setup.foot)
    board_settings = _board(mission, settings)
    plan = MissionPlan(mission.setup.name, tuple(hop.plan for hop in mission.hops))
    with open_board("sim", board_settings) as board:
        result = fly(board, settings, plan, NullLog())
        truths = world_of(board).hops
    if not result.completed:
        raise CampaignFailed(
            f"set-up {mission.setup.name!r}: ended after {len(result.hops)} of {len(mission.hops)} hops "
            f"({result.end_reason})"
        )
    return [
        FlownHop(mission.setup, hop, report, truth)
        for hop, report, truth in zip(mission.hops, result.hops, truths, strict=True)
    ]


def campaign_settings(settings: FlightSettings, plan: CampaignPlan, foot: str) -> FlightSettings:
    """The flight code's settings with a foot on the arm, and the campaign's patience with a ringing spring."""
    patient = replace(settings.monitors[_FLIGHT_TIMEOUT], above=plan.flight_timeout_s)
    monitors = {**settings.monitors, _FLIGHT_TIMEOUT: patient}
    return replace(settings, rig=on_arm(settings.rig, foot), monitors=monitors)


def _board(mission: Mission, settings: FlightSettings) -> dict[str, Any]:
    """Settings of the simulated board, with the plant's values of every hop."""
    mechanisms = Mechanisms(settings.rig, mission.plan.least_damping_n_s_m)
    foot = mission.setup.foot
    own = foot_values(settings.rig, foot)
    spots = [
        {
            "surface": hop.plan.surface,
            "foot": int(foot),
            "tilt_deg": hop.plan.tilt_deg,
            "values": {**own, **mechanisms.values(foot, hop.plan.energy_j, hop.c2_ref), **hop.values},
        }
        for hop in mission.hops
    ]
    found: dict[str, Any] = read_yaml(config_path("boards", "sim.yaml"))
    found["plants"] = {**found["plants"], "hop": PLANT}
    return {**found, "seed": mission.seed, "spots": spots}


def campaign_runs(flown: Sequence[FlownHop], settings: FlightSettings) -> tuple[list[CampaignRun], list[str]]:
    """The accepted runs of the campaign, probes left out, and those rejected, each named with its reasons.

    Errors that a hop has of its own are told apart by set-up, those of the rig stay common.
    """
    runs: list[CampaignRun] = []
    rejected: list[str] = []
    believed: dict[tuple[str, str], float] = {}
    for each in flown:
        place = (each.setup.name, each.hop.plan.place)
        if not each.hop.probe:
            run = _run(each, settings, believed.get(place))
            if run is None:
                rejected.append(f"{_name(each)}: {'; '.join(each.report.reasons)}")
            else:
                runs.append(run)
        if each.report.belief is not None:
            believed[place] = each.report.belief.c3_mean
    return runs, rejected


def _name(each: FlownHop) -> str:
    return f"{each.setup.name}/{each.report.hop_index + 1}"


def _run(each: FlownHop, settings: FlightSettings, known_c3: float | None) -> CampaignRun | None:
    seen, plan = each.report.energies, each.hop.plan
    if seen.compression_m is None or seen.height_m is None:
        return None
    return CampaignRun(
        label=_name(each),
        setup=each.setup.name,
        surface=plan.surface or REFERENCE,
        foot=each.setup.foot,
        tilt_deg=plan.tilt_deg,
        place=plan.place,
        reference=plan.reference,
        compression_m=_own(seen.compression_m, each.setup.name),
        height_m=_own(_apex_m(each, settings), each.setup.name),
        known_c3=known_c3,
        true_c3=None if plan.reference else each.truth.c3,
        true_height_m=each.truth.hop_height_m,
    )


def _apex_m(each: FlownHop, settings: FlightSettings) -> Uncertain:
    """The height whose E_pot under the rig's configured weight is the flight code's own E_pot.

    The flight code measures gravity in each hop; the chain weighs with the configured one, like a laboratory.
    """
    seen = each.report.energies
    assert seen.potential_j is not None
    rig = RigConstants.of(on_arm(settings.rig, each.setup.foot))
    return seen.potential_j / (rig.total_mass_kg * rig.gravity_m_s2)


def _own(value: Uncertain, setup: str) -> Uncertain:
    return Uncertain(
        value.value, {f"{setup}:{key}" if "#" in key else key: part for key, part in value.parts.items()}
    )
