"""Tables of many blind cases: what was right by kind of rig and by what shows, what was named instead, the rivals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.blind.run import Row

VISIBLE_EDGES = (0.0, 1.0, 2.0, 5.0, 10.0, 1e9)
Z95 = 1.96
DASH = "–"


@dataclass(frozen=True)
class Share:
    """A share of right answers, with its 95 % interval by Wilson (1927)."""

    right: float
    of: int

    @property
    def value(self) -> float:
        return self.right / self.of if self.of else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper limit."""
        n, p = self.of, self.value
        centre, spread = p + Z95**2 / (2 * n), Z95 * np.sqrt(p * (1 - p) / n + Z95**2 / (4 * n * n))
        return float((centre - spread) / (1 + Z95**2 / n)), float((centre + spread) / (1 + Z95**2 / n))

    def __str__(self) -> str:
        if not self.of:
            return DASH
        low, high = self.interval
        return f"{self.value:.2f} ({low:.2f}–{high:.2f}, n {self.of})"


def share(values: Iterable[float | bool | None]) -> Share:
    """The mean of what is there."""
    known = [float(value) for value in values if value is not None]
    return Share(sum(known), len(known))


def judged(rows: Sequence[Row], key: str) -> Share:
    """A share over the hidden cases; a crash is wrong."""
    return share(row["judged"][key] if "judged" in row else 0.0 for row in rows if row["hidden"])


def verdicts(rows: Sequence[Row]) -> Share:
    """Share of right verdicts; a crash is wrong."""
    return share("judged" in row and row["judged"]["verdict"] for row in rows)


def false_alarms(rows: Sequence[Row]) -> Share:
    """Share of null cases called a mismatch."""
    return share(row.get("verdict") == "mismatch" for row in rows if not row["hidden"])


def brier(rows: Sequence[Row]) -> float:
    """Mean squared error of the findings' probabilities."""
    pairs = [pair for row in rows if "judged" in row for pair in row["judged"]["brier"]]
    return float(np.mean([(p - right) ** 2 for p, right in pairs])) if pairs else float("nan")


def excess(rows: Sequence[Row], pick: Callable[[Sequence[float]], float]) -> float:
    """Some figure of the shares of the excess removed on held-out runs; a crash removes nothing."""
    values = [row.get("removed", 0.0) for row in rows if row["hidden"]]
    known = [value for value in values if value is not None]
    return float(pick(known)) if known else float("nan")


def rival(rows: Sequence[Row], name: str, key: str) -> Share:
    """A share of a rival's right answers."""
    return share(row["rivals"][name][key] for row in rows if "rivals" in row)


LINES: tuple[tuple[str, Callable[[Sequence[Row]], object]], ...] = (
    ("cases", len),
    ("crashed", lambda rows: sum("error" in row for row in rows)),
    ("verdict right", verdicts),
    ("false alarms among nulls", false_alarms),
    ("named first", lambda rows: judged(rows, "top1")),
    ("named first, or one that shows the same", lambda rows: judged(rows, "top1_or_alike")),
    ("among the first three", lambda rows: judged(rows, "top3")),
    ("phase right", lambda rows: judged(rows, "phase")),
    ("equation right", lambda rows: judged(rows, "equation")),
    ("excess removed, median", lambda rows: f"{excess(rows, np.median):.3f}"),
    ("excess removed, least", lambda rows: f"{excess(rows, min):.3f}"),
    ("Brier score", lambda rows: f"{brier(rows):.3f}"),
    ("seconds, median", lambda rows: f"{np.median([row['seconds'] for row in rows]):.0f}"),
    ("seconds, most", lambda rows: f"{max(row['seconds'] for row in rows):.0f}"),
    ("least squares: verdict right", lambda rows: rival(rows, "least squares", "right")),
    ("least squares: named", lambda rows: rival(rows, "least squares", "named")),
    ("sparse regression: verdict right", lambda rows: rival(rows, "sparse regression", "right")),
    ("sparse regression: named", lambda rows: rival(rows, "sparse regression", "named")),
)


def groups(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """All rows, then those of each kind of rig."""
    kinds = dict.fromkeys(row["kind"] for row in rows)
    return {"all": list(rows)} | {kind: [row for row in rows if row["kind"] == kind] for kind in kinds}


def summary(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Headers and lines of the main table."""
    parts = groups(rows)
    return ["", *parts], [[name, *(str(line(part)) for part in parts.values())] for name, line in LINES]


def by_visibility(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Cases with one thing hidden, by how many sigmas of it show."""
    lines = []
    for low, high in pairwise(VISIBLE_EDGES):
        part = [r for r in rows if len(r["hidden"]) == 1 and low <= r["hidden"][0]["visible"] < high]
        if part:
            name = f"{low:g} to {high:g}" if high < 1e9 else f"above {low:g}"
            lines.append([name, str(verdicts(part)), str(judged(part, "top1")), str(judged(part, "top3"))])
    return ["sigmas that show", "verdict right", "named first", "among the first three"], lines


def confusion(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """For each thing hidden alone: how often it was hidden, and what was named first."""
    table: dict[str, Counter[str]] = {}
    for row in rows:
        if len(row["hidden"]) < 2:
            hidden = row["hidden"][0]["physics_id"] if row["hidden"] else "nothing"
            table.setdefault(hidden, Counter())[first_name(row)] += 1
    lines = []
    for hidden, named in sorted(table.items()):
        wrong = ", ".join(f"{name} {count}" for name, count in named.most_common() if name != hidden)
        lines.append([hidden, str(named.total()), str(named[hidden]), wrong or DASH])
    return ["hidden", "cases", "named so", "named instead"], lines


def first_name(row: Row) -> str:
    """What a diagnosis named first; "nothing" where it named nothing."""
    if "error" in row:
        return "crash"
    return row["findings"][0]["physics_id"] if row["findings"] else "nothing"


def pairs(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Each case with two things hidden."""
    lines = []
    for row in rows:
        if len(row["hidden"]) == 2:
            hidden = " + ".join(f"{one['physics_id']} ({one['visible']:.1f} σ)" for one in row["hidden"])
            found = " + ".join(f["physics_id"] for f in row.get("findings", [])) or first_name(row)
            lines.append([row["case"], hidden, found])
    return ["case", "hidden", "named"], lines


def show(rows: Sequence[Row]) -> None:
    """Print all tables."""
    console = Console()
    for title, (headers, lines) in tables(rows):
        drawn = Table(title=title, title_justify="left")
        for header in headers:
            drawn.add_column(header)
        for line in lines:
            drawn.add_row(*line)
        console.print(drawn)


def tables(rows: Sequence[Row]) -> list[tuple[str, tuple[list[str], list[list[str]]]]]:
    """All tables with their titles."""
    codes = {row["code"] for row in rows}
    mixed = "" if len(codes) == 1 else f" (rows of {len(codes)} versions of the code)"
    return [
        (f"Blind cases{mixed}", summary(rows)),
        ("One thing hidden, by how much of it shows", by_visibility(rows)),
        ("Hidden alone, and named first", confusion(rows)),
        ("Two things hidden", pairs(rows)),
    ]


def markdown(rows: Sequence[Row]) -> str:
    """All tables as markdown."""
    parts = []
    for title, (headers, lines) in tables(rows):
        bar = ["---"] * len(headers)
        body = "\n".join("| " + " | ".join(line) + " |" for line in [headers, bar, *lines])
        parts.append(f"### {title}\n\n{body}\n")
    return "\n".join(parts)


MARK = "<!-- measured: everything below is written by `python -m benchmarks.blind --page` -->"


def write_page(path: Path, rows: Sequence[Row]) -> None:
    """Replace what stands below the mark in a page (or all of a new one) by the tables."""
    head = path.read_text(encoding="utf-8").partition(MARK)[0] if path.exists() else "# Blind cases\n\n"
    path.write_text(f"{head}{MARK}\n\n{markdown(rows)}", encoding="utf-8")


def figures(rows: Sequence[Row]) -> dict[str, dict[str, object]]:
    """Figures by name, for `--json`."""
    plain = {
        "blind_verdict_right": verdicts(rows),
        "blind_false_alarms": false_alarms(rows),
        "blind_named_first": judged(rows, "top1"),
        "blind_named_first_or_alike": judged(rows, "top1_or_alike"),
        "blind_named_in_three": judged(rows, "top3"),
        "blind_phase_right": judged(rows, "phase"),
        "blind_equation_right": judged(rows, "equation"),
        "blind_least_squares_verdict_right": rival(rows, "least squares", "right"),
        "blind_least_squares_named": rival(rows, "least squares", "named"),
        "blind_sparse_regression_verdict_right": rival(rows, "sparse regression", "right"),
        "blind_sparse_regression_named": rival(rows, "sparse regression", "named"),
    }
    found: dict[str, dict[str, object]] = {
        name: {"value": s.value, "unit": "1", "low": s.interval[0], "high": s.interval[1], "n": s.of}
        for name, s in plain.items()
        if s.of
    }
    for name, value, unit in (
        ("blind_excess_removed_median", excess(rows, np.median), "1"),
        ("blind_excess_removed_least", excess(rows, min), "1"),
        ("blind_brier", brier(rows), "1"),
        ("blind_seconds_median", float(np.median([row["seconds"] for row in rows])), "s"),
        ("blind_seconds_most", max(row["seconds"] for row in rows), "s"),
    ):
        found[name] = {"value": value, "unit": unit, "n": len(rows)}
    return found
