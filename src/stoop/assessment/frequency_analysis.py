"""Frequency responses of flights and of a model, and what follows from them, as one labelled result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop.assessment.frequency import ModelResponse
from stoop.assessment.handling import Bandwidth, EquivalentSystem
from stoop.base.arrays import BoolArray
from stoop.base.notices import Notice
from stoop.base.text import Summarized
from stoop.errors import FlightError
from stoop.flight.frequency import FrequencyResponse
from stoop.problem.windows import Window

if TYPE_CHECKING:
    import xarray as xr

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
            responses.append(
                {
                    "input": r.input, "output": r.output, "frequency": r.frequency.tolist(),
                    "real": r.response.real.tolist(), "imag": r.response.imag.tolist(),
                    "coherence": r.coherence.tolist(), "bound": r.bound.tolist(), "known": known(r).tolist(),
                    "model": None if modeled is None else _document(modeled),
                }
            )  # fmt: skip
        return {
            "format": "stoop-frequency/1",
            "windows": [str(w) for w in self.windows],
            "condition": dict(self.condition),
            "responses": responses,
            "figures": [_figures_document(one) for one in self.figures],
            "notices": [one.to_dict() for one in self.notices],
        }


def known(response: FrequencyResponse) -> BoolArray:
    """Return at which frequencies (m,) a response is known: coherence and random error."""
    return np.asarray((response.coherence >= MIN_COHERENCE) & (response.bound < MAX_ERROR))


def _document(one: ModelResponse) -> dict[str, Any]:
    return {
        "frequency": one.frequency.tolist(),
        "real": one.response.real.tolist(),
        "imag": one.response.imag.tolist(),
        "magnitude_half_width_db": one.magnitude_half_width.tolist(),
        "phase_half_width": one.phase_half_width.tolist(),
    }


def _figures_document(one: Figures) -> dict[str, Any]:
    band = None if one.bandwidth is None else {n: vars(e) for n, e in vars(one.bandwidth).items()}
    system = None
    if one.system is not None:
        parameters = {n: vars(e) for n, e in one.system.parameters.items()}
        system = {**vars(one.system), "parameters": parameters}
    return {
        "source": one.source,
        "input": one.input,
        "output": one.output,
        "bandwidth": band,
        "equivalent_system": system,
    }
