"""The table of measurements: ratios, growth, the page; and that the peers compute the same hop."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.bench.__main__ import figures, page
from benchmarks.bench.logs import as_library, as_lines, as_ours, as_table
from benchmarks.bench.numba_hop import numba_hop
from benchmarks.bench.readme import BEGIN, END, short_table, with_table
from benchmarks.bench.rows import Growth, Row, plain
from benchmarks.hop_peers import Rig, by_scipy
from flight.log import read_log
from hal.log import LogMessage

ROOT = Path(__file__).resolve().parents[2]
RIG = Rig(m_b=4.9, m_l=0.6, g=9.81, k=30600.0, c=20.0, k_l=90000.0, chi=0.8, s=0.03)


def test_a_ratio_above_one_is_ours_the_better_one() -> None:
    assert Row("rate", "1/s", (4.0, 6.0), "peer", (2.0, 3.0, 2.5), gain=True).ratio == 2.0
    assert Row("time", "s", (4.0, 6.0), "peer", (2.5,)).ratio == 0.5
    assert Row("alone", "s", (4.0,)).ratio is None
    assert Row("share", "1", (1.0,), "peer", (0.0,), gain=True).ratio is None


def test_the_exponent_of_a_power_law_is_found_with_its_error() -> None:
    exact = Growth("x", (1.0, 2.0, 4.0, 8.0), tuple(0.1 * n**1.5 for n in (1.0, 2.0, 4.0, 8.0)))
    assert exact.exponent == pytest.approx((1.5, 0.0), abs=1e-9)
    bent = Growth("x", (1.0, 2.0, 4.0), (1.0, 2.0, 8.0)).exponent
    assert bent[0] == pytest.approx(1.5)
    assert bent[1] > 0.1


def test_the_page_names_what_is_behind_its_peer_and_why() -> None:
    rows = [Row("a", "s", (2.0,), "p", (1.0,), note="it does more"), Row("b", "s", (1.0,), "p", (2.0,))]
    text = page(rows, [Growth("n", (1.0, 2.0), (1.0, 2.0))])
    assert "- a against p: it does more" in text
    assert "- b against" not in text
    assert figures(rows, [])["a beside p: ratio"] == {"value": 0.5, "unit": "1"}


def test_the_readme_shows_what_the_page_says() -> None:
    rows = [
        Row("a", "1/s", (41000.0, 42000.0), "p", (1.0,), gain=True),
        Row("a", "1/s", (41500.0,), "q", (2.0,)),
    ]
    table = short_table(page([*rows, Row("b", "1", (0.5,))], []))
    assert (
        "| a | 41\N{NO-BREAK SPACE}500 1/s | p: 41\N{NO-BREAK SPACE}500 ×; q: 4.82e-05 × |\n| b | 0.5 | – |"
        in table
    )
    assert with_table(f"x\n{BEGIN}old\n{END}y\n", page(rows, [])).startswith(f"x\n{BEGIN}| measured | here |")
    with pytest.raises(ValueError, match=r"README\.md: has no lines"):
        with_table("x\n", page(rows, []))
    assert [plain(value, 3) for value in (0.01234, 12.34, 999.96, 1234.5, 1.2345e5, -2.0e4)] == [
        "0.0123",
        "12.3",
        "1000",
        "1230",
        "123\N{NO-BREAK SPACE}000",
        "-20\N{NO-BREAK SPACE}000",
    ]


def test_the_readme_shows_the_page_in_the_repository() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert short_table((ROOT / "benchmarks" / "results.md").read_text(encoding="utf-8")) in readme


def test_the_numba_hop_is_that_of_scipy() -> None:
    pytest.importorskip("numba", reason="Numba is not installed")
    assert numba_hop(RIG, 1e-5)() == pytest.approx(by_scipy(RIG, 1e-10), rel=1e-4)


def test_every_writer_of_logs_keeps_the_messages(tmp_path: Path) -> None:
    messages = [LogMessage(n, "event", 0.1 * n, {"name": "x", "number": n}) for n in range(250)]
    for name, write in (("ours", as_ours), ("library", as_library), ("lines", as_lines), ("table", as_table)):
        write(tmp_path / name, messages)
        assert (tmp_path / name).stat().st_size > 250 * 10
    assert len(read_log(tmp_path / "ours").messages) == 250
    assert len((tmp_path / "lines").read_text(encoding="utf-8").splitlines()) == 250
