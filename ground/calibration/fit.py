"""Fitting each soil's few numbers to the published C3, through the simulated robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flight.settings import RigSettings
from ground.calibration.hop_model import HopModel
from ground.calibration.targets import CalibrationSettings, middles, rows_of
from ground.progress import Show
from ground.reproduce.paper import Paper, PaperSurface
from sim_hal.soils import FootLaw, Pad, Soil, Soils, TiltLaw, ground_of

Array = NDArray[np.float64]

_STEP = 2e-3  # of the derivatives: far above what the simulation's own error can move
_LOOSEST = 10.0


@dataclass(frozen=True)
class RowFit:
    """One row of Table 5, aimed at and met: mean, smallest and largest C3 of as many runs; fold where it compacts."""

    row: PaperSurface
    mean: float
    low: float
    high: float
    fold: float | None = None


@dataclass
class Calibration:
    """The fit of all soils. `simulate(row, soils)` gives the C3 of a row's runs."""

    paper: Paper
    settings: CalibrationSettings
    rig: RigSettings

    def __post_init__(self) -> None:
        feet = sorted({row.foot for row in self.paper.surfaces})
        self._models = {foot: HopModel(self.rig, foot) for foot in feet}

    def fitted(self, show: Show) -> Soils:
        """All soils, each fitted to its rows of Table 5."""
        soils = self._start()
        work = {name: sum(row.runs for row in rows_of(self.paper, name)) for name in self.settings.soils}
        done = 0
        for name, runs in work.items():
            show(f"fitting {name.replace('_', ' ')}", done / sum(work.values()))
            done += runs
            soils = self._fit_soil(soils, name)
        return soils

    def table(self, soils: Soils) -> list[RowFit]:
        """Every row of Table 5 with what these soils give."""
        found = []
        for row in self.paper.surfaces:
            c3 = self.simulate(row, soils)
            fold = c3[0] / c3[self.paper.compaction.hops - 1] if self._compacts(row) else None
            found.append(RowFit(row, float(np.mean(c3)), min(c3), max(c3), fold))
        return found

    def simulate(self, row: PaperSurface, soils: Soils) -> list[float]:
        """C3 of a row's runs: on one prepared place each, or where the soil compacts in the published order."""
        if self._compacts(row):
            hops = self.paper.compaction.hops
            return [
                self._c3(row, soils, earlier, 0.0) for earlier in (*range(hops), *[0] * (row.runs - hops))
            ]
        return [self._c3(row, soils, 0, looseness) for looseness in middles(row.runs)]

    def _c3(self, row: PaperSurface, soils: Soils, earlier: int, looseness: float) -> float:
        model = self._models[row.foot]
        ground = ground_of(
            soils, row.surface, row.foot, row.tilt_deg, earlier_hops=earlier, looseness=looseness
        )
        values = {"c": self.settings.damping_n_s_m, **ground.values(row.surface)}
        return model.c3(row.surface, model.compression_m(self.settings.energy_j), values)

    def _compacts(self, row: PaperSurface) -> bool:
        return self.settings.soils[row.surface].compacts

    def _start(self) -> Soils:
        settings = self.settings
        pads = {
            name: Pad(foot.area_m2, foot.shape == "flat")
            for name, foot in self.paper.feet.items()
            if foot.area_m2 is not None
        }
        soils = {
            name: Soil(
                start.stiffness_n_m,
                start.lost_share,
                start.spot_std,
                settings.hop_share * start.spot_std,
                settings.stiffness_spot_std,
                1.0,
            )
            for name, start in settings.soils.items()
        }
        law = FootLaw(
            pads[settings.reference_foot].area_m2,
            settings.exponent_start,
            settings.stiffness_exponent_start,
            settings.flat_factor_start,
        )
        return Soils(pads, law, TiltLaw(settings.friction_angle_deg_start), soils)

    def _fit_soil(self, soils: Soils, name: str) -> Soils:
        rows = rows_of(self.paper, name)
        unknowns = list(self._unknowns(soils, name, rows))
        start = np.array([value for value, _ in unknowns])
        setters = [setter for _, setter in unknowns]

        def build(x: Array) -> Soils:
            built = soils
            for value, setter in zip(x, setters, strict=True):
                built = setter(built, float(value))
            return built

        def residuals(x: Array) -> Array:
            built = build(x)
            return np.array([*self._prior(built, name), *self._misses(rows, built)])

        return build(
            least_squares(
                residuals, start, diff_step=np.full(len(start), _STEP), x_scale="jac", xtol=1e-6, ftol=1e-6
            ).x
        )

    def _unknowns(
        self, soils: Soils, name: str, rows: Sequence[PaperSurface]
    ) -> Iterator[tuple[float, Callable[[Soils, float], Soils]]]:
        """Start and setter of each unknown; all unbounded, in logarithms or logits."""
        settings, start = self.settings, self.settings.soils[name]

        def of_soil(change: Callable[[Soil, float], Soil]) -> Callable[[Soils, float], Soils]:
            return lambda all_, x: replace(all_, soils={**all_.soils, name: change(all_.soils[name], x)})

        yield math.log(start.stiffness_n_m), of_soil(lambda soil, x: replace(soil, stiffness_n_m=math.exp(x)))
        yield _logit(start.lost_share), of_soil(lambda soil, x: replace(soil, lost_share=_share(x)))
        if start.spot_std_fitted:
            yield (
                math.log(start.spot_std),
                of_soil(
                    lambda soil, x: replace(
                        soil, spot_std=math.exp(x), hop_std=settings.hop_share * math.exp(x)
                    )
                ),
            )
        if start.compacts:
            yield _logit(0.85), of_soil(lambda soil, x: replace(soil, kept_by_hop=_share(x)))
        if any(row.tilt_deg for row in rows):
            yield (
                settings.friction_angle_deg_start,
                lambda all_, x: replace(all_, tilt_law=TiltLaw(max(x, 25.0))),
            )
        if any(row.foot != settings.reference_foot for row in rows):
            yield settings.exponent_start, _of_foot_law("exponent")
            yield settings.stiffness_exponent_start, _of_foot_law("stiffness_exponent")
            yield settings.flat_factor_start, _of_foot_law("flat_factor")

    def _prior(self, soils: Soils, name: str) -> Iterator[float]:
        soil, start, settings = soils.soils[name], self.settings.soils[name], self.settings
        yield math.log(soil.stiffness_n_m / start.stiffness_n_m) / settings.stiffness_log_std
        yield (soil.lost_share - start.lost_share) / settings.lost_share_std
        drift = soils.foot_law.stiffness_exponent - settings.stiffness_exponent_start
        yield drift / settings.stiffness_exponent_std

    def _misses(self, rows: Sequence[PaperSurface], soils: Soils) -> Iterator[float]:
        settings = self.settings
        for row in rows:
            c3, target = self.simulate(row, soils), row.c3_direct
            assert target.low is not None and target.high is not None
            yield (float(np.mean(c3)) - target.mean) / settings.mean_tolerance
            if self._compacts(row):
                fold = max(c3[0], 1e-3) / max(c3[self.paper.compaction.hops - 1], 1e-3)
                yield math.log(fold / self.paper.compaction.fold) / settings.fold_tolerance
            yield (max(c3) - min(c3) - (target.high - target.low)) / settings.range_tolerance


def _of_foot_law(name: str) -> Callable[[Soils, float], Soils]:
    return lambda soils, x: replace(soils, foot_law=replace(soils.foot_law, **{name: x}))


def _logit(share: float) -> float:
    return math.log(share / (1.0 - share))


def _share(logit: float) -> float:
    return 1.0 / (1.0 + math.exp(-max(min(logit, _LOOSEST), -_LOOSEST)))
