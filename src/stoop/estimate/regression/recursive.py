"""Real-time equation error in the frequency domain: recursive Fourier transforms, least squares on demand.

The finite Fourier transform at fixed frequencies is a sum over samples, so a new sample costs one addition per
frequency, whatever the length of the record, and old samples are not kept. Estimates and error bars come from the
transforms as in batch. A bias and a drift of each coefficient are estimated too, in place of detrending a record.

References
----------
E. A. Morelli, "Real-time parameter estimation in the frequency domain", *Journal of Guidance, Control, and
Dynamics* 23(5), 2000, pp. 812-818.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.base.variables import RATES, SPECIFIC_FORCE
from stoop.errors import IdentificationError
from stoop.estimate.regression.aircraft import (
    COEFFICIENTS,
    NOT_NEEDED,
    AircraftEquations,
    History,
    Motion,
    coefficients,
    states_of,
)
from stoop.estimate.regression.least_squares import Priors, Rows, solve
from stoop.problem import Layout
from stoop.problem.observation import AIR_FRAME, true_values
from stoop.simulation import parameter_rows
from stoop.simulation.delays import delayed, input_actuators, play, rate_limited
from stoop.simulation.initial import commanded
from stoop.vehicle import Vehicle

STENCIL: Final = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0  #: central difference of fourth order, times dt
DELAY: Final = 2  #: samples by which estimates are later than the flight, half the stencil
NUISANCES: Final = 2  #: bias and drift of each coefficient


class RecursiveTransform:
    """Finite Fourier transforms of signals at frequencies (f,), Hz, sampled every `dt` s.

    The time constant of exponential forgetting is `memory`, s; infinite keeps all. Memory and cost of a sample do not depend on
    the record.
    """

    def __init__(self, frequencies: FloatArray, signals: int, dt: float, memory: float = np.inf) -> None:
        self.turn = -2j * np.pi * np.asarray(frequencies) * dt
        self.kept = float(np.exp(-dt / memory))
        self.values = np.zeros((len(frequencies), signals), dtype=np.complex128)
        self.count = 0

    def update(self, sample: FloatArray) -> None:
        """Add one sample (signals,)."""
        self.values *= self.kept
        self.values += np.exp(self.turn * self.count)[:, None] * sample
        self.count += 1


@dataclass(frozen=True)
class Estimate:
    """A parameter at one instant; its standard error is infinite where it is not identifiable."""

    value: float
    std_error: float


class RealTime:
    """The free aerodynamic terms of a vehicle, estimated while it flies from transforms at frequencies (f,), Hz.

    All else of the vehicle is known. It is sampled every `dt` s; `memory`, s, is the time constant of exponential forgetting.
    Kept are as many samples as the difference formula and the control delays need, the states of servos and control lags, and
    one complex number per frequency and signal.
    """

    def __init__(self, vehicle: Vehicle, dt: float, frequencies: FloatArray, memory: float = np.inf) -> None:
        self._vehicle, self._dt, self._frequencies = vehicle, dt, np.asarray(frequencies, dtype=float)
        self._equations = AircraftEquations(Layout.of(vehicle, ()), ())
        self._names = self._equations.names
        if not self._names:
            raise IdentificationError(f"{vehicle.where}: no aerodynamic term is free; set free = true")
        self._constants = sorted(set(self._equations.constants.values()))
        self._parameters = parameter_rows(vehicle)
        self._servos = {
            vehicle.inputs[a.column]: a.numbers(self._parameters, dt)[:, 0].tolist()
            for a in input_actuators(vehicle)
        }
        slowest = max((delay for _, _, delay in self._servos.values()), default=0.0)
        self._recent: deque[dict[str, float]] = deque(maxlen=len(STENCIL) + int(np.ceil(slowest)) + 2)
        self._lags: dict[str, tuple[float, float]] = {}
        self._positions: dict[str, tuple[float, float]] = {}
        signals = len(COEFFICIENTS[vehicle.reduce]) * (1 + len(self._names)) + 2
        self._transform = RecursiveTransform(self._frequencies, signals, dt, memory)
        self._memory = memory

    def update(self, sample: Mapping[str, float]) -> None:
        """Take one sample: every output and input of the vehicle by name, and ``altitude``, SI.

        An incomplete sample adds nothing but its time.
        """
        taken = {name: float(value) for name, value in sample.items()}
        self._recent.append(
            taken | {name: self._moved(name, taken[name]) for name in self._servos if name in taken}
        )
        if len(self._recent) < len(STENCIL):
            return
        row = self._signals()
        self._transform.update(np.zeros(self._transform.values.shape[1]) if row is None else row)

    def estimate(self) -> dict[str, Estimate]:
        """Return the estimates by parameter, constants excepted; empty while there are too few independent rows."""
        rows, count, repetition = self._rows(), 2 * len(self._frequencies), 1.0
        priors = self._equations.priors()
        if len(self._frequencies) > 1:  # those closer than one over the record's length repeat each other
            length = min(max(self._transform.count, 1) * self._dt, self._memory)
            repetition = max(1.0, 1.0 / (length * float(self._frequencies[1] - self._frequencies[0])))
        most = max(int(np.count_nonzero(r.used)) for r in rows)
        freedom = count / repetition - most - NUISANCES  # of independent rows
        if freedom < 1.0:
            return {}
        found = solve(rows, Priors(priors.mean, priors.sigma))
        variance = np.nan_to_num(np.diag(found.covariance), nan=np.inf)
        std = np.sqrt(np.maximum(variance, 0.0) * (count - most) / freedom)
        pairs = zip(self._names, map(Estimate, found.values.tolist(), std.tolist()), strict=True)
        return {name: one for k, (name, one) in enumerate(pairs) if k not in self._constants}

    def _rows(self) -> list[Rows]:
        """Return the rows of each coefficient, bias and drift removed."""
        values = self._transform.values
        real = np.concatenate([values.real, values.imag])
        nuisance = np.linalg.qr(real[:, -2:] / np.maximum(np.linalg.norm(real[:, -2:], axis=0), 1e-300))[0]
        clear = real[:, :-2] - nuisance @ (nuisance.T @ real[:, :-2])
        clear = np.sqrt(2.0 / max(self._transform.count, 1)) * clear
        width, out = 1 + len(self._names), []
        for i, name in enumerate(COEFFICIENTS[self._vehicle.reduce]):
            part = clear[:, i * width : (i + 1) * width]
            part[:, [1 + k for k in self._constants]] = 0.0  # bias and drift left rounding of them
            out.append(Rows(name, part[:, 0], part[:, 1:], self._dt))
        return out

    def _signals(self) -> FloatArray | None:
        """Return coefficients and terms two samples ago, then one and the time; None where the sample is incomplete."""
        vehicle, recent, parameters = self._vehicle, list(self._recent), self._parameters
        now, last = recent[-1 - DELAY], recent[-len(STENCIL) :]
        # inputs (n_u,) as the surfaces receive them at the center of the stencil
        inputs = np.zeros(len(vehicle.inputs))
        for i, name in enumerate(vehicle.inputs):
            signal = np.array([s.get(name, np.nan if name != "none" else 0.0) for s in recent])
            inputs[i] = delayed(signal, self._servos.get(name, [0.0])[-1])[-1 - DELAY]
        deflections = {}
        for control in vehicle.controls:
            angle = float(commanded(vehicle, control, parameters, inputs)[0])
            if vehicle.file.controls[control].lag is not None:
                angle = self._lagged(control, angle)
            deflections[control] = np.array([angle])
        needed = [now.get(c, np.nan) for c in vehicle.outputs if c not in NOT_NEEDED]
        rates = [c for c in RATES if c in vehicle.outputs]
        turning = true_values(vehicle, {c: np.array([s.get(c, np.nan) for s in last]) for c in rates})
        angular = np.array([[STENCIL @ turning[c] / self._dt] for c in rates])
        if not (np.isfinite(needed).all() and np.isfinite(angular).all() and np.isfinite(inputs).all()):
            return None
        readings = {c: np.array([now.get(c, np.nan)]) for c in vehicle.outputs}
        default = {"V": vehicle.value("reference.airspeed")}
        start = {n: now.get(n, default.get(n, 0.0)) for n in AIR_FRAME.start_scales}
        states = states_of(vehicle, {**start, "h": now.get("altitude", 0.0)}, readings)
        felt = {c: v for c, v in readings.items() if c in SPECIFIC_FORCE}
        first: IntArray = np.zeros(1, dtype=np.intp)
        motion = Motion(first, states, felt, inputs[:, None], deflections, parameters)
        found = coefficients(vehicle, motion, angular)
        history = History(0, np.zeros(1), self._dt, found, motion.variables(vehicle))
        parts = [np.concatenate([row.y, row.X[0]]) for row in self._equations.regressors(history)]
        return np.concatenate([*parts, [1.0, self._transform.count * self._dt]])

    def _moved(self, channel: str, command: float) -> float:
        """Return a channel after the dead zone and the rate limit of its servo, whose state advances."""
        width, step, _ = self._servos[channel]
        held, position = self._positions.get(channel, (command, command))
        if np.isfinite(command):
            held = float(play(np.array([command]), width, held)[0])
            position = float(rate_limited(np.array([held]), step, position)[0])
            self._positions[channel] = (held, position)
            return position
        return command

    def _lagged(self, control: str, command: float) -> float:
        """Return the deflection of a lagged control whose command is linear from sample to sample; its state advances."""
        lag = float(self._parameters[self._vehicle.rows[f"controls.{control}.lag"], 0]) / self._dt
        before, position = self._lags.get(control, (command, command))
        slope = command - before
        decay = float(np.exp(-1.0 / lag)) if lag > 0.0 else 0.0
        position = command - lag * slope + decay * (position - before + lag * slope)
        if np.isfinite(position):
            self._lags[control] = (command, position)
        return position
