"""What the command line shows: tables, progress, and errors without a traceback."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from ground.diagnose.pipeline import DiagnosisError
from ground.recordings.model import RecordingError
from hal.errors import HalError
from sim_hal.plant.simulate import SimulationError

out = Console()
err = Console(stderr=True)

USER_ERRORS = (HalError, RecordingError, DiagnosisError, SimulationError, OSError)
"""Errors whose message is written for a person: they end a command without a traceback, with exit code 2."""


@contextmanager
def clear_errors() -> Iterator[None]:
    """Show an expected error as one message and leave with exit code 2."""
    try:
        yield
    except USER_ERRORS as error:
        err.print(f"[bold red]error:[/] {type(error).__name__}", highlight=False)
        err.print(str(error), markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(2) from error
    except KeyboardInterrupt:
        err.print("stopped; nothing was written")
        raise typer.Exit(130) from None


@contextmanager
def steps(total: float | None = None) -> Iterator[Callable[..., None]]:
    """A line that moves while long work goes on: call it with a text, and how much of `total` is done."""
    columns = [SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()]
    if total is not None:
        columns.insert(2, BarColumn())
    with Progress(*columns, console=err, transient=True) as progress:
        task = progress.add_task("starting", total=total)

        def show(text: str, done: float | None = None) -> None:
            progress.update(task, description=text, completed=done)
            if not err.is_terminal and done is None:
                print(text, file=sys.stderr, flush=True)

        yield show


def table(title: str, headers: Sequence[str], rows: Sequence[Sequence[str]], dim_every: int = 0) -> None:
    """Print a table; with `dim_every` n, each n-th row steps back (what the row above is compared with)."""
    drawn = Table(title=title, title_justify="left", header_style="bold")
    for number, header in enumerate(headers):
        drawn.add_column(header, justify="left" if number < 2 else "right")
    for number, row in enumerate(rows, start=1):
        dim = dim_every and number % dim_every == 0
        drawn.add_row(*row, style="dim" if dim else None, end_section=bool(dim))
    out.print(drawn)


def print_json(content: Any) -> None:
    """Machine-readable answer on standard output, nothing else."""
    print(json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))
