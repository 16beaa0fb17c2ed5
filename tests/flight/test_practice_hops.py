"""Hops of simulated rigs whose hidden physics flight does not know: heights within the stated error."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from flight import settings as flight_settings
from flight.evaluation import HopEnergies, evaluate_hop
from flight.record import HopRecord

PRACTICE = Path(__file__).resolve().parents[2] / "../shared/practice"
SETTINGS = flight_settings.load()

pytestmark = pytest.mark.skipif(not PRACTICE.is_dir(), reason=f"no practice recordings at {PRACTICE}")


def hops(case: str) -> Iterator[tuple[HopEnergies, float, float]]:
    """Each training hop of a case: its evaluation, true height and true touchdown."""
    truth = yaml.safe_load((PRACTICE / case / "answer.yaml").read_text())["aggregates_true"]
    for sidecar in sorted((PRACTICE / case / "train").glob("*.yaml")):
        about = yaml.safe_load(sidecar.read_text())
        with gzip.open(sidecar.with_suffix(".csv.gz"), "rt") as lines:
            table = np.genfromtxt(lines, delimiter=",", names=True)
        times, force = table["time_s"], table["body_acceleration_m_s2"]
        record = HopRecord(
            about["events"][0]["time_s"],
            times,
            force,
            np.abs(force) > 313.7,
            times,
            table["spring_compression_m"],
        )
        true = truth[sidecar.stem]
        yield evaluate_hop(record, SETTINGS, 0), true["hop_height_m"], true["touchdown_s"]


@pytest.mark.parametrize("case", ["case_01", "case_02", "case_03", "case_05"])
def test_heights_of_soil_drag_and_latch_cases_are_within_half_a_per_cent(case: str) -> None:
    seen = list(hops(case))
    assert seen
    for energies, height_m, touchdown_s in seen:
        assert energies.flight.verdict == "valid", energies.flight.reasons
        assert energies.height_m is not None
        assert energies.height_m.value == pytest.approx(height_m, rel=5e-3)
        assert abs(energies.height_m.value - height_m) < 2.5 * energies.height_m.sigma
        # The truth names the first sample after touchdown: up to 0.6 ms later.
        assert -1.0e-3 < energies.flight.touchdown_s - touchdown_s < 0.4e-3


def test_friction_in_the_spring_degrades_the_verdict_and_widens_the_errors() -> None:
    for energies, height_m, _ in hops("case_07"):
        assert energies.flight.verdict in ("degraded", "rejected")
        assert energies.flight.reasons
        if energies.height_m is not None:
            assert energies.height_m.value == pytest.approx(height_m, rel=0.015)
            assert abs(energies.height_m.value - height_m) < 3.0 * energies.height_m.sigma
