"""What the demonstration of concealed physics shows, as a sentence, as tables and as JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from flight.uncertain import Uncertain
from ground.demo_concealed import NOTHING, WAYS, Concealed

Table = tuple[tuple[str, ...], list[tuple[str, ...]]]


def sentence(result: Concealed) -> str:
    """What came of it, in one sentence."""
    hidden = "nothing" if result.hidden == NOTHING else result.hidden.replace("_", " ")
    found = result.outcome.diagnosis
    named = " and ".join(f.physics_id.replace("_", " ") for f in found.findings) or "nothing"
    normal = "all" if result.looks_normal else "not all"
    lumped, refit, extended = (1e3 * result.error(way, "height_m") for way in WAYS)
    return (
        f"The robot hid {hidden}; {normal} of its {len(result.learned)} hops' C3 look normal; the diagnosis says "
        f"{found.verdict} and names {named}. Hops that no fit saw are predicted to {extended:.2f} mm of height with "
        f"what was found, {refit:.2f} mm with the refitted nominal plant, {lumped:.2f} mm with lumped C2 and C3."
    )


def learned_rows(result: Concealed) -> Table:
    """Headers and rows of the hops that the diagnosis saw."""
    rows: list[tuple[str, ...]] = []
    for hop, gap in zip(result.learned, result.closes_by, strict=True):
        report, c3 = hop.report, hop.report.c3
        normal = c3 is not None and result.c3_low <= c3.value <= result.c3_high
        rows.append(
            (
                str(report.hop_index + 1),
                f"{report.plan.energy_j:g}",
                percent(c3),
                "yes" if normal else "no",
                f"{100 * gap:+.1f}",
            )
        )
    return ("hop", "E_used [J]", "C3 [%]", "in published range", "chain misses height by [%]"), rows


def later_rows(result: Concealed) -> Table:
    """Headers and rows of the hops that no fit saw; the last row holds the rms errors against the truth."""
    rows: list[tuple[str, ...]] = []
    for one in result.predictions:
        height, time = one.flown_height_m, one.flown_time_s
        flown = (
            f"{1e3 * height.value:.1f} ± {1e3 * height.sigma:.1f}",
            f"{1e3 * time.value:.2f} ± {1e3 * time.sigma:.2f}",
        )
        heights = [f"{1e3 * one.height_m[way]:.1f}" for way in WAYS]
        times = [milliseconds(one.time_s[way]) for way in WAYS[1:]]
        rows.append((str(one.hop), f"{one.energy_j:g}", flown[0], *heights, flown[1], *times))
    errors = [f"{1e3 * result.error(way, 'height_m'):.2f}" for way in WAYS]
    late = [f"{1e3 * result.error(way, 'time_s'):.2f}" for way in WAYS[1:]]
    rows.append(("rms error", "", "", *errors, "", *late))
    headers = ("hop", "E_used [J]", "height flown [mm]", *WAYS, "flight flown [ms]", *WAYS[1:])
    return headers, rows


def rehearsed_rows(result: Concealed) -> Table:
    """Headers and rows: the later hops as the flight software saw them, on the robot and on the plant found."""
    rows = []
    for robot, simulated in zip(result.later, result.rehearsed, strict=True):
        rows.append(
            (
                str(robot.report.hop_index + 1),
                *(percent(hop.report.c3) for hop in (robot, simulated)),
                *(millimetres(hop.report.energies.height_m) for hop in (robot, simulated)),
            )
        )
    headers = ("hop", "C3 on the robot [%]", "C3 rehearsed [%]", "height on the robot [mm]", "rehearsed [mm]")
    return headers, rows


def percent(share: Uncertain | None) -> str:
    """A share with its sigma, in per cent."""
    return "–" if share is None else f"{100 * share.value:.1f} ± {100 * share.sigma:.1f}"


def millimetres(length_m: Uncertain | None) -> str:
    """A length with its sigma."""
    return "–" if length_m is None else f"{1e3 * length_m.value:.1f} ± {1e3 * length_m.sigma:.1f}"


def milliseconds(time_s: float | None) -> str:
    """A time for a table; a dash where there is none."""
    return "–" if time_s is None else f"{1e3 * time_s:.2f}"


def content_of(result: Concealed) -> dict[str, Any]:
    """What `--json` prints: SI units, unrounded."""
    found = result.outcome.diagnosis
    return {
        "format": 1,
        **{"hidden": result.hidden, "seed": result.seed, "looks_normal": result.looks_normal},
        **{"verdict": found.verdict, "found": result.found, "published_c3": [result.c3_low, result.c3_high]},
        "findings": [{"physics_id": f.physics_id, "probability": f.probability} for f in found.findings],
        "c3": [hop.report.c3.value if hop.report.c3 else None for hop in result.learned],
        "chain_misses_height_by": list(result.closes_by),
        "predictions": [
            asdict(one)
            | {
                "flown_height_m": {"value": one.flown_height_m.value, "sigma": one.flown_height_m.sigma},
                "flown_time_s": {"value": one.flown_time_s.value, "sigma": one.flown_time_s.sigma},
            }
            for one in result.predictions
        ],
        "c3_rehearsed": [hop.report.c3.value if hop.report.c3 else None for hop in result.rehearsed],
        "rms_height_error_m": {way: result.error(way, "height_m") for way in WAYS},
        "rms_time_error_s": {way: result.error(way, "time_s") for way in WAYS[1:]},
    }
