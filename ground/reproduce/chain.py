"""The energy chain of a campaign's runs: C1, C2_ref, C3 and the predicted height, with their uncertainties.

It does not matter whether the runs were flown by the simulated robot or read from a laboratory's table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from flight import energy
from flight.energy import RigConstants
from flight.settings import RigSettings
from flight.uncertain import Uncertain, exactly, mean_of
from ground.calibration.hop_model import compression_of, on_arm


@dataclass(frozen=True)
class CampaignRun:
    """One accepted run: what was stored, and how high it went. `reference` marks a jump off rigid ground.

    `known_c3` is what the flight code held C3 to be before the hop; None where it knew nothing of the place.
    `true_c3`, `true_height_m` are the simulation's.
    """

    label: str
    setup: str
    surface: str
    foot: str
    tilt_deg: float
    place: str
    reference: bool
    compression_m: Uncertain
    height_m: Uncertain
    known_c3: float | None = None
    true_c3: float | None = None
    true_height_m: float | None = None

    @property
    def row(self) -> tuple[str, str, float]:
        """Surface, foot and tilt: what a row of Table 5 is known by."""
        return self.surface, self.foot, self.tilt_deg


@dataclass(frozen=True)
class ChainRun:
    """A run with its energies [J] and coefficients; C2 of a reference jump, C3 of any other."""

    run: CampaignRun
    used_j: Uncertain
    analysis_j: Uncertain
    potential_j: Uncertain
    c1: Uncertain
    c2_reference: Uncertain | None = None
    c2_direct: Uncertain | None = None
    c3_direct: Uncertain | None = None
    c3_average: Uncertain | None = None


@dataclass
class Chain:
    """All runs through Eqs. (1)-(7). A rig on its arm; the foot is each run's own."""

    rig: RigSettings
    runs: list[ChainRun] = field(default_factory=list)
    c2_average: Uncertain | None = None

    def constants(self, foot: str) -> RigConstants:
        """Masses, stiffness and gravity with a foot, and their common errors."""
        return RigConstants.of(on_arm(self.rig, foot))

    @property
    def references(self) -> list[ChainRun]:
        """Reference jumps."""
        return [run for run in self.runs if run.run.reference]

    @property
    def tests(self) -> list[ChainRun]:
        """Runs on soil."""
        return [run for run in self.runs if not run.run.reference]

    def predicted_height_m(self, run: ChainRun, c2: Uncertain | float, c3: Uncertain | float) -> Uncertain:
        """Eq. (7): the loss-free height with the input energy (1 - C2)(1 - C3) E_used."""
        rig = self.constants(run.run.foot)
        wanted = energy.equivalent_input_energy(run.used_j, exactly(c2), exactly(c3))
        compression_m = compression_of(wanted.value, on_arm(self.rig, run.run.foot))
        share = energy.analysis_energy(Uncertain(compression_m), rig) / energy.used_energy(
            Uncertain(compression_m), rig
        )
        return energy.height_of_energy_m(share * wanted, rig)


def through_chain(runs: Sequence[CampaignRun], rig: RigSettings) -> Chain:
    """C1, C2_ref (direct: of the latest references before a run in its set-up; average: of all), C3 of all runs.

    A test without a reference in its set-up has no direct C2_ref and no direct C3; without any reference at all there
    is no average either.
    """
    chain = Chain(rig)
    first = [_energies(chain, run) for run in runs]
    measured = [run.c2_reference for run in first if run.c2_reference is not None]
    chain.c2_average = mean_of(measured) if measured else None
    for index, run in enumerate(first):
        chain.runs.append(run if run.run.reference else _test(run, first[:index], chain.c2_average))
    return chain


def _energies(chain: Chain, run: CampaignRun) -> ChainRun:
    rig = chain.constants(run.foot)
    used_j = energy.used_energy(run.compression_m, rig)
    analysis_j = energy.analysis_energy(run.compression_m, rig)
    potential_j = rig.total_mass_kg * rig.gravity_m_s2 * run.height_m
    c2 = energy.c2_reference(potential_j, analysis_j) if run.reference else None
    c1 = energy.c1_analysis(analysis_j, used_j)
    return ChainRun(run, used_j, analysis_j, potential_j, c1, c2_reference=c2)


def _test(run: ChainRun, before: Sequence[ChainRun], average: Uncertain | None) -> ChainRun:
    def c3(c2: Uncertain | None) -> Uncertain | None:
        return None if c2 is None else energy.c3_surface(run.potential_j, run.analysis_j, c2)

    references = _latest_references(run, before)
    direct = mean_of(references) if references else None
    return replace(run, c2_direct=direct, c3_direct=c3(direct), c3_average=c3(average))


def _latest_references(run: ChainRun, before: Sequence[ChainRun]) -> list[Uncertain]:
    """C2_ref of the reference jumps that stand together just before a run, in its set-up and with its foot."""
    found: list[Uncertain] = []
    for earlier in reversed(before):
        if (earlier.run.setup, earlier.run.foot) != (run.run.setup, run.run.foot):
            continue
        if earlier.c2_reference is not None:
            found.append(earlier.c2_reference)
        elif found:
            break
    return found
