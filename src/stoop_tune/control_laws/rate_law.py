"""The law of a rate loop about one axis: terms of a few signals, at the rate of the loop.

Every term is a sum of filtered signals: the setpoint and the measured rate, rad/s, and where the firmware differentiates the
gyro before its low-pass also the angular acceleration, rad/s2. An integral is limited and may be attenuated where the error is
large. Fixed wings scale terms by powers of the ratio of trim airspeed to airspeed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from stoop.extend.arrays import ComplexArray, FloatArray
from stoop_tune.control_laws.filters import PASS, Filter

AXES: Final = ("roll", "pitch", "yaw")
SETPOINT, RATE, ACCELERATION = "setpoint", "rate", "acceleration"
ERROR: Final[Mapping[str, Filter]] = {SETPOINT: PASS, RATE: Filter((-1.0,))}
Frequencies = FloatArray | ComplexArray  #: rad/s; s / j off the imaginary axis


def through(paths: Mapping[str, Filter], then: Filter | float) -> dict[str, Filter]:
    """Return paths with a filter or a gain behind each."""
    return {name: path * then for name, path in paths.items()}


@dataclass(frozen=True)
class Integral:
    """Sum of the error times its gain and the sample time, within limits."""

    gain: float  #: 1/s
    limit: float = math.inf  #: of its magnitude
    #: error, rad/s, at which the integral no longer grows; in between its gain is times 1 - (error / fade)^2
    fade: float = math.inf
    late: bool = False  #: whether the sum is used before the error of the sample is added
    scaled_error: bool = False  #: whether airspeed scales the error before it is summed, not the sum

    def response(self, z: ComplexArray, rate: float) -> ComplexArray:
        """Return the transfer function from the error, without limits, at the rate of the loop, Hz."""
        sum_of_errors = self.gain / rate / (1.0 - 1.0 / z)
        return sum_of_errors / z if self.late else sum_of_errors

    def growth(self, error: FloatArray, rate: float) -> FloatArray:
        """Return by how much errors (n,) change the integral, each over a sample."""
        return np.asarray(self.gain / rate * error * np.maximum(0.0, 1.0 - (error / self.fade) ** 2))

    def output(self, error: FloatArray, rate: float, start: float = 0.0) -> FloatArray:
        """Return the integral (n,) of errors (n,), from a value at the start."""
        out, value = np.empty_like(error), start
        for k, step in enumerate(self.growth(error, rate).tolist()):
            after = min(max(value + step, -self.limit), self.limit)
            out[k] = value if self.late else after
            value = after
        return out


@dataclass(frozen=True)
class Term:
    """Sum of filtered signals, or the integral of it."""

    name: str  #: P, I, D or FF, as logs name it
    paths: Mapping[str, Filter]  #: by signal
    power: int = 0  #: of the ratio of trim airspeed to airspeed
    integral: Integral | None = None

    def response(self, signal: str, z: ComplexArray, rate: float) -> ComplexArray:
        """Return the transfer function from a signal at points z."""
        if signal not in self.paths:
            return np.zeros_like(z)
        path = self.paths[signal].response(z)
        return path * self.integral.response(z, rate) if self.integral else path

    def output(
        self,
        signals: Mapping[str, FloatArray],
        rate: float,
        scale: FloatArray | float = 1.0,
        start: float = 0.0,
    ) -> FloatArray:
        """Return the term (n,) for signals (n,), scaled; `start` is that of an integral."""
        total = np.asarray(sum(path.output(signals[name]) for name, path in self.paths.items()))
        factor = np.power(scale, self.power)
        if self.integral is None:
            return np.asarray(total * factor)
        if self.integral.scaled_error:
            return self.integral.output(total * factor, rate, start)
        return np.asarray(self.integral.output(total, rate, start) * factor)


@dataclass(frozen=True)
class RateLaw:
    """Command about one axis, as a share of what the autopilot can command.

    Attributes
    ----------
    sensing : from the rate of the vehicle to each measured signal, at the rate of the gyro
    sensing_loop : what follows it at the rate of the loop
    lacks : features of the firmware that this law leaves out and that the parameters switch on
    """

    axis: str
    rate: float  #: Hz
    terms: tuple[Term, ...]
    after: Filter = PASS  #: filter of the sum
    limit: float = 1.0  #: of the command
    sensing: Mapping[str, Filter] = field(default_factory=dict)
    sensing_loop: Filter = PASS
    gyro_rate: float = 0.0  #: Hz, of the filters of sensing
    lacks: tuple[str, ...] = ()

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals that the terms are computed from."""
        return tuple(dict.fromkeys(name for term in self.terms for name in term.paths))

    def response(self, signal: str, frequency: Frequencies, scale: FloatArray | float = 1.0) -> ComplexArray:
        """Return the command over a signal, without limits.

        Parameters
        ----------
        signal : one of `signals`
        frequency : (n,)
        scale : ratio of trim airspeed to airspeed; of d readings (d, 1), which makes the response (d, n)
        """
        z = np.exp(1j * frequency / self.rate)
        total = sum(t.response(signal, z, self.rate) * scale**t.power for t in self.terms)
        return np.asarray(total * self.after.response(z))

    def feedback(self, frequency: Frequencies, scale: FloatArray | float = 1.0) -> ComplexArray:
        """Return minus the command over the rate of the vehicle (n,), through the filters of its gyro, without limits."""
        z = np.exp(1j * frequency / (self.gyro_rate or self.rate))
        measured = (n for n in self.signals if n != SETPOINT)
        sensed = {n: self.sensing.get(n, PASS).response(z) for n in measured}
        total = sum(self.response(n, frequency, scale) * x for n, x in sensed.items())
        return np.asarray(-total * self.sensing_loop.response(np.exp(1j * frequency / self.rate)))

    def outputs(
        self,
        signals: Mapping[str, FloatArray],
        scale: FloatArray | float = 1.0,
        integral: float = 0.0,
    ) -> dict[str, FloatArray]:
        """Return each term (n,), scaled, and their sum after filter and limit as ``command``.

        Parameters
        ----------
        signals : (n,) by name, at the rate of the loop; those before the first sample are taken as constant
        scale : (n,) ratio of trim airspeed to airspeed
        integral : value of the integral before the first sample
        """
        out = {t.name: t.output(signals, self.rate, scale, integral) for t in self.terms}
        total = self.after.output(np.asarray(sum(out.values())))
        return {**out, "command": np.clip(total, -self.limit, self.limit)}
