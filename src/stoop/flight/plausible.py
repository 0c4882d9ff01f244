"""Degrees where radians belong: told by size, or by a rate that is not the derivative of its angle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import DEGREE
from stoop.errors import FlightError
from stoop.flight.channels import Channels, finite, stretches
from stoop.flight.guilty import declared, guilty

QUANTILE: Final = 0.995  #: of the sizes; some wild samples prove nothing
LIMITS: Final = {
    "theta": 0.51 * math.pi,
    "alpha": math.pi,
    "beta": 0.51 * math.pi,
    "phi": 2.02 * math.pi,
    "psi": 2.02 * math.pi,
    "elevator": 0.5 * math.pi,
    "aileron": 0.5 * math.pi,
    "rudder": 0.5 * math.pi,
    "flap": 0.5 * math.pi,
    "p": 40.0,
    "q": 40.0,
    "r": 40.0,
}  #: rad, rad/s; gyros of drones end at 35 rad/s
RATES: Final = ("p", "q", "r")
PAIRS: Final = (
    ("phi", "p"),
    ("theta", "q"),
    ("psi", "r"),
    ("alpha", "q"),
)  #: angle, and the rate that is nearly its derivative
SPANS: Final = (
    0.1,
    0.5,
)  #: s over which the angle is differenced, to keep noise down; the shortest that tells
LIKENESS: Final = 0.8  #: correlation above which the factor between a pair means something
BAND: Final = 2.0  #: a factor this close to 57.3 is taken for it


def check_radians(
    channels: Sequence[Channels], place: str, mapping: str = "", places: Mapping[str, str] | None = None
) -> None:
    """Refuse a flight whose angles or rates are in degrees.

    Parameters
    ----------
    channels : as recorded
    place : file, for the error message
    mapping : where its units are said, for the error message
    places : variable -> key of the mapping, such as "M.toml: variables.p"

    Raises
    ------
    FlightError
        Names the file, the channel and the fix.
    """
    fix = _Fix(mapping, places or {})
    values = {name: (group.time, x) for group in channels for name, x in group.values.items()}
    for angle, rate in PAIRS:
        if angle in values and rate in values and not _many_turns(angle, values[angle][1]):
            factor = _factor(values[angle], values[rate])
            if any(_near(factor, degree) for degree in (DEGREE, 1.0 / DEGREE)):
                accused = guilty(angle, rate, factor, values, declared(mapping))
                raise FlightError(f"{place}: {_accusation(angle, rate, factor, *accused, fix)}")
    for name, limit in LIMITS.items():
        size = _size(values[name][1]) if name in values else 0.0
        if size > limit and not (name == "psi" and _turns_like_r(values)):
            unit = "deg/s" if name in RATES else "degrees"
            raise FlightError(
                f"{place}: '{name}' reaches {size:.4g}: {unit} where radians belong; {fix.of(name)}"
            )


@dataclass(frozen=True)
class _Fix:
    """Which line to change: the mapping, and the keys of its variables."""

    mapping: str
    places: Mapping[str, str]

    def of(self, name: str, unit: str = "") -> str:
        unit = unit or ("deg/s" if name in RATES else "deg")
        _, _, key = self.places.get(name, "").rpartition(": ")
        if self.mapping and key:
            return f'write unit = "{unit}" for {key} in {self.mapping}'
        if self.mapping:
            return f"write its unit as {unit} in {self.mapping}"
        if key:
            return f'convert it, or write a mapping that extends the ready one and says unit = "{unit}" for {name}'
        return "convert it and read the log again"


def _size(x: FloatArray) -> float:
    known = np.abs(x[np.isfinite(x)])
    return float(np.quantile(known, QUANTILE)) if known.size else 0.0


def _near(factor: float, degree: float) -> bool:
    return 1.0 / BAND < factor * degree < BAND


def _accusation(angle: str, rate: str, factor: float, accused: str, unit: str, fix: _Fix) -> str:
    other = rate if accused == angle else angle
    within, beside = ("degrees", "radians") if unit.startswith("deg") else ("radians", "degrees")
    is_said = f"'{accused}' is in {within}, '{other}' in radians"
    if within == "radians":
        is_said = f"'{accused}' is in radians, but mapped as {beside}"
    return (
        f"'{angle}' changes {factor:.3g} times as fast as '{rate}' says: {is_said}; {fix.of(accused, unit)}"
    )


def _many_turns(angle: str, x: FloatArray) -> bool:
    """Tell whether a heading is too large for its jumps to be told from turns; its size is judged instead."""
    return angle == "psi" and _size(x) > LIMITS["psi"]


def _turns_like_r(values: dict[str, tuple[FloatArray, FloatArray]]) -> bool:
    """Tell whether a heading beyond 2 pi was counted through several turns: it turns as the yaw rate says."""
    return "r" in values and 0.2 < _factor(values["psi"], values["r"]) < 5.0


def _factor(angle: tuple[FloatArray, FloatArray], rate: tuple[FloatArray, FloatArray]) -> float:
    """Return how many times faster the angle changes than the rate says; NaN when they are unlike."""
    found = (_factor_over(span, angle, rate) for span in SPANS)
    return next((factor for factor in found if np.isfinite(factor)), math.nan)


def _factor_over(
    span: float, angle: tuple[FloatArray, FloatArray], rate: tuple[FloatArray, FloatArray]
) -> float:
    t, x = finite(*angle)
    change, turned = [], []
    for part in stretches(t):
        steps = max(1, round(span / float(np.median(np.diff(t[part])))))
        integral = _integral(t[part], *finite(*rate))
        change.append(x[part][steps:] - x[part][:-steps])
        turned.append(integral[steps:] - integral[:-steps])
    if not change:
        return math.nan
    return _ratio(np.concatenate(change), np.concatenate(turned))


def _integral(at: FloatArray, t: FloatArray, rate: FloatArray) -> FloatArray:
    if t.size < 2:
        return np.full(at.size, np.nan)
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    return np.asarray(np.interp(at, t, turned, left=np.nan, right=np.nan))


def _ratio(change: FloatArray, turned: FloatArray) -> float:
    good = np.isfinite(turned) & np.isfinite(change)
    if good.any():  # a jump of the angle by a whole turn is no change
        good &= np.abs(change) < 20.0 * np.median(np.abs(change[good])) + 1e-12
    a, b = change[good], turned[good]
    power = float(a @ a) * float(b @ b)
    if a.size < 20 or power == 0.0 or float(a @ b) / math.sqrt(power) < LIKENESS:
        return math.nan
    return math.sqrt(float(a @ a) / float(b @ b))
