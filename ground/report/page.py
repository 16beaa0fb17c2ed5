"""One self-contained page: text, tables and interactive figures in a single file that opens offline.

Plotly's script is inlined once, whatever the number of figures; colours follow the reader's light or dark
setting. All text is escaped: a page shows what it is given, and never lets it act.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from typing import Any, Literal

from plotly.graph_objects import Figure
from plotly.offline import get_plotlyjs

from ground.files import write_atomic
from ground.report.compact import compacted
from ground.report.skeleton import DRAW_SCRIPT, STYLE

BLUE, ORANGE, GREEN, VIOLET, RED, GREY = "#3b82f6", "#e0763a", "#35a06a", "#a06bd6", "#dc4c64", "#8a8f98"
"""Mid-tones that read on a light and on a dark page alike; figures should take their colours from here."""

Tone = Literal["plain", "good", "bad", "muted"]


@dataclass(frozen=True)
class Cell:
    """One cell of a table: its text, and whether it stands out (`good`, `bad`) or steps back (`muted`)."""

    text: str
    tone: Tone = "plain"


class Page:
    """A page under construction. Every method but `html` and `write` returns the page, so calls chain.

    Parts appear in the order of the calls.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._parts: list[str] = [f"<h1>{escape(title)}</h1>"]
        self._figures = 0

    def sentence(self, text: str, tone: Tone = "plain") -> Page:
        """Add the sentence that a reader in a hurry should take away; meant to stand first."""
        return self._add(f'<p class="verdict {tone}">{escape(text)}</p>')

    def section(self, title: str, text: str = "") -> Page:
        """Begin a section. Blank lines in `text` part paragraphs."""
        self._add(f"<h2>{escape(title)}</h2>")
        return self.text(text)

    def text(self, text: str) -> Page:
        """Add running text; blank lines part paragraphs."""
        for paragraph in filter(None, (part.strip() for part in text.split("\n\n"))):
            self._add(f"<p>{escape(paragraph)}</p>")
        return self

    def code(self, text: str) -> Page:
        """Add text in fixed width with its line breaks kept: a formula, a file, a command."""
        return self._add(f"<pre>{escape(text)}</pre>")

    def equations(self, mathml: Iterable[str]) -> Page:
        """Add equations, each a MathML element."""
        return self._add(f'<div class="wide">{"".join(mathml)}</div>')

    def table(self, headers: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> Page:
        """Add a table. Cells are `Cell`s or anything with a text; columns of figures are set right.

        Raises `ValueError` when a row has not as many cells as there are headers.
        """
        cells = [[cell if isinstance(cell, Cell) else Cell(str(cell)) for cell in row] for row in rows]
        for number, row in enumerate(cells, start=1):
            if len(row) != len(headers):
                raise ValueError(f"table row {number} has {len(row)} cells, its header has {len(headers)}")
        numeric = [all(_is_figure(row[column].text) for row in cells) for column in range(len(headers))]
        head = "".join(_cell("th", Cell(name), right) for name, right in zip(headers, numeric, strict=True))
        body = "".join(
            f"<tr>{''.join(_cell('td', cell, right) for cell, right in zip(row, numeric, strict=True))}</tr>"
            for row in cells
        )
        note = f"<caption>{escape(caption)}</caption>" if caption else ""
        return self._add(
            f'<div class="wide"><table>{note}<thead><tr>{head}</tr></thead>'
            f"<tbody>{body}</tbody></table></div>"
        )

    def figure(self, figure: Figure, caption: str = "") -> Page:
        """Add a Plotly figure (its template is replaced by the page's)."""
        self._figures += 1
        content: dict[str, Any] = compacted(json.loads(figure.to_json()))
        content["layout"].pop("template", None)
        height = content["layout"].get("height", 380)
        # "</" would let a string in the data close the script element
        data = json.dumps(content, separators=(",", ":")).replace("</", "<\\/")
        note = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
        return self._add(
            f'<figure><div id="figure-{self._figures}" style="height:{height}px"></div>'
            f'<script type="application/json" data-for="figure-{self._figures}">{data}</script>'
            f"{note}</figure>"
        )

    def html(self) -> str:
        """The whole page as one HTML document."""
        plots = (
            f'<script type="text/plain" id="plotly">{packed_plotly()}</script>\n<script>{DRAW_SCRIPT}</script>'
            if self._figures
            else ""
        )
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            '<meta name="color-scheme" content="light dark">'
            f"<title>{escape(self._title)}</title><style>{STYLE}</style></head>\n<body><main>\n"
            + "\n".join(self._parts)
            + f"\n</main>\n{plots}</body></html>\n"
        )

    def write(self, path: Path) -> Path:
        """Write the page to `path`, whole or not at all. Returns `path`."""
        return write_atomic(path, self.html())

    def _add(self, part: str) -> Page:
        self._parts.append(part)
        return self


@cache
def packed_plotly() -> str:
    """Plotly's script, compressed: a third of its size. The page unpacks it before it draws."""
    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), mtime=0)).decode()


def _cell(tag: str, cell: Cell, right: bool) -> str:
    classes = " ".join(name for name in (cell.tone, "figures" if right else "") if name not in ("plain", ""))
    attribute = f' class="{classes}"' if classes else ""
    return f"<{tag}{attribute}>{escape(cell.text)}</{tag}>"


def _is_figure(text: str) -> bool:
    """Whether a cell reads as a number (with sign, uncertainty or unit), or is empty."""
    return not text or text in ("–", "—") or text.lstrip("+-−±< ")[:1].isdigit()
