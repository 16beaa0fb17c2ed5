"""Fits spread over processes: the same answers in the same order, whatever the number of workers."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from ground.diagnose.candidates import Scales, ranges_of
from ground.diagnose.fit import Fit, fit_plant
from ground.diagnose.segments import Segment, is_open
from ground.pools import end_with_parent
from sim_hal.plant.simulate import Plant

SEARCH_TOLERANCE = 1e-3
POLISH_TOLERANCE = 1e-5
FINAL_TOLERANCE = 1e-7
"""Relative gain in chi-square below which a fit is done."""
SEARCH_STEPS = 15
APPROACH = (0.15, 0.3)
"""Shares of each recording that are fitted first where it is simulated as a whole."""

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Context:
    """What all fits of a search share."""

    segments: tuple[Segment, ...]
    sigmas: NDArray[np.float64]
    scales: Scales


@dataclass(frozen=True)
class FitTask:
    """A plant to fit beside a fit of a similar one, and values to start from.

    Search fits are rough; `polish` gives one its own sensitivities; `final` fits go to the bottom and know their
    sigmas well.
    """

    plant: Plant
    near: Fit
    known: Mapping[str, float]
    depth: Literal["search", "polish", "final"] = "search"


def fit_job(context: Context, task: FitTask) -> Fit:
    """Full fit of one plant."""
    ranges = ranges_of(task.plant, context.scales)
    problem = (task.plant, context.segments, context.sigmas, ranges, task.known)
    if task.depth == "search":
        return fit_plant(
            *problem,
            tolerance=SEARCH_TOLERANCE,
            iterations=SEARCH_STEPS,
            approach=APPROACH if free_runs(task.plant) else (),
            near=task.near,
            rough=True,
        )
    if task.depth == "polish":
        return fit_plant(*problem, tolerance=POLISH_TOLERANCE, near=task.near)
    # a window of a rig given as equations that stuck at a wrong start shall begin anew
    near = None if task.plant.kind == "equations" else task.near
    return fit_plant(*problem, tolerance=FINAL_TOLERANCE, precise=True, near=near)


def free_runs(plant: Plant) -> bool:
    """Whether a rig given as equations runs from a given start to its recordings' ends.

    What a law does late in a free run depends on all before: a fit of the whole at once soon sticks.
    """
    states = plant.structure.states.values()
    return plant.kind == "equations" and not all(is_open(state) for state in states)


class Workers:
    """Does jobs on one context, on `count` processes (1: in this one). A context manager."""

    def __init__(
        self, segments: Sequence[Segment], sigmas: NDArray[np.float64], scales: Scales, count: int
    ) -> None:
        self.context = Context(tuple(segments), sigmas, scales)
        self.count = count
        self._pool: ProcessPoolExecutor | None = None
        if count > 1:
            # One thread of linear algebra in each process: more would only wait for each other's cores.
            for library in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
                os.environ.setdefault(library, "1")
            # spawn: this process may have threads (a progress line), and a fork would copy their locks
            spawn = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(count, spawn, _install, (self.context,))

    def map(self, job: Callable[[Context, Task], Result], tasks: Sequence[Task]) -> Iterator[Result]:
        """Results in the order of the tasks."""
        if self._pool is None:
            return (job(self.context, task) for task in tasks)
        return self._pool.map(partial(_remote, job), tasks)

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)


_installed: list[Context] = []


def _install(context: Context) -> None:
    end_with_parent()
    _installed[:] = [context]


def _remote(job: Callable[[Context, Task], Result], task: Task) -> Result:
    """A job in a worker process, on the context that was installed there."""
    return job(_installed[0], task)
