r"""Frequency responses of a linear model with their 95 % band, from the covariance of the parameters.

.. math:: H(\omega) = e^{-j\omega\tau_y}\,[C (j\omega I - A)^{-1} B + D]\,e^{-j\omega\tau_u}

about the steady flight, lags of actuators among the states, delays in series. Parameters are drawn from their covariance
(`stoop.assessment.draws`), and the model is linearized at each draw, the steady flight following; the band is 1.96 times the
root mean square change of magnitude (in dB) and phase.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.draws import from_covariance
from stoop.base.arrays import ComplexArray, FloatArray
from stoop.base.notices import Notice, notice
from stoop.results.result import Result
from stoop.simulation import LinearModel, Trim
from stoop.simulation.linearize import linearize, linearize_lanes
from stoop.simulation.steady_flight import neighbors
from stoop.vehicle import Vehicle

DRAWS: Final = 100  #: a standard deviation is known to 7 %
MIN_GROWTH: Final = 0.05  #: 1/s; a slower divergence (of the spiral, the phugoid) disturbs no test


@dataclass(frozen=True, eq=False)
class ModelResponse:
    """Response of an output of a model to an input, over rising frequencies, with draws of it."""

    input: str
    output: str
    frequency: FloatArray  #: (m,) rad/s
    response: ComplexArray  #: (m,), unit of the output over that of the input
    draws: ComplexArray  #: (d, m); none where no covariance is known

    @property
    def magnitude_half_width(self) -> FloatArray:
        """Half width (m,) of the 95 % band of the magnitude, dB; NaN without draws."""
        return self._half_width(decibels(self.draws) - decibels(self.response))

    @property
    def phase_half_width(self) -> FloatArray:
        """Half width (m,) of the 95 % band of the phase, rad; NaN without draws."""
        return self._half_width(np.angle(self.draws / self.response))

    def _half_width(self, changes: FloatArray) -> FloatArray:
        if not len(changes):
            return np.full(len(self.frequency), np.nan)
        return np.asarray(NORMAL_95 * np.sqrt(np.mean(changes**2, axis=0)))


def decibels(response: ComplexArray) -> FloatArray:
    """Return magnitudes in dB."""
    with np.errstate(divide="ignore"):
        return np.asarray(20.0 * np.log10(np.abs(response)))


@dataclass(frozen=True, eq=False)
class UncertainModel:
    """A linear model and draws of it."""

    model: LinearModel
    draws: tuple[LinearModel, ...]
    notices: tuple[Notice, ...] = ()

    def with_inputs(self, names: Sequence[str], of: Sequence[str], mixing: FloatArray) -> UncertainModel:
        """Return all with new inputs; see :meth:`LinearModel.with_inputs`."""
        draws = tuple(one.with_inputs(names, of, mixing) for one in self.draws)
        return replace(self, model=self.model.with_inputs(names, of, mixing), draws=draws)

    def responses(
        self, inputs: Sequence[str], outputs: Sequence[str], frequency: FloatArray
    ) -> dict[tuple[str, str], ModelResponse]:
        """Return the responses by input and output of those that the model has, over frequencies (m,), rad/s."""
        found = transfer(self.model, frequency)
        shape = (0, *found.shape)
        drawn = np.array([transfer(one, frequency) for one in self.draws]) if self.draws else np.zeros(shape)
        out = {}
        for i in (i for i in inputs if i in self.model.inputs):
            for o in (o for o in outputs if o in self.model.outputs):
                j, k = self.model.outputs.index(o), self.model.inputs.index(i)
                out[i, o] = ModelResponse(i, o, frequency, found[:, j, k], drawn[:, :, j, k])
        return out


def transfer(model: LinearModel, frequency: FloatArray) -> ComplexArray:
    """Return the responses (m, n_y, n_u) of a linear model at frequencies (m,), rad/s."""
    s = 1j * np.asarray(frequency)[:, None, None]
    states = np.linalg.solve(s * np.eye(len(model.A)) - model.A, model.B.astype(complex))
    late = np.exp(-s * (model.output_delays[:, None] + model.input_delays[None, :]))
    return np.asarray((model.C @ states + model.D) * late)


def uncertain_model(
    vehicle: Vehicle, point: Trim, result: Result | None = None, seed: int = 0
) -> UncertainModel:
    """Return the linear model about a trim and draws of it from the covariance of a result; none without a result."""
    base = linearize(vehicle, point)
    unstable = tuple(m.name for m in base.modes if m.eigenvalue.real > MIN_GROWTH)
    notices = [notice("frequency-unstable", modes=unstable)] if unstable else []
    if result is None:
        return UncertainModel(base, (), tuple(notices))
    drawn = from_covariance(result, DRAWS, seed)
    kept = [i for i, name in enumerate(drawn.names) if name in vehicle.rows or name.endswith(".delay")]
    numbers = {drawn.names[i]: drawn.values[:, i].copy() for i in kept}
    models = linearize_lanes(vehicle, neighbors(point)(numbers))
    return UncertainModel(base, tuple(models), (*notices, *drawn.notices))
