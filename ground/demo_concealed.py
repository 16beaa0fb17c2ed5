"""A demonstration: physics concealed inside a C3 that looks normal, found, and of use for the next hops.

A simulated robot has something more in its plant than its software knows. It hops; every hop's C3 lies in the
published range of its ground, and the energy chain closes. The diagnosis gets the first hops' recordings and the
nominal plant. The later hops, which no fit has seen, are then predicted three ways: by the lumped C2 and C3, by the
refitted nominal plant, and by the plant with what was found.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flight.energy import RigConstants, height_of_energy_m
from flight.executive import Progress
from flight.mission import HopPlan, MissionPlan
from flight.uncertain import Uncertain
from ground.diagnose.pipeline import Outcome, diagnose, write_outcome
from ground.mission_run import run_mission
from ground.mission_summary import HopOutcome, MissionRun
from ground.progress import Show, nobody, part_of
from hal.config import config_path, read_yaml
from hal.errors import ConfigError
from sim_hal.plant.simulate import EffectUse, Parameter, Plant, load_plant, save_plant
from sim_hal.truth import REFERENCE, hop_truth

NOTHING = "nothing"
FIT_TRIES = 200
FLYING = 0.05
"""Share of the whole time that each of the two missions takes, about."""
WAYS = ("lumped C2 and C3", "refitted nominal plant", "plant found")


@dataclass(frozen=True)
class Scenario:
    """What `config/demo/concealed.yaml` says: the ground, the energies [J], the rig's spread, what may be hidden."""

    surface: str
    reference_energy_j: float
    learning_energies_j: tuple[float, ...]
    next_energies_j: tuple[float, ...]
    within_sigmas: float
    hidden: Mapping[str, EffectUse]


@dataclass(frozen=True)
class Prediction:
    """One later hop: flown as flight estimated it, true, and predicted in each of `WAYS`."""

    hop: int
    energy_j: float
    flown_height_m: Uncertain
    flown_time_s: Uncertain
    true_height_m: float
    true_time_s: float
    height_m: Mapping[str, float]
    time_s: Mapping[str, float | None]


@dataclass(frozen=True)
class Concealed:
    """All that came of the demonstration. `c3_low`, `c3_high`: the published range of the ground.

    `later` are the hops that no fit saw; `rehearsed` the same hops by the same flight software on the plant found.
    """

    hidden: str
    seed: int
    flown: MissionRun
    outcome: Outcome
    learned: tuple[HopOutcome, ...]
    c3_low: float
    c3_high: float
    closes_by: tuple[float, ...]
    predictions: tuple[Prediction, ...]
    later: tuple[HopOutcome, ...]
    rehearsed: tuple[HopOutcome, ...]
    folder: Path

    @property
    def looks_normal(self) -> bool:
        """Whether every learning hop's C3 lies in the published range."""
        values = [hop.report.c3 for hop in self.learned]
        return all(c3 is not None and self.c3_low <= c3.value <= self.c3_high for c3 in values)

    @property
    def found(self) -> bool:
        """Whether the diagnosis says what is hidden: that name first, or that nothing is missing."""
        diagnosis = self.outcome.diagnosis
        if self.hidden == NOTHING:
            return diagnosis.verdict == "consistent"
        return bool(diagnosis.findings) and diagnosis.findings[0].physics_id == self.hidden

    def error(self, way: str, quantity: str) -> float:
        """Root mean square error of a way's predictions over the later hops, against the truth [m] or [s]."""
        errors = []
        for one in self.predictions:
            predicted = (one.height_m if quantity == "height_m" else one.time_s)[way]
            true = one.true_height_m if quantity == "height_m" else one.true_time_s
            errors.append(float("nan") if predicted is None else predicted - true)
        return float(np.sqrt(np.mean(np.square(errors))))


def load_scenario(path: Path | None = None) -> Scenario:
    """The scenario's file; raises `ConfigError` naming file and key."""
    path = path or config_path("demo", "concealed.yaml")
    content: dict[str, Any] = read_yaml(path)
    try:
        hidden = {
            name: EffectUse(
                name,
                item["equation"],
                None,
                {key: Parameter(float(p["value"]), 0.0, p["unit"]) for key, p in item["parameters"].items()},
            )
            for name, item in content["hidden"].items()
        }
        return Scenario(
            surface=content["surface"],
            reference_energy_j=float(content["reference_energy_j"]),
            learning_energies_j=tuple(map(float, content["learning_energies_j"])),
            next_energies_j=tuple(map(float, content["next_energies_j"])),
            within_sigmas=float(content["within_sigmas"]),
            hidden=hidden,
        )
    except KeyError as error:
        raise ConfigError(f"{path}: key {error.args[0]!r} is missing") from error
    except (AttributeError, TypeError, ValueError) as error:
        raise ConfigError(f"{path}: a value has the wrong type ({error})") from error


def demonstrate(
    folder: Path,
    hide: str = "soil_rate_dependence",
    seed: int = 1,
    show: Show = nobody,
    scenario: Scenario | None = None,
    processes: int = 1,
) -> Concealed:
    """Fly, diagnose, predict; everything is written to `folder`. Raises `ConfigError` for an unknown `hide`."""
    scenario = scenario or load_scenario()
    nominal = load_plant(config_path("plant", "bb0b_hop.yaml"))
    published = published_c3(scenario.surface)
    truth = true_plant(nominal, scenario, hide, seed, published)
    folder.mkdir(parents=True, exist_ok=True)
    save_plant(truth, folder / "true_plant.yaml")
    plan = plan_of(scenario)
    watch = watcher(part_of(show, 0.0, FLYING), f"a robot that hides {hide.replace('_', ' ')}", plan)
    changes = {"plants": {"hop": str((folder / "true_plant.yaml").resolve())}}
    flown = run_mission(plan, folder / "mission", seed=seed, changes=changes, watch=watch)
    last = 1 + len(scenario.learning_energies_j)
    learned, later = flown.hops[1:last], flown.hops[last:]
    recordings = [hop.hop for hop in learned if hop.hop is not None]
    outcome = diagnose(recordings, nominal, part_of(show, FLYING, 1.0 - FLYING), processes=processes)
    write_outcome(outcome, folder / "diagnosis")
    watch = watcher(part_of(show, 1.0 - FLYING, 1.0), "the plant found", plan)
    found = {"plants": {"hop": str((folder / "diagnosis" / "plant.yaml").resolve())}}
    rehearsed = run_mission(plan, folder / "rehearsal", seed=seed + 1, changes=found, watch=watch)
    show("predicting the next hops")
    plants = {"refitted nominal plant": refitted(nominal, outcome), "plant found": outcome.plant}
    c3 = float(np.mean([hop.report.c3.value for hop in learned if hop.report.c3 is not None]))
    return Concealed(
        hidden=hide,
        seed=seed,
        flown=flown,
        outcome=outcome,
        learned=learned,
        c3_low=published[0],
        c3_high=published[1],
        closes_by=tuple(chain_gap(flown, hop, c3) for hop in learned),
        predictions=tuple(predicted(flown, hop, c3, plants) for hop in later),
        later=tuple(later),
        rehearsed=tuple(rehearsed.hops[last:]),
        folder=folder,
    )


def watcher(show: Show, robot: str, plan: MissionPlan) -> Callable[[Progress], None]:
    """Tells how far a mission is."""
    energies = [hop.energy_j for hop in plan.hops]

    def watch(progress: Progress) -> None:
        at = min(progress.hop_index, len(energies) - 1)
        stored_j = min(progress.energy_used_j, energies[at])
        done = (sum(energies[:at]) + stored_j) / sum(energies)
        show(f"flying {len(energies)} hops on {robot}", done)

    return watch


def published_c3(surface: str) -> tuple[float, float]:
    """The published range of C3 on level ground with the rig's foot; raises `ConfigError` where none is known."""
    for known in read_yaml(config_path("surfaces.yaml"))["surfaces"]:
        if known["name"] == surface and known["foot"] == "1" and known["tilt_deg"] == 0.0:
            return float(known["c3_low"]), float(known["c3_high"])
    raise ConfigError(f"config/surfaces.yaml: no published C3 of {surface!r} with foot 1 on level ground")


def plan_of(scenario: Scenario) -> MissionPlan:
    """A reference hop off steel, the hops to learn from, and the next ones."""
    reference = HopPlan(scenario.reference_energy_j, surface=REFERENCE, place="reference", reference=True)
    energies = (*scenario.learning_energies_j, *scenario.next_energies_j)
    return MissionPlan("concealed", (reference, *(HopPlan(e, surface=scenario.surface) for e in energies)))


def true_plant(
    nominal: Plant, scenario: Scenario, hide: str, seed: int, published: tuple[float, float]
) -> Plant:
    """A rig drawn within its tolerances, with `hide` in it, whose C3 looks normal at both ends of energy."""
    if hide != NOTHING and hide not in scenario.hidden:
        known = ", ".join((*scenario.hidden, NOTHING))
        raise ConfigError(f"hide = {hide!r}: what the demonstration can hide is {known}")
    random = np.random.Generator(np.random.PCG64(seed))
    for _ in range(FIT_TRIES):
        away = {name: random.normal() for name in nominal.flat()}
        limit = scenario.within_sigmas
        values = {
            name: p.value + float(np.clip(away[name], -limit, limit)) * p.std
            for name, p in nominal.flat().items()
        }
        surfaces = {name: min(max(v, 0.0), 0.97) for name, v in values.items() if name.endswith(".chi")}
        plant = nominal.with_values(values | surfaces)
        if hide != NOTHING:
            plant = plant.with_effect(scenario.hidden[hide])
        if all(published[0] < c3 < published[1] for c3 in true_c3(plant, scenario)):
            return plant
    raise ConfigError(f"config/demo/concealed.yaml: no rig that hides {hide} keeps C3 in the published range")


def true_c3(plant: Plant, scenario: Scenario) -> list[float]:
    """C3 of the hops with the least and the greatest energy."""
    energies = scenario.learning_energies_j
    found = []
    for energy_j in (min(energies), max(energies)):
        k, weight_n = plant.parameters["k"].value, plant.parameters["m_b"].value * plant.parameters["g"].value
        compression_m = (np.sqrt(weight_n**2 + 2.0 * k * energy_j) - weight_n) / k
        found.append(truth_of(plant, scenario.surface, float(compression_m)).c3)
    return found


def truth_of(plant: Plant, surface: str, compression_m: float) -> Any:
    """What a plant says of one hop from a compression: a `HopTruth` without a spot of its own."""
    from sim_hal.settings import Spot

    conditions: dict[str, float | str] = {"surface": surface, "foot": 1.0, "tilt_deg": 0.0, "hop_index": 0.0}
    return hop_truth(plant, conditions, compression_m, hop=0, spot=Spot(surface), fire_s=0.0)


def refitted(nominal: Plant, outcome: Outcome) -> Plant:
    """The nominal plant with its own parameters as the diagnosis refitted them, no physics added."""
    values = outcome.diagnosis.details["nominal_parameters"]
    return nominal.with_values(
        {name: item["refit"] for name, item in values.items() if name in nominal.flat()}
    )


def lumped_height_m(flown: MissionRun, hop: HopOutcome, c3: float) -> float:
    """Height by the energy chain, Eqs. (5) and (6): the loss-free jump's energy, less C2_ref and the mean C3."""
    analysis = hop.report.energies.analysis_j
    if analysis is None:
        return float("nan")
    energy = analysis * (1.0 - hop.report.c2_ref) * (1.0 - c3)
    return height_of_energy_m(energy, RigConstants.of(flown.settings.rig)).value


def chain_gap(flown: MissionRun, hop: HopOutcome, c3: float) -> float:
    """Share of the measured height that the energy chain with the spot's mean C3 misses."""
    measured = hop.report.energies.height_m
    return float("nan") if measured is None else lumped_height_m(flown, hop, c3) / measured.value - 1.0


def predicted(flown: MissionRun, hop: HopOutcome, c3: float, plants: Mapping[str, Plant]) -> Prediction:
    """One later hop, from the compression held before its fire command, in each of the ways."""
    report, truth, recording = hop.report, hop.truth, hop.hop
    seen = report.energies
    if truth is None or recording is None or seen.height_m is None or seen.time_of_flight_s is None:
        raise ConfigError(
            f"hop {report.hop_index + 1} was not seen: {'; '.join(report.reasons) or 'no recording'}"
        )
    surface = str(recording.conditions["surface"])
    simulated = {
        way: truth_of(plant, surface, recording.state["spring_compression_m"])
        for way, plant in plants.items()
    }
    return Prediction(
        hop=report.hop_index + 1,
        energy_j=report.plan.energy_j,
        flown_height_m=seen.height_m,
        flown_time_s=seen.time_of_flight_s,
        true_height_m=truth.hop_height_m,
        true_time_s=truth.time_of_flight_s or float("nan"),
        height_m={WAYS[0]: lumped_height_m(flown, hop, c3)}
        | {way: found.hop_height_m for way, found in simulated.items()},
        time_s={WAYS[0]: None} | {way: found.time_of_flight_s for way, found in simulated.items()},
    )
