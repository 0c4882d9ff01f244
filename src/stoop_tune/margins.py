r"""Stability margins of loops, from their frequency responses, many loops at once.

A loop is opened at the actuator, the others closed: L(jw) is the command that comes back for one that goes out, with its sign
changed, and the loop is stable where the Nyquist curve of L does not encircle -1. The margins are those of the closest crossings;
the disk margin is [1]_

.. math:: \alpha = \min_\omega 1 / |S(j\omega) - 1/2|, \qquad S = 1 / (1 + L)

with the gain and phase that a disk of that size, centered in gain, guarantees together.

References
----------
.. [1] P. Seiler, A. Packard, P. Gahinet, "An Introduction to Disk Margins", IEEE Control Systems 40(5), 2020, eqs. 6 to 9.
.. [2] SAE AS94900, Flight Control Systems: 6 dB and 45 deg.
.. [3] M. B. Tischler and others, Practical Methods for Aircraft and Rotorcraft Flight Control Design, AIAA, 2017: disturbance
   rejection bandwidth and peak.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from stoop.extend.arrays import BoolArray, ComplexArray, FloatArray, IntArray

LEAST: Final = 1e-12  #: of a gain
ONCE: Final = 1e6  #: period of a level that does not recur
REDUCTIONS: Final = (np.log(2.0) / 2.0, 0.2 * np.log(10.0))  #: of a disturbance, 3 and 4 dB, as logarithms
NEWTON: Final = 4  #: steps on a cubic, from the straight line


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins (d,) of d loops; infinite where a loop never crosses."""

    gain_up: FloatArray  #: smallest factor above one that takes the loop to its limit
    gain_down: FloatArray  #: largest factor below one that does; zero where none does
    phase: FloatArray  #: rad
    delay: FloatArray  #: s
    disk: FloatArray  #: alpha, with no skew
    crossover: FloatArray  #: rad/s, highest frequency at which the gain is one; NaN where it never is
    #: rad/s, lowest frequency from which a disturbance at the actuator is reduced by less than 3 dB; zero where none is by more
    rejection: FloatArray
    #: likewise, 4 dB: a hump of the sensitivity that just touches 3 dB makes `rejection` jump, so that gains are searched by this
    firm_rejection: FloatArray
    peak: FloatArray  #: largest factor by which a disturbance at the actuator grows
    slow: FloatArray  #: factor by which a disturbance at the lowest frequency remains
    limit: (
        FloatArray  #: rad/s, at which a disturbance grows most: there a loop with more gain or delay swings
    )

    def where(self, stable: BoolArray) -> Margins:
        """Return the margins with none left where loops (d,) are unstable."""
        none = {"gain_up": 1.0, "gain_down": 1.0, "phase": 0.0, "delay": 0.0, "disk": 0.0, "peak": np.inf}
        return replace(self, **{n: np.where(stable, getattr(self, n), x) for n, x in none.items()})

    @property
    def gain(self) -> FloatArray:
        """Smaller of both gain margins, as a factor above one."""
        with np.errstate(divide="ignore"):
            return np.minimum(self.gain_up, 1.0 / self.gain_down)

    @property
    def disk_gain(self) -> FloatArray:
        """Gain, a factor above one, up and down, that the disk guarantees; infinite from a disk of two on."""
        half = np.minimum(0.5 * self.disk, 1.0)
        with np.errstate(divide="ignore"):
            return np.asarray((1.0 + half) / (1.0 - half))

    @property
    def disk_phase(self) -> FloatArray:
        """Phase, rad, that the disk guarantees."""
        return np.asarray(2.0 * np.arctan(0.5 * self.disk))


def margins(frequency: FloatArray, loop: ComplexArray) -> Margins:
    """Return the margins of stable loops.

    Between frequencies, log gain and phase are cubics over log frequency, which should be evenly spaced.

    Parameters
    ----------
    frequency : (m,) rising, rad/s
    loop : (d, m) L(jw)
    """
    w = np.log(frequency)
    size, angle = np.log(np.maximum(np.abs(loop), LEAST)), np.unwrap(np.angle(loop), axis=1)
    count = len(loop)
    of, _, gains = _crossings(w, angle, size, np.pi, 2.0 * np.pi)
    up = _least(count, of, np.where(gains < 0.0, np.exp(-gains), np.inf))
    down = 1.0 / _least(count, of, np.where(gains >= 0.0, np.exp(gains), np.inf))
    of, at, turned = _crossings(w, size, angle, 0.0, ONCE)
    ahead = np.mod(turned + np.pi, 2.0 * np.pi)  # what a delay may take
    phase = _least(count, of, np.minimum(ahead, 2.0 * np.pi - ahead))
    delay = _least(count, of, ahead / np.exp(at))
    highest = -_least(count, of, -at)
    crossover = np.where(np.isfinite(highest), np.exp(highest), np.nan)
    disk = np.sqrt(_lowest(1.0 / np.abs(1.0 / (1.0 + loop) - 0.5) ** 2))
    difference = np.log(np.abs(1.0 + loop))
    rejection, firm = (_rejected(w, difference, level) for level in REDUCTIONS)
    peak = 1.0 / np.sqrt(_lowest(np.abs(1.0 + loop) ** 2))
    slow, limit = np.exp(-difference[:, 0]), frequency[np.argmin(difference, axis=1)]
    return Margins(up, down, phase, delay, disk, crossover, rejection, firm, peak, slow, limit)


def _rejected(w: FloatArray, difference: FloatArray, level: float) -> FloatArray:
    """Return the frequency (d,), rad/s, up to which log |1 + L| (d, m) is above a level; zero where it begins below."""
    of, at, _ = _crossings(w, difference, difference, level, ONCE)
    lowest = np.minimum(_least(len(difference), of, at), w[-1])
    return np.where(difference[:, 0] > level, np.exp(lowest), 0.0)


def rms_of_noise(
    frequency: FloatArray, feedback: ComplexArray, loop: ComplexArray, density: float
) -> FloatArray:
    """Return the rms (d,) of the command that white noise of the sensor of a loop causes.

    Parameters
    ----------
    frequency : (m,) rising, rad/s
    feedback : (m,) command over reading
    loop : (d, m) L(jw)
    density : of the noise, one-sided, the reading's unit squared per Hz
    """
    power = np.abs(feedback / (1.0 + loop)) ** 2
    return np.asarray(
        np.sqrt(density / (2.0 * np.pi) * (0.5 * (power[:, 1:] + power[:, :-1]) @ np.diff(frequency)))
    )


def joined(parts: Sequence[Margins]) -> Margins:
    """Return the margins of some loops and then of others."""
    return Margins(
        **{f.name: np.concatenate([getattr(one, f.name) for one in parts]) for f in fields(Margins)}
    )


def split(loops: Margins, count: int) -> list[Margins]:
    """Return the margins of loops in `count` equal parts."""
    each = {f.name: np.split(getattr(loops, f.name), count) for f in fields(Margins)}
    return [Margins(**{name: x[i] for name, x in each.items()}) for i in range(count)]


def _least(count: int, of: IntArray, values: FloatArray) -> FloatArray:
    """Return the least of the values (k,) of each of `count` loops; infinite where there is none."""
    out = np.full(count, np.inf)
    np.minimum.at(out, of, values)
    return out


def _crossings(
    w: FloatArray, crossing: FloatArray, value: FloatArray, level: float, period: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return where curves (d, m) cross a level plus multiples of a period: loop (k,), log frequency and value there."""
    turn = np.floor((crossing - level) / period)
    of, i = np.nonzero(np.diff(turn, axis=1))
    # neighbors may be more than a period apart only where the grid is too coarse for any interpolation
    reached = level + np.maximum(turn[of, i], turn[of, i + 1]) * period
    t = (reached - crossing[of, i]) / (crossing[of, i + 1] - crossing[of, i])
    places = np.clip(i[:, None] + np.arange(-1, 3), 0, len(w) - 1)
    inside = (i > 0) & (i < len(w) - 2)
    c0, c1, c2, c3 = _cubics(crossing[of[:, None], places])
    for _ in range(NEWTON):
        height, slope = c0 + t * (c1 + t * (c2 + t * c3)), c1 + t * (2.0 * c2 + 3.0 * t * c3)
        t = np.where(inside, np.clip(t - (height - reached) / np.where(slope, slope, 1.0), 0.0, 1.0), t)
    found = value[of, i] + t * (value[of, i + 1] - value[of, i])
    c0, c1, c2, c3 = _cubics(value[of[:, None], places])
    return of, w[i] + t * (w[i + 1] - w[i]), np.where(inside, c0 + t * (c1 + t * (c2 + t * c3)), found)


def _cubics(y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the coefficients (k,) from the lowest power on of the cubics through y (k, 4) at -1, 0, 1 and 2 (Lagrange)."""
    before, start, end, after = y.T
    c1 = end - before / 3.0 - start / 2.0 - after / 6.0
    c2 = 0.5 * (before + end) - start
    return start, c1, c2, (after - before) / 6.0 + 0.5 * (start - end)


def _lowest(values: FloatArray) -> FloatArray:
    """Return the minimum (d,) of curves (d, m), of the parabola through the lowest point and its neighbors."""
    rows, i = np.arange(len(values)), np.argmin(values, axis=1)
    inside = np.clip(i, 1, values.shape[1] - 2)
    before, low, after = (values[rows, inside + k] for k in (-1, 0, 1))
    bend = before - 2.0 * low + after
    with np.errstate(divide="ignore", invalid="ignore"):
        bottom = low - (after - before) ** 2 / (8.0 * bend)
    return np.asarray(np.where((i == inside) & (bend > 0.0) & (bottom > 0.0), bottom, values[rows, i]))
