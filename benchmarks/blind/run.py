"""One case from its draw to its row; and many of them, resumable, each row written as soon as it is there."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.blind.cases import BlindCase, draw_case
from benchmarks.blind.rivals import RivalAnswer, least_squares, sparse_regression
from benchmarks.blind.scoring import chi_on_test, judge, removed
from ground.diagnose.pipeline import Outcome, diagnose
from ground.files import write_atomic
from sim_hal.plant.simulate import Plant

Row = dict[str, Any]
Task = tuple[str, int, int]
"""Kind, number and seed of a case."""


def fingerprint() -> str:
    """Short hash of the diagnosis and the plant: rows of other code are not of the same table."""
    root = Path(__file__).parents[2]
    files = sorted((root / "ground" / "diagnose").glob("*.py")) + sorted((root / "sim_hal").rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:10]


def row_of(task: Task) -> Row:
    """Draw a case, diagnose it, judge the answer, and let the rivals try. A crash is a row like any other."""
    case = draw_case(*task)
    row: Row = {
        **{"case": case.name, "kind": task[0], "number": task[1], "seed": task[2], "code": fingerprint()},
        "runs": len(case.train),
        "hidden": [asdict(one) | {"visible": one.visible} for one in case.hidden],
    }
    start = time.perf_counter()
    try:
        outcome = diagnose(case.train, case.plant, processes=1)
    except Exception as error:  # whatever goes wrong is the figure to report
        return row | {"error": f"{type(error).__name__}: {error}", "seconds": time.perf_counter() - start}
    row["seconds"] = time.perf_counter() - start
    return row | judged(case, outcome)


def judged(case: BlindCase, outcome: Outcome) -> Row:
    """What the diagnosis said and what of it is right; the same for the rivals."""
    found = outcome.diagnosis
    values = {name: item["refit"] for name, item in found.details["nominal_parameters"].items()}
    refit = case.plant.with_values({n: v for n, v in values.items() if n in case.plant.flat()})
    chi = {
        "refit": chi_on_test(case, refit),
        "extended": chi_on_test(case, outcome.plant),
        "oracle": chi_on_test(case, case.truth),
    }
    return {
        "verdict": found.verdict,
        "findings": [
            {
                **{"physics_id": f.physics_id, "kind": f.kind, "equation": f.equation, "phase": f.phase},
                **{"channels": list(f.channels) if f.kind == "sensor" else []},
                **{"probability": f.probability},
                "rivals": {a.physics_id: a.probability for a in f.alternatives},
                "parameters": {name: [e.value, e.std] for name, e in f.parameters.items()},
            }
            for f in found.findings
        ],
        "judged": asdict(judge(case, found)),
        "chi": chi,
        "removed": removed(chi["refit"], chi["extended"], chi["oracle"]) if case.hidden else None,
        "rivals": {
            "least squares": rival_row(case, least_squares(case, refit, chi["refit"])),
            "sparse regression": rival_row(case, sparse_regression(case, refit)),
        },
        "parameters_at_the_edge": edge(case.plant, refit),
    }


def rival_row(case: BlindCase, answer: RivalAnswer) -> Row:
    """A rival's answer and what of it is right."""
    hidden = {one.physics_id for one in case.hidden}
    named = len(hidden & answer.names) / len(hidden) if hidden else None
    return {"mismatch": answer.mismatch, "right": answer.mismatch == bool(hidden), "named": named}


def edge(plant: Plant, refit: Plant) -> list[str]:
    """Nominal parameters that the refit left at the edge of their tolerance."""
    stated = plant.flat()
    return [
        name
        for name, parameter in refit.flat().items()
        if stated[name].std > 0.0 and abs(parameter.value - stated[name].value) > 2.99 * stated[name].std
    ]


def run_all(tasks: Sequence[Task], file: Path, processes: int, seen: Callable[[Row], None]) -> list[Row]:
    """Rows of all tasks; those that `file` (JSON lines) has already are not run again. New ones are appended."""
    rows = {task_of(row): row for row in read_rows(file)}
    todo = [task for task in tasks if task not in rows]
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(
        file, "".join(json.dumps(row) + "\n" for row in rows.values())
    )  # without a last line cut off
    with file.open("a", encoding="utf-8") as stream:
        for row in computed(todo, processes):
            stream.write(json.dumps(row, allow_nan=False, default=float) + "\n")
            stream.flush()
            rows[task_of(row)] = row
            seen(row)
    return [rows[task] for task in tasks]


def computed(tasks: Sequence[Task], processes: int) -> Iterator[Row]:
    """Rows as they come."""
    if processes <= 1:
        yield from map(row_of, tasks)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        try:
            for future in as_completed([pool.submit(row_of, task) for task in tasks]):
                yield future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)  # an error is told now, not when all have run


def task_of(row: Row) -> Task:
    """Which case a row is of."""
    return row["kind"], row["number"], row["seed"]


def read_rows(file: Path) -> Iterable[Row]:
    """Rows of a JSON-lines file; a last line that was cut off is dropped."""
    if not file.exists():
        return
    for line in file.read_text(encoding="utf-8").splitlines():
        if line.endswith("}"):
            yield json.loads(line)
