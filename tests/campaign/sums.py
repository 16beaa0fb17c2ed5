"""A study that costs nothing, for the engine: what it returns is a function of seed and index alone."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ground.campaign.study import FAILED, Row


@dataclass(frozen=True)
class Sums:
    """Case 7 fails. `killed_once` and `deadly` name a case that kills its process; `trace` is told who does what."""

    seed: int
    weight: float = 1.0
    killed_once: int | None = None
    deadly: int | None = None
    trace: str | None = None
    wait_s: float = 0.0
    name: str = "sums"

    def settings(self) -> object:
        return self.weight

    def schema(self) -> Any:
        import pyarrow as pa

        return pa.schema({"sum": pa.float64(), "parts": pa.list_(pa.struct({"at": pa.float64()}))})

    def run(self, index: int) -> Row:
        if self.trace is not None:
            with Path(self.trace).open("a", encoding="utf-8") as file:
                file.write(f"{os.getpid()} {index}\n")
            mark = Path(f"{self.trace}.{index}.killed")
            if index == self.deadly or (index == self.killed_once and not mark.exists()):
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(self.wait_s)
        if index == 7:
            raise ValueError("seven cannot be done")
        parts = np.random.default_rng([self.seed, index]).random(index % 4)
        return {"sum": float(parts.sum()), "parts": [{"at": float(part)} for part in parts]}

    def counts(self, row: Row) -> float:
        return self.weight if row[FAILED] is None else 0.0

    def most_cases(self, wanted: float) -> int | None:
        return None

    def suspicious(self, row: Row) -> bool:
        return bool(row["sum"] > 1.5)


def quiet(text: str, done: float) -> None:
    """Shows nothing."""
