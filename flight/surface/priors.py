"""What is expected of a spot before its first hop: a mixture over the known, the learned and unknown ground."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flight.surface.compaction import FEW_LAWS
from flight.surface.known import UNKNOWN, KnownSurface, SurfaceSettings, same_setting
from flight.surface.mixture import FALL, LAW_COUNT, LOSS, SIZE, SLOPE, STIFFNESS, Mixture
from flight.surface.settings import LearningSettings, SurfaceLearning

Array = NDArray[np.float64]

KINDS = ("as before", "new place", "loosened", "changed foot")
"""Ways in which the robot came to stand on a spot."""
AS_BEFORE, NEW_PLACE, LOOSENED, CHANGED_FOOT = range(len(KINDS))

_CELLS_C3, _CELLS_STIFFNESS = 9, 7
_CELL_OVERLAP = 0.6  # standard deviation of a cell of the unknown, in widths of the cell
_MIDDLE, _NO_INFORMATION_STD = 11.5, 1.5  # of ln stiffness, where a table has none


@dataclass(frozen=True)
class SurfaceModel:
    """Places of one surface with one foot and tilt: loss u, its fall as a share, ln stiffness, each mean and spread.

    `loss_stiffness` is the correlation of u and ln stiffness from place to place: looser is softer and lossier.
    """

    name: str
    loss: float
    loss_std: float
    fall: float
    fall_std: float
    log_stiffness: float | None
    log_stiffness_std: float
    hop_std: float
    loss_stiffness: float = 0.0


def loss_of(c3: float) -> float:
    """u = -ln(1 - C3)."""
    return -math.log1p(-c3)


def c3_of(loss: float) -> float:
    """C3 = 1 - exp(-u)."""
    return -math.expm1(-loss)


def known_models(
    surfaces: SurfaceSettings, learning: LearningSettings, foot: str, tilt_deg: float
) -> list[SurfaceModel]:
    """Every known surface with this foot and tilt; where no table has it, carried there from another row."""
    models = []
    for name in dict.fromkeys(surface.name for surface in surfaces.surfaces):
        rows = [surface for surface in surfaces.surfaces if surface.name == name]
        exact = [row for row in rows if same_setting(row, foot, tilt_deg)]
        model = surface_model(exact[0] if exact else rows[0], learning)
        models.append(model if exact else _carried(model, rows[0], learning, foot, tilt_deg))
    return models


def surface_model(row: KnownSurface, learning: LearningSettings) -> SurfaceModel:
    """A row of the table as a model of places."""
    loss_std = row.place_c3_std / (1.0 - row.place_c3_mean)
    fall = 0.0 if row.fall is None else row.fall
    stiffness = None if row.stiffness_n_m is None else math.log(row.stiffness_n_m)
    return SurfaceModel(
        name=row.name,
        loss=loss_of(row.place_c3_mean),
        loss_std=loss_std,
        fall=fall,
        fall_std=learning.fall_std,
        log_stiffness=stiffness,
        log_stiffness_std=_NO_INFORMATION_STD if stiffness is None else learning.stiffness_place_std,
        hop_std=max(learning.hop_share * loss_std, learning.least_hop_std),
        loss_stiffness=0.0 if stiffness is None else learning.loss_stiffness,
    )


def _carried(
    model: SurfaceModel, row: KnownSurface, learning: LearningSettings, foot: str, tilt_deg: float
) -> SurfaceModel:
    """A surface with another foot or tilt than measured, by the factors that quartz sand showed, and less sure."""
    factor = learning.foot_factors.get(foot, 1.0) / learning.foot_factors.get(row.foot, 1.0)
    factor *= learning.tilt_factor_20deg ** ((abs(tilt_deg) - abs(row.tilt_deg)) / 20.0)
    spread = math.hypot(model.loss_std * factor, learning.carried_std * model.loss * factor)
    return SurfaceModel(
        model.name,
        model.loss * factor,
        spread,
        model.fall,
        model.fall_std,
        model.log_stiffness,
        math.hypot(model.log_stiffness_std, learning.carried_std),
        model.hop_std * factor,
        0.0,
    )


def unknown_models(surfaces: SurfaceSettings, learning: LearningSettings) -> Iterator[SurfaceModel]:
    """Cells that together cover unknown ground evenly in C3 and ln stiffness, firm or compacting."""
    low, high = surfaces.unknown_c3_low, surfaces.unknown_c3_high
    width = (high - low) / _CELLS_C3
    bottom, top = (
        math.log(value) for value in (surfaces.unknown_stiffness_low_n_m, surfaces.unknown_stiffness_high_n_m)
    )
    step = (top - bottom) / _CELLS_STIFFNESS
    for row in range(_CELLS_C3):
        c3 = low + (row + 0.5) * width
        for column in range(_CELLS_STIFFNESS):
            for fall, fall_std in (
                (0.0, learning.fall_std),
                (learning.unknown_fall, learning.unknown_fall_std),
            ):
                yield SurfaceModel(
                    name=UNKNOWN,
                    loss=loss_of(c3),
                    loss_std=_CELL_OVERLAP * width / (1.0 - c3),
                    fall=fall,
                    fall_std=fall_std,
                    log_stiffness=bottom + (column + 0.5) * step,
                    log_stiffness_std=_CELL_OVERLAP * step,
                    hop_std=learning.unknown_hop_std,
                )


def prior_mixture(
    models: Sequence[SurfaceModel], names: Sequence[str], settings: SurfaceLearning
) -> tuple[Mixture, Array]:
    """All hypotheses of a fresh spot, unweighted, without an error of C2_ref; and each one's share of its name (n,).

    A name's probability is shared out evenly among its models and laws.
    """
    learning = settings.learning
    rows: list[tuple[float, int, SurfaceModel]] = []  # each with a hypothesis for each of its laws
    laws: list[Sequence[int]] = []
    for number, name in enumerate(names):
        own = [model for model in models if model.name == name]
        apart = FEW_LAWS if len(own) > 1 else range(LAW_COUNT)
        rows += [(1.0 / (len(own) * len(apart)), number, model) for model in own]
        laws += [apart] * len(own)
    times = [len(apart) for apart in laws]
    count = sum(times)
    mixture = Mixture(
        log_weights=np.zeros(count),
        means=np.repeat([_mean(model, learning.energy_slope_share) for *_, model in rows], times, axis=0),
        covariances=np.repeat([_covariance(model, learning) for *_, model in rows], times, axis=0),
        surfaces=np.repeat(np.array([number for _, number, _ in rows], dtype=np.int64), times),
        laws=np.array([law for apart in laws for law in apart], dtype=np.int64),
        kinds=np.full(count, AS_BEFORE, dtype=np.int64),
        loss_scatter=np.repeat([model.hop_std for *_, model in rows], times),
        stiffness_scatter=np.full(count, learning.stiffness_hop_std),
    )
    return mixture, np.repeat([share for share, *_ in rows], times)


def _mean(model: SurfaceModel, slope_share: float) -> list[float]:
    mean = [0.0] * SIZE
    mean[LOSS], mean[FALL] = model.loss, model.loss * model.fall
    mean[SLOPE] = slope_share * model.loss
    mean[STIFFNESS] = _MIDDLE if model.log_stiffness is None else model.log_stiffness
    return mean


def _covariance(model: SurfaceModel, learning: LearningSettings) -> Array:
    """The fall is a share of the loss, d = a f, which ties the two; to first order."""
    covariance = np.zeros((SIZE, SIZE))
    square, share = model.loss_std**2, model.fall
    covariance[LOSS, LOSS] = square
    covariance[LOSS, FALL] = covariance[FALL, LOSS] = share * square
    covariance[FALL, FALL] = share**2 * square + model.fall_std**2 * (model.loss**2 + square)
    covariance[SLOPE, SLOPE] = learning.energy_slope_std**2
    covariance[STIFFNESS, STIFFNESS] = model.log_stiffness_std**2
    tied = model.loss_stiffness * model.loss_std * model.log_stiffness_std
    covariance[LOSS, STIFFNESS] = covariance[STIFFNESS, LOSS] = tied
    covariance[FALL, STIFFNESS] = covariance[STIFFNESS, FALL] = share * tied
    return covariance
