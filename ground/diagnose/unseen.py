"""What no fit saw: how plants predict it from its first samples, and what that says of rivals.

Cross-validation settles an open start on the left-out data itself, for a start that nobody could know is no failure
to predict. So it does not see that a law predicts well only from a start that no first samples show; what no fit saw
does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.crossval import HeldOut
from ground.diagnose.fit import Fit
from ground.diagnose.scoring import effective_share, model_weights
from ground.diagnose.segments import Segment
from ground.diagnose.verify import predict
from sim_hal.plant.simulate import SimulationError

Float = NDArray[np.float64]

WINS = 0.5
"""An effect stays if the held-out stretches are likelier than not to be predicted better with it."""
SURELY_WORSE = 0.05
"""It leaves if whole held-out recordings, run free, are less likely than this to be predicted better with it."""


@dataclass(frozen=True)
class HeldOutViews:
    """What no fit saw, as windows that are each anchored anew, and as whole recordings run free from their start.

    Windows judge, for they bear with what no model of the rig knows; but what each window takes for a start that is
    a little off (a drift, say) may carry the whole recording away: what surely makes that worse is not there.
    """

    windows: Sequence[Segment]
    whole: Sequence[Segment]

    @property
    def views(self) -> tuple[tuple[Sequence[Segment], float], ...]:
        """The views that differ, each with the least probability of being better that an effect must have there."""
        free = ((self.whole, SURELY_WORSE),) if len(self.whole) != len(self.windows) else ()
        return ((self.windows, WINS), *free)


def errors_of(fit: Fit, held_out: Sequence[Segment], sigmas: Float) -> list[Float]:
    """Standardised errors of each held-out window, (samples, outputs), NaN where nothing was measured."""
    plant = fit.plant.with_values(fit.values)
    return [(segment.judged - predict(plant, segment, sigmas)) / sigmas for segment in held_out]


def weights_on(segments: Sequence[Segment], fits: Sequence[Fit], sigmas: Float) -> Float:
    """Probability of each fit, (fits,), by how it predicts segments that no fit saw; even where one cannot be run."""
    try:
        seen = [HeldOut(tuple(errors_of(fit, segments, sigmas))) for fit in fits]
    except SimulationError:
        return np.full(len(fits), 1.0 / len(fits))
    best = min(seen, key=lambda held: held.mean_square)
    share = effective_share(np.vstack(best.residuals))
    return model_weights(np.vstack([held.scores(share) for held in seen]), [0.0] * len(fits))


def pooled(shares: Float, others: Float) -> Float:
    """Probabilities by two independent lots of data; by the first alone where they exclude each other."""
    both = shares * others
    total = float(both.sum())
    return both / total if total > 0.0 else shares
