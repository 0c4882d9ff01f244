"""From what an engineer calls an initial state to the states of the kernel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import AIR_START, GROUND_START

START_NAMES = AIR_START  #: of a vehicle without rotors; Vehicle.start_names has those of any


def rigid_states(start: Mapping[str, ArrayLike]) -> dict[str, FloatArray]:
    """Return the rigid-body states (each of shape (B,)) of a start; what is absent is zero.

    The velocity is told by V, alpha and beta, or along the body axes by u, v and w.
    """
    names = GROUND_START if any(axis in start for axis in "uvw") else START_NAMES
    shapes = (np.shape(v) for k, v in start.items() if k in names)
    zero = np.zeros(np.broadcast_shapes(*shapes) or (1,))
    g = {name: zero + np.asarray(start.get(name, 0.0), dtype=float) for name in names}
    e = quaternions_of(np.stack([g["phi"], g["theta"], g["psi"]], axis=-1))
    velocity = {axis: g[axis] for axis in "uvw"} if "u" in g else _through_air(g)
    return velocity | {n: g[n] for n in "hpqr"} | {f"e{i}": e[..., i] for i in range(4)}


def _through_air(g: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    plane = g["V"] * np.cos(g["beta"])
    return {
        "u": plane * np.cos(g["alpha"]),
        "v": g["V"] * np.sin(g["beta"]),
        "w": plane * np.sin(g["alpha"]),
    }


def commanded(vehicle: Vehicle, control: str, rows: FloatArray, inputs: FloatArray) -> FloatArray:
    """Return the deflection that a control is commanded to, rad; of a rotor its x, in its own unit.

    Parameters
    ----------
    rows : (n_p, B) array
        Kernel parameters.
    inputs : (n_u,) or (n_u, B) array
        Recorded channels.
    """
    index = vehicle.rows
    if control in vehicle.file.rotor:
        return _spin(vehicle, control, rows, inputs)
    spec = vehicle.file.controls[control]
    base = f"controls.{control}"

    def number(name: str, default: float) -> FloatArray:
        return rows[index[name]] if name in index else np.full(rows.shape[1], default)

    total = number(f"{base}.offset", 0.0)
    for channel in vehicle.channels_of(control):
        gain = number(f"{base}.mix.{channel}", 1.0) if spec.mix is not None else 1.0
        center = number(f"{base}.center.{channel}", 0.0)
        total = total + gain * (inputs[vehicle.inputs.index(channel)] - center)
    return np.asarray(total)


def _spin(vehicle: Vehicle, rotor: str, rows: FloatArray, inputs: FloatArray) -> FloatArray:
    index, channel = vehicle.rows, vehicle.file.rotor[rotor].channel
    raw = rows[index["rotors.gain"]] * (inputs[vehicle.inputs.index(channel)] - rows[index["rotors.idle"]])
    if "rotors.nominal_voltage" in index:
        raw = raw * inputs[vehicle.inputs.index("voltage")] / rows[index["rotors.nominal_voltage"]]
    return np.asarray(np.maximum(raw, 0.0))


def initial_states(
    vehicle: Vehicle, start: Mapping[str, ArrayLike], rows: FloatArray, inputs: FloatArray
) -> FloatArray:
    """Return kernel states (n_x, B).

    Parameters
    ----------
    start : mapping
        The vehicle's ``start_names`` -> scalar or (B,); ``NAME.lag`` may add to a lagged deflection, rad, or to x
        of a rotor; gust states, m/s, are zero where they are not named.
    rows : (n_p, B) array
        Kernel parameters of each candidate.
    inputs : (n_u,) array
        Recorded channels at the start: a lagged surface or rotor starts where it is commanded.
    """
    return kernel_states(vehicle, rigid_states(start), start, rows, inputs)


def kernel_states(
    vehicle: Vehicle,
    rigid: Mapping[str, FloatArray],
    start: Mapping[str, ArrayLike],
    rows: FloatArray,
    inputs: FloatArray,
) -> FloatArray:
    """Return kernel states (n_x, B) where the rigid-body states (:func:`rigid_states`) of a start are known.

    Other parameters as in :func:`initial_states`.
    """
    out = np.empty((len(vehicle.states), rows.shape[1]))
    for i, name in enumerate(vehicle.states):
        if name.endswith(".lag"):
            out[i] = commanded(vehicle, name.removesuffix(".lag"), rows, inputs) + np.asarray(
                start.get(name, 0.0)
            )
        else:
            out[i] = rigid[name] if name in rigid else np.asarray(start.get(name, 0.0))
    return out


def parameter_rows(
    vehicle: Vehicle, changes: Mapping[str, ArrayLike] | None = None, count: int = 1
) -> FloatArray:
    """Return kernel parameters (n_p, B): the file's values, some replaced by scalars or (B,) arrays."""
    rows = np.repeat(vehicle.values[:, None], count, axis=1)
    for name, value in (changes or {}).items():
        rows[vehicle.rows[name]] = value
    return rows
