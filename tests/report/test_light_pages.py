"""Pages are light, their figures lose no extreme, and come out as files."""

from __future__ import annotations

import base64
import json
import shutil
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pytest

from ground.fault_campaign.campaign import CampaignResult
from ground.report.campaign_page import rate_limits, verdict_sentence, write_campaign_page
from ground.report.compact import LINE_POINTS, compacted, thin_indices
from ground.report.figure_files import figures_of, write_figures
from ground.report.page import Page
from hal.errors import ConfigError

THREE_MB = 3_000_000


def noisy_line(points: int) -> go.Figure:
    rng = np.random.default_rng(3)
    values = rng.normal(size=points)
    values[points // 3] = 50.0
    return go.Figure(go.Scatter(x=np.arange(points) / 1000.0, y=values, mode="lines"))


def values(data: object) -> np.ndarray:
    """A trace's numbers, as the page's script decodes them."""
    if isinstance(data, dict):
        return np.frombuffer(base64.b64decode(data["bdata"]), data["dtype"]).astype(float)
    return np.asarray(data, float)


def test_a_long_line_keeps_its_extremes_and_its_order() -> None:
    content = compacted(json.loads(noisy_line(100_000).to_json()))
    figure = go.Figure(content)
    x, y = values(figure.data[0].x), values(figure.data[0].y)
    assert LINE_POINTS - 2 <= y.size <= LINE_POINTS
    assert y.max() == 50.0
    assert np.all(np.diff(x) > 0)


def test_markers_gaps_names_and_error_bars_are_left_whole() -> None:
    x = np.arange(5000.0)
    gaps = np.where(x == 7, np.nan, x)
    names = [f"surface {number}" for number in range(5000)]
    for trace in (
        go.Scatter(x=x, y=x, mode="markers"),
        go.Scatter(x=x, y=gaps, mode="lines"),
        go.Scatter(x=x, y=x, mode="lines", error_y={"array": x}),
        go.Bar(x=names, y=x),
    ):
        figure = go.Figure(compacted(json.loads(go.Figure(trace).to_json())))
        assert values(figure.data[0].y).size == 5000


def test_numbers_come_back_to_single_precision() -> None:
    x = np.linspace(0.0, 500.0, 200)
    figure = go.Figure(compacted(json.loads(go.Figure(go.Scatter(x=x, y=np.sin(x))).to_json())))
    assert np.allclose(values(figure.data[0].x), x, rtol=1e-7)
    assert np.allclose(values(figure.data[0].y), np.sin(x), rtol=1e-6)


def test_thinning_of_a_short_line_changes_nothing() -> None:
    assert thin_indices(np.arange(10.0)).tolist() == list(range(10))


def test_a_page_of_many_long_lines_is_light(tmp_path: Path) -> None:
    page = Page("many")
    for _ in range(40):
        page.figure(noisy_line(20_000))
    assert page.write(tmp_path / "p.html").stat().st_size < THREE_MB


def test_the_page_of_a_mission_is_light(flown_log: Path) -> None:
    assert (
        flown_log.with_name("report.html").stat().st_size < 2_300_000
    )  # 1.9 MB of it is the plotting library


def test_figures_of_a_page_are_those_that_went_in(tmp_path: Path) -> None:
    figure = go.Figure(go.Scatter(x=[0, 1], y=[2, 3], name="</script>"))
    page = Page("two").figure(figure, "first & only").figure(figure).write(tmp_path / "two.html")
    found = figures_of(page)
    assert [caption for caption, _ in found] == ["first & only", ""]
    assert found[0][1].data[0].name == "</script>"
    (tmp_path / "empty.html").write_text("<p>nothing</p>")
    with pytest.raises(ConfigError, match=r"empty.html: holds no figures"):
        figures_of(tmp_path / "empty.html")


def test_figures_come_out_as_png_and_svg(tmp_path: Path) -> None:
    pytest.importorskip("kaleido", reason="kaleido is not installed (extra 'figures')")
    if not any(map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))):
        pytest.skip("no Chromium on this computer")
    page = Page("one").figure(noisy_line(500), "noise").write(tmp_path / "one.html")
    written = write_figures(page, tmp_path / "figures")
    assert [path.name for path in written] == ["one-01.png", "one-01.svg"]
    assert written[0].read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in written[1].read_bytes()[:200]
    assert (tmp_path / "figures" / "captions.txt").read_text() == "one-01: noise\n"


def row(index: int, *hazards: str) -> dict[str, object]:
    fault = {"device": "spring", "kind": "noise", "from_s": 2.0, "until_s": 3.0, "size": 1.0}
    return {
        "case": {"index": index, "faults": [fault]},
        "effects_s": [2.0],
        "came_to_nothing": 1,
        "end_reason": "stall" if index % 2 else "stowed",
        "releases": 0,
        "hazards": list(hazards),
        "simulated_s": 9.0,
    }


def test_the_page_of_a_campaign_says_what_was_dangerous_and_how_sure(tmp_path: Path) -> None:
    safe = CampaignResult(tuple(row(index) for index in range(100)))
    assert "none of them was dangerous" in verdict_sentence(safe)
    assert "fewer than 3.6 %" in verdict_sentence(safe)
    hurt = CampaignResult((*safe.rows, row(100, "log_lost")))
    assert "1 of these were dangerous" in verdict_sentence(hurt)
    text = write_campaign_page(hurt, 7, tmp_path / "c.html").read_text()
    assert "log lost" in text and "spring noise from 2.00 s" in text
    assert len(text) < THREE_MB


def test_rates_have_the_published_limits() -> None:
    low, high = rate_limits(0, 100)
    assert (low, round(high, 4)) == (0.0, 0.0362)  # 1 - 0.025^(1/100)
    low, high = rate_limits(5, 50)
    assert (round(low, 4), round(high, 4)) == (0.0333, 0.2181)  # Clopper and Pearson's tables
    assert rate_limits(3, 3)[1] == 1.0
