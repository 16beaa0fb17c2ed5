"""Ratios of errors: of the same blocks, with an interval that covers, and a rival that ran away loses."""

from __future__ import annotations

import numpy as np

from benchmarks.case_studies.scores import ratio, scored


def test_a_rival_that_errs_twice_as_much_everywhere() -> None:
    """The blocks differ much, but both models err in the same ones: the ratio is sure."""
    own = np.random.default_rng(1).exponential(size=20)
    found = ratio([own, 3.0 * own], [4.0 * own, 12.0 * own])
    assert np.allclose([found.value, found.low, found.high], 0.5)


def test_a_rival_that_ran_away() -> None:
    own = scored([np.ones((40, 1))], 0, 20)
    other = scored([np.where(np.arange(40)[:, None] > 30, np.inf, 1.0)], 0, 20)
    assert ratio([own.sums], [other.sums]).value == 0.0
    assert ratio([other.sums], [own.sums]).value == np.inf


def test_channels_count_alike() -> None:
    """In metres or in millimetres."""
    own, other = np.full(20, 2.0), np.full(20, 8.0)
    plain = ratio([own, own], [other, 4.0 * other])
    scaled = ratio([own, 1e6 * own], [other, 4e6 * other])
    assert np.isclose(plain.value, scaled.value)
    assert np.isclose(plain.value, 1.0 / np.sqrt((4.0 + 16.0) / 2.0))


def test_the_interval_covers() -> None:
    """Two models that err alike, independently: nine intervals in ten hold 1, or nearly so, with 20 blocks."""
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(300):
        own, other = (rng.normal(size=(20, 10)) ** 2 for _ in range(2))
        found = ratio([own.sum(axis=1)], [other.sum(axis=1)])
        held += found.low <= 1.0 <= found.high
    assert 0.80 <= held / 300 <= 0.97
