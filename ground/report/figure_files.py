"""The figures of a page as files for papers: PNG and SVG, white paper, the page's own drawing.

A page carries its figures as data, so any page of this software can be asked for them, also later.
"""

from __future__ import annotations

import asyncio
import importlib
import json
import re
from html import unescape
from pathlib import Path
from typing import Any

import plotly.graph_objects as go

from ground.progress import Show, nobody
from hal.errors import ConfigError

WIDTH, SCALE = 900, 2
KINDS = ("png", "svg")
_FIGURE = re.compile(
    r'<script type="application/json" data-for="figure-(\d+)">(.*?)</script>\s*(?:<figcaption>(.*?)</figcaption>)?',
    re.DOTALL,
)


def figures_of(page: Path) -> list[tuple[str, go.Figure]]:
    """Each figure of a page with its caption. Raises `ConfigError` when the file holds none."""
    try:
        text = page.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{page}: cannot be read as a page ({error})") from error
    found = [
        (unescape(caption), go.Figure(json.loads(data.replace("<\\/", "</"))))
        for _, data, caption in _FIGURE.findall(text)
    ]
    if not found:
        raise ConfigError(f"{page}: holds no figures of this software")
    return found


def write_figures(page: Path, folder: Path, show: Show = nobody) -> list[Path]:
    """Write each figure of a page as PNG and SVG, and their captions as `captions.txt`. Returns the files.

    Raises `ConfigError` when the page has none, or the library or the browser that draws them is not there.
    """
    figures = figures_of(page)
    try:
        kaleido: Any = importlib.import_module("kaleido")
    except ImportError as error:
        raise ConfigError("the figures need kaleido; install it with: pip install kaleido") from error
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    jobs: list[dict[str, Any]] = []
    for number, (_, figure) in enumerate(figures, start=1):
        figure.update_layout(template="plotly_white", width=WIDTH)
        for kind in KINDS:
            path = folder / f"{page.stem}-{number:02d}.{kind}"
            options = {"format": kind, "scale": SCALE if kind == "png" else 1}
            jobs.append({"fig": figure, "path": str(path), "opts": options})
            written.append(path)
    try:
        asyncio.run(_draw(kaleido, jobs, show))
    except Exception as error:  # the many ways in which a browser does not start
        raise ConfigError(
            f"--figures: no browser could draw them ({type(error).__name__}: {error}); "
            "install Chromium or Chrome (apt install chromium)"
        ) from error
    captions = "".join(f"{page.stem}-{n:02d}: {caption}\n" for n, (caption, _) in enumerate(figures, start=1))
    (folder / "captions.txt").write_text(captions, encoding="utf-8")
    return written


async def _draw(kaleido: Any, jobs: list[dict[str, Any]], show: Show) -> None:
    """Draw one after the other in one browser."""
    show("starting the browser that draws", 0.0)
    async with kaleido.Kaleido(mathjax=False) as browser:
        for number, job in enumerate(jobs):
            show(f"drawing {job['path']}", number / len(jobs))
            for error in await browser.write_fig_from_object(job):
                raise error
