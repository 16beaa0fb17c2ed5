"""What was found beside its rivals: errors of held-out windows over theirs, each with an interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.case_studies.run import BLACK_BOX, FOUND, PHYSICAL, REFIT, Result
from benchmarks.case_studies.scores import Score, ratio

Float = NDArray[np.float64]

OVER_PHYSICAL, OVER_BLACK_BOX = "over_best_physical_rival", "over_black_box"


def ratios(result: Result) -> dict[str, Score]:
    """Windowed error of what was found over that of the best physical rival and of the black box, channels pooled."""
    own = [score.sums for score in result.windowed[FOUND].values()]
    over = {
        model: ratio(own, [score.sums for score in scores.values()])
        for model, scores in result.windowed.items()
    }
    return _best(over)


def pooled(results: Sequence[Result]) -> dict[str, Score]:
    """The same of several groups together, whose bootstrap draws whole groups.

    A model that a group lacks (a regression that found no term) is the refitted plant there. A black box that a
    group lacks is not compared at all.
    """
    models = [model for model in (*PHYSICAL, BLACK_BOX) if any(model in r.windowed for r in results)]
    if any(BLACK_BOX not in r.windowed for r in results) and BLACK_BOX in models:
        models.remove(BLACK_BOX)
    own = [_sums(results, FOUND)]
    return _best({model: ratio(own, [_sums(results, model)]) for model in models})


def _sums(results: Sequence[Result], model: str) -> Float:
    """Sum of squares of each group, of its first channel."""
    scores = [next(iter(result.windowed.get(model, result.windowed[REFIT]).values())) for result in results]
    return np.array([score.sums.sum() for score in scores])


def _best(over: Mapping[str, Score]) -> dict[str, Score]:
    """Of the physical rivals the one that leaves what was found the largest ratio, and the black box."""
    found = {OVER_PHYSICAL: max((over[m] for m in PHYSICAL if m in over), key=lambda score: score.value)}
    if BLACK_BOX in over:
        found[OVER_BLACK_BOX] = over[BLACK_BOX]
    return found


def comparison(result: Result) -> str:
    """The ratios in words."""
    found = ratios(result)
    text = f"By windows, what was found errs {found[OVER_PHYSICAL]} times as much as its best physical rival"
    if OVER_BLACK_BOX in found:
        return f"{text}, {found[OVER_BLACK_BOX]} times as much as the black box."
    return f"{text}; no black box of those tried stays bounded."


def overview(results: Sequence[Result]) -> list[str]:
    """A line for each group, and one for all together."""
    lines = [
        "## All of them",
        "",
        "The last two columns: the held-out error of what was found over that of its best physical rival (whichever"
        " that is for the line), and over that of the black box. All together, whole groups are drawn for the"
        " interval.",
        "",
        "| | verdict | found | rms refitted | rms found | over physical | over black box |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for result in results:
        scores = [next(iter(result.windowed[model].values())) for model in (REFIT, FOUND)]
        cells = [result.diagnosis["verdict"], _findings(result), *map(str, scores), *_cells(ratios(result))]
        lines.append(f"| {result.label} | {' | '.join(cells)} |")
    cells = ["", "", "", "", *_cells(pooled(results))]
    return [*lines, f"| **all together** | {' | '.join(cells)} |", ""]


def _findings(result: Result) -> str:
    """Names, probabilities and parameters."""
    names = (
        f"{f['physics_id'].replace('_', ' ')} {f['probability']:.2f}"
        + "".join(
            f", {name} = {p['value']:.3g} ± {p['std']:.1g} {p['unit']}"
            for name, p in f["parameters"].items()
            if p["std"]
        )
        for f in result.diagnosis["findings"]
    )
    return "; ".join(names) or "–"


def _cells(found: Mapping[str, Score]) -> list[str]:
    return [str(found[key]) if key in found else "–" for key in (OVER_PHYSICAL, OVER_BLACK_BOX)]
