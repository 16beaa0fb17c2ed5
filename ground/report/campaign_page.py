"""The page of a campaign of faults: what was planted, what was dangerous, how the missions ended."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
from scipy import stats

from ground.fault_campaign.campaign import CampaignResult
from ground.report.page import BLUE, GREEN, GREY, Cell, Page, Tone

CONFIDENCE = 0.95
STOWED = "stowed"
LONGEST_LIST = 50


def rate_limits(happened: int, missions: int) -> tuple[float, float]:
    """The 95 % interval of a rate (Clopper and Pearson 1934), from how often it happened."""
    tail = (1.0 - CONFIDENCE) / 2.0
    low = 0.0 if happened == 0 else float(stats.beta.ppf(tail, happened, missions - happened + 1))
    high = (
        1.0 if happened == missions else float(stats.beta.ppf(1.0 - tail, happened + 1, missions - happened))
    )
    return low, high


def verdict_sentence(result: CampaignResult) -> str:
    """What came of it, in words."""
    missions = len(result.rows)
    hurt = sum(bool(row["hazards"]) for row in result.rows)
    low, high = rate_limits(hurt, missions)
    text = f"{result.faults} faults that made a difference were planted in {missions} missions; "
    if hurt == 0:
        return text + (
            "none of them was dangerous by the plant's truth. With 95 % confidence fewer than "
            f"{100.0 * high:.2g} % of such missions are."
        )
    return text + (
        f"{hurt} of these were dangerous by the plant's truth: {100.0 * hurt / missions:.2g} %, with 95 % confidence "
        f"between {100.0 * low:.2g} and {100.0 * high:.2g} %."
    )


def write_campaign_page(result: CampaignResult, seed: int, path: Path) -> Path:
    """Write the page of a campaign, whole or not at all. Returns `path`."""
    page = Page("Faults planted in whole missions")
    hurt = sum(bool(row["hazards"]) for row in result.rows)
    page.sentence(verdict_sentence(result), "bad" if hurt else "good")
    page.text(
        f"Drawn with seed {seed}. A fault that left its mission as it would have been to the bit came to nothing: "
        f"{result.came_to_nothing} did, and do not count. The judge sees the simulated robot itself, and believes "
        "nothing that the flight software says. The figures hold for faults as they are drawn here "
        "(config/campaigns/faults.yaml), not for those of a real robot."
    )
    _add_hazards(page, result)
    _add_ends(page, result)
    _add_faults(page, result)
    if hurt:
        _add_dangerous(page, result)
    return page.write(path)


def _add_hazards(page: Page, result: CampaignResult) -> None:
    page.section(
        "Hazards", "Each judged by the plant's truth; the interval is that of the rate by missions, at 95 %."
    )
    rows: list[list[object]] = []
    missions = len(result.rows)
    for name, count in result.hazards.items():
        low, high = rate_limits(count, missions)
        tone: Tone = "bad" if count else "good"
        rows.append(
            [name.replace("_", " "), Cell(str(count), tone), f"{100 * low:.2g} to {100 * high:.2g} %"]
        )
    page.table(["hazard", "missions", "rate"], rows)


def _add_ends(page: Page, result: CampaignResult) -> None:
    page.section(
        "How the missions ended",
        "Stowed: the mission was flown to its end in spite of the fault. All others ended in SAFE, for the reason "
        "named.",
    )
    ends = sorted(result.ends.items(), key=lambda item: item[1])
    figure = go.Figure(
        go.Bar(
            x=[count for _, count in ends],
            y=[name.replace("_", " ") for name, _ in ends],
            orientation="h",
            marker={"color": [GREEN if name == STOWED else BLUE for name, _ in ends]},
            text=[str(count) for _, count in ends],
            textposition="outside",
            textangle=0,
        )
    )
    figure.update_xaxes(title="missions")
    figure.update_layout(height=120 + 22 * len(ends), showlegend=False)
    page.figure(figure, "Missions by the reason of their end.")
    waited = [row["simulated_s"] - min(row["effects_s"]) for row in result.rows if row["effects_s"]]
    histogram = go.Figure(go.Histogram(x=waited, nbinsx=40, marker={"color": GREY}))
    histogram.update_xaxes(title="time from the first effect of a fault to the end of the mission [s]")
    histogram.update_yaxes(title="missions")
    page.figure(
        histogram.update_layout(height=300), "How long the missions went on after a fault had begun to show."
    )


def _add_faults(page: Page, result: CampaignResult) -> None:
    page.section("The faults that made a difference")
    planted: Counter[tuple[str, str]] = Counter()
    dangerous: Counter[tuple[str, str]] = Counter()
    for row in result.rows:
        for fault in row["case"]["faults"]:
            kind = fault["device"], fault["kind"]
            planted[kind] += 1
            dangerous[kind] += bool(row["hazards"])
    rows = [
        [device.replace("_", " "), kind, str(count), Cell(str(hurt), "bad" if hurt else "plain")]
        for (device, kind), count in sorted(planted.items())
        for hurt in [dangerous[device, kind]]
    ]
    page.table(["device", "fault", "planted", "in dangerous missions"], rows)
    devices = Counter(device for (device, _), count in planted.items() for _ in range(count))
    figure = go.Figure(
        go.Bar(
            x=[name.replace("_", " ") for name in devices], y=list(devices.values()), marker={"color": BLUE}
        )
    )
    figure.update_yaxes(title="faults")
    page.figure(figure.update_layout(height=300), "Faults by device.")


def _add_dangerous(page: Page, result: CampaignResult) -> None:
    page.section("The dangerous missions", "Index and seed draw the same mission again.")
    rows = [_mission_row(row) for row in result.rows if row["hazards"]]
    page.table(["index", "hazards", "faults", "end"], rows[:LONGEST_LIST])
    if len(rows) > LONGEST_LIST:
        page.text(f"{len(rows) - LONGEST_LIST} more are in the Parquet files.")


def _mission_row(row: dict[str, Any]) -> list[object]:
    faults = "; ".join(f"{f['device']} {f['kind']} from {f['from_s']:.2f} s" for f in row["case"]["faults"])
    hazards = Cell(", ".join(name.replace("_", " ") for name in row["hazards"]), "bad")
    return [row["case"]["index"], hazards, faults, row["end_reason"]]
