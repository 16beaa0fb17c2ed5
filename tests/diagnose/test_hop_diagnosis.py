"""Hops in which something is hidden that the nominal parameters nearly absorb; and hops in which nothing is."""

from __future__ import annotations

import numpy as np
import pytest
from hop_rig import effect, hops, nominal

from ground.diagnose.data import prepare
from ground.diagnose.fit import fit_plant
from ground.diagnose.knots import knot_force
from ground.diagnose.pipeline import APPROACH, diagnose
from ground.diagnose.scales import find_scales

DRAG = effect("latch_drag", "latch", F_d=(14.0, "N"), t_f=(0.012, "s"))
RATE = effect("soil_rate_dependence", "ground_contact", c_g=(35.0, "N*s/m"))
SCALE = effect("sensor_scale", "sensor", "spring_compression_m", scale=(0.02, "1"))


@pytest.mark.parametrize(
    ("planted", "equation"), [(DRAG, "latch"), (RATE, "ground_contact"), (SCALE, "sensor")]
)
def test_what_was_planted_is_named(planted, equation) -> None:  # type: ignore[no-untyped-def]
    found = diagnose(hops(nominal().with_effect(planted), seed=5), nominal()).diagnosis
    assert found.verdict == "mismatch"
    assert [finding.physics_id for finding in found.findings] == [planted.physics_id]
    assert found.findings[0].equation == equation
    assert found.findings[0].probability > 0.9
    for name, parameter in planted.parameters.items():
        estimate = found.findings[0].parameters[name]
        assert abs(estimate.value - parameter.value) < 4.0 * estimate.std, name
    for channel, fit in found.fit.items():
        assert fit.extended_rms < 1.15 * fit.noise_rms, channel


def test_hops_without_anything_hidden_are_consistent() -> None:
    found = diagnose(hops(nominal(), seed=6), nominal()).diagnosis
    assert found.verdict == "consistent"
    assert not found.findings


def test_a_missing_force_on_the_foot_is_located_there() -> None:
    data = prepare(hops(nominal().with_effect(RATE), seed=7), nominal())
    refit = fit_plant(nominal(), data.windows, data.sigmas, {}, approach=APPROACH)
    scales = find_scales(refit, data.windows)
    gains = {}
    for balance in ("ground_contact", "body_momentum", "magnet"):
        force = knot_force(refit, data.windows, 0, data.sigmas, balance, scales[balance]["F"])
        assert force is not None
        gains[balance] = force.log_likelihood_gain
    assert gains["ground_contact"] > gains["body_momentum"] + 10.0
    assert gains["ground_contact"] > gains["magnet"] + 10.0


def test_no_force_is_missing_where_nothing_is_hidden() -> None:
    data = prepare(hops(nominal(), seed=8), nominal())
    refit = fit_plant(nominal(), data.windows, data.sigmas, {}, approach=APPROACH)
    scales = find_scales(refit, data.windows)
    force = knot_force(refit, data.windows, 0, data.sigmas, "body_momentum", scales["body_momentum"]["F"])
    assert force is not None
    assert force.log_likelihood_gain < 10.0
    assert np.mean(np.abs(force.force) < 2.0 * force.force_std) > 0.9
