"""How much more data an open question needs: as evidence grows with data, and not where the two never part."""

from __future__ import annotations

import math
import re

import pytest
from diagnose_rig import plant, recordings

from ground.diagnose.candidates import EffectCandidate, effect_candidates
from ground.diagnose.chosen import Chosen
from ground.diagnose.data import prepare
from ground.diagnose.fit import fit_plant
from ground.diagnose.needed import needed
from ground.diagnose.scales import find_scales
from sim_hal.plant.simulate import Plant


@pytest.fixture(scope="module")
def rivals(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plant, EffectCandidate, EffectCandidate]:
    """Two laws with one free parameter each."""
    given = plant(tmp_path_factory.mktemp("rig"))
    data = prepare(recordings(given, seed=1), given)
    scales = find_scales(fit_plant(given, data.windows, data.sigmas, {}), data.windows)
    found = {c.physics_id: c for c in effect_candidates(given, scales)}
    return given, found["coulomb_friction"], found["quadratic_friction"]


def said(rivals: tuple[Plant, EffectCandidate, EffectCandidate], own: float, other: float) -> tuple[str, ...]:
    given, one, rival = rivals
    weights = ((one, own), (rival, other))
    return needed((Chosen(one, 1.0, (rival,), {}, weights),), given)


@pytest.mark.parametrize("more", [2.5, 4.0, 10.0])
def test_the_more_evidence_the_less_data_is_needed(
    rivals: tuple[Plant, EffectCandidate, EffectCandidate], more: float
) -> None:
    odds = math.exp(math.log(19.0) / more)  # what so many times as much data would bring to 19 : 1
    (text,) = said(rivals, odds / (1.0 + odds), 1.0 / (1.0 + odds))
    number = float(re.findall(r"About ([0-9.e+]+) times", text)[0])
    assert number == pytest.approx(more, rel=0.1)
    assert "coulomb friction (force balance) from quadratic friction (force balance)" in text


def test_laws_that_the_data_do_not_part_get_no_number(
    rivals: tuple[Plant, EffectCandidate, EffectCandidate],
) -> None:
    (text,) = said(rivals, 0.5, 0.5)
    assert "hardly tell" in text


def test_what_is_told_is_not_mentioned(rivals: tuple[Plant, EffectCandidate, EffectCandidate]) -> None:
    assert said(rivals, 0.97, 0.03) == ()


def test_a_law_without_rivals_needs_nothing(rivals: tuple[Plant, EffectCandidate, EffectCandidate]) -> None:
    given, one, _ = rivals
    assert needed((Chosen(one, 1.0, (), {}, ((one, 1.0),)),), given) == ()
