"""The ringing of a part of the flight: a damped wave about a level, with dry friction where that is there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flight.ringing import Ringing

Array = NDArray[np.float64]

_SEEN_TO_RUB, _LEAST_FOR_FRICTION = 4.0, 16  # dry friction, in sigmas of the noise; samples
_TURNS = 4  # of Gauss-Newton


@dataclass(frozen=True)
class LocalRinging:
    """A ringing fitted to a part of the flight: about which level, what rubs, and what is left unexplained.

    `friction_m_s2`: dry friction over the body's mass, at work on the half turns away from `from_s`.
    """

    ringing: Ringing
    level_m_s2: float
    rms_m_s2: float
    from_s: float
    friction_m_s2: float = 0.0

    def motion_m_s2(self, times_s: Array) -> Array:
        """The ringing, went it on, at any times (n,)."""
        rubbed = (
            self.friction_m_s2 * self.ringing.half_turns(times_s, self.from_s) if self.friction_m_s2 else 0.0
        )
        return np.asarray(
            self.ringing.acceleration_m_s2(times_s) + self.level_m_s2 + rubbed, dtype=np.float64
        )


def fit_ringing(
    times_s: Array,
    motion: Array,
    omega: tuple[float, float],
    decay: tuple[float, float],
    noise_m_s2: float,
    from_s: float,
) -> LocalRinging:
    """Ringing over a stretch of flight (n,) that ends at `from_s`; frequency and decay with their priors (mean, std).

    Dry friction is taken to be there where its wave is plainly in what a free ringing leaves.
    """
    free = _ringing(times_s, motion, omega, decay, noise_m_s2, None)
    without = replace(free, from_s=from_s)
    if (
        times_s.size < _LEAST_FOR_FRICTION
        or rubbing_sigmas(without, times_s, motion, noise_m_s2) < _SEEN_TO_RUB
    ):
        return without
    rubbing = _ringing(times_s, motion, omega, decay, noise_m_s2, from_s)
    return rubbing if rubbing.rms_m_s2 < free.rms_m_s2 else without


def rubbing_sigmas(free: LocalRinging, times_s: Array, motion: Array, noise_m_s2: float) -> float:
    """Dry friction that a free ringing leaves in the samples (n,), in sigmas: standard normal where there is none.

    Friction takes its share at each turn of the spring. What frequency, decay, amplitude, phase and level could have
    taken up of that wave tells nothing.
    """
    tau = times_s - free.ringing.reference_s
    wave = np.exp(free.ringing.pole * tau)
    cosine, sine = wave.real, wave.imag
    taken = np.linalg.qr(np.column_stack((cosine, sine, np.ones_like(tau), tau * cosine, tau * sine)))[0]
    rubbed = free.ringing.half_turns(times_s, free.from_s)
    rubbed = rubbed - taken @ (rubbed @ taken)
    size = float(np.linalg.norm(rubbed))
    left = motion - free.motion_m_s2(times_s)
    return float(rubbed @ left) / (size * noise_m_s2) if size > 0.0 else 0.0


def _ringing(
    times_s: Array,
    motion: Array,
    omega: tuple[float, float],
    decay: tuple[float, float],
    noise_m_s2: float,
    from_s: float | None,
) -> LocalRinging:
    """Gauss-Newton in frequency and decay, the rest being linear; with friction where `from_s` is given."""
    middle = float(0.5 * (times_s[0] + times_s[-1]))
    tau = times_s - middle
    mean = np.array((omega[0], decay[0]))
    weight = noise_m_s2 / np.array((omega[1], decay[1]))
    pole = mean.copy()
    amplitudes, left = np.zeros(4), motion
    ringing = Ringing(middle, omega[0], decay[0], 0.0, 0.0)
    for step in range(_TURNS + 1):
        fade = np.exp(-pole[1] * tau)
        cosine, sine = fade * np.cos(pole[0] * tau), fade * np.sin(pole[0] * tau)
        if step == 0:
            amplitudes[:3] = np.linalg.lstsq(
                np.column_stack((cosine, sine, np.ones_like(tau))), motion, rcond=None
            )[0]
        wave = amplitudes[0] * cosine + amplitudes[1] * sine
        ringing = Ringing(middle, float(pole[0]), float(pole[1]), float(amplitudes[0]), float(amplitudes[1]))
        rubbed = np.zeros_like(tau) if from_s is None else ringing.half_turns(times_s, from_s)
        left = motion - wave - amplitudes[2] - amplitudes[3] * rubbed
        if step == _TURNS:
            break
        turned = amplitudes[1] * cosine - amplitudes[0] * sine
        columns = np.column_stack((tau * turned, -tau * wave, cosine, sine, np.ones_like(tau), rubbed))
        normal = columns.T @ columns
        normal[[0, 1, 5], [0, 1, 5]] += (*weight**2, 1e-6)
        gradient = columns.T @ left
        gradient[:2] -= weight**2 * (pole - mean)
        scale = np.sqrt(np.diag(normal))
        move = np.linalg.solve(normal / np.outer(scale, scale), gradient / scale) / scale
        pole, amplitudes = pole + move[:2], amplitudes + move[2:]
    rms = math.sqrt(float(np.sum(left**2)) / max(tau.size - 5, 1))
    return LocalRinging(ringing, float(amplitudes[2]), rms, from_s or 0.0, float(amplitudes[3]))
