"""The rows of the table, by part. Each part takes how often to repeat."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

import flight
from benchmarks import estimator, onboard, plant
from benchmarks.bench.logs import log_rows
from benchmarks.bench.numba_hop import numba_hop
from benchmarks.bench.output_error import output_error
from benchmarks.bench.rows import Growth, Row, by_turns, rates, seconds
from benchmarks.blind.cases import BlindCase, draw_case, measured
from benchmarks.blind.rivals import sparse_regression
from benchmarks.blind.sight import simulate
from benchmarks.hop_peers import MuJoCoHop, Rig, by_scipy
from benchmarks.real_time import recorded
from benchmarks.rival_estimators import RIVALS
from ground.diagnose.pipeline import diagnose
from ground.recordings import Recording
from hal.config import config_path
from sim_hal.plant.hops import Hops
from sim_hal.plant.simulate import Run, compile_plant, load_plant

HOPS, HARD_HOPS, LOGGED_S, TICK_BUDGET_US = 4000, 400, 5.0, 5000.0
ESTIMATED, GROUPS = 200, 5
CASES = (("axis", 0), ("axis", 1), ("axis", 3), ("drop", 0))
"""Generated cases with something hidden, few and quick; `python -m benchmarks.blind` has the whole campaign."""
GROWTH_CASE = ("axis", 0)
IMPORTS = "import time, numpy, yaml, mcap.writer, serial, smbus2; print(time.process_time())"


def hops(repeats: int) -> list[Row]:
    """Hops to their highest point, to a height within 1e-6: in a batch, beside each peer one by one."""
    nominal = load_plant(config_path("plant", "bb0b_hop.yaml"))
    batch, compressions, values = plant.drawn_hops(nominal, HOPS)
    rig = plant._rig(batch, compressions[1], values[1])
    exact = by_scipy(rig, 1e-12)

    def close(jobs: list[Callable[[], float]]) -> Callable[[], float]:
        return next(job for job in jobs if abs(job() / exact - 1.0) <= plant.CLOSE)

    peers = {"scipy.solve_ivp (DOP853)": close([partial(by_scipy, rig, 10.0**-n) for n in range(4, 12)])}
    for name, made in (("MuJoCo (RK4)", _mujoco), ("Numba (RK4)", numba_hop)):
        try:
            peers[name] = close([made(rig, 2e-3 * 0.5**n) for n in range(14)])
        except ImportError:
            print(f"{name} is not installed: left out")
    times = by_turns(
        repeats, lambda: batch.heights_m(compressions, values), *(_often(p) for p in peers.values())
    )
    ours = rates(HOPS, times[0])
    rows = [
        Row(
            "hops, nominal",
            "1/s",
            ours,
            name,
            rates(_TIMES, taken),
            True,
            "height within 1e-6; one core each",
        )
        for name, taken in zip(peers, times[1:], strict=True)
    ]
    hard, compressions, values = plant.drawn_hops(plant.with_effects(nominal, plant.HOP_EFFECTS), HARD_HOPS)
    (taken,) = by_turns(repeats, lambda: hard.heights_m(compressions, values))
    note = "friction, drag, soil that resists speed; the peers fly the nominal hop"
    return [
        *rows,
        Row(
            "hops, three effects",
            "1/s",
            rates(HARD_HOPS, taken),
            "MuJoCo (RK4), nominal",
            _theirs(rows, "MuJoCo"),
            True,
            note,
        ),
    ]


_TIMES = 20


def _often(job: Callable[[], float]) -> Callable[[], None]:
    def run() -> None:
        for _ in range(_TIMES):
            job()

    return run


def _mujoco(rig: Rig, step_s: float) -> Callable[[], float]:
    return MuJoCoHop(rig, step_s).rise_m


def _theirs(rows: list[Row], name: str) -> tuple[float, ...]:
    return next((row.theirs for row in rows if name in row.peer), ())


def ran_as() -> str:
    """What a tick runs through, here."""
    return "machine code" if flight.COMPILED else "sources"


def missions(repeats: int) -> list[Row]:
    """30 s of tensioning with three effects; a whole mission against real time."""
    model = plant.with_effects(load_plant(config_path("plant", "bb0b_drive.yaml")), plant.DRIVE_EFFECTS)
    compiled, run = compile_plant(model), tensioning(6000)
    (taken,) = by_turns(repeats, lambda: compiled.run(compiled.values, run))
    rows = [Row("tensioning, 30 s, three effects", "ms", tuple(1e3 * t for t in taken), "real time", (30e3,))]
    factors = plant.sil_factors(max(2, repeats // 2))
    what = f"software in the loop, {ran_as()}"
    note = "flight software at 200 Hz and simulated robot, one core"
    by_sources = plant.sil_by_sources(max(2, repeats // 2))
    return [
        *rows,
        Row(what, "s/s", tuple(factors), "real time", (1.0,), True, note),
        Row(
            what,
            "s/s",
            tuple(factors),
            "sources",
            tuple(by_sources),
            True,
            "`hopper compile` makes the former",
        ),
    ]


def tensioning(samples: int) -> Run:
    """30 s of voltages, in so many samples."""
    times = np.linspace(0.0, 30.0, samples, endpoint=False)
    volts = np.where(times < 16.0, 9.0, np.where(times < 24.0, 0.0, -6.0))
    return Run(times, {"motor_voltage_v": volts.astype(np.float64)})


def estimates(repeats: int) -> list[Row]:
    """The time of flight of broad hops: error and cost beside the textbook's, and beside the information bound."""
    found = estimator.measure(ESTIMATED, 20260, 1)
    ours = [o for o in found[estimator.OURS] if o.answer.accepted and not o.nominal]
    rows = []
    for name in RIVALS:
        theirs = {o.index: o for o in found[name] if o.answer.accepted and not o.nominal}
        both = [(o, theirs[o.index]) for o in ours if o.index in theirs]
        groups = [both[n::GROUPS] for n in range(GROUPS) if both[n::GROUPS]]
        errors = [tuple(_rms([p[k].flight_error_ms for p in group]) for group in groups) for k in (0, 1)]
        note = f"rms over groups of the {len(both)} hops that both accept"
        rows.append(Row("time of flight: error", "ms", errors[0], name, errors[1], note=note))
        costs = [tuple(1e3 * p[k].cost_s for p in both) for k in (0, 1)]
        why = "ours fits the whole record and states an uncertainty; the textbook's does neither"
        rows.append(Row("time of flight: cost", "ms", costs[0], name, costs[1], note=why))
    bounded = [o for o in found[estimator.OURS] if np.isfinite(o.bound_s) and o.answer.accepted]
    if bounded:
        error, bound = _rms([o.flight_error_ms for o in bounded]), _rms([1e3 * o.bound_s for o in bounded])
        note = f"rms of {len(bounded)} nominal hops; no unbiased estimator is below the bound"
        name = "time of flight: error, nominal hops"
        rows.append(Row(name, "ms", (error,), "information bound", (bound,), note=note))
    return rows


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def on_board(repeats: int) -> list[Row]:
    """The tick, the log, and the start."""
    ticks = onboard.ticks(logged=True)[:-1]
    budget, of_flights = "budget at 200 Hz", f" (least of {onboard.FLIGHTS} flights, {ran_as()})"
    rows = [
        *(
            Row(
                f"tick{of_flights}, {name}",
                "µs",
                (float(np.percentile(ticks, share)),),
                budget,
                (TICK_BUDGET_US,),
            )
            for name, share in (("median", 50.0), ("99.9 %", 99.9))
        ),
        *log_rows(recorded(LOGGED_S), LOGGED_S, repeats),
    ]
    _, cpu_s, memory_mb = onboard.start_and_memory()
    bare = tuple(
        float(subprocess.check_output([sys.executable, "-c", IMPORTS])) for _ in range(onboard.STARTS)
    )
    note = "ours up to where it asks for the board; no start of Python can be below its imports"
    rows.append(
        Row("start, processor time", "s", (cpu_s,), "its libraries' imports", (min(bare),), note=note)
    )
    return [*rows, Row("memory at the start", "MB", (memory_mb,))]


def answers(repeats: int) -> list[Row]:
    """Diagnoses of generated cases: time, and how many are named right, beside the rivals."""
    taken: dict[str, list[float]] = {"ours": [], "output error": [], "PySINDy": []}
    right: dict[str, list[float]] = {name: [] for name in taken}
    for kind, number in CASES:
        case = draw_case(kind, number, 1)
        hidden = {one.physics_id for one in case.hidden}
        for name, answer in (("ours", _ours), ("output error", _full), ("PySINDy", _sparse)):
            start = time.process_time()
            names = answer(case)
            taken[name].append(time.process_time() - start)
            right[name].append(len(hidden & names) / len(hidden) if hidden else float(not names))
        print(f"  {case.name} hides {sorted(hidden)}: " + ", ".join(f"{n} {right[n][-1]:.1f}" for n in right))
    rows = []
    for name, label in (("output error", "SciPy output-error fit"), ("PySINDy", "PySINDy on the residual")):
        share = (float(np.mean(right["ours"])),), label, (float(np.mean(right[name])),)
        rows.append(Row(f"diagnosis: named right of {len(CASES)}", "1", *share, gain=True))
        why = "ours searches over names and shapes and checks on held-out runs; theirs fits once"
        rows.append(Row("diagnosis: time", "s", tuple(taken["ours"]), label, tuple(taken[name]), note=why))
    return rows


def _ours(case: BlindCase) -> set[str]:
    found = diagnose(case.train, case.plant, processes=1).diagnosis
    return {finding.physics_id for finding in found.findings}


def _full(case: BlindCase) -> set[str]:
    return set(output_error(case).names)


def _sparse(case: BlindCase) -> set[str]:
    return set(sparse_regression(case, case.plant).names)


def growth(repeats: int) -> list[Growth]:
    """How cost grows with size."""
    nominal = load_plant(config_path("plant", "bb0b_hop.yaml"))

    def least(job: Callable[[], object]) -> float:
        return min(by_turns(repeats, job)[0])

    counts = (500, 2000, 8000, 32000)
    batches = [plant.drawn_hops(nominal, count) for count in counts]
    found = [Growth("hops: number", counts, tuple(least(partial(b.heights_m, c, v)) for b, c, v in batches))]
    effects = [plant.with_effects(nominal, (*plant.HOP_EFFECTS, *MORE_EFFECTS)[:n]) for n in (1, 2, 3, 4, 5)]
    spent = tuple(least(partial(_heights, *plant.drawn_hops(one, HARD_HOPS))) for one in effects)
    found.append(Growth("hops: effects in the plant", (1, 2, 3, 4, 5), spent))
    compiled = compile_plant(
        plant.with_effects(load_plant(config_path("plant", "bb0b_drive.yaml")), plant.DRIVE_EFFECTS)
    )
    samples = (1500, 6000, 24000, 96000)
    found.append(
        Growth(
            "tensioning: samples of 30 s",
            samples,
            tuple(least(partial(compiled.run, compiled.values, tensioning(n))) for n in samples),
        )
    )
    return found


def _heights(batch: Hops, compressions: plant.Float, values: plant.Float) -> object:
    return batch.heights_m(compressions, values)


MORE_EFFECTS = (
    ("aerodynamic_drag_linear", "ballistic", {"d": (0.05, "N*s/m")}),
    ("latch_drag", "latch", {"F_d": (25.0, "N"), "t_f": (0.012, "s")}),
)


def diagnosis_growth(repeats: int) -> list[Growth]:
    """How a diagnosis grows with recordings, and with samples of the same runs.

    Finer runs have the same inputs and are measured anew: thinned ones would have other inputs, and so physics of
    their own to be searched.
    """
    case = draw_case(*GROWTH_CASE, 1)
    runs = (*case.train, *case.test)

    def spent(recordings: Sequence[Recording]) -> float:
        return seconds(lambda: diagnose(recordings, case.plant))

    most = len(runs)
    numbers = tuple(sorted({2, most // 2, most}))
    by_runs = tuple(spent(runs[:number]) for number in numbers)
    finer = [measured_at(case, runs, times) for times in (1, 2, 4)]
    return [
        Growth("diagnosis: recordings", tuple(map(float, numbers)), by_runs),
        Growth(
            "diagnosis: samples",
            tuple(float(sum(run.times_s.size for run in each)) for each in finer),
            tuple(map(spent, finer)),
        ),
    ]


def measured_at(case: BlindCase, runs: Sequence[Recording], times: int) -> tuple[Recording, ...]:
    """The same runs of the true rig, read so many times as often."""
    random = np.random.default_rng(times)
    finer = []
    for run in runs:
        grid = np.linspace(run.times_s[0], run.times_s[-1], times * (run.times_s.size - 1) + 1)
        channels = {name: np.interp(grid, run.times_s, values) for name, values in run.channels.items()}
        finer.append(replace(run, times_s=grid, channels=channels))
    clean = simulate(case.truth, finer)
    return tuple(measured(run, table, case.plant, random) for run, table in zip(finer, clean, strict=True))


PARTS: Mapping[str, Callable[[int], list[Row]]] = {
    "hops": hops,
    "missions": missions,
    "estimates": estimates,
    "on_board": on_board,
    "answers": answers,
}
GROWTHS: Mapping[str, Callable[[int], list[Growth]]] = {
    "growth": growth,
    "diagnosis_growth": diagnosis_growth,
}
