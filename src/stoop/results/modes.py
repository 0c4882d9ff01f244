"""The natural modes of a fitted model, as a result holds them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from stoop.base.notices import AS_TEXT, Notice

NAN: Final = math.nan


@dataclass(frozen=True)
class DerivedValue:
    """A derived number with its standard error and 95 % interval; NaN for what does not exist."""

    estimate: float = NAN
    std_error: float = NAN
    ci95_lower: float = NAN
    ci95_upper: float = NAN


@dataclass(frozen=True)
class MeasuredMode:
    """A mode as the record shows it after the input, no flight-dynamics model involved.

    `frequency` [rad/s], `damping` and their intervals come from damped oscillations fitted to `channels` between
    `start` and `stop` [s, the log's own clock]; NaN, and `remark` says why, where they are not identifiable.
    """

    maneuver: int  #: counts from 0
    start: float = NAN
    stop: float = NAN
    channels: tuple[str, ...] = ()
    frequency: DerivedValue = DerivedValue()
    damping: DerivedValue = DerivedValue()
    remark: Notice | None = field(default=None, metadata=AS_TEXT)


@dataclass(frozen=True)
class ModeEstimate:
    """One natural mode of the fitted model, with intervals from the covariance of the parameters."""

    name: str  #: short period, phugoid, Dutch roll, roll, spiral, or what it has become
    real: DerivedValue  #: 1/s; the eigenvalue; of a pair the one with the positive imaginary part
    imag: DerivedValue
    frequency: DerivedValue  #: rad/s; undamped natural frequency; of a real mode the size of its eigenvalue
    damping: DerivedValue  #: damping ratio; 1 or -1 for a real mode
    time_constant: DerivedValue  #: s; minus one over the real part; no interval where that may be zero
    #: ``"delta"``: standard errors by the derivatives of the eigenvalue; ``"sampled"``: percentiles, because the mode
    #: changes its character within the uncertainty of the parameters
    method: str = "delta"
    #: share of samples of the parameters in which a pair has become two real modes, or the other way around
    other_character: float = 0.0
    remark: tuple[Notice, ...] = field(default=(), metadata=AS_TEXT)  #: what to know about it
    measured: tuple[MeasuredMode, ...] = ()  #: the same mode in the records, where it is identifiable


@dataclass(frozen=True)
class StateEquations:
    """x' = A x + B u about a steady flight, SI and rad: dimensional derivatives with their standard errors.

    Heading and altitude, on which nothing depends, are left out. A standard error is NaN where an entry depends on a parameter
    that the data do not determine.
    """

    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    A: tuple[tuple[float, ...], ...] = ()
    B: tuple[tuple[float, ...], ...] = ()
    A_std: tuple[tuple[float, ...], ...] = ()
    B_std: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True)
class ConditionModes:
    """Modes and linear model at one flight condition: mean airspeed [m/s], altitude [m], angle of attack [rad] of `maneuvers`.

    `about` is ``"trim"`` (the model's steady straight flight at that airspeed) or ``"mean state"`` (of the
    maneuvers, where the model has no trim; `remark` says why).
    """

    maneuvers: tuple[int, ...]  #: count from 0
    about: str
    airspeed: float
    altitude: float
    alpha: float
    modes: tuple[ModeEstimate, ...]
    remark: Notice | None = field(default=None, metadata=AS_TEXT)
    linear: StateEquations = StateEquations()
