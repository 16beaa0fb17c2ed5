"""What came of a campaign of missions or diagnoses: a table, a sentence, figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ground.campaign.diagnosis import NOTHING
from ground.campaign.missions import QUANTITIES, errors_sigmas
from ground.campaign.study import Row
from ground.report.campaign_page import rate_limits

Z95 = 1.959964
DASH = "–"


@dataclass(frozen=True)
class Summary:
    """A table for people and figures for machines."""

    title: str
    headers: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    sentence: str
    figures: dict[str, dict[str, object]]


def of_missions(rows: Sequence[Row]) -> Summary:
    """By surface: missions, those completed, valid hops, and what of the 95 % intervals hold the truth."""
    table, figures = [], dict[str, float]()
    names = sorted({row["surface"] for row in rows})
    for name in (*names, "all"):
        own = [row for row in rows if name in (row["surface"], "all")]
        hops = [hop for row in own for hop in row["hops"]]
        valid = sum(hop["verdict"] == "valid" for hop in hops)
        completed = sum(row["completed"] for row in own)
        cells = [_coverage(own, quantity) for quantity in QUANTITIES]
        table.append(
            (name, str(len(own)), str(completed), f"{valid} of {len(hops)}", *(text for text, _ in cells))
        )
        if name == "all":
            found = zip(QUANTITIES, (numbers for _, numbers in cells), strict=True)
            figures = {f"{q}_{key}": value for q, numbers in found for key, value in numbers.items()}
            figures |= {"missions": len(own), "completed": completed, "hops": len(hops), "valid": valid}
    low, high = rate_limits(sum(row["completed"] for row in rows), len(rows)) if rows else (0.0, 1.0)
    return Summary(
        "Missions",
        (
            "surface",
            "missions",
            "completed",
            "hops valid",
            *(f"{q}: in 95 %, mean error" for q in QUANTITIES),
        ),
        tuple(table),
        f"completed: with 95 % confidence between {100 * low:.1f} and {100 * high:.1f} % of such missions; "
        "mean errors are in the estimates' own sigmas",
        {key: {"value": value, "unit": "1"} for key, value in figures.items()},
    )


def _coverage(rows: list[Row], quantity: str) -> tuple[str, dict[str, float]]:
    errors = np.array([error for name, error in errors_sigmas(rows) if name == quantity])
    if not errors.size:
        return DASH, {}
    inside, mean = float(np.mean(np.abs(errors) <= Z95)), float(np.mean(errors))
    text = f"{100 * inside:.0f} %, {mean:+.2f} ± {1.0 / np.sqrt(errors.size):.2f}"
    return text, {"coverage95": inside, "mean_error_sigmas": mean, "estimates": errors.size}


def of_diagnoses(rows: Sequence[Row]) -> Summary:
    """By what was hidden: trials, right ones with their 95 % interval, and what was said instead."""
    table, figures = [], {}
    for name in (*sorted({row["hidden"] for row in rows}), "all"):
        own = [row for row in rows if name in (row["hidden"], "all")]
        right = sum(row["right"] for row in own)
        low, high = rate_limits(right, len(own))
        wrong = sorted({_said(row) for row in own if not row["right"]})
        share = f"{100 * right / len(own):.0f} % ({100 * low:.0f} to {100 * high:.0f})"
        table.append((name, ", ".join(wrong) or DASH, str(len(own)), share))
        figures[f"right_{name}"] = {"value": right / len(own), "unit": "1"}
        figures[f"trials_{name}"] = {"value": len(own), "unit": "1"}
    nulls = [row for row in rows if row["hidden"] == NOTHING]
    alarms = sum(bool(row["findings"]) for row in nulls)
    return Summary(
        "Diagnoses",
        ("hidden", "said instead", "trials", "right (95 %)"),
        tuple(table),
        f"false alarms where nothing was hidden: {alarms} of {len(nulls)}",
        figures,
    )


def _said(row: Row) -> str:
    return str(row["findings"][0]["physics"]) if row["findings"] else NOTHING


SUMMARIES: Mapping[str, Callable[[Sequence[Row]], Summary]] = {
    "missions": of_missions,
    "diagnosis": of_diagnoses,
}
