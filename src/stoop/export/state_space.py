"""Linear models as files: JSON of format ``stoop-state-space/1`` and a MATLAB 5 ``.mat`` with the same numbers."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.simulate import LinearModel, Trim, initial_states, linearize, parameter_rows
from stoop.simulate.initial import commanded
from stoop.vehicle import Vehicle

FORMAT: Final = "stoop-state-space/1"
MATRICES: Final = ("A", "B", "C", "D")
STEP: Final = 1e-3  #: of a parameter's standard error: how far it is moved for a derivative
UNGUIDED: Final = 1e-4  #: of a parameter's value, where there is no standard error
ROUNDING: Final = 1e-7  #: of the largest derivative by a parameter; below it is rounding
_UNITS: Final = {
    **dict.fromkeys(("V", "u", "v", "w"), "m/s"), **dict.fromkeys(("p", "q", "r"), "rad/s"), "h": "m",
    **dict.fromkeys(("ax", "ay", "az"), "m/s2"),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class ParameterCovariance:
    """Covariance (k, k) of the named parameters of an identification, SI."""

    names: tuple[str, ...]
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class StateSpace:
    """A linear model with its steady flight.

    Attributes
    ----------
    vehicle : Vehicle
    point : Trim
    model : LinearModel
    x, u, y : (n_x,), (n_u,), (n_y,)
        The steady flight that the model's deviations are from, SI and rad.
    standard_errors : mapping of str to array
        Of the entries of A, B, C, D, first order in the parameters' covariance, the steady flight held; infinite
        for an entry that depends on a parameter which the data cannot tell; empty where no covariance is known.
    """

    vehicle: Vehicle
    point: Trim
    model: LinearModel
    x: FloatArray
    u: FloatArray
    y: FloatArray
    standard_errors: Mapping[str, FloatArray] = field(default_factory=dict)


def state_space(vehicle: Vehicle, point: Trim, known: ParameterCovariance | None = None) -> StateSpace:
    """Linearize a vehicle about a steady flight."""
    model = linearize(vehicle, point)
    errors = {} if known is None else standard_errors(vehicle, point, known)
    return StateSpace(vehicle, point, model, *_steady(vehicle, point, model), errors)


def _steady(vehicle: Vehicle, point: Trim, model: LinearModel) -> tuple[FloatArray, FloatArray, FloatArray]:
    rows = parameter_rows(vehicle, point.changes)
    states = initial_states(vehicle, point.start, rows, point.inputs)
    _, readings = vehicle.kernel().evaluate(rows, states, point.inputs[:, None])
    surfaces = {c: float(commanded(vehicle, c, rows, point.inputs)[0]) for c in vehicle.controls}
    spins = {r: float(commanded(vehicle, r, rows, point.inputs)[0]) for r in vehicle.rotors}
    lags = {f"{c}.lag": position for c, position in (surfaces | spins).items()}
    channels = dict(zip(vehicle.inputs, point.inputs.tolist(), strict=True))
    x = np.array([lags[n] if n in lags else point.start.get(n, 0.0) for n in model.states])
    u = np.array([surfaces[n] if n in surfaces else channels[n] for n in model.inputs])
    return x, u, readings[:, 0]


def standard_errors(vehicle: Vehicle, point: Trim, known: ParameterCovariance) -> dict[str, FloatArray]:
    """Return the standard error of every entry: the square root of diag(J S J') with J by central differences.

    A parameter without a finite variance is unknown, and so is every entry that it moves.
    """
    variances = np.diag(known.covariance)
    moved = [i for i, s in enumerate(variances) if np.isfinite(s) and s > 0.0]
    lost = [i for i, s in enumerate(variances) if not np.isfinite(s)]
    slopes = [_slope(vehicle, point, known.names[i], STEP * math.sqrt(variances[i])) for i in moved]
    blind = [_slope(vehicle, point, known.names[i], _small(vehicle, known.names[i])) for i in lost]
    covariance = known.covariance[np.ix_(moved, moved)]
    out = {}
    for k, name in enumerate(MATRICES):
        J = np.stack([s[k] for s in slopes], axis=-1) if slopes else np.zeros((*_shape(blind, k), 0))
        variance = np.einsum("...i,ij,...j->...", J, covariance, J)
        unknown = np.any([_depends(s[k]) for s in blind], axis=0) if blind else False
        out[name] = np.where(unknown, np.inf, np.sqrt(np.maximum(variance, 0.0)))
    return out if slopes or blind else {}


def _shape(slopes: list[list[FloatArray]], matrix: int) -> tuple[int, ...]:
    return slopes[0][matrix].shape if slopes else ()


def _small(vehicle: Vehicle, name: str) -> float:
    """Return a step of a parameter whose standard error is no guide: a small part of its value, or of one."""
    return UNGUIDED * (abs(vehicle.value(name)) or 1.0)


def _depends(slope: FloatArray) -> NDArray[np.bool_]:
    """Tell which entries a parameter moves, by more than the rounding of the others."""
    return np.asarray(np.abs(slope) > ROUNDING * np.max(np.abs(slope), initial=0.0))


def _slope(vehicle: Vehicle, point: Trim, name: str, step: float) -> list[FloatArray]:
    center = vehicle.value(name)
    up, down = (linearize(vehicle.with_numbers({name: {"value": center + s}}), point) for s in (step, -step))
    return [(getattr(up, m) - getattr(down, m)) / (2.0 * step) for m in MATRICES]


def unit(name: str, vehicle: Vehicle) -> str:
    """Return the unit of a state, input or output; what is none of the flight's and no rotor's is an angle."""
    from stoop.flight import VARIABLES

    if name in _UNITS:
        return _UNITS[name]
    if name.endswith(".slope"):
        own = unit(name.removesuffix(".slope"), vehicle)
        return f"{own}2" if own.endswith("/s") else f"{own}/s"
    if vehicle.file.rotors is not None and name.removesuffix(".lag") in vehicle.rotors:
        return "rad/s" if vehicle.file.rotors.drive == "speed" else "1"
    return VARIABLES[name].unit if name in VARIABLES else "rad"


def document(found: StateSpace) -> dict[str, Any]:
    """Return the model for JSON, SI and rad; numbers carry all their digits."""
    model, vehicle = found.model, found.vehicle
    return {
        "format": FORMAT,
        "vehicle": vehicle.name,
        "reduce": vehicle.reduce,
        "equations": "x' = A (x - x0) + B (u - u0), y - y0 = C (x - x0) + D (u - u0)",
        "states": _signals(vehicle, model.states, found.x),
        "inputs": _signals(vehicle, model.inputs, found.u),
        "outputs": _signals(vehicle, model.outputs, found.y),
        **{m: getattr(model, m).tolist() for m in MATRICES},
        "standard_errors": {m: e.tolist() for m, e in found.standard_errors.items()},
        "trim": {"altitude": found.point.start.get("h", 0.0), "residual": found.point.residual},
        "parameters": numbers(vehicle, found.point),
    }


def _signals(vehicle: Vehicle, names: tuple[str, ...], values: FloatArray) -> list[dict[str, Any]]:
    return [
        {"name": n, "unit": unit(n, vehicle), "trim": v} for n, v in zip(names, values.tolist(), strict=True)
    ]


def numbers(vehicle: Vehicle, point: Trim | None) -> dict[str, float]:
    """Return every number of the vehicle as it is flown, by name."""
    own = dict(zip((p.name for p in vehicle.parameters), vehicle.values.tolist(), strict=True))
    return own | ({} if point is None else {n: float(v) for n, v in point.changes.items()})


def json_text(found: StateSpace) -> str:
    """Return the model as JSON; what does not exist is null."""
    return json.dumps(_plain(document(found)), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _plain(node: Any) -> Any:
    if isinstance(node, Mapping):
        return {k: _plain(v) for k, v in node.items()}
    if isinstance(node, list):
        return [_plain(v) for v in node]
    return None if isinstance(node, float) and not math.isfinite(node) else node


def variables(found: StateSpace) -> dict[str, Any]:
    """Return what the ``.mat`` file holds: matrices, steady flight, and names as cells of text."""
    model = found.model
    parameters = numbers(found.vehicle, found.point)
    return {
        **{m: getattr(model, m) for m in MATRICES},
        **{f"{m}_std": e for m, e in found.standard_errors.items()},
        "x0": found.x[:, None],
        "u0": found.u[:, None],
        "y0": found.y[:, None],
        "states": cells(model.states),
        "inputs": cells(model.inputs),
        "outputs": cells(model.outputs),
        "parameter_names": cells(parameters),
        "parameters": np.array(list(parameters.values()))[:, None],
    }


def cells(words: Any) -> NDArray[np.object_]:
    """Return a column of text cells."""
    out = np.empty((len(words), 1), dtype=object)
    out[:, 0] = list(words)
    return out


def mat_bytes(variables: Mapping[str, Any]) -> bytes:
    """Return a MATLAB 5 file; the same numbers give the same bytes, so no date stands in its header."""
    from scipy.io import savemat

    stream = io.BytesIO()
    target: Any = stream  # SciPy's types know of files with a name only
    savemat(target, dict(variables), format="5", oned_as="column")
    return b"MATLAB 5.0 MAT-file, made by stoop export".ljust(116) + stream.getvalue()[116:]
