"""The page is one file, escapes what it shows, and is never written in half."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import plotly.graph_objects as go
import pytest

from ground.report.page import Cell, Page

HOSTILE = '<img src=x onerror="alert(1)"></script><b>&'


class _Outline(HTMLParser):
    """Collects the tags, the text outside scripts, and what would be fetched from elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.fetched: list[str] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.fetched += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1] not in ("script", "style"):
            self.words.append(data)


def outline(page: Page) -> _Outline:
    parser = _Outline()
    parser.feed(page.html())
    return parser


def test_hostile_text_is_shown_and_never_acts() -> None:
    figure = go.Figure(go.Scatter(x=[0, 1], y=[0, 1], name=HOSTILE))
    page = Page(HOSTILE).sentence(HOSTILE).section(HOSTILE, HOSTILE).code(HOSTILE)
    page.table([HOSTILE], [[HOSTILE]], caption=HOSTILE).figure(figure, HOSTILE)
    seen = outline(page)
    assert "img" not in seen.tags
    assert "b" not in seen.tags
    assert "".join(seen.words).count(HOSTILE) == 10  # the title stands twice, the other eight once


def test_figures_share_one_script_and_nothing_is_fetched() -> None:
    figure = go.Figure(go.Scatter(x=[0.0, 1.0], y=[2.0, 3.0]))
    one = Page("one").figure(figure)
    three = Page("three").figure(figure).figure(figure).figure(figure)
    assert not outline(three).fetched
    assert len(three.html()) - len(one.html()) < 5000
    assert re.findall(r'data-for="(figure-\d)"', three.html()) == ["figure-1", "figure-2", "figure-3"]


def test_page_without_figure_is_small() -> None:
    assert len(Page("note").sentence("All is well.").html()) < 10_000


def test_columns_of_figures_are_set_right_and_tones_marked() -> None:
    html = Page("t").table(["name", "value"], [["a", "1.5 ± 0.2 J"], ["b", Cell("−2", "bad")]]).html()
    assert '<td class="figures">1.5 ± 0.2 J</td>' in html
    assert '<td class="bad figures">−2</td>' in html
    assert "<td>a</td>" in html


def test_row_of_wrong_length_is_refused() -> None:
    with pytest.raises(ValueError, match="row 2 has 1 cells"):
        Page("t").table(["a", "b"], [[1, 2], [3]])


def test_a_failing_write_leaves_the_old_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = Page("old").write(tmp_path / "deep" / "page.html")

    def fail(self: Path, target: Path) -> Path:
        raise OSError("disk full")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        Page("new").write(path)
    assert "old" in path.read_text(encoding="utf-8")
    assert [entry.name for entry in path.parent.iterdir()] == ["page.html"]
