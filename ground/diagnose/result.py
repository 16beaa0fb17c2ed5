"""What a diagnosis answers: the contract of `diagnosis.json`, as dataclasses."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Verdict = Literal["mismatch", "consistent", "undecidable"]
FindingKind = Literal["physics", "sensor", "parameter"]


@dataclass(frozen=True)
class Interval:
    """A stretch of one run, on the recording's clock."""

    run: str
    from_s: float
    to_s: float


@dataclass(frozen=True)
class Alternative:
    """Another name that the evidence leaves open."""

    physics_id: str
    probability: float


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter with its standard deviation."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Finding:
    """One thing that the plant left out, in the contract's terms."""

    kind: FindingKind
    phase: str
    equation: str
    channels: tuple[str, ...]
    intervals: tuple[Interval, ...]
    regime: str
    physics_id: str
    probability: float
    alternatives: tuple[Alternative, ...]
    statement: str
    formula: str
    parameters: Mapping[str, Estimate]


@dataclass(frozen=True)
class ChannelFit:
    """Held-out misfit of one channel under the three fits, and the sensor's own noise; in the channel's unit."""

    nominal_rms: float
    refit_rms: float
    extended_rms: float
    noise_rms: float
    unit: str


@dataclass(frozen=True)
class Whiteness:
    """p-values of the Ljung-Box test on the held-out residuals, before and after."""

    refit_p: float
    extended_p: float


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer. `notes` tell a person what to keep in mind; `details` holds figures beyond the contract."""

    plant: str
    fitted: tuple[str, ...]
    held_out: tuple[str, ...]
    verdict: Verdict
    findings: tuple[Finding, ...]
    fit: Mapping[str, ChannelFit]
    residual_whiteness: Mapping[str, Whiteness]
    next_experiment: str | None
    notes: tuple[str, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> str:
        """The text of `diagnosis.json` (format 1). A figure that does not exist is null, never NaN."""
        content: dict[str, Any] = {
            "format": 1,
            "plant": self.plant,
            "recordings": {"fitted": list(self.fitted), "held_out": list(self.held_out)},
            "verdict": self.verdict,
            "findings": [asdict(finding) for finding in self.findings],
            "fit": {name: asdict(fit) for name, fit in self.fit.items()},
            "residual_whiteness": {name: asdict(white) for name, white in self.residual_whiteness.items()},
            "next_experiment": self.next_experiment,
            "notes": list(self.notes),
            "details": dict(self.details),
        }
        return json.dumps(_finite(content), indent=1, allow_nan=False) + "\n"


def _finite(content: Any) -> Any:
    """The same structure with every figure that is not finite replaced by None."""
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_finite(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content
