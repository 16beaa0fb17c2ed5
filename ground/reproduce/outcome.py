"""Every published number beside ours."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from flight import energy
from flight.uncertain import Uncertain, mean_of
from ground.reproduce.chain import Chain, ChainRun
from ground.reproduce.mechanism import Mechanisms
from ground.reproduce.paper import Paper, PaperSurface, Span
from ground.reproduce.plan import AnalysisModel

C3_TOLERANCE = 0.02
"""How near the mean of a row of Table 5 is to be met."""

PREDICTION_GOAL = 0.5
"""The share of the published error of the predicted height that is to be reached."""


@dataclass(frozen=True)
class Found:
    """One published number beside ours. Shares unless `unit` says otherwise; `met` is None where nothing is asked.

    `sigma` is ours, `low` and `high` the range of our runs.
    """

    name: str
    source: str
    says: str
    value: float
    unit: str = "1"
    sigma: float | None = None
    low: float | None = None
    high: float | None = None
    runs: int | None = None
    published: float | None = None
    published_low: float | None = None
    published_high: float | None = None
    met: bool | None = None


@dataclass(frozen=True)
class Prediction:
    """Heights [m] of one run: measured, and predicted in three ways.

    `by_average`: Eq. (7) as published, with the averages over all references and over the row, the run itself among
    them. `by_others`: the same with the row's other runs alone. `by_flight`: with the set-up's reference jump and
    what the flight code held C3 of the place to be just before the hop (what is published of a new place where it had
    not hopped yet, and of the soil that compacts the published fall from hop to hop).
    """

    run: ChainRun
    by_average: float
    by_others: float | None
    by_flight: float | None

    @property
    def height_m(self) -> float:
        """The height that was measured."""
        return self.run.run.height_m.value

    def error(self, way: str) -> float | None:
        """Predicted against measured, as a share of what was measured."""
        height = getattr(self, way)
        return None if height is None else height / self.height_m - 1.0


WAYS = ("by_average", "by_others", "by_flight")


@dataclass(frozen=True)
class Reproduction:
    """All that came of a campaign."""

    chain: Chain
    c1_analysis: tuple[float, ...]  # of each run of the chain
    predictions: tuple[Prediction, ...]
    found: tuple[Found, ...]
    rejected: tuple[str, ...] = ()  # runs whose flight the flight code did not accept, with its reasons

    def named(self, name: str) -> Found | None:
        """One of the numbers."""
        return next((found for found in self.found if found.name == name), None)


def reproduce(chain: Chain, paper: Paper, analysis: AnalysisModel, mechanisms: Mechanisms) -> Reproduction:
    """Compare a campaign with what is published; rows that the campaign lacks are left out."""
    c1 = tuple(
        mechanisms.c1_analysis(run.run.foot, run.run.compression_m.value, analysis) for run in chain.runs
    )
    predictions = tuple(_predictions(chain, paper))
    found = [
        *_table_4(chain, paper, c1),
        *_table_5(chain, paper),
        *_ratios(chain, paper),
        *_table_6(predictions, paper),
    ]
    return Reproduction(chain, c1, predictions, tuple(found))


def _table_4(chain: Chain, paper: Paper, c1: Sequence[float]) -> Iterator[Found]:
    for foot, known in paper.feet.items():
        here = [index for index, run in enumerate(chain.runs) if run.run.foot == foot]
        if not here:
            continue
        expected = energy.c1_expected(chain.constants(foot))
        yield Found(
            f"c1_expected_foot_{foot}",
            "Table 3",
            f"C1 expected (Eq. 1), foot {foot}",
            expected.value,
            sigma=expected.sigma,
            published=known.c1_expected,
            met=abs(expected.value - known.c1_expected) < 0.001,
        )
        values = [c1[index] for index in here]
        yield spanned(
            f"c1_analysis_foot_{foot}",
            "Table 4",
            f"C1 by the analysis, foot {foot}",
            values,
            known.c1,
            met=_within(sum(values) / len(values), known.c1),
        )
        free = [chain.runs[index].c1.value for index in here]
        yield spanned(
            f"c1_loss_free_foot_{foot}", "Eq. (2)", f"C1 of the flight code, loss-free, foot {foot}", free
        )
        references = [chain.runs[index].c2_reference for index in here]
        c2 = [value for value in references if value is not None]
        if c2:
            yield estimated(f"c2_ref_foot_{foot}", "Table 4", f"C2_ref, foot {foot}", c2, known.c2_ref, None)
    c2 = [run.c2_reference for run in chain.references if run.c2_reference is not None]
    if c2:
        yield estimated("c2_ref_all", "Table 4", "C2_ref, all references", c2, paper.c2_ref_all, None)
    errors = [
        abs(value / energy.c1_expected(chain.constants(run.run.foot)).value - 1.0)
        for value, run in zip(c1, chain.runs, strict=True)
    ]
    yield Found(
        "c1_model_error",
        "Section 4.1",
        "mean absolute error of the simplified C1 model",
        sum(errors) / len(errors),
        runs=len(errors),
        published=paper.c1_model_error,
    )


def _within(value: float, span: Span) -> bool | None:
    if span.low is None or span.high is None:
        return None
    return span.low <= value <= span.high


def _table_5(chain: Chain, paper: Paper) -> Iterator[Found]:
    for row in paper.surfaces:
        here = [run for run in chain.tests if run.run.row == row.key]
        for way, span in (("direct", row.c3_direct), ("average", row.c3_average)):
            values = [getattr(run, f"c3_{way}") for run in here]
            values = [value for value in values if value is not None]
            if values:
                met = abs(sum(v.value for v in values) / len(values) - span.mean) <= C3_TOLERANCE
                yield estimated(
                    f"c3_{way}_{row_name(row)}",
                    "Table 5",
                    f"C3 ({way}), {row_words(row)}",
                    values,
                    span,
                    met,
                )


def _ratios(chain: Chain, paper: Paper) -> Iterator[Found]:
    """What the text says of the rows: compaction and tilt."""
    fold = compaction_fold(chain, paper)
    if fold is not None:
        yield Found(
            "compaction_fold",
            "Section 5.1, Figure 17",
            f"fall of C3 over {paper.compaction.hops} hops in one place, {paper.compaction.surface}",
            fold,
            published=paper.compaction.fold,
        )
    tilt = paper.tilt
    rows = [paper.row(tilt.surface, "1", degrees) for degrees in (0.0, tilt.tilt_deg)]
    means = [_mean_c3(chain, row) for row in rows if row is not None]
    if len(means) == 2 and means[0] is not None and means[1] is not None:
        yield Found(
            "tilt_factor",
            "Section 4.2",
            f"C3 at {tilt.tilt_deg:g}° over level, C2_ref average",
            means[1] / means[0],
            published=tilt.factor,
        )


def compaction_fold(chain: Chain, paper: Paper) -> float | None:
    """C3 of the first hop over that of the last in the place with the published number of hops; None without one."""
    known = paper.compaction
    places: dict[tuple[str, str], list[float]] = {}
    for run in chain.tests:
        if run.run.surface == known.surface and run.c3_direct is not None:
            places.setdefault((run.run.setup, run.run.place), []).append(run.c3_direct.value)
    full = [values for values in places.values() if len(values) >= known.hops]
    return full[0][0] / full[0][known.hops - 1] if full else None


def _mean_c3(chain: Chain, row: PaperSurface) -> float | None:
    values = [run.c3_average for run in chain.tests if run.run.row == row.key]
    known = [value.value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def _predictions(chain: Chain, paper: Paper) -> Iterator[Prediction]:
    if chain.c2_average is None:
        return
    for run in chain.tests:
        row = [other for other in chain.tests if other.run.row == run.run.row]
        averages = {id(other): other.c3_average for other in row}
        known = [value for value in averages.values() if value is not None]
        others = [value for key, value in averages.items() if key != id(run) and value is not None]
        yield Prediction(
            run,
            chain.predicted_height_m(run, chain.c2_average, mean_of(known)).value,
            chain.predicted_height_m(run, chain.c2_average, mean_of(others)).value if others else None,
            _by_flight(chain, paper, run),
        )


def _by_flight(chain: Chain, paper: Paper, run: ChainRun) -> float | None:
    known = paper.row(*run.run.row)
    if (
        run.run.true_c3 is None or run.c2_direct is None or known is None
    ):  # not flown: nobody believed anything
        return None
    fresh, kept = _published_course(known, paper)
    c3 = fresh if run.run.known_c3 is None else kept * run.run.known_c3
    return chain.predicted_height_m(run, run.c2_direct, c3).value


def _published_course(row: PaperSurface, paper: Paper) -> tuple[float, float]:
    """Published C3 of a place that is new, and the share of it that is left after each hop there."""
    known = paper.compaction
    if row.surface != known.surface:
        return row.c3_direct.mean, 1.0
    kept = known.fold ** (-1.0 / (known.hops - 1))
    course = sum(kept**hop for hop in range(known.hops)) + (row.runs - known.hops)
    return row.c3_direct.mean * row.runs / course, kept


def _table_6(predictions: Sequence[Prediction], paper: Paper) -> Iterator[Found]:
    for row in paper.prediction:
        here = [
            p for p in predictions if (p.run.run.surface, p.run.run.tilt_deg) == (row.surface, row.tilt_deg)
        ]
        name = f"{row.surface}_{row.tilt_deg:.0f}deg"
        yield from _errors(here, name, f"{row.surface.replace('_', ' ')} {row.tilt_deg:.0f}°", row.mae)
    total = paper.prediction_all
    yield from _errors(predictions, "all", "all tests", total.mae)


def _errors(here: Sequence[Prediction], name: str, words: str, published: float) -> Iterator[Found]:
    says = {
        "by_average": "averages, as published",
        "by_others": "averages of the others",
        "by_flight": "flight code, before the hop",
    }
    for way in WAYS:
        errors = [abs(error) for error in (p.error(way) for p in here) if error is not None]
        if errors:
            mae = sum(errors) / len(errors)
            asked = way == "by_flight" and name == "all"
            yield Found(
                f"mae_{way}_{name}",
                "Table 6",
                f"height error, {words}: {says[way]}",
                mae,
                low=min(errors),
                high=max(errors),
                runs=len(errors),
                published=published,
                met=mae <= PREDICTION_GOAL * published if asked else None,
            )


def row_name(row: PaperSurface) -> str:
    """A row of Table 5 as part of a name."""
    return f"{row.surface}_foot_{row.foot}_{row.tilt_deg:.0f}deg"


def row_words(row: PaperSurface) -> str:
    """A row of Table 5 in words."""
    return f"{row.surface.replace('_', ' ')}, foot {row.foot}, {row.tilt_deg:.0f}°"


def spanned(
    name: str,
    source: str,
    says: str,
    values: Sequence[float],
    span: Span | None = None,
    met: bool | None = None,
) -> Found:
    """Mean and range of plain numbers beside the published ones."""
    return Found(
        name,
        source,
        says,
        sum(values) / len(values),
        low=min(values),
        high=max(values),
        runs=len(values),
        published=None if span is None else span.mean,
        published_low=None if span is None else span.low,
        published_high=None if span is None else span.high,
        met=met,
    )


def estimated(
    name: str,
    source: str,
    says: str,
    values: Sequence[Uncertain],
    span: Span,
    met: bool | None,
) -> Found:
    """Mean and range of estimates beside the published ones; sigma of the mean by measurement, not by scatter."""
    plain = spanned(name, source, says, [value.value for value in values], span, met)
    sigma = mean_of(values).sigma
    return Found(**{**vars(plain), "sigma": sigma if math.isfinite(sigma) else None})
