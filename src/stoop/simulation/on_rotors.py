"""Flight on rotors under the autopilot: the loop is closed over true states, at the rate of the maneuver.

A command that is computed from the state of one sample is recorded for a later one, so that a simulation of the
recorded channels alone is the flight that was flown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.base.rotations import to_ground
from stoop.simulation.asked import Asked, asked
from stoop.simulation.autopilot import Gains, design, linear_errors, rotor_lags
from stoop.simulation.commands import Commands, Late
from stoop.simulation.delays import with_slopes
from stoop.simulation.initial import initial_states, parameter_rows
from stoop.simulation.maneuver import SETPOINTS, Maneuver
from stoop.simulation.paths import Stepper
from stoop.simulation.steady import Trim
from stoop.vehicle import Vehicle

_LOST: Final = 1e6  #: of any state; from there on a flight is not computed
_FAR: Final = np.repeat(
    [1.5, 2.0], 3
)  #: errors of position, m, and velocity, m/s: the autopilot sees no larger ones


@dataclass(frozen=True, eq=False)
class OnRotors:
    """A flight, before an instrument saw it.

    Attributes
    ----------
    inputs, received : (n, n_u)
        Channels as recorded, and as they arrive after the delay.
    states : (n, n_x)
    clipped : (n, m)
        Where a rotor channel was held at an end of its range.
    """

    inputs: FloatArray
    received: FloatArray
    states: FloatArray
    clipped: NDArray[np.bool_]


def fly_on_rotors(
    vehicle: Vehicle,
    maneuver: Maneuver,
    point: Trim,
    gusts: dict[str, float],
    rng: np.random.Generator,
) -> OnRotors:
    """Fly a maneuver from a trim on rotors.

    Parameters
    ----------
    gusts : dict
        Gust states at the start, m/s.
    rng : Generator
        Of the noise that drives the gusts.

    Raises
    ------
    SimulationError
        No autopilot holds the vehicle.
    """
    dt, count = 1.0 / maneuver.rate, len(maneuver.time)
    rows = parameter_rows(vehicle, point.changes)
    late, model = Late.of(vehicle, rows, dt), linear_errors(vehicle, point)
    gains = design(vehicle, point, model, dt, late.ahead + late.delay)
    commands = Commands.of(vehicle, maneuver, point, model)
    signals = maneuver.deflections()
    goal = asked({n: signals[n] for n in SETPOINTS if n in signals}, point, count, dt)
    for k in range(min(late.ahead, count)):
        commands.give(k, np.array([0.0, 0.0, 0.0, goal.up[k]]))
    state = initial_states(vehicle, {**point.start, **gusts}, rows, commands.inputs[0])[:, 0]
    stepper = Stepper.of(vehicle, rows, count, dt, rng)
    return _closed(_Loop.of(vehicle, point, goal, gains, state), commands, late, stepper, state, dt)


def _closed(
    loop: _Loop, commands: Commands, late: Late, stepper: Stepper, state: FloatArray, dt: float
) -> OnRotors:
    """Fly sample by sample; a flight that diverges is left where it does."""
    count, height = len(commands.inputs), _Height.of(stepper.vehicle, commands.inputs, state)
    states, received = np.full((count, len(state)), np.nan), np.full(commands.inputs.shape, np.nan)
    states[0], received[0] = state, late.received(commands.inputs, 0)
    position, before = np.zeros(3), loop.velocity(state)
    for k in range(count - 1):
        errors, velocity = loop.errors(k, states[k], position)
        if k + late.ahead < count:
            wanted = loop.gains.command(errors, _underway(commands.given, k, late))
            wanted[3] += loop.goal.up[k + late.ahead]
            commands.give(k + late.ahead, wanted)
        height.record(k + 1, states[k], velocity, dt)
        received[k + 1] = late.received(commands.inputs, k + 1)
        with_slopes(stepper.vehicle, received[k : k + 2], dt)
        states[k + 1] = stepper.step(k, states[k], received[k], received[k + 1])
        if not float(np.abs(states[k + 1]).max()) < _LOST:
            states[k + 1] = np.nan
            break
        before, velocity = velocity, loop.velocity(states[k + 1])
        position = position + 0.5 * dt * (before + velocity)
    return OnRotors(commands.inputs, received, states, commands.clipped)


@dataclass(frozen=True, eq=False)
class _Height:
    """Records the height above the ground, where the vehicle feels it."""

    inputs: FloatArray
    terrain: FloatArray  #: (n,), m, by which the maneuver lowers the ground
    column: int
    state: int

    @classmethod
    def of(cls, vehicle: Vehicle, inputs: FloatArray, state: FloatArray) -> _Height:
        h, table = vehicle.states.index("h"), vehicle.file.ground_effect
        column = -1 if table is None else vehicle.inputs.index(table.channel)
        return cls(inputs, inputs[:, column] - state[h], column, h)

    def record(self, k: int, before: FloatArray, velocity: FloatArray, dt: float) -> None:
        """Record what the state one sample before leads to; inputs of a step are known before it."""
        if self.column >= 0:
            self.inputs[k, self.column] = before[self.state] - dt * velocity[2] + self.terrain[k]


def _underway(given: FloatArray, k: int, late: Late) -> FloatArray:
    """Return the commands (N, 4) that arrive before the next one does; before the flight there were none."""
    first = k - late.delay
    known = given[max(first, 0) : k + late.ahead]
    return known if first >= 0 else np.vstack([np.zeros((min(-first, late.delay), 4)), known])


@dataclass(frozen=True, eq=False)
class _Loop:
    """What the autopilot compares."""

    goal: Asked
    gains: Gains
    wind: FloatArray
    first: tuple[int, int, int]  #: states u, p and e0
    lags: NDArray[np.intp]
    calm: FloatArray  #: lags of the trim

    @classmethod
    def of(cls, vehicle: Vehicle, point: Trim, goal: Asked, gains: Gains, state: FloatArray) -> _Loop:
        u, p, e0 = (vehicle.states.index(name) for name in ("u", "p", "e0"))
        lags = np.array(rotor_lags(vehicle), dtype=np.intp)
        return cls(goal, gains, np.array(point.wind), (u, p, e0), lags, state[lags])

    def velocity(self, x: FloatArray) -> FloatArray:
        """Return the velocity over ground of a state (n_x,), m/s north-east-down."""
        u, _, e0 = self.first
        return to_ground(x[e0 : e0 + 4], x[u : u + 3]) + self.wind

    def errors(self, k: int, x: FloatArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return errors (n_e,) at a sample, and the velocity over ground."""
        goal, (_, p, e0) = self.goal, self.first
        back, velocity = goal.rotation[k].T, self.velocity(x)
        near = np.concatenate([back @ (position - goal.position[k]), back @ (velocity - goal.velocity[k])])
        near = np.minimum(np.maximum(near, -_FAR), _FAR)
        angle = _between(goal.quaternion[k].tolist(), x[e0 : e0 + 4].tolist())
        turning = x[p : p + 3] - back[:, 2] * goal.turning[k]
        return np.concatenate([near, angle, turning, x[self.lags] - self.calm]), velocity


def _between(a: Sequence[float], b: Sequence[float]) -> list[float]:
    """Return `rotations.vectors_of` of conj(a) b, for small angles: one sample at a time, fifty times as fast."""
    a0, a1, a2, a3 = a
    b0, b1, b2, b3 = b
    twice = 2.0 if a0 * b0 + a1 * b1 + a2 * b2 + a3 * b3 >= 0.0 else -2.0
    return [
        twice * (a0 * b1 - a1 * b0 - a2 * b3 + a3 * b2),
        twice * (a0 * b2 - a2 * b0 - a3 * b1 + a1 * b3),
        twice * (a0 * b3 - a3 * b0 - a1 * b2 + a2 * b1),
    ]
