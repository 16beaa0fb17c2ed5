"""What acts alike on the recordings is set aside with its like, for as long as it does."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from ground.diagnose.outlook import Outlook
from ground.diagnose.trials import Trials


class Weighed(Trials):
    """Trials whose candidates are as likely as said."""

    def odds(self, promise: Any) -> float:
        return float(promise.likely)


def promise(key: str, gain: float, likely: float, angle_rad: float) -> Any:
    """A promise that moves two residuals, in a direction."""
    direction = np.array([np.cos(angle_rad), np.sin(angle_rad)])
    return SimpleNamespace(candidate=SimpleNamespace(key=key), gain=gain, likely=likely, direction=direction)


def test_twins_are_told_apart_once_what_is_found_parts_them() -> None:
    nothing: Any = None
    trials = Weighed(nothing, Outlook(lambda *_: None), nothing, {})
    dry, bias = promise("dry", 5.0, 1.0, 0.3), promise("bias", 6.0, 0.1, 0.3)
    assert trials.without_twins([dry, bias]) == [dry]
    assert [(c.key, odds) for c, odds in trials._twins["dry"]] == [("bias", 0.1)]
    assert trials.without_twins([dry]) == [dry]  # what does not compete now is what it was
    assert len(trials._twins["dry"]) == 1
    parted = promise("bias", 6.0, 0.4, 1.0)
    assert trials.without_twins([dry, parted]) == [parted, dry]
    assert trials._twins["dry"] == ()
