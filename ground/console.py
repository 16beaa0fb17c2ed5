"""What the command line shows: tables, progress, and errors without a traceback."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
from math import inf, isfinite
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table
from rich.text import Text

import flight
from ground.diagnose.data import DiagnosisError
from ground.progress import Show
from ground.recordings.model import RecordingError
from ground.report.figure_files import write_figures
from hal.compiled import SWITCH
from hal.errors import HalError
from sim_hal.plant.simulate import SimulationError

FigureFolder = Annotated[
    Path | None, typer.Option("--figures", help="Folder for each plot as PNG and SVG (needs a Chromium).")
]

out = Console()
err = Console(stderr=True)

SURE_SHARE = 0.02
"""Of the work that must be done before anything is said about the rest."""
LINES_EVERY_S = 20.0
"""How often long work says how far it is where no line can move."""

USER_ERRORS = (HalError, RecordingError, DiagnosisError, SimulationError, OSError)
"""Errors whose message is written for a person: they end a command without a traceback, with exit code 2."""


@contextmanager
def clear_errors(stopped: str = "nothing was written") -> Iterator[None]:
    """Show an expected error as one message and leave with exit code 2.

    `stopped` says what is left when the command is stopped by Ctrl-C, unless the interrupt itself says so.
    """
    try:
        yield
    except USER_ERRORS as error:
        err.print("[bold red]error:[/] ", end="")
        err.print(error_text(error), markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2) from error
    except KeyboardInterrupt as interrupt:
        left = "; ".join(_notes(interrupt)) or stopped
        err.print(f"stopped; {left}", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(130) from None


def error_text(error: BaseException) -> str:
    """What went wrong, in words; the system's own errors name their file first, like all others."""
    text = str(error)
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        text = f"{error.filename}: {error.strerror}"
    return "\n".join((text, *_notes(error)))


def _notes(error: BaseException) -> list[str]:
    return list(getattr(error, "__notes__", ()))


class TimeLeft(ProgressColumn):
    """How long the work will still take, by its mean pace so far; it counts down between two reports."""

    def render(self, task: Task) -> Text:
        """The time left, or that it is not known yet."""
        return Text(f"about {left} left" if (left := time_left(task)) else "")


def time_left(task: Task) -> str:
    """What is left of a task by its mean pace so far; empty while nothing of it is done.

    Rich's own estimate needs two reports within seconds of each other, which long steps do not give.
    """
    left_s = task.fields["ends_s"] - task.get_time()
    return str(timedelta(seconds=max(0, round(left_s)))) if isfinite(left_s) else ""


def _ends_s(task: Task) -> float:
    """When a task will be done, on its own clock [s]."""
    share = task.completed / (task.total or 1.0)
    return task.get_time() + (task.elapsed or 0.0) * (1.0 - share) / share if share >= SURE_SHARE else inf


@contextmanager
def steps(total: float = 1.0) -> Iterator[Show]:
    """A line that moves while long work goes on: call it with a text, and how much of `total` is done (never less).

    Where standard error is no terminal, a line is written there instead for each new step, and every `LINES_EVERY_S`.
    """
    columns: list[ProgressColumn] = [SpinnerColumn(), TextColumn("{task.description}")]
    columns += [BarColumn(bar_width=20), TimeElapsedColumn(), TimeLeft()]
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as progress:
        progress.add_task("starting", total=total, ends_s=inf)
        (task,) = progress.tasks
        said_s = -inf

        def show(text: str, done: float | None = None) -> None:
            nonlocal said_s
            new = text != task.description and done is None
            progress.update(task.id, description=text)
            if done is not None:
                progress.update(task.id, completed=max(done, task.completed))
                progress.update(task.id, ends_s=_ends_s(task))
            if not err.is_terminal and (new or task.get_time() - said_s >= LINES_EVERY_S):
                said_s = task.get_time()
                print(_line(task), file=sys.stderr, flush=True)

        yield show


def _line(task: Task) -> str:
    left = time_left(task)
    return f"{task.description} ({task.percentage:.0f} %, about {left} left)" if left else task.description


def draw_figures(page: Path, folder: Path | None, quiet: bool = False) -> list[Path]:
    """Write the plots of a page as files, if a folder was asked for; returns the files."""
    if folder is None:
        return []
    with steps() as show:
        written = write_figures(page, folder, show)
    if not quiet:
        say(f"{folder}: {len(written)} files")
    return written


def say(text: str) -> None:
    """Print a sentence as it is: wrapped between words on a terminal, whole lines elsewhere."""
    out.print(text, markup=False, highlight=False, soft_wrap=not out.is_terminal)


def say_if_interpreted() -> None:
    """How many missions would take less time, where nothing was translated and nobody asked for that."""
    if not flight.COMPILED and os.environ.get(SWITCH) != "0":
        err.print("`hopper compile`, once, makes missions twice as fast", markup=False, highlight=False)


def table(title: str, headers: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table: the first two columns are text, the others figures."""
    drawn = Table(title=title, title_justify="left", header_style="bold")
    for number, header in enumerate(headers):
        drawn.add_column(header, justify="left" if number < 2 else "right")
    for row in rows:
        drawn.add_row(*row)
    out.print(drawn)


def hop_table(headers: Sequence[str], hops: Sequence[Sequence[Sequence[str]]]) -> None:
    """Print hops of several lines each; the lines below the first step back. Fits a terminal of 80 columns."""
    drawn = Table(box=box.SIMPLE_HEAD, header_style="bold", padding=(0, 1, 0, 0), show_edge=False)
    last = len(headers) - 1
    for number, header in enumerate(headers):
        drawn.add_column(header, justify="right" if 2 <= number < last else "left", no_wrap=True)
    for lines in hops:
        for number, line in enumerate(lines, start=1):
            drawn.add_row(*line, style="dim" if number > 1 else None, end_section=number == len(lines))
    out.print(drawn)


def print_json(content: Any) -> None:
    """Machine-readable answer on standard output, nothing else."""
    print(json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))
