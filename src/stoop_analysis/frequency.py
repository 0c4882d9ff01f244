r"""Frequency responses of flights and of a linear model with its 95 % band, and what follows from them.

.. math:: H(\omega) = e^{-j\omega\tau_y}\,[C (j\omega I - A)^{-1} B + D]\,e^{-j\omega\tau_u}

about the steady flight, lags of actuators among the states, delays in series. Parameters are drawn from their covariance
(`stoop_analysis.draws`), and the model is linearized at each draw, the steady flight following; the band is 1.96 times the
root mean square change of magnitude (in dB) and phase.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop import Notice, Vehicle, linearize
from stoop.extend.arrays import BoolArray, ComplexArray, FloatArray
from stoop.extend.errors import FlightError
from stoop.extend.fits import NORMAL_95, Result
from stoop.extend.flights import FrequencyResponse, Window
from stoop.extend.motion import LinearModel, Trim
from stoop.extend.notices import notice
from stoop.extend.text import Summarized
from stoop_analysis.draws import from_covariance
from stoop_analysis.handling import Bandwidth, EquivalentSystem

if TYPE_CHECKING:
    import xarray as xr

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
        with np.errstate(divide="ignore", invalid="ignore"):
            change = 20.0 * np.log10(np.abs(self.draws)) - 20.0 * np.log10(np.abs(self.response))
        return self._half_width(change)

    @property
    def phase_half_width(self) -> FloatArray:
        """Half width (m,) of the 95 % band of the phase, rad; NaN without draws."""
        return self._half_width(np.angle(self.draws / self.response))

    def _half_width(self, changes: FloatArray) -> FloatArray:
        if not len(changes):
            return np.full(len(self.frequency), np.nan)
        return np.asarray(NORMAL_95 * np.sqrt(np.mean(changes**2, axis=0)))


@dataclass(frozen=True, eq=False)
class UncertainModel:
    """A linear model and draws of it."""

    model: LinearModel
    draws: tuple[LinearModel, ...]
    notices: tuple[Notice, ...] = ()

    def with_inputs(self, names: Sequence[str], of: Sequence[str], mixing: FloatArray) -> UncertainModel:
        """Return all with new inputs; see :func:`with_inputs`."""
        draws = tuple(with_inputs(one, names, of, mixing) for one in self.draws)
        return replace(self, model=with_inputs(self.model, names, of, mixing), draws=draws)

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


def with_inputs(
    model: LinearModel, names: Sequence[str], of: Sequence[str], mixing: FloatArray
) -> LinearModel:
    """Return the model with new inputs after its others: those in `of` (m) are `mixing` (m, k) times `names` (k).

    The delay of the first of them is that of the new ones.
    """
    mixed = [model.inputs.index(name) for name in of]
    kept = [i for i in range(len(model.inputs)) if i not in mixed]
    B, D = (np.hstack([M[:, kept], M[:, mixed] @ mixing]) for M in (model.B, model.D))
    delays = np.append(model.input_delays[kept], np.full(len(names), model.input_delays[mixed[0]]))
    inputs = (*(model.inputs[i] for i in kept), *names)
    return replace(model, inputs=inputs, B=B, D=D, input_delays=delays)


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
    models = LinearModel.of_lanes(vehicle, point.neighbors()(drawn.numbers_of(vehicle)))
    return UncertainModel(base, tuple(models), (*notices, *drawn.notices))


AXES: Final = {"p": ("aileron", "roll"), "q": ("elevator", "pitch"), "r": ("rudder", "yaw")}
"""The surface that usually drives a rate, and the axis of the rotors that does."""
MIN_COHERENCE: Final = 0.6  #: below it a response is usually not used
MAX_ERROR: Final = 0.7  #: 95 % of the magnitude over the magnitude, beyond which a response is not known


@dataclass(frozen=True)
class Figures:
    """What follows from one response of the flight or the model."""

    source: str  #: "flight" or "model"
    input: str
    output: str
    bandwidth: Bandwidth | None  #: of the attitude; none of r
    system: EquivalentSystem | None


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyAnalysis(Summarized):
    """Frequency responses of flights, and of a model beside them."""

    flights: tuple[str, ...]
    windows: tuple[Window, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    responses: tuple[FrequencyResponse, ...]  #: of the flights
    model: Mapping[tuple[str, str], ModelResponse]  #: by input and output
    figures: tuple[Figures, ...]
    condition: Mapping[str, float]  #: airspeed (m/s), altitude (m), density (kg/m3) of the model
    notices: tuple[Notice, ...]

    def response(self, input: str, output: str) -> FrequencyResponse:  # noqa: A002 (the word of the field)
        """Return one response of the flights; raises `FlightError` if there is none."""
        for one in self.responses:
            if (one.input, one.output) == (input, output):
                return one
        raise FlightError(f"no response of {output} to {input}; there are those of {', '.join(self.outputs)}")

    def to_xarray(self) -> xr.Dataset:
        """Return all responses of the flights.

        Returns
        -------
        xarray.Dataset
            ``magnitude`` (unit of the output over that of the input), ``phase`` (rad), ``coherence``, ``bound`` (95 % random
            error, relative, and of the phase in rad) over ``output``, ``input`` and ``frequency`` (rad/s); NaN where an output
            was not estimated.
        """
        import xarray as xr

        frequency = np.unique(np.concatenate([r.frequency for r in self.responses] or [np.zeros(0)]))
        values = np.full((4, len(self.outputs), len(self.inputs), len(frequency)), np.nan)
        for r in self.responses:
            place = (self.outputs.index(r.output), self.inputs.index(r.input))
            at = np.searchsorted(frequency, r.frequency)
            rows = (np.abs(r.response), np.angle(r.response), r.coherence, r.bound)
            for own, row in zip(values, rows, strict=True):
                own[(*place, at)] = row
        names = ("magnitude", "phase", "coherence", "bound")
        over = ("output", "input", "frequency")
        coordinates = {"output": list(self.outputs), "input": list(self.inputs), "frequency": frequency}
        return xr.Dataset(
            {name: (over, own) for name, own in zip(names, values, strict=True)}, coords=coordinates
        )

    def to_dict(self) -> dict[str, Any]:
        """Return what a JSON document holds; SI, rad and rad/s."""
        responses = []
        for r in self.responses:
            modeled = self.model.get((r.input, r.output))
            numbers = {"coherence": r.coherence, "bound": r.bound, "known": known(r)}
            own = {name: values.tolist() for name, values in (_curve(r) | numbers).items()}
            of_model = None
            if modeled is not None:
                widths = modeled.magnitude_half_width, modeled.phase_half_width
                bands = dict(zip(("magnitude_half_width_db", "phase_half_width"), widths, strict=True))
                of_model = {name: values.tolist() for name, values in (_curve(modeled) | bands).items()}
            responses.append({"input": r.input, "output": r.output, **own, "model": of_model})
        figures = []
        for one in self.figures:
            band = None if one.bandwidth is None else {n: vars(e) for n, e in vars(one.bandwidth).items()}
            system = None
            if one.system is not None:
                parameters = {n: vars(e) for n, e in one.system.parameters.items()}
                system = {**vars(one.system), "parameters": parameters}
            place = {"source": one.source, "input": one.input, "output": one.output}
            figures.append({**place, "bandwidth": band, "equivalent_system": system})
        return {
            "format": "stoop-frequency/1",
            "windows": [str(w) for w in self.windows],
            "condition": dict(self.condition),
            "responses": responses,
            "figures": figures,
            "notices": [one.to_dict() for one in self.notices],
        }


def known(response: FrequencyResponse) -> BoolArray:
    """Return at which frequencies (m,) a response is known: coherence and random error."""
    return np.asarray((response.coherence >= MIN_COHERENCE) & (response.bound < MAX_ERROR))


def _curve(one: FrequencyResponse | ModelResponse) -> dict[str, Any]:
    return {"frequency": one.frequency, "real": one.response.real, "imag": one.response.imag}
