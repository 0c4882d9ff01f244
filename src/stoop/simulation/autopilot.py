"""The autopilot that holds a hovering vehicle: an LQR, designed from the vehicle's own linear model at its trim.

Small errors e are those of position, velocity over ground (both in the body axes of the attitude that is asked for),
attitude (a rotation vector in body axes), rates, and the lags of the rotors. Commands m are the accelerations of
:data:`~stoop.simulation.rotors.AXES`; their slopes count, too, where rotors have inertia and no lag. Between samples
commands go in straight lines, so over one sample

    e[k+1] = F e[k] + G0 r[k] + G1 r[k+1],    s[k] = e[k] - G1 r[k],    s[k+1] = F s[k] + (F G1 + G0) r[k]

where r are the commands as they arrive, N samples after the state that they were computed from: one because a command
that depends on the state of a sample cannot already act in it, the others are the delay of the rotors. s[k+N] follows
from s[k] and the commands that are on their way, so that m = -K s[k+N] with the gain K of the system without delay.

References
----------
Franklin, Powell and Workman, Digital Control of Dynamic Systems, 3rd ed., sections 4.3.1 (first-order hold) and 9.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.base.rotations import matrices_of, matrices_of_angles, product, quaternions_about, quaternions_of
from stoop.base.variables import EULER
from stoop.errors import SimulationError
from stoop.simulation.initial import initial_states, parameter_rows
from stoop.simulation.rotors import allocation, channel_range, effects
from stoop.simulation.steady import Trim
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import slope_input

_EXCUSED: Final = np.repeat([1.0, 1.0, 0.25, 1.5], 3)  #: errors that count alike: m, m/s, rad, rad/s
_SHARE: Final = 0.3  #: of what the rotors can do at once: a command that counts as much as those errors
_STEP: Final = 1e-5  #: of the errors, for derivatives


@dataclass(frozen=True, eq=False)
class LinearErrors:
    """e' = A e + B m + E m'; axes as in the module."""

    A: FloatArray
    B: FloatArray
    E: FloatArray
    effect: FloatArray  #: (4, m): accelerations by channels
    mixing: FloatArray  #: (m, 4): channels by accelerations


@dataclass(frozen=True, eq=False)
class Gains:
    """What makes a command of errors and of commands on their way.

    Attributes
    ----------
    errors : (4, n_e)
    underway : (N, 4, 4)
        The oldest first.
    """

    errors: FloatArray
    underway: FloatArray

    def command(self, e: FloatArray, underway: FloatArray) -> FloatArray:
        """Return accelerations (4,) for errors (n_e,) and the last commands (N, 4)."""
        return np.asarray(-(self.errors @ e) - np.einsum("kij,kj->i", self.underway, underway))


def linear_errors(vehicle: Vehicle, point: Trim) -> LinearErrors:
    """Return the linear model about a trim on rotors, by central differences of the compiled equations."""
    effect = effects(vehicle, point.start, point.inputs, point.changes)
    mixing = allocation(vehicle, effect)
    area = channel_range(vehicle)
    lags = rotor_lags(vehicle)
    count = 12 + len(lags)
    e = np.vstack([_STEP * np.eye(count), -_STEP * np.eye(count)])
    rates = _error_rates(vehicle, point, e, np.repeat(point.inputs[:, None], 2 * count, axis=1))
    A = (rates[:, :count] - rates[:, count:]) / (2.0 * _STEP)
    B = _by_inputs(vehicle, point, area.columns, 1e-4 * (np.abs(point.inputs[area.columns]) + 1e-3))
    slopes = np.array([vehicle.inputs.index(slope_input(n)) for n in area.names if n in vehicle.sloped], int)
    E = _by_inputs(vehicle, point, slopes, np.ones(len(slopes))) if len(slopes) else np.zeros_like(B)
    return LinearErrors(A, B @ mixing, E @ mixing, effect, mixing)


def _by_inputs(vehicle: Vehicle, point: Trim, columns: NDArray[np.intp], step: FloatArray) -> FloatArray:
    """Return the derivatives (n_e, m) of the rates of no error by some of the channels."""
    moved = np.repeat(point.inputs[:, None], 2 * len(step), axis=1)
    for i, column in enumerate(columns):
        moved[column, [2 * i, 2 * i + 1]] += [step[i], -step[i]]
    none = np.zeros((moved.shape[1], 12 + len(rotor_lags(vehicle))))
    rates = _error_rates(vehicle, point, none, moved)
    return np.asarray((rates[:, 0::2] - rates[:, 1::2]) / (2.0 * step))


def rotor_lags(vehicle: Vehicle) -> list[int]:
    """Return the kernel states that are lags of rotors."""
    names = {f"{rotor}.lag" for rotor in vehicle.rotors}
    return [i for i, state in enumerate(vehicle.states) if state in names]


def _error_rates(vehicle: Vehicle, point: Trim, e: FloatArray, inputs: FloatArray) -> FloatArray:
    """Return the rates (n_e, B) of errors (B, n_e) about a trim, for channels (n_u, B)."""
    s = point.start
    angles = np.array([s[name] for name in EULER])
    reference = matrices_of_angles(angles)
    ground, air = reference.T @ point.velocity, reference.T @ point.wind
    q = product(quaternions_of(angles), quaternions_about(e[:, 6:9]))
    back = np.einsum("ij,bjk->bik", reference.T, matrices_of(q))  # body to the body of the reference
    rows = parameter_rows(vehicle, point.changes, len(e))
    states = np.repeat(initial_states(vehicle, s, rows[:, :1], point.inputs), len(e), axis=1)
    at = {name: vehicle.states.index(name) for name in ("u", "p", "e0")}
    velocity = np.einsum("bij,bi->jb", back, ground - air + e[:, 3:6])
    states[at["u"] : at["u"] + 3] = velocity
    states[at["p"] : at["p"] + 3] += e[:, 9:12].T
    states[at["e0"] : at["e0"] + 4] = q.T
    lags = rotor_lags(vehicle)
    states[lags] += e[:, 12:].T
    rates, _ = vehicle.kernel().evaluate(rows, states, np.ascontiguousarray(inputs))
    omega = states[at["p"] : at["p"] + 3]
    felt = rates[at["u"] : at["u"] + 3] + np.cross(omega, velocity, axis=0)
    accelerated = np.einsum("bij,jb->ib", back, felt)
    return np.vstack([e[:, 3:6].T, accelerated, omega, rates[at["p"] : at["p"] + 3], rates[lags]])


def design(vehicle: Vehicle, point: Trim, model: LinearErrors, dt: float, delay: int) -> Gains:
    """Return the gains of the autopilot.

    Parameters
    ----------
    point : Trim
        On rotors.
    model : LinearErrors
        About it.
    dt : float, s
        Sample period.
    delay : int
        N: samples from a state to the arrival of the command that is computed from it.

    Raises
    ------
    SimulationError
        The rotors cannot hold the vehicle.
    """
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # what leaves all bounds between samples is refused below
        F, G0, G1 = _held(model.A, model.B, model.E, dt)
        drive = F @ G1 + G0
    K = _regulator(F, drive, _weights(vehicle, point, model))
    if not (np.isfinite(K).all() and np.abs(np.linalg.eigvals(F - drive @ K)).max() < 1.0):
        raise SimulationError(
            f"{vehicle.where}: no autopilot was found that holds it at {1.0 / dt:g} Hz; raise the rate of the maneuver, "
            "or check inertia, lag and drag"
        )
    ahead = [np.linalg.matrix_power(F, i) for i in range(delay + 1)]
    underway = np.array([K @ ahead[delay - 1 - i] @ drive for i in range(delay)])
    underway[0] -= K @ ahead[delay] @ G1
    return Gains(K @ ahead[delay], underway)


def _weights(vehicle: Vehicle, point: Trim, model: LinearErrors) -> tuple[FloatArray, FloatArray]:
    """Return what errors and commands cost."""
    excused = np.concatenate([_EXCUSED, np.full(len(model.A) - 12, np.inf)])
    return np.diag(1.0 / excused**2), np.diag(1.0 / (_SHARE * _authority(vehicle, point, model)) ** 2)


def _regulator(F: FloatArray, drive: FloatArray, weights: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Return the gain of the LQR for e[k+1] = F e[k] + drive m[k]; NaN where there is none."""
    from scipy.linalg import LinAlgError, solve_discrete_are

    try:
        P = solve_discrete_are(F, drive, *weights)
        return np.asarray(np.linalg.solve(weights[1] + drive.T @ P @ drive, drive.T @ P @ F))
    except (LinAlgError, ValueError):
        return np.full((4, len(F)), np.nan)


def _held(
    A: FloatArray, B: FloatArray, E: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return F, G0 and G1 for commands that go in straight lines from sample to sample."""
    from scipy.linalg import expm

    n, m = B.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m], block[n : n + m, n + m :] = A * dt, B * dt, np.eye(m)
    block[:n, n + m :] = E  # a slope is the difference of two commands over a sample
    whole = expm(block)
    F, held, G1 = whole[:n, :n], whole[:n, n : n + m], whole[:n, n + m :]
    return F, held - G1, G1


def _authority(vehicle: Vehicle, point: Trim, model: LinearErrors) -> FloatArray:
    """Return how much of each acceleration (4,) a rotor's range allows, the others unchanged."""
    area = channel_range(vehicle)
    now = point.inputs[area.columns]
    room = np.minimum(now - area.idle, np.where(np.isfinite(area.full), area.full - now, now - area.idle))
    room = np.maximum(room, 0.05 * (now - area.idle))  # who hovers at a limit still has to try
    moved = np.abs(model.mixing)
    return np.asarray(
        np.min(np.where(moved > 0.0, room[:, None] / np.maximum(moved, 1e-300), np.inf), axis=0)
    )
