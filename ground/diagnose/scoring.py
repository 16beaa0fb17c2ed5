"""How well a model predicts what it did not see, and how sure a comparison of two models is.

The score of a held-out block is its Gaussian log predictive density, with the residual's scale learned on the
fitted part and the samples counted at their effective number (residuals of an imperfect model are correlated).
Models are compared by the scores' differences over blocks; the Bayesian bootstrap over blocks turns them into
weights (pseudo-BMA+, Yao, Vehtari, Simpson and Gelman 2018).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Float = NDArray[np.float64]

BOOTSTRAP_DRAWS = 4000
OCCAM = 10.0
"""Prior odds against each further free parameter (one step of Jeffreys' scale: strong)."""


def lag_one_correlation(residuals: Float) -> float:
    """Correlation of successive residuals of one channel, 0 where there is no variance; in [0, 0.9999]."""
    seen = residuals[np.isfinite(residuals)]
    power = float(seen @ seen)
    if seen.size < 3 or power == 0.0:
        return 0.0
    return float(np.clip(seen[1:] @ seen[:-1] / power, 0.0, 0.9999))


def effective_share(residuals: Float) -> Float:
    """Effective samples per sample for each channel of (samples, channels), from an AR(1) picture."""
    rho = np.array([lag_one_correlation(column) for column in residuals.T])
    return (1.0 - rho) / (1.0 + rho)


def block_scores(blocks: Sequence[Float], scale: Float, share: Float) -> Float:
    """Log predictive density of each held-out block, (blocks,).

    `blocks` are standardised residuals (samples, channels), NaN where nothing was measured; `scale` (channels,) is
    the residual's learned scale in sigmas, at least 1; `share` (channels,) the effective samples per sample.
    """
    scores = np.zeros(len(blocks))
    for number, block in enumerate(blocks):
        count = np.isfinite(block).sum(axis=0)
        power = np.nansum(block**2, axis=0)
        density = -0.5 * (power / scale**2 + count * np.log(2.0 * np.pi * scale**2))
        scores[number] = float(np.sum(share * density))
    return scores


def learned_scale(residuals: Float) -> Float:
    """Root mean square of standardised residuals by channel, never below the sensor's own noise (1)."""
    with np.errstate(invalid="ignore"):
        power = np.array(
            [np.mean(c[np.isfinite(c)] ** 2) if np.isfinite(c).any() else 1.0 for c in residuals.T]
        )
    return np.asarray(np.sqrt(np.maximum(1.0, power)))


def model_weights(scores: Float, parameters: Sequence[float], seed: int = 0) -> Float:
    """Probability of each model, (models,), from its block scores (models, blocks) by pseudo-BMA+.

    `parameters` (models,) counts the free parameters of each: a rival that holds another as a limiting case predicts
    just as well, so the prior odds fall by `OCCAM` for each further parameter (and for whatever else is as unusual).
    """
    generator = np.random.Generator(np.random.PCG64(seed))
    models, count = scores.shape
    if models == 1:
        return np.ones(1)
    shares = generator.dirichlet(np.ones(count), BOOTSTRAP_DRAWS)
    totals = count * shares @ scores.T - np.log(OCCAM) * np.asarray(parameters)
    totals -= totals.max(axis=1, keepdims=True)
    weights = np.exp(totals)
    weights /= weights.sum(axis=1, keepdims=True)
    return np.asarray(weights.mean(axis=0))


def probability_better(challenger: Float, current: Float, seed: int = 0) -> float:
    """Probability that the challenger's expected score is the higher one, by the Bayesian bootstrap."""
    generator = np.random.Generator(np.random.PCG64(seed))
    shares = generator.dirichlet(np.ones(challenger.size), BOOTSTRAP_DRAWS)
    return float(np.mean(shares @ (challenger - current) > 0.0))


def whiteness_p(residuals: Float, lags: int = 20) -> float:
    """p-value of the Ljung-Box test that one channel's residuals are white; NaN samples are dropped.

    Fewer samples than four times the lags cannot be tested and give 1.
    """
    seen = residuals[np.isfinite(residuals)]
    seen = seen - (seen.mean() if seen.size else 0.0)
    power = float(seen @ seen)
    if seen.size < 4 * lags or power == 0.0:
        return 1.0
    count = seen.size
    correlation = np.array([seen[k:] @ seen[:-k] / power for k in range(1, lags + 1)])
    statistic = count * (count + 2) * float(np.sum(correlation**2 / (count - np.arange(1, lags + 1))))
    return float(stats.chi2.sf(statistic, lags))
