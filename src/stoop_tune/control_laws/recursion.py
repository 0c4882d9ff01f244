"""Rate laws sample by sample, for lanes side by side: what the firmware computes while it flies.

Filters run in the transposed direct form II [1]_. The gyro is sampled faster than the loop runs; between two samples of the
loop its rate is taken as linear.

References
----------
.. [1] A. V. Oppenheim and R. W. Schafer, Discrete-Time Signal Processing, 3rd ed., 2010, section 6.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop_tune.control_laws.filters import PASS, Filter
from stoop_tune.control_laws.rate_law import SETPOINT, RateLaw

ROUNDING: Final = 1e-9  #: of a command


class FilterBank:
    """Filters side by side, in which constant inputs have settled.

    Parameters
    ----------
    filters : n of them
    before : (n, B), inputs before the first sample
    """

    def __init__(self, filters: Sequence[Filter], before: FloatArray) -> None:
        order = max([1, *(max(len(f.a), len(f.b)) - 1 for f in filters)])
        self.b, self.a = np.zeros((2, len(filters), order + 1, 1))
        settled = np.zeros((len(filters), order, 1))
        for i, f in enumerate(filters):
            self.b[i, : len(f.b), 0], self.a[i, : len(f.a), 0] = f.b, f.a
            own = f.settled()
            settled[i, : len(own), 0] = own
        self.state = settled * before[:, None]

    def output(self, x: FloatArray) -> FloatArray:
        """Return the outputs (n, B) for the next inputs (n, B)."""
        y = self.b[:, 0] * x + self.state[:, 0]
        self.state[:, :-1] = self.state[:, 1:]
        self.state[:, -1] = 0.0
        self.state += self.b[:, 1:] * x[:, None] - self.a[:, 1:] * y[:, None]
        return np.asarray(y)


class LawRecursion:
    """Rate laws about k axes, of one firmware, flying B vehicles from rest.

    Parameters
    ----------
    laws : one of each axis
    rates : (k, B), of the vehicles before the first sample, rad/s; the setpoints are the same
    """

    def __init__(self, laws: Sequence[RateLaw], rates: FloatArray) -> None:
        self.laws, first = laws, laws[0]
        self.rates = rates
        self.finer = max(1.0, (first.gyro_rate or first.rate) / first.rate)
        self.sample = 0
        sensed = [(i, n) for i, law in enumerate(laws) for n in law.signals if n != SETPOINT]
        self.axes = [i for i, _ in sensed]
        self.terms = [(i, t) for i, law in enumerate(laws) for t in law.terms]
        paths = [(k, i, n) for k, (i, t) in enumerate(self.terms) for n in t.paths]
        self.term_of_path = [k for k, *_ in paths]
        #: row of the signal of each path, among setpoints and then sensed signals
        rows = [(i, SETPOINT) for i in range(len(laws))] + sensed
        self.signal_of_path = [rows.index((i, n)) for _, i, n in paths]
        self.sensing = FilterBank([laws[i].sensing.get(n, PASS) for i, n in sensed], rates[self.axes])
        self.sensed_last = self.sensing.output(rates[self.axes])
        self.sensing_loop = FilterBank([laws[i].sensing_loop for i in self.axes], self.sensed_last)
        signals = self._signals(rates, self.sensing_loop.output(self.sensed_last))
        self.path = FilterBank([self.terms[k][1].paths[n] for k, _, n in paths], signals)
        self.unlimited = np.zeros_like(rates)
        self.after = FilterBank([law.after for law in laws], self.unlimited)
        self.limits = np.array([law.limit for law in laws])[:, None]
        self.integrals = np.zeros((len(self.terms), rates.shape[1]))

    def commands(
        self, setpoints: FloatArray, rates: FloatArray, scale: FloatArray, achieved: FloatArray
    ) -> FloatArray:
        """Return the commands (k, B) of the next sample.

        Parameters
        ----------
        setpoints, rates : (k, B), rad/s
        scale : (B,), ratio of trim airspeed to airspeed
        achieved : (k, B)
            What actuators did of the last commands. Where that was less than commanded, no integral grows to that side.
        """
        excess = self.excess(achieved)
        # samples of the gyro since the last of the loop, which need not be a whole number
        for instant in range(int(self.sample * self.finer) + 1, int((self.sample + 1) * self.finer) + 1):
            share = instant / self.finer - self.sample
            self.sensed_last = self.sensing.output((self.rates + share * (rates - self.rates))[self.axes])
        self.rates, self.sample = rates, self.sample + 1
        passed = self.path.output(self._signals(setpoints, self.sensing_loop.output(self.sensed_last)))
        sums = np.zeros_like(self.integrals)
        np.add.at(sums, self.term_of_path, passed)
        total = np.zeros_like(rates)
        for k, (i, term) in enumerate(self.terms):
            factor = np.power(scale, term.power)
            value = sums[k]
            if term.integral is None:
                total[i] += value * factor
                continue
            error, of_sum = (value * factor, 1.0) if term.integral.scaled_error else (value, factor)
            grown = term.integral.growth(error, self.laws[i].rate)
            after = np.where(grown * excess[i] > 0.0, self.integrals[k], self.integrals[k] + grown)
            after = np.clip(after, -term.integral.limit, term.integral.limit)
            total[i] += (self.integrals[k] if term.integral.late else after) * of_sum
            self.integrals[k] = after
        self.unlimited = self.after.output(total)
        return np.clip(self.unlimited, -self.limits, self.limits)

    def excess(self, achieved: FloatArray) -> FloatArray:
        """Return by how much (k, B) the last commands, without their limits, exceed what was achieved."""
        excess = self.unlimited - achieved
        return np.where(np.abs(excess) < ROUNDING, 0.0, excess)

    def _signals(self, setpoints: FloatArray, sensed: FloatArray) -> FloatArray:
        """Return the signal of each path, of setpoints (k, B) and of sensed signals in their order."""
        return np.concatenate([setpoints, sensed])[self.signal_of_path]
