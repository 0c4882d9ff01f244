"""Autopilot on rotors: smooth set-points, and an LQR designed from the vehicle's own linear model at its trim.

Small errors e are those of position, velocity over ground (both in the body axes of the desired attitude), attitude (a
rotation vector in body axes), rates, and the lags of the rotors. Commands m are the accelerations of
:data:`~stoop.vehicle.rotor_channels.AXES`; their slopes also act where rotors have inertia and no lag. Commands are linear
between samples, so over one sample

    e[k+1] = F e[k] + G0 r[k] + G1 r[k+1],    s[k] = e[k] - G1 r[k],    s[k+1] = F s[k] + (F G1 + G0) r[k]

where r are the commands as they arrive, N samples after the state that they were computed from: one because a command
that depends on the state of a sample cannot act in it, the others are the delay of the rotors. s[k+N] follows from
s[k] and the commands on their way, so that m = -K s[k+N] with the gain K of the system without delay.

References
----------
Franklin, Powell and Workman, Digital Control of Dynamic Systems, 3rd ed., sections 4.3.1 (first-order hold) and 9.2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.base.rotations import matrices_of, matrices_of_angles, product, quaternions_about, quaternions_of
from stoop.base.variables import EULER
from stoop.errors import SimulationError
from stoop.simulation.trim import Trim, traveled
from stoop.vehicle import Vehicle
from stoop.vehicle.channels import slope_input

GRAVITY: Final = 9.80665
#: of set-points: m/s2 north, east, down, rad/s of heading
RATE_LIMITS: Final = np.array([3.0, 3.0, 1.5, 0.5])
RISE_TIME: Final = 0.4  #: s, in which a set-point is reached within those limits
ERROR_SCALES: Final = np.repeat([1.0, 1.0, 0.25, 1.5], 3)  #: errors of equal cost: m, m/s, rad, rad/s
COMMAND_SHARE: Final = 0.3  #: of what the rotors can do at once: a command of the same cost as those errors


@dataclass(frozen=True, eq=False)
class Reference:
    """Attitude and motion that the autopilot tracks, at each sample."""

    velocity: FloatArray  #: (n, 3), north-east-down, m/s
    position: FloatArray  #: (n, 3), m
    quaternion: FloatArray  #: (n, 4), body to Earth
    rotation: FloatArray  #: (n, 3, 3), the same
    turn_rate: FloatArray  #: (n,), of the heading, rad/s
    up: FloatArray  #: (n,), specific force in excess of the steady flight, m/s2


def reference_motion(signals: Mapping[str, FloatArray], point: Trim, count: int, dt: float) -> Reference:
    """Return the motion that set-points describe, relative to a trim.

    The attitude tilts the thrust of the trim into the wanted acceleration and turns about it into the heading.
    `signals` are changes (n,) from the trim by name of :data:`~stoop.vehicle.rotor_channels.SETPOINTS`; `dt`, s.
    """
    zero = np.zeros(count)
    turned, turn_rate = _rate_limited(signals.get("heading", zero)[:, None], RATE_LIMITS[3:], dt)
    heading = point.start["psi"] + turned[:, 0]
    forward, right = signals.get("forward", zero), signals.get("right", zero)
    wanted = np.column_stack(
        [
            signals.get("north", zero) + forward * np.cos(heading) - right * np.sin(heading),
            signals.get("east", zero) + forward * np.sin(heading) + right * np.cos(heading),
            signals.get("down", zero),
        ]
    )
    change, acceleration = _rate_limited(wanted, RATE_LIMITS[:3], dt)
    velocity = np.asarray(point.velocity) + change
    # The trim's attitude, turned about its own down axis, then tilted about level axes; a rotation about an axis of the
    # Earth is one about that axis as the body sees it.
    trim = quaternions_of(np.array([point.start[name] for name in EULER]))
    yawed = product(trim, quaternions_about(np.column_stack([zero, zero, turned[:, 0]])))
    tilt = np.column_stack([acceleration[:, 1], -acceleration[:, 0], zero]) / GRAVITY
    q = product(yawed, quaternions_about(np.einsum("bji,bj->bi", matrices_of(yawed), tilt)))
    position = traveled(velocity, dt)
    return Reference(velocity, position, q, matrices_of(q), turn_rate[:, 0], -acceleration[:, 2])


def _rate_limited(wanted: FloatArray, limits: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Return signals (n, k) that follow wanted ones within limits (k,) of their rates, and the rates."""
    out, rates = np.zeros_like(wanted), np.zeros_like(wanted)
    if not wanted.any():
        return out, rates
    rise = max(RISE_TIME, dt)
    now = np.zeros(wanted.shape[1])
    for k, goal in enumerate(wanted):
        rates[k] = np.minimum(np.maximum((goal - now) / rise, -limits), limits)
        out[k] = now
        now = now + dt * rates[k]
    return out, rates


@dataclass(frozen=True, eq=False)
class LinearErrors:
    """e' = A e + B m + E m'; axes as in the module."""

    A: FloatArray
    B: FloatArray
    E: FloatArray
    effect: FloatArray  #: (4, m): accelerations by channels
    mixing: FloatArray  #: (m, 4): channels by accelerations


def linear_errors(vehicle: Vehicle, point: Trim) -> LinearErrors:
    """Return the linear model about a trim on rotors, by central differences of the compiled equations."""
    effect = vehicle.rotor_effects(point.start, point.inputs, point.changes)
    mixing = vehicle.rotor_allocation(effect)
    area = vehicle.rotor_range
    count = 12 + len(rotor_lags(vehicle))
    step = 1e-5
    e = np.vstack([step * np.eye(count), -step * np.eye(count)])
    rates = _error_rates(vehicle, point, e, np.repeat(point.inputs[:, None], 2 * count, axis=1))

    def by_inputs(columns: IntArray, steps: FloatArray) -> FloatArray:
        inputs = np.repeat(point.inputs[:, None], 2 * len(steps), axis=1)
        for i, column in enumerate(columns):
            inputs[column, [2 * i, 2 * i + 1]] += [steps[i], -steps[i]]
        change = _error_rates(vehicle, point, np.zeros((inputs.shape[1], count)), inputs)
        return np.asarray((change[:, 0::2] - change[:, 1::2]) / (2.0 * steps))

    A = (rates[:, :count] - rates[:, count:]) / (2.0 * step)
    B = by_inputs(area.columns, 1e-4 * (np.abs(point.inputs[area.columns]) + 1e-3))
    slopes = np.array([vehicle.inputs.index(slope_input(n)) for n in area.names if n in vehicle.sloped], int)
    E = by_inputs(slopes, np.ones(len(slopes))) if len(slopes) else np.zeros_like(B)
    return LinearErrors(A, B @ mixing, E @ mixing, effect, mixing)


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
    rows = vehicle.parameter_rows(point.changes, len(e))
    states = np.repeat(vehicle.initial_states(s, rows[:, :1], point.inputs), len(e), axis=1)
    u, p, e0 = (slice(i := vehicle.states.index(name), i + 3 + (name == "e0")) for name in ("u", "p", "e0"))
    states[u] = np.einsum("bij,bi->jb", back, ground - air + e[:, 3:6])
    states[p] += e[:, 9:12].T
    states[e0] = q.T
    lags = rotor_lags(vehicle)
    states[lags] += e[:, 12:].T
    rates, _ = vehicle.kernel().evaluate(rows, states, np.ascontiguousarray(inputs))
    inertial = rates[u] + np.cross(states[p], states[u], axis=0)
    accelerated = np.einsum("bij,jb->ib", back, inertial)
    return np.vstack([e[:, 3:6].T, accelerated, states[p], rates[p], rates[lags]])


class Gains(NamedTuple):
    """Gains from errors (4, n_e), and from the N commands on their way (N, 4, 4), the oldest first."""

    errors: FloatArray
    underway: FloatArray


def design(vehicle: Vehicle, point: Trim, model: LinearErrors, dt: float, delay: int) -> Gains:
    """Return the gains of the autopilot about a trim on rotors.

    Parameters
    ----------
    dt : float, s
        Sample period.
    delay : int
        N: samples from a state to the arrival of the command that is computed from it.

    Raises
    ------
    SimulationError
        The rotors cannot hold the vehicle.
    """
    from scipy.linalg import LinAlgError, solve_discrete_are

    with np.errstate(over="ignore", invalid="ignore"):  # what diverges within a sample is refused below
        F, G0, G1 = first_order_hold(model.A, model.B, model.E, dt)
        drive = F @ G1 + G0
    # Weights of the LQR: how much of each acceleration the rotors' range allows, the others unchanged.
    area = vehicle.rotor_range
    now = point.inputs[area.columns]
    room = np.minimum(now - area.idle, np.where(np.isfinite(area.full), area.full - now, now - area.idle))
    room = np.maximum(room, 0.05 * (now - area.idle))  # a vehicle at a limit of its range still tries
    size = np.abs(model.mixing)
    available = np.min(np.where(size > 0.0, room[:, None] / np.maximum(size, 1e-300), np.inf), axis=0)
    scales = np.concatenate([ERROR_SCALES, np.full(len(model.A) - 12, np.inf)])
    Q, R = np.diag(1.0 / scales**2), np.diag(1.0 / (COMMAND_SHARE * available) ** 2)
    try:
        P = solve_discrete_are(F, drive, Q, R)
        K = np.asarray(np.linalg.solve(R + drive.T @ P @ drive, drive.T @ P @ F))
    except (LinAlgError, ValueError):
        K = np.full((4, len(F)), np.nan)
    if not (np.isfinite(K).all() and np.abs(np.linalg.eigvals(F - drive @ K)).max() < 1.0):
        raise SimulationError(
            f"{vehicle.where}: no autopilot was found that holds it at {1.0 / dt:g} Hz; raise the rate of the maneuver, "
            "or check inertia, lag and drag"
        )
    ahead = [np.linalg.matrix_power(F, i) for i in range(delay + 1)]
    underway = np.array([K @ ahead[delay - 1 - i] @ drive for i in range(delay)])
    underway[0] -= K @ ahead[delay] @ G1
    return Gains(K @ ahead[delay], underway)


def first_order_hold(
    A: FloatArray, B: FloatArray, E: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return F, G0 and G1 of e' = A e + B m + E m' for commands m that are linear between samples."""
    from scipy.linalg import expm

    n, m = B.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m], block[n : n + m, n + m :] = A * dt, B * dt, np.eye(m)
    block[:n, n + m :] = E  # a slope is the difference of two commands over a sample
    whole = expm(block)
    F, step, G1 = whole[:n, :n], whole[:n, n : n + m], whole[:n, n + m :]
    return F, step - G1, G1
