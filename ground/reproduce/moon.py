"""Hopter on the Moon (Figure 23): height by Eq. (6) over what the ground takes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ground.reproduce.chain import Chain
from ground.reproduce.outcome import Found, row_name, row_words
from ground.reproduce.paper import MoonHop, Paper


def moon_height_m(moon: MoonHop, c3: float, legs: int) -> float:
    """Eq. (6), h = (1 - C1)(1 - C2)(1 - C3) E/(M g), with the published energy in each of `legs` legs."""
    energy_j = legs * moon.spring_energy_j
    left = (1.0 - moon.c1) * (1.0 - moon.c2) * (1.0 - c3)
    return left * energy_j / (moon.mass_kg * moon.gravity_m_s2)


def moon_rows(chain: Chain, paper: Paper) -> Iterator[Found]:
    """The height on each ground, by our mean C3, beside that by the published one; and the published span."""
    moon = paper.moon
    heights: list[float] = []
    for row in paper.surfaces:
        c3 = [
            run.c3_direct.value for run in chain.tests if run.run.row == row.key and run.c3_direct is not None
        ]
        if not c3:
            continue
        ours = [moon_height_m(moon, value, moon.legs) for value in (sum(c3) / len(c3), max(c3), min(c3))]
        if not row.tilt_deg:
            heights += ours
        yield Found(
            f"moon_height_{row_name(row)}",
            "Figure 23",
            f"height on the Moon, {row_words(row)}",
            ours[0],
            "m",
            low=ours[1],
            high=ours[2],
            runs=len(c3),
            published=moon_height_m(moon, row.c3_direct.mean, moon.legs),
        )
    yield from _span(heights, moon)


def _span(heights: Sequence[float], moon: MoonHop) -> Iterator[Found]:
    if heights:
        for name, value, known in (
            ("lowest", min(heights), moon.height_low_m),
            ("highest", max(heights), moon.height_high_m),
        ):
            yield Found(
                f"moon_height_{name}",
                "Figure 23",
                f"{name} height on the Moon, level grounds",
                value,
                "m",
                published=known,
                met=abs(value - known) < 0.5,
            )
