"""Regression in real time: Fourier transforms that grow by one sample, least squares whenever they are asked.

The finite Fourier transform at fixed frequencies is a sum over samples, so a new sample costs one addition per
frequency, whatever the length of the record, and old ones need not be kept. Estimates and error bars come from
the transforms as in batch. A bias and a drift of each coefficient are fitted along, in place of taking trends
off a record that is not there.

References
----------
E. A. Morelli, "Real-time parameter estimation in the frequency domain", *Journal of Guidance, Control, and
Dynamics* 23(5), 2000, pp. 812-818.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.estimate.regression.domain import Band
from stoop.estimate.regression.estimate import constants, contributions, layout_places, priors_of, unbounded
from stoop.estimate.regression.history import ESTIMATED, balance, coefficients, variables
from stoop.estimate.regression.least_squares import Block, solve
from stoop.estimate.regression.measured import RATES, Measured, motion
from stoop.problem import Layout, Piece
from stoop.problem.observation import AirFrame
from stoop.simulate import parameter_rows
from stoop.simulate.delays import delayed, input_delays
from stoop.simulate.initial import commanded
from stoop.vehicle import Vehicle

STENCIL: Final = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0  #: central difference of fourth order, times dt
CENTER: Final = 2  #: samples by which estimates lag the flight
NUISANCES: Final = 2  #: bias and drift of each coefficient


class GrowingTransform:
    """Finite Fourier transforms of some signals; memory and cost of a sample do not depend on the record.

    Parameters
    ----------
    frequencies : (f,), Hz
    signals : int
    dt : float, s
    memory : float, s
        Time in which the past is forgotten to 1/e; infinite keeps all.
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
    """A term's parameter at some instant; its error is infinite where nothing tells it."""

    value: float
    std_error: float


class RealTime:
    """The free aerodynamic terms of a vehicle, estimated while it flies.

    Parameters
    ----------
    vehicle : Vehicle
        Its free terms are estimated; all else is known.
    dt : float, s
        Sample period.
    frequencies : (f,), Hz
    memory : float, s
        Time in which the past is forgotten to 1/e; infinite keeps all.

    Notes
    -----
    What is kept: the last few samples, as many as the difference formula and the control delays need, the states
    of the control lags, and one complex number per frequency and signal.
    """

    def __init__(self, vehicle: Vehicle, dt: float, frequencies: FloatArray, memory: float = np.inf) -> None:
        self._vehicle, self._dt, self._frequencies = vehicle, dt, np.asarray(frequencies, dtype=float)
        self._layout = Layout.of(vehicle, ())
        self._places = layout_places(self._layout)
        if not self._places:
            raise IdentificationError(f"{vehicle.where}: no aerodynamic term is free; set free = true")
        self._constants = sorted(set(constants(self._layout, self._places).values()))
        self._rows = parameter_rows(vehicle)
        slowest = max((self._rows[row, 0] for _, row in input_delays(vehicle)), default=0.0)
        self._recent: deque[dict[str, float]] = deque(maxlen=5 + int(np.ceil(slowest / dt)) + 2)
        self._lags: dict[str, tuple[float, float]] = {}
        signals = len(ESTIMATED[vehicle.reduce]) * (1 + len(self._places)) + 2
        self._transform = GrowingTransform(self._frequencies, signals, dt, memory)
        self._memory = memory

    def update(self, sample: Mapping[str, float]) -> None:
        """Take one sample: every output and input of the vehicle by name, and ``altitude``, SI.

        A sample that lacks something says nothing, but its time passes.
        """
        self._recent.append({name: float(value) for name, value in sample.items()})
        if len(self._recent) < 5:
            return
        row = self._signals()
        self._transform.update(np.zeros(self._transform.values.shape[1]) if row is None else row)

    def estimate(self) -> dict[str, Estimate]:
        """Return the estimates by parameter, constants left out; empty while there is too little to say anything."""
        repeated, rows = self._repeated(), 2 * len(self._frequencies)
        blocks = self._blocks()
        most = max(int(np.count_nonzero(b.own)) for b in blocks)
        freedom = rows / repeated - most - NUISANCES  # what is left of rows that say something new
        if freedom < 1.0:
            return {}
        parameters = [self._layout.parameters[i] for i in self._places]
        solved = solve(blocks, unbounded(parameters), priors_of(parameters), Band())
        variance = np.nan_to_num(np.diag(solved.covariance), nan=np.inf)
        std = np.sqrt(np.maximum(variance, 0.0) * (rows - most) / freedom)
        return {
            p.name: Estimate(float(solved.values[k]), float(std[k]))
            for k, p in enumerate(parameters)
            if k not in self._constants
        }

    def _repeated(self) -> float:
        """Return how often the rows say the same: frequencies closer than one over the record's length do."""
        if len(self._frequencies) < 2:
            return 1.0
        spacing = float(self._frequencies[1] - self._frequencies[0])
        lasting = min(max(self._transform.count, 1) * self._dt, self._memory)
        return max(1.0, 1.0 / (lasting * spacing))

    def _blocks(self) -> list[Block]:
        """Return the regression of each coefficient, bias and drift taken off."""
        values = self._transform.values
        real = np.concatenate([values.real, values.imag])
        nuisance = np.linalg.qr(real[:, -2:] / np.maximum(np.linalg.norm(real[:, -2:], axis=0), 1e-300))[0]
        clear = real[:, :-2] - nuisance @ (nuisance.T @ real[:, :-2])
        width = 1 + len(self._places)
        scale = np.sqrt(2.0 / max(self._transform.count, 1))
        parts = (
            scale * clear[:, i * width : (i + 1) * width] for i in range(len(ESTIMATED[self._vehicle.reduce]))
        )
        names = ESTIMATED[self._vehicle.reduce]
        blocks = [Block(c, part[:, 0], part[:, 1:], self._dt) for c, part in zip(names, parts, strict=True)]
        for block in blocks:
            block.X[:, self._constants] = 0.0  # what bias and drift left of them is rounding
        return blocks

    def _signals(self) -> FloatArray | None:
        """Return coefficients and terms two samples ago, then one and the time; None where something is missing."""
        vehicle = self._vehicle
        recent = list(self._recent)
        now = recent[-1 - CENTER]
        inputs = self._late(recent)
        deflections = self._deflections(inputs)
        needed = [now.get(c, np.nan) for c in vehicle.outputs if c != "psi"]
        rates = [c for c in RATES if c in vehicle.outputs]
        turning = np.array([[STENCIL @ [s.get(c, np.nan) for s in recent[-5:]] / self._dt] for c in rates])
        if not (np.isfinite(needed).all() and np.isfinite(turning).all() and np.isfinite(inputs).all()):
            return None
        found = self._measured(now, inputs, deflections)
        solved = coefficients(vehicle, *balance(vehicle, found), turning, found.readings)
        made_of = variables(vehicle, found)
        parts = [
            np.concatenate([[y], X])
            for y, X in (
                (float(y[0]), X[0]) for y, X in contributions(self._layout, self._places, solved, made_of)
            )
        ]
        return np.concatenate([*parts, [1.0, self._transform.count * self._dt]])

    def _late(self, recent: Sequence[Mapping[str, float]]) -> FloatArray:
        """Return the inputs (n_u,) that the surfaces receive at the center."""
        out = np.zeros(len(self._vehicle.inputs))
        late = dict(input_delays(self._vehicle))
        for i, name in enumerate(self._vehicle.inputs):
            signal = np.array([s.get(name, np.nan if name != "none" else 0.0) for s in recent])
            delay = float(self._rows[late[i], 0]) / self._dt if i in late else 0.0
            out[i] = delayed(signal, delay)[-1 - CENTER]
        return out

    def _deflections(self, inputs: FloatArray) -> dict[str, FloatArray]:
        """Return the deflections (1,), rad, and move the lags on to this instant."""
        out = {}
        for control in self._vehicle.controls:
            command = float(commanded(self._vehicle, control, self._rows, inputs)[0])
            if self._vehicle.file.controls[control].lag is not None:
                command = self._lagged(control, command)
            out[control] = np.array([command])
        return out

    def _lagged(self, control: str, command: float) -> float:
        """Return the deflection of a lagged control whose command is linear from sample to sample."""
        lag = float(self._rows[self._vehicle.rows[f"controls.{control}.lag"], 0]) / self._dt
        before, position = self._lags.get(control, (command, command))
        left = float(np.exp(-1.0 / lag))
        slope = command - before
        position = command - lag * slope + left * (position - before + lag * slope)
        if np.isfinite(position):
            self._lags[control] = (command, position)
        return position

    def _measured(
        self, now: Mapping[str, float], inputs: FloatArray, deflections: Mapping[str, FloatArray]
    ) -> Measured:
        vehicle = self._vehicle
        readings = {c: np.array([now.get(c, np.nan)]) for c in vehicle.outputs}
        start = {
            n: now.get(n, vehicle.value("reference.airspeed") if n == "V" else 0.0)
            for n in AirFrame.start_scales
        }
        start["h"] = now.get("altitude", 0.0)
        piece = Piece(0, np.zeros(1), inputs[None, :], np.array([[v[0] for v in readings.values()]]), start)
        felt = {c: v for c, v in readings.items() if c in ("ax", "ay", "az")}
        level = motion(vehicle, piece, readings)
        return Measured(np.zeros(1, dtype=np.intp), level, felt, inputs[:, None], deflections, self._rows)
