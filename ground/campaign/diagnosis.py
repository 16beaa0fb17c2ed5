"""The study of diagnoses: rigs that hide something or nothing, flown, and diagnosed from their recordings alone."""

from __future__ import annotations

import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import yaml

from flight import settings as flight_settings
from flight.executive import fly
from flight.log import McapLog, read_log
from ground.campaign.drawing import as_built, board_with, generator, hops_on, log_uniform, nominal_hop_plant
from ground.campaign.study import FAILED, Row
from ground.diagnose.pipeline import diagnose
from ground.recordings import Recording
from ground.recordings.from_log import recordings_from_log
from hal.board import open_board
from hal.config import Limits, build_settings, config_path, load_settings, read_yaml
from hal.errors import ConfigError
from hal.tap import tap_board
from sim_hal.plant.simulate import EffectUse, Parameter, Plant
from sim_hal.truth import REFERENCE

NOTHING = "nothing"


@dataclass(frozen=True)
class HiddenEffect:
    """What may be hidden; `parameters` are value and unit by name, `strength` is the one that is multiplied."""

    physics: str
    equation: str
    strength: str
    parameters: dict[str, Any]


@dataclass(frozen=True)
class TrialRanges:
    """`config/campaigns/diagnosis.yaml`."""

    surface: str
    reference_energy_j: float
    hops: tuple[int, ...]
    energies_j: tuple[float, ...]
    within_sigmas: Annotated[float, Limits(0.0, 5.0)]
    nothing_share: Annotated[float, Limits(0.0, 1.0)]
    size: tuple[float, ...]
    hidden: tuple[Any, ...]


@dataclass(frozen=True)
class DiagnosisStudy:
    """Diagnoses; each counts as one."""

    ranges: TrialRanges
    effects: tuple[HiddenEffect, ...]
    seed: int
    name: str = "diagnosis"

    def settings(self) -> object:
        """The ranges, the flight software's, the simulated board and the nominal plant."""
        board = read_yaml(config_path("boards", "sim.yaml"))
        return self.ranges, flight_settings.load(), board, nominal_hop_plant()

    def schema(self) -> Any:
        """A row is a trial; `findings` are in the order in which they were told."""
        import pyarrow as pa

        text, real = pa.string(), pa.float64()
        finding = pa.struct({"physics": text, "probability": real, "equation": text})
        drawn = {"hidden": text, "size": real, "board_seed": pa.int64(), "recordings": pa.int64()}
        told = {"verdict": text, "findings": pa.list_(finding), "right": pa.bool_()}
        return pa.schema({**drawn, **told})

    def run(self, index: int) -> Row:
        """Draw a rig, fly it, diagnose its recordings."""
        rng, ranges = generator(self.seed, index), self.ranges
        plant = as_built(nominal_hop_plant(), ranges.within_sigmas, rng)
        hidden, size = NOTHING, 0.0
        if rng.random() >= ranges.nothing_share:
            effect = self.effects[int(rng.integers(len(self.effects)))]
            hidden, size = effect.physics, log_uniform(rng, ranges.size)
            plant = plant.with_effect(_use(effect, size))
        hops = int(rng.integers(ranges.hops[0], ranges.hops[1] + 1))
        energies_j = tuple(log_uniform(rng, ranges.energies_j) for _ in range(hops))
        board_seed = int(rng.integers(2**31))
        recordings = _flown(ranges, plant, energies_j, board_seed, f"case-{index}")
        found = diagnose(recordings, nominal_hop_plant(), processes=1).diagnosis
        findings = [
            {"physics": each.physics_id, "probability": each.probability, "equation": each.equation}
            for each in found.findings
        ]
        first = findings[0]["physics"] if findings else NOTHING
        drawn = {"hidden": hidden, "size": size, "board_seed": board_seed, "recordings": len(recordings)}
        return {**drawn, "verdict": found.verdict, "findings": findings, "right": first == hidden}

    def counts(self, row: Row) -> float:
        """One."""
        return 1.0

    def most_cases(self, wanted: float) -> int | None:
        """As many as are wanted."""
        return int(wanted)

    def suspicious(self, row: Row) -> bool:
        """Whether the answer was wrong."""
        return row[FAILED] is None and not row["right"]


def load_diagnosis(seed: int, path: Path | None = None) -> DiagnosisStudy:
    """The study of a seed. Raises `ConfigError` naming file, key and value."""
    where = path or config_path("campaigns", "diagnosis.yaml")
    ranges = load_settings(where, TrialRanges)
    effects = tuple(
        build_settings(each, HiddenEffect, str(where), f"hidden[{row}].")
        for row, each in enumerate(ranges.hidden)
    )
    for row, effect in enumerate(effects):
        if effect.strength not in effect.parameters:
            known = ", ".join(effect.parameters)
            raise ConfigError(f"{where}: hidden[{row}].strength = {effect.strength!r} is none of {known}")
    return DiagnosisStudy(ranges, effects, seed)


def _use(effect: HiddenEffect, size: float) -> EffectUse:
    parameters = {
        name: Parameter(float(value) * (size if name == effect.strength else 1.0), 0.0, unit)
        for name, (value, unit) in effect.parameters.items()
    }
    return EffectUse(effect.physics, effect.equation, None, parameters)


def _flown(
    ranges: TrialRanges, plant: Plant, energies_j: tuple[float, ...], board_seed: int, name: str
) -> list[Recording]:
    """The hops' recordings, as they come out of the flight's log; the reference hop is left out."""
    plan = hops_on(name, ranges.surface, ranges.reference_energy_j, energies_j)
    settings_path = config_path("flight.yaml")
    settings = flight_settings.load(settings_path)
    spot = {"foot": 1, "tilt_deg": 0.0}
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        spots = [{"surface": REFERENCE, **spot}, {"surface": ranges.surface, **spot}]
        found = {**board_with(plant, folder), "spots": spots, "seed": board_seed}
        metadata = {
            "board": "sim",
            "seed": str(board_seed),
            "settings": settings_path.read_text(encoding="utf-8"),
            "mission": yaml.safe_dump(asdict(plan), sort_keys=False),
        }
        path = folder / "flight.mcap"
        with open_board("sim", found) as board, McapLog(path, metadata) as log:
            fly(tap_board(board, log), settings, plan, log)
        hops = recordings_from_log(read_log(path))
    return [replace(each.hop, source=None) for each in hops if each.hop_index > 0]
