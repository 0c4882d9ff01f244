"""The terms of an aerodynamic model as a flight flew them, with the controls and modes of the vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.estimate import Estimate
from stoop.problem import Piece
from stoop.problem.observation import observation_model
from stoop.results.result import Result
from stoop.vehicle import Vehicle, terms

AXES: Final = {"pitch": ("Cm", "elevator"), "roll": ("Cl", "aileron"), "yaw": ("Cn", "rudder")}


@dataclass(frozen=True, eq=False)
class Term:
    """A term of one aerodynamic coefficient as it was flown."""

    name: str
    coefficient: str
    variables: frozenset[str]  #: what it is made of: alpha, beta, p, q, r, V, and controls
    value: float  #: its parameter's estimate
    flown: FloatArray  #: what the parameter multiplies, over all fitted samples (n,)

    @property
    def nonlinear(self) -> bool:
        """Whether it is no single variable: a power, or a product of several."""
        return len(self.variables) > 1 or any(c in self.name[len(self.coefficient) :] for c in "23456")

    def __str__(self) -> str:
        """Return what it is made of."""
        names = " and ".join(sorted(self.variables))
        return f"the term {self.name} ({names})" if names and self.nonlinear else names or "the constant"


@dataclass(frozen=True, eq=False)
class FlownModel:
    """Terms of a model along the fitted flights, and the controls that move it."""

    terms: Mapping[str, Term]  #: by parameter
    pitch: str = ""  #: the control that does most about the axis; empty where there is none
    roll: str = ""
    yaw: str = ""
    power: str = ""
    frequencies: Mapping[str, float] = field(default_factory=dict)  #: of modes by name, natural, rad/s

    @property
    def controls(self) -> set[str]:
        """The controls that there are."""
        return {self.pitch, self.roll, self.yaw, self.power} - {""}

    @property
    def sizes(self) -> dict[str, float]:
        """The value of each parameter at which its effect (rms) would be the largest on its force or moment, SI."""
        rms = {t.name: float(np.sqrt(np.mean(t.flown**2))) for t in self.terms.values()}
        largest: dict[str, float] = {}
        for t in self.terms.values():
            largest[t.coefficient] = max(largest.get(t.coefficient, 0.0), abs(t.value) * rms[t.name])
        moving = [t for t in self.terms.values() if rms[t.name] > 0.0]
        return {t.name: largest[t.coefficient] / rms[t.name] for t in moving}


def flown_model(result: Result, fit: Estimate) -> FlownModel:
    """Return the terms as the model flew them, and the controls and modes of the vehicle."""
    vehicle, layout = fit.problem.layout.vehicle, fit.problem.layout
    every = [mode for condition in result.modes for mode in condition.modes]
    frequencies = {mode.name: mode.frequency.estimate for mode in reversed(every)}
    if not observation_model(vehicle).open_loop:  # terms are compared along one simulation
        return FlownModel({}, frequencies=frequencies)
    free = {p.name for p in layout.parameters}
    columns = [_columns(vehicle, fit, i, piece) for i, piece in enumerate(fit.problem.pieces)]
    known = set(terms.STATE_VARIABLES) | set(vehicle.file.controls)
    found = {}
    for coefficient, texts in vehicle.terms.items():
        for name, text in texts.items():
            tree = terms.parse(text, known, vehicle.where)
            series = [np.broadcast_to(terms.convert(tree, c), len(c["V"])) for c in columns]
            value = fit.estimates[name] if name in free else vehicle.value(name)
            flown = np.concatenate(series).astype(np.float64)
            found[name] = Term(name, coefficient, terms.variables(tree), value, flown)
    axes = {}  # the control that does most about each; the usual one where the model is without that axis
    for axis, (coefficient, usual) in AXES.items():
        of_axis = [t for t in found.values() if t.coefficient == coefficient and len(t.variables) == 1]
        power = {c: abs(t.value) for t in of_axis for c in t.variables if c in vehicle.file.controls}
        fallback = usual if usual in vehicle.file.controls else ""
        axes[axis] = max(power, key=lambda c: power[c]) if power else fallback
    propulsion = vehicle.file.propulsion
    throttle = "" if propulsion is None or propulsion.kind == "constant" else propulsion.channel
    return FlownModel(found, power=throttle, frequencies=frequencies, **axes)


def _columns(vehicle: Vehicle, fit: Estimate, index: int, piece: Piece) -> dict[str, FloatArray]:
    """Return what terms are made of, (n,) each, along one piece as the model flew it."""
    read = dict(zip(vehicle.outputs, fit.readings[index].T, strict=True))
    still = np.zeros(len(piece.time))
    rows = vehicle.parameter_rows(piece.changes)
    motion = {c: np.nan_to_num(read.get(c, still)) for c in ("V", "alpha", "beta", "p", "q", "r")}
    if "V" not in read:
        motion["V"] = np.full(len(piece.time), float(piece.start.get("V", 1.0)))
    actual = vehicle.actual_rates
    rates = (motion["p"], motion["q"], motion["r"])
    made = terms.values(vehicle.value, actual, motion["V"], motion["alpha"], motion["beta"], rates)
    every = np.repeat(rows, len(piece.time), axis=1)
    return made | {c: vehicle.commanded(c, every, piece.inputs.T) for c in vehicle.controls}
