"""From what an engineer calls an initial state to the states of the kernel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stoop.vehicle import Vehicle

FloatArray = NDArray[np.float64]
START_NAMES = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h")  #: m/s, rad, rad/s, m


def quaternion(phi: ArrayLike, theta: ArrayLike, psi: ArrayLike) -> FloatArray:
    """Return the unit quaternion (4, ...) of Euler angles in rad, body to Earth, scalar first."""
    half = [np.asarray(angle, dtype=float) / 2.0 for angle in (phi, theta, psi)]
    (c1, c2, c3), (s1, s2, s3) = [np.cos(h) for h in half], [np.sin(h) for h in half]
    return np.stack(
        [
            c1 * c2 * c3 + s1 * s2 * s3,
            s1 * c2 * c3 - c1 * s2 * s3,
            c1 * s2 * c3 + s1 * c2 * s3,
            c1 * c2 * s3 - s1 * s2 * c3,
        ]
    )


def rigid_states(start: Mapping[str, ArrayLike]) -> dict[str, FloatArray]:
    """Return the rigid-body states (each of shape (B,)) of a start; what is absent is zero."""
    shapes = (np.shape(v) for k, v in start.items() if k in START_NAMES)
    zero = np.zeros(np.broadcast_shapes(*shapes) or (1,))
    g = {name: zero + np.asarray(start.get(name, 0.0), dtype=float) for name in START_NAMES}
    e = quaternion(g["phi"], g["theta"], g["psi"])
    plane = g["V"] * np.cos(g["beta"])
    out = {
        "u": plane * np.cos(g["alpha"]),
        "v": g["V"] * np.sin(g["beta"]),
        "w": plane * np.sin(g["alpha"]),
        "h": g["h"],
    }
    return out | {n: g[n] for n in "pqr"} | {f"e{i}": e[i] for i in range(4)}


def commanded(vehicle: Vehicle, control: str, rows: FloatArray, inputs: FloatArray) -> FloatArray:
    """Return the deflection that a control is commanded to, rad.

    Parameters
    ----------
    rows : (n_p, B) array
        Kernel parameters.
    inputs : (n_u,) or (n_u, B) array
        Recorded channels.
    """
    index = vehicle.rows
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


def initial_states(
    vehicle: Vehicle, start: Mapping[str, ArrayLike], rows: FloatArray, inputs: FloatArray
) -> FloatArray:
    """Return kernel states (n_x, B).

    Parameters
    ----------
    start : mapping
        :data:`START_NAMES` -> scalar or (B,); ``NAME.lag`` may add to a lagged deflection, rad; gust states, m/s,
        are zero where they are not named.
    rows : (n_p, B) array
        Kernel parameters of each candidate.
    inputs : (n_u,) array
        Recorded channels at the start: a lagged surface starts where it is commanded.
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
