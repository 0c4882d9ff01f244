"""Digital filters as transfer functions in powers of 1/z.

References
----------
.. [1] A. V. Oppenheim and R. W. Schafer, Discrete-Time Signal Processing, 3rd ed., 2010, chapters 6 and 7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, reduce
from typing import Final, Self

import numpy as np
from scipy.signal import butter, iirnotch, lfilter, lfiltic

from stoop.extend.arrays import ComplexArray, FloatArray
from stoop.extend.errors import StoopError


@dataclass(frozen=True)
class Filter:
    """H(z) = sum b_k z^-k / sum a_k z^-k with a_0 = 1."""

    b: tuple[float, ...] = (1.0,)
    a: tuple[float, ...] = (1.0,)

    @classmethod
    def of(cls, b: FloatArray, a: FloatArray) -> Self:
        """Return the filter of arrays of coefficients."""
        return cls(tuple(b.tolist()), tuple(a.tolist()))

    def response(self, z: ComplexArray) -> ComplexArray:
        """Return H at points z of any shape."""
        if len(self.a) == len(self.b) == 1:  # a gain, as most are
            return np.full_like(z, self.b[0])
        delay = 1.0 / z
        return np.asarray(np.polyval(self.b[::-1], delay) / np.polyval(self.a[::-1], delay))

    def settled(self) -> FloatArray:
        """Return the state, of the transposed direct form II, in which a constant input of one has settled."""
        before = np.ones(max(len(self.a), len(self.b)) - 1)
        gain = sum(self.b) / sum(self.a) if sum(self.a) else 0.0
        return np.asarray(lfiltic(self.b, self.a, gain * before, before))

    def output(self, x: FloatArray) -> FloatArray:
        """Return the output (n,) for an input (n,) that was constant before its first sample."""
        if len(x) == 0:
            return np.zeros(0)
        return np.asarray(lfilter(self.b, self.a, x, zi=x[0] * self.settled())[0], dtype=np.float64)

    def __mul__(self, other: Filter | float) -> Filter:
        """Return this filter and another in series, or with a gain."""
        if not isinstance(other, Filter):
            return Filter(tuple(float(other) * b for b in self.b), self.a)
        return Filter.of(np.convolve(self.b, other.b), np.convolve(self.a, other.a))


PASS: Final = Filter()


def series(*filters: Filter) -> Filter:
    """Return filters one after the other."""
    return reduce(Filter.__mul__, filters, PASS)


def difference(rate: float) -> Filter:
    """Return the backward difference over a sample, times the sample rate, Hz."""
    return Filter((rate, -rate))


def low_pass(cutoff: float, rate: float) -> Filter:
    """Return y += alpha (x - y), alpha = dt / (dt + 1 / (2 pi cutoff)); nothing for a cutoff of zero.

    Parameters
    ----------
    cutoff, rate : Hz
    """
    if not cutoff > 0.0:
        return PASS
    alpha = 1.0 / (1.0 + rate / (2.0 * math.pi * cutoff))
    return Filter((alpha,), (1.0, alpha - 1.0))


@cache
def butterworth(cutoff: float, rate: float) -> Filter:
    """Return the second-order Butterworth low-pass by the bilinear transform, prewarped; nothing for a cutoff of zero.

    Parameters
    ----------
    cutoff, rate : Hz

    Raises
    ------
    StoopError
        The cutoff is not below half the rate.
    """
    if not cutoff > 0.0:
        return PASS
    return Filter.of(*butter(2, below_nyquist(cutoff, rate), fs=rate))


@cache
def notch(frequency: float, bandwidth: float, rate: float) -> Filter:
    """Return the second-order notch, 3 dB down over its bandwidth; nothing for a frequency or bandwidth of zero.

    Parameters
    ----------
    frequency, bandwidth, rate : Hz

    Raises
    ------
    StoopError
        The frequency is not below half the rate.
    """
    if not (frequency > 0.0 and bandwidth > 0.0):
        return PASS
    return Filter.of(*iirnotch(below_nyquist(frequency, rate), frequency / bandwidth, fs=rate))


def notch_of_quality(frequency: float, quality: float, rate: float) -> Filter:
    """Return the second-order notch whose poles have alpha = sin(w) / (2 Q), w = 2 pi frequency / rate; nothing for zeros.

    Parameters
    ----------
    frequency, rate : Hz
    quality : Q

    Raises
    ------
    StoopError
        The frequency is not below half the rate.
    """
    if not quality > 0.0:
        return PASS
    alpha = math.sin(2.0 * math.pi * below_nyquist(frequency, rate) / rate) / (2.0 * quality)
    return notch(frequency, rate / math.pi * math.atan(alpha), rate)


def below_nyquist(frequency: float, rate: float) -> float:
    """Return a frequency, Hz, if it is below half the rate."""
    if frequency >= 0.5 * rate:
        raise StoopError(
            f"filter: its frequency, {frequency:g} Hz, is not below half the rate of its loop, {rate:g} Hz; "
            "correct the filter's parameter or the rate of the loop"
        )
    return frequency
