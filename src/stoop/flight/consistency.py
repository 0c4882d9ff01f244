"""Whether attitude and body rates belong together: the rates that the attitude implies, against those measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import conjugate, product, vectors_of
from stoop.base.units import DEGREE
from stoop.base.variables import QUATERNION
from stoop.flight.faults import Fault, described
from stoop.flight.gridding import complete

RATES: Final = ("p", "q", "r")
SPAN: Final = 0.2  #: s over which the attitude is differenced
LEAST: Final = 200  #: samples that say anything
TURNING: Final = 3.0 * DEGREE  #: rad/s rms; less turning tells nothing
OFF: Final = 0.15  #: of the gain, that good gyros do not have
BAND: Final = 1.5  #: a gain this close to a degree, or to a degree's inverse, is taken for it
APART: Final = 0.05  #: s between attitudes whose noise is independent
NORMAL: Final = 1.4826  #: standard deviation over the median of sizes, of normal numbers
FOLLOWS: Final = 0.8  #: share of the turning that a matching pair explains


def rate_faults(time: FloatArray, data: Mapping[str, FloatArray], rate: float) -> list[Fault]:
    """Look for an attitude that does not turn as the rates say: a sign, an axis, a unit, or another clock.

    Parameters
    ----------
    time : (n,) s
    data : variable -> (n,), gridded
    rate : Hz
    """
    if not set(RATES) | set(QUATERNION) <= set(data):
        return []
    implied, measured, kept = _pairs(data, max(2, round(SPAN * rate)), rate)
    if len(kept) < LEAST:
        return []
    span = (float(time[kept[0]]), float(time[kept[-1]]))
    noise = _noise(data, rate) * np.sqrt(2.0) * rate / max(2, round(SPAN * rate))
    told = [_judged(i, implied, measured, noise[i]) for i in range(3)]
    return [
        described("inconsistent", name, float(gain), *span, words)
        for name, (gain, words) in zip(RATES, told, strict=True)
        if words
    ]


def _pairs(
    data: Mapping[str, FloatArray], steps: int, rate: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean rates (n, 3) that the attitude implies over `steps`, those measured, and where each begins."""
    e = np.column_stack([data[name] for name in QUATERNION])
    omega = np.column_stack([data[name] for name in RATES])
    running = np.concatenate([np.zeros((1, 3)), np.cumsum(np.nan_to_num(omega), axis=0)])
    gone = np.concatenate([[0], np.cumsum(~(complete(omega) & complete(e)))])
    first = np.arange(len(e) - steps)
    first = first[gone[first + steps + 1] == gone[first]]
    mean = (running[first + steps + 1] - running[first] - 0.5 * (omega[first] + omega[first + steps])) / steps
    return _turn(e[first], e[first + steps]) * rate / steps, mean, first


def _turn(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the rotation vector (n, 3) rad in body axes from attitude a to b."""
    return vectors_of(product(conjugate(a), b))


def turning(data: Mapping[str, FloatArray], span: float, rate: float) -> tuple[FloatArray, FloatArray]:
    """Return the mean rates (n, 3) that the attitude implies over a span [s], and those measured; rad/s."""
    return _pairs(data, max(2, round(span * rate)), rate)[:2]


def _noise(data: Mapping[str, FloatArray], rate: float) -> FloatArray:
    """Return (3,) how far the attitude about each body axis scatters, beside what the rates say, rad.

    Second differences over a time that is longer than the grid's filter remembers: neighbors on the grid scatter
    less than what was recorded. The median passes over maneuvers in which attitude and rates do not belong together.
    """
    steps = max(1, round(APART * rate))
    implied, measured, first = _pairs(data, steps, rate)
    left = np.full((len(data["q0"]), 3), np.nan)
    left[first] = (implied - measured) * steps / rate
    jumps = left[steps:] - left[:-steps]
    known = jumps[complete(jumps)]
    return NORMAL * np.median(np.abs(known), axis=0) / np.sqrt(6.0) if len(known) else np.zeros(3)


def _judged(i: int, implied: FloatArray, measured: FloatArray, noise: float) -> tuple[float, str]:
    """Return the gain between one rate and the attitude, and what is wrong with it, if anything.

    Noise [rad/s] of the rate that the attitude implies is not taken for turning.
    """
    name = RATES[i]
    y, x = implied[:, i] - implied[:, i].mean(), measured - measured.mean(axis=0)
    size = float(np.sqrt(np.mean(y**2)))
    turning = np.sqrt(max(size**2 - noise**2, 0.0))
    if turning < max(TURNING, noise):
        return 1.0, ""
    likeness = [_correlation(y, column) * size / turning for column in x.T]
    best = int(np.argmax(np.abs(likeness)))
    if abs(likeness[i]) ** 2 < FOLLOWS:
        return likeness[i], _unlike(name, i, best, likeness)
    gain = float(y @ x[:, i]) / float(x[:, i] @ x[:, i])
    if gain < 0.0:
        return gain, f"{name} and the attitude turn against each other: the sign of one of them is wrong"
    for unit, factor in (("rad/s", 1.0 / DEGREE), ("deg/s", DEGREE)):
        if 1.0 / BAND < gain / factor < BAND:
            return (
                gain,
                f"the attitude turns {gain:.3g} times as fast as {name} says: the column of {name} is in {unit}",
            )
    if abs(gain - 1.0) > OFF:
        return gain, (
            f"the attitude turns {gain:.2f} times as fast as {name} says: {name} is clipped, filtered or badly scaled, "
            "or the attitude lags"
        )
    return gain, ""


def _unlike(name: str, i: int, best: int, likeness: list[float]) -> str:
    other = RATES[best]
    swapped = best != i and likeness[best] ** 2 > FOLLOWS
    why = (
        f"it follows {other} instead: axes are swapped"
        if swapped
        else "attitude and rates are inconsistent (clocks, clipping, axes or units)"
    )
    return f"the attitude does not turn as {name} says (correlation {likeness[i]:.2f}): {why}"


def _correlation(a: FloatArray, b: FloatArray) -> float:
    power = float(a @ a) * float(b @ b)
    return float(a @ b) / np.sqrt(power) if power > 0.0 else 0.0
