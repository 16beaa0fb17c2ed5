"""An effect in the plant file stays as long as recordings are predicted better with it, and no longer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from diagnose_rig import friction, plant, recordings

from ground.diagnose.data import prepare
from ground.diagnose.fit import fit_plant
from ground.diagnose.scales import find_scales
from ground.diagnose.withdraw import withdrawals
from ground.diagnose.workers import Workers


@pytest.mark.parametrize(("at_work", "proposed"), [(True, []), (False, ["coulomb_friction"])])
def test_a_needless_effect_is_proposed_for_withdrawal(
    tmp_path: Path, at_work: bool, proposed: list[str]
) -> None:
    bare = plant(tmp_path)
    level = friction(0.8)
    known = replace(level, parameters={n: replace(p, std=0.05) for n, p in level.parameters.items()})
    given = bare.with_effect(known)
    data = prepare(recordings(bare.with_effect(level) if at_work else bare, seed=21), given)
    refit = fit_plant(given, data.windows, data.sigmas, {})
    with Workers(data.windows, data.sigmas, find_scales(refit, data.windows), 1) as workers:
        found = withdrawals(refit, given, workers)
    assert [withdrawal.physics_id for withdrawal in found] == proposed
