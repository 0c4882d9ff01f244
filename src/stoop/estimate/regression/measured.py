"""What a maneuver's samples say of the motion, once bias, scale and position of the instruments are undone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from stoop.base.arrays import FloatArray
from stoop.problem import Piece
from stoop.problem.observation import at_center_of_gravity, true_value
from stoop.simulate import START_NAMES, parameter_rows
from stoop.simulate.delays import lagged, late_inputs
from stoop.simulate.initial import commanded, kernel_states, rigid_states
from stoop.vehicle import Vehicle

NEEDLESS: Final = ("psi",)  #: no force depends on it
RATES: Final = ("p", "q", "r")
FORCES: Final = ("ax", "ay", "az")


@dataclass(frozen=True, eq=False)
class Measured:
    """The samples of one piece at which all that the equations need was measured; n of them.

    Attributes
    ----------
    kept : (n,) of int
        Which samples of the piece these are.
    motion : mapping
        ``V`` ... ``psi``, ``h`` -> (n,), at the center of gravity; SI.
    readings : mapping
        ``ax``, ``ay``, ``az`` -> (n,), as they were read.
    inputs : (n_u, n)
        As the surfaces receive them.
    deflections : mapping
        Control -> (n,), rad; lags applied.
    rows : (n_p, n)
        Kernel parameters: the file's values and the maneuver's loading.
    """

    kept: NDArray[np.intp]
    motion: Mapping[str, FloatArray]
    readings: Mapping[str, FloatArray]
    inputs: FloatArray
    deflections: Mapping[str, FloatArray]
    rows: FloatArray

    @property
    def omega(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rates p, q, r, rad/s."""
        return self.motion["p"], self.motion["q"], self.motion["r"]


def complete(vehicle: Vehicle, piece: Piece) -> NDArray[np.bool_]:
    """Return the samples (n,) at which all that the equations need was measured."""
    needed = [i for i, c in enumerate(vehicle.outputs) if c not in NEEDLESS]
    return np.asarray(np.isfinite(piece.measured[:, needed]).all(axis=1))


def measured(vehicle: Vehicle, piece: Piece) -> Measured:
    """Return what the samples of a piece say; delays and lags are those of the vehicle file."""
    kept = np.flatnonzero(complete(vehicle, piece))
    rows = parameter_rows(vehicle, piece.changes, len(kept))
    late = late_inputs(vehicle, piece.inputs, rows[:, :1], piece.dt)
    inputs = np.ascontiguousarray(late[kept].T)
    deflections = {c: _deflection(vehicle, c, rows[:, :1], late, piece.dt)[kept] for c in vehicle.controls}
    readings = {c: piece.measured[kept, i] for i, c in enumerate(vehicle.outputs)}
    level = motion(vehicle, piece, readings)
    found = Measured(
        kept, level, {c: v for c, v in readings.items() if c in FORCES}, inputs, deflections, rows
    )
    return Measured(**{**vars(found), "motion": {**level, "h": _altitude(vehicle, piece, found)}})


def motion(vehicle: Vehicle, piece: Piece, readings: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the motion at the center of gravity; what a reduced model does not observe stays as at the start."""
    count = len(next(iter(readings.values())))
    held = {n: np.full(count, float(piece.start.get(n, 0.0))) for n in START_NAMES}
    unseen = {"beta", "p", "q", "r", "phi", "psi"} - set(vehicle.outputs)
    held |= {n: np.zeros(count) for n in unseen}
    seen = {c: np.nan_to_num(true_value(vehicle, c, v)) for c, v in readings.items() if c in START_NAMES}
    return at_center_of_gravity(vehicle, held | seen)


def _altitude(vehicle: Vehicle, piece: Piece, found: Measured) -> FloatArray:
    """Integrate the climb rate that the measured motion implies, m (steady air)."""
    rates, _ = vehicle.kernel().evaluate(found.rows, states(vehicle, found), found.inputs)
    climb = rates[vehicle.states.index("h")]
    start = found.motion["h"][:1]
    return np.concatenate([start, start + cumulative_trapezoid(climb, piece.time[found.kept])])


def states(vehicle: Vehicle, found: Measured) -> FloatArray:
    """Return the kernel's states (n_x, n) at the measured samples."""
    out = kernel_states(vehicle, rigid_states(found.motion), {}, found.rows, found.inputs)
    for i, name in enumerate(vehicle.states):
        if name.endswith(".lag"):
            out[i] = found.deflections[name.removesuffix(".lag")]
    return out


def _deflection(
    vehicle: Vehicle, control: str, rows: FloatArray, inputs: FloatArray, dt: float
) -> FloatArray:
    """Return the deflection (n,) of a control that follows its command with the lag of the file, rad."""
    command = commanded(vehicle, control, np.repeat(rows, len(inputs), axis=1), inputs.T)
    if vehicle.file.controls[control].lag is None:
        return command
    return lagged(command, float(rows[vehicle.rows[f"controls.{control}.lag"], 0]), dt)
