"""A folder of recordings: those of the rig are taken, the others named with the reason."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from diagnose_rig import plant, recordings

from ground.diagnose.belonging import amount, belonging
from ground.diagnose.data import prepare
from ground.diagnose.unlike_units import unlike_units
from ground.recordings.model import RecordingError


def test_recordings_of_another_rig_are_left_out_with_the_reason(tmp_path: Path) -> None:
    given = plant(tmp_path)
    own = recordings(given, seed=1, count=2, samples=60)
    other = replace(own[0], run="another", channels={"temperature_k": own[0].channels["position_m"]})
    kept, reasons = belonging([own[0], other, own[1]], given)
    assert [one.run for one in kept] == ["run_0", "run_1"]
    (reason,) = reasons
    assert "another: the plant 'oscillator' needs the input 'push_n'" in reason
    with pytest.raises(RecordingError, match="needs the input"):
        belonging([other], given)


def test_the_amount_of_data_is_said(tmp_path: Path) -> None:
    own = recordings(plant(tmp_path), seed=1, count=2, samples=60)
    assert amount(own).startswith("Data: 2 recordings, 120 samples over 1.18 s.")
    assert amount(own[:1]).startswith("Data: 1 recording, 60 samples over 0.59 s.")
    assert amount(own, single=True).startswith("Data: 1 recording, 120 samples")


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1e3, "thousandths of m"),
        (1e-3, "multiples of 1000 m"),
        (57.3, None),
        (1.0, None),
    ],
)
def test_a_channel_in_another_unit_is_asked_about(tmp_path: Path, factor: float, words: str | None) -> None:
    given = plant(tmp_path)
    runs = recordings(given, seed=2, count=3)
    wrong = [
        replace(one, channels={**one.channels, "position_m": factor * one.channels["position_m"]})
        for one in runs
    ]
    notes = unlike_units(given, prepare(wrong, given).whole)
    assert len(notes) == (words is not None)
    if words is not None:
        assert "position_m" in notes[0]
        assert words in notes[0]
