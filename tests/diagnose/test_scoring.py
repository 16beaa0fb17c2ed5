"""Scores and probabilities of models, on residuals whose truth is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ground.diagnose import scoring


def ar1(generator: np.random.Generator, count: int, rho: float) -> np.ndarray:
    noise = generator.standard_normal(count) * math.sqrt(1.0 - rho**2)
    series = np.empty(count)
    series[0] = generator.standard_normal()
    for k in range(1, count):
        series[k] = rho * series[k - 1] + noise[k]
    return series


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_effective_share_counts_correlated_samples_once(rho: float) -> None:
    """The variance of a mean of n samples is 1 / (n * share)."""
    generator = np.random.default_rng(1)
    means = [ar1(generator, 2000, rho).mean() for _ in range(300)]
    share = scoring.effective_share(ar1(generator, 20000, rho)[:, None])[0]
    assert np.var(means) * 2000 * share == pytest.approx(1.0, rel=0.3)


def test_whiteness_passes_white_residuals_as_often_as_it_should() -> None:
    generator = np.random.default_rng(2)
    p = [scoring.whiteness_p(generator.standard_normal(1000)) for _ in range(400)]
    assert 0.02 <= np.mean(np.array(p) < 0.05) <= 0.09


def test_whiteness_refuses_coloured_residuals() -> None:
    assert scoring.whiteness_p(ar1(np.random.default_rng(3), 1000, 0.4)) < 1e-6


def test_whiteness_of_too_few_samples_is_undecided() -> None:
    assert scoring.whiteness_p(np.array([1.0, math.nan, 2.0])) == 1.0


def test_a_clearly_better_model_takes_the_weight() -> None:
    generator = np.random.default_rng(4)
    blocks = [generator.standard_normal((50, 1)) for _ in range(20)]
    worse = [block + 0.8 for block in blocks]
    one, share = np.ones(1), np.ones(1)
    scores = np.vstack([scoring.block_scores(b, one, share) for b in (blocks, worse)])
    assert scoring.model_weights(scores, [1, 1])[0] > 0.99
    assert scoring.probability_better(scores[0], scores[1]) > 0.99


def test_equal_models_share_the_weight() -> None:
    scores = np.vstack([np.linspace(-3.0, 3.0, 12)] * 2)
    assert scoring.model_weights(scores, [2, 2]) == pytest.approx([0.5, 0.5])
    assert scoring.model_weights(scores, [1, 2]) == pytest.approx([10 / 11, 1 / 11])
    assert scoring.probability_better(scores[0], scores[1]) == 0.0


def test_missing_samples_score_nothing() -> None:
    block = np.array([[1.0, math.nan], [2.0, math.nan]])
    alone = scoring.block_scores([block[:, :1]], np.ones(1), np.ones(1))
    assert scoring.block_scores([block], np.ones(2), np.ones(2)) == pytest.approx(alone)


def test_the_learned_scale_never_beats_the_sensor() -> None:
    assert scoring.learned_scale(np.full((10, 1), 0.1)) == pytest.approx([1.0])
    assert scoring.learned_scale(np.full((10, 1), 7.0)) == pytest.approx([7.0])
