"""Release and touchdown of a falling phone, from published accelerometer recordings.

    python -m benchmarks.falling_phone [--data DIR] [--page FILE]

No spring rings here, so the ends are found by what a rigid body must read: the hand's force falls to nothing at the
release, then the sensor's own bias and the air's drag are left, and a cushion's force grows from touchdown on. The
sensor's three axes are used together, so that it does not matter how the phone lay. Data: F. Saliby, "Air Resistance
From the Acceleration of a Falling Smartphone", arXiv:2410.14172 (CC0), 198.6 samples a second.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[1] / "../shared/data/falling-smartphone"
G_M_S2 = 9.80665
_FALLING_M_S2 = 4.0  # of specific force: below it the phone falls
_SHORTEST_S = 0.2
_CLEAR = 6  # samples after the hand's force got weak, by which it is gone
_BIAS_S = (0.03, 0.08)  # after the release: the sensor has settled, and drag is below 1 % of gravity
_NOISE_M_S2 = 0.022  # the author's figure
_STRONG_M_S2 = {
    -1: 1.2,
    1: 2.0,
}  # above the air's: the hand still holds; the cushion pushes, not the air under it
_POWERS = tuple(np.arange(0.6, 2.51, 0.1).tolist())  # with which the force of hand and cushion may vanish
_POWER_STD = 0.3  # what three samples leave open, as hands and cushions are no powers of time
_FURTHEST_STEPS = 3.0  # from the first strong sample to where the force is nothing
_NOISE_GAIN = 3.0  # of the line through the first samples
_HELD_S = 0.15  # of the hand giving way


class NoFall(Exception):
    """The recording shows no fall; the message says why."""


@dataclass(frozen=True)
class Fall:
    """Release and touchdown [s] with sigma, and the speed [m/s] that the phone already had at the release."""

    release_s: float
    release_sigma_s: float
    touchdown_s: float
    touchdown_sigma_s: float
    release_speed_m_s: float

    @property
    def flight_s(self) -> float:
        return self.touchdown_s - self.release_s

    @property
    def flight_sigma_s(self) -> float:
        return math.hypot(self.release_sigma_s, self.touchdown_sigma_s)


def read(path: Path) -> tuple[Array, Array]:
    """Times (n,) [s] and specific force (n, 3) [m/s^2] of a recording: comma or tab, with or without a heading."""
    text = path.read_text(encoding="utf-8").splitlines()
    lines = text[1:] if text and text[0].startswith('"') else text
    table = np.array(
        [[float(cell) for cell in line.replace(",", "\t").split("\t")] for line in lines if line]
    )
    return table[:, 0], table[:, 1:4]


def find_fall(times_s: Array, force_m_s2: Array) -> Fall:
    """The fall in a recording. Raises `NoFall`."""
    low = np.linalg.norm(force_m_s2, axis=1) < _FALLING_M_S2
    edges = np.flatnonzero(np.diff(np.concatenate(([0], low.astype(np.int8), [0]))))
    runs = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    begin, end = max(runs, key=lambda run: run[1] - run[0], default=(0, 0))
    if end <= begin or times_s[end - 1] - times_s[begin] < _SHORTEST_S:
        raise NoFall(f"nothing falls for {_SHORTEST_S:g} s")
    if begin < 3 or end > times_s.size - 3:
        raise NoFall("the recording begins or ends in the fall")
    since = times_s - times_s[begin]
    settled = (since > _BIAS_S[0]) & (since < _BIAS_S[1])
    bias = force_m_s2[settled].mean(axis=0)
    felt = np.linalg.norm(force_m_s2 - bias, axis=1)
    release_s, release_sigma_s = _vanishing(times_s, felt, begin + _CLEAR, -1)
    touchdown_s, touchdown_sigma_s = _vanishing(times_s, felt, end - 2, 1)
    held = (times_s > release_s - _HELD_S) & (times_s < release_s)
    missing = G_M_S2 - np.append(felt[held], 0.0)
    at = np.append(times_s[held], release_s)
    speed = float(np.sum(0.5 * (missing[1:] + missing[:-1]) * np.diff(at)))
    return Fall(release_s, release_sigma_s, touchdown_s, touchdown_sigma_s, speed)


def _vanishing(times_s: Array, felt: Array, inside: int, way: int) -> tuple[float, float]:
    """When the force beyond `inside`, seen `way`, is nothing any more; and its sigma.

    From its first three strong samples, as the power of time that they follow best.
    """
    nearby = felt[inside - 4 * way : inside + way : way] if way > 0 else felt[inside : inside + 5]
    air = float(np.median(nearby))
    first = inside
    while felt[first] - air < _STRONG_M_S2[way]:
        first += way
        if not 2 < first < felt.size - 3:
            raise NoFall("no end of the fall is seen")
    at = np.arange(first, first + 3 * way, way)
    t, strong = times_s[at], felt[at] - air
    if np.any(np.diff(strong) <= 0.0):  # its rise lies within one step
        step = float(t[1] - t[0])
        return float(t[0]) - 0.5 * step, abs(step) / math.sqrt(12.0)

    def zero_s(power: float) -> float:
        root = strong ** (1.0 / power)
        steps = min(float(root[0] / (root[1] - root[0])), _FURTHEST_STEPS)
        return float(t[0] - steps * (t[1] - t[0]))

    def bend(power: float) -> float:
        root = strong ** (1.0 / power)
        return abs(float(root[2] - 2.0 * root[1] + root[0])) / float(root[2] - root[0])

    power = min(_POWERS, key=bend)
    spread_s = 0.5 * abs(zero_s(power + _POWER_STD) - zero_s(max(power - _POWER_STD, 1e-3)))
    noise_s = abs(t[1] - t[0]) * _NOISE_M_S2 * _NOISE_GAIN / float(strong[1] - strong[0])
    return zero_s(power), math.hypot(spread_s, noise_s)


def page(folder: Path) -> str:
    """The page of all recordings (Markdown)."""
    files = sorted((folder / "raw_csv").glob("*.csv"), key=lambda path: int(path.stem.split("_")[1]))
    files += sorted(folder.glob("*.txt"))
    rows, found = [], []
    for path in files:
        try:
            fall = find_fall(*read(path))
        except NoFall as error:
            rows.append(f"| `{path.name}` | no fall: {error} | | | |")
            continue
        found.append(fall)
        rows.append(
            f"| `{path.name}` | {fall.release_s:.4f} ± {fall.release_sigma_s:.4f} "
            f"| {fall.touchdown_s:.4f} ± {fall.touchdown_sigma_s:.4f} "
            f"| {1e3 * fall.flight_s:.1f} ± {1e3 * fall.flight_sigma_s:.1f} | {fall.release_speed_m_s:.2f} |"
        )
    sigmas = np.array([1e3 * fall.flight_sigma_s for fall in found])
    flights = np.array([1e3 * fall.flight_s for fall in found])
    return _PAGE.format(
        rows="\n".join(rows),
        found=len(found),
        files=len(files),
        low=flights.min(),
        high=flights.max(),
        sigma=float(np.median(sigmas)),
    )


_PAGE = """# Real falls: release and touchdown of a phone

Made by `python -m benchmarks.falling_phone --page docs/falls.md` from F. Saliby's recordings (arXiv:2410.14172, CC0):
a phone held, let go, falling, landing on a cushion; 198.6 samples a second, no reference of the times. In {found} of
{files} recordings a fall is found; flights last {low:.1f} to {high:.1f} ms, known to {sigma:.1f} ms (median, 1
sigma).

No spring rings in a phone, so the ends follow from what a rigid body must read. The bias of the three axes is taken
from the first hundredths of a second of the fall, where the air does nothing yet. Release and touchdown are where the
force of the hand, or of the cushion, is nothing, by its first three strong samples and the power of time that they
follow best; what that leaves open is most of the stated sigma. A hand lets go slowly: the phone moves already when
it is free, and the last column is its speed then, integrated over the 0.15 s before.

| file | release [s] | touchdown [s] | flight [ms] | speed at release [m/s] |
| --- | --- | --- | --- | --- |
{rows}
"""


def main() -> None:
    """Print the page, or write it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the recordings")
    parser.add_argument("--page", type=Path, help="write the page to this file")
    options = parser.parse_args()
    if not options.data.is_dir():
        parser.error(f"{options.data}: no such folder; give --data DIR")
    text = page(options.data)
    if options.page:
        options.page.write_text(text, encoding="utf-8")
    else:
        print(text, end="")


if __name__ == "__main__":
    main()
