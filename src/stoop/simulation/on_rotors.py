"""Flight on rotors under the autopilot: the loop is closed over true states, at the rate of the maneuver.

A command that is computed from the state of one sample is recorded for a later one, so that a simulation of the
recorded channels alone reproduces the flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.base.rotations import to_ground
from stoop.simulation import autopilot, trajectories
from stoop.simulation.delays import (
    OFFSETS,
    input_actuators,
    input_delays,
    lagrange,
    late_inputs,
    late_outputs,
    with_slopes,
)
from stoop.simulation.initial import initial_states, parameter_rows
from stoop.simulation.maneuver import Battery, Maneuver
from stoop.simulation.rotors import AXES, EXCITATIONS, SETPOINTS, channel_range
from stoop.simulation.trajectories import FINER, Flown
from stoop.simulation.trim import Trim, inputs_about
from stoop.vehicle import Vehicle

DIVERGED: Final = 1e6  #: of any state; a flight ends there
ERROR_LIMITS: Final = np.repeat([1.5, 2.0], 3)  #: of position, m, and velocity, m/s, in the autopilot
EMPTY_BATTERY: Final = 0.05  #: of the nominal voltage, the least there is


def fly_on_rotors(vehicle: Vehicle, maneuver: Maneuver, point: Trim, rng: np.random.Generator) -> Flown:
    """Fly a maneuver from a trim on rotors; `rng` draws the gusts.

    Raises
    ------
    SimulationError
        No autopilot holds the vehicle.
    """
    dt, count, gusts = 1.0 / maneuver.rate, len(maneuver.time), trajectories.gust_start(vehicle, rng)
    rows = parameter_rows(vehicle, point.changes)
    delay, model = _Delay.of(vehicle, rows, dt), autopilot.linear_errors(vehicle, point)
    gains = autopilot.design(vehicle, point, model, dt, delay.ahead + delay.arrival)
    commands = _Commands(vehicle, maneuver, point, model)
    signals = maneuver.deflections()
    setpoints = {n: signals[n] for n in SETPOINTS if n in signals}
    reference = autopilot.reference_motion(setpoints, point, count, dt)
    for k in range(min(delay.ahead, count)):
        commands.give(k, np.array([0.0, 0.0, 0.0, reference.up[k]]))
    inputs = commands.inputs
    state = initial_states(vehicle, {**point.start, **gusts}, rows, inputs[0])[:, 0]
    noise = trajectories.gust_noise(vehicle, count, dt, rng)
    loop = _Loop(vehicle, point, reference, state)
    # Height above the ground, an input where the vehicle has a ground effect; the maneuver may move the ground.
    h, table = vehicle.states.index("h"), vehicle.file.ground_effect
    column = None if table is None else vehicle.inputs.index(table.channel)
    terrain = inputs[:, column or 0] - state[h]

    # Surfaces are moved by the maneuver alone, so what their servos make of it is known before the flight.
    servos = [a.column for a in input_actuators(vehicle) if a.dead_zones or a.rate_limits]
    surfaces = late_inputs(vehicle, inputs, rows, dt)[:, servos]
    states, received = np.full((count, len(state)), np.nan), np.full(inputs.shape, np.nan)
    states[0], received[0] = state, delay.received(inputs, 0)
    position, velocity = np.zeros(3), loop.velocity(state)
    for k in range(count - 1):
        if k + delay.ahead < count:
            underway = np.einsum("kij,kj->i", gains.underway, delay.underway(commands, k))
            command = -(gains.errors @ loop.errors(k, states[k], position, velocity)) - underway
            command[3] += reference.up[k + delay.ahead]
            commands.give(k + delay.ahead, command)
        if column is not None:  # inputs of a step are known before it
            inputs[k + 1, column] = states[k, h] - dt * velocity[2] + terrain[k + 1]
        received[k + 1] = delay.received(inputs, k + 1)
        received[k + 1, servos] = surfaces[k + 1]
        with_slopes(vehicle, received[k : k + 2], dt)
        driving = noise[FINER * k : FINER * (k + 1) + 1]
        states[k + 1] = trajectories.next_state(vehicle, rows, states[k], received[k : k + 2], driving, dt)
        if not float(np.abs(states[k + 1]).max()) < DIVERGED:
            states[k + 1] = np.nan
            break
        before, velocity = velocity, loop.velocity(states[k + 1])
        position = position + 0.5 * dt * (before + velocity)
    readings = trajectories.readings_along(vehicle, rows, states, received)[None]
    outputs, ground = (
        late_outputs(vehicle, readings, rows, dt)[0],
        trajectories.over_ground(vehicle, point, states),
    )
    return Flown(point, maneuver.time, inputs, outputs, ground, commands.clipped, states)


@dataclass(frozen=True, eq=False)
class _Delay:
    """Delay of each channel, as weights (4, n_u) of the neighboring samples at offsets (4, n_u)."""

    offsets: IntArray
    weights: FloatArray
    ahead: int  #: samples from a state to the first command that can depend on it
    arrival: int  #: samples from there to its arrival, rounded

    @classmethod
    def of(cls, vehicle: Vehicle, rows: FloatArray, dt: float) -> _Delay:
        """Return the delays in kernel parameters (n_p, 1)."""
        samples = np.zeros(len(vehicle.inputs))
        for column, row in input_delays(vehicle):
            samples[column] = rows[row, 0] / dt
        whole = np.floor(samples)
        offsets = np.array(OFFSETS)[:, None] - whole.astype(np.intp)
        weights = np.array([lagrange(float(f)) for f in samples - whole]).T
        rotors = channel_range(vehicle).columns
        needed = 1 - whole[rotors] + (samples[rotors] > whole[rotors])
        return cls(offsets, weights, max(1, int(needed.max())), max(0, round(float(samples[rotors].mean()))))

    def received(self, commands: FloatArray, k: int) -> FloatArray:
        """Return the channels (n_u,) that arrive at a sample of (n, n_u), as `late_inputs` does for all samples."""
        at = np.minimum(np.maximum(k + self.offsets, 0), len(commands) - 1)
        return np.asarray((self.weights * commands[at, np.arange(commands.shape[1])]).sum(axis=0))

    def underway(self, commands: _Commands, k: int) -> FloatArray:
        """Return the commands (N, 4) that arrive before the next one; there were none before the flight."""
        first = k - self.arrival
        known = commands.given[max(first, 0) : k + self.ahead]
        return known if first >= 0 else np.vstack([np.zeros((min(-first, self.arrival), 4)), known])


class _Commands:
    """The recorded channels of a maneuver, those of the rotors filled sample by sample.

    Attributes
    ----------
    inputs : (n, n_u)
    given : (n, 4)
        Accelerations that the channels give, in excess of the trim's.
    clipped : (n, m)
        Where the range ended.
    """

    def __init__(
        self, vehicle: Vehicle, maneuver: Maneuver, point: Trim, model: autopilot.LinearErrors
    ) -> None:
        signals, count, area = maneuver.deflections(), len(maneuver.time), channel_range(vehicle)
        zero = np.zeros(count)
        own = {*EXCITATIONS, *SETPOINTS, *area.names}
        others = {name: signal for name, signal in signals.items() if name not in own}
        self.inputs = inputs_about(vehicle, point, others, count)
        self.range, self.model, self.trim = area, model, point.inputs[area.columns]
        self.excitations = np.column_stack([signals.get(axis, zero) for axis in AXES])
        self.single = np.column_stack([signals.get(name, zero) for name in area.names])
        self.given = np.zeros((count, 4))
        self.clipped = np.zeros((count, len(area.names)), dtype=bool)
        self.nominal: float | None = None
        battery = maneuver.battery or Battery()
        if "rotors.nominal_voltage" in vehicle.rows:  # the rotors feel the battery
            self.nominal = vehicle.value("rotors.nominal_voltage")
            start = self.nominal if battery.start is None else battery.start
            self.voltage, self.sag = start - battery.fall * maneuver.time, battery.sag
            self.column = vehicle.inputs.index("voltage")

    def give(self, k: int, accelerations: FloatArray) -> None:
        """Record the channels that give accelerations (4,) in addition to the excitations, within their range.

        The autopilot measures the voltage, which sags under the current of these channels, and compensates for it.
        """
        area = self.range
        wanted = self.trim + self.model.mixing @ (accelerations + self.excitations[k]) + self.single[k]
        share = 1.0
        if self.nominal is not None:
            load = float(np.mean(np.square((wanted - area.idle) / (self.trim - area.idle))))
            volts = max(float(self.voltage[k]) - self.sag * load, EMPTY_BATTERY * self.nominal)
            self.inputs[k, self.column] = volts
            share = volts / self.nominal
        sent = area.idle + (wanted - area.idle) / share
        limited = area.clip(sent)
        self.clipped[k] = limited != sent
        self.inputs[k, area.columns] = limited
        self.given[k] = self.model.effect @ (area.idle + (limited - area.idle) * share - self.trim)


class _Loop:
    """Errors of a state with respect to the reference motion."""

    def __init__(
        self, vehicle: Vehicle, point: Trim, reference: autopilot.Reference, state: FloatArray
    ) -> None:
        self.reference, self.wind = reference, np.array(point.wind)
        self.u, self.p, self.e0 = (vehicle.states.index(name) for name in ("u", "p", "e0"))
        self.lags = np.array(autopilot.rotor_lags(vehicle), dtype=np.intp)
        self.trim_lags = state[self.lags]

    def velocity(self, x: FloatArray) -> FloatArray:
        """Return the velocity over ground of a state (n_x,), m/s north-east-down."""
        return np.asarray(to_ground(x[self.e0 : self.e0 + 4], x[self.u : self.u + 3]) + self.wind)

    def errors(self, k: int, x: FloatArray, position: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return errors (n_e,) at a sample."""
        goal, back = self.reference, self.reference.rotation[k].T
        near = np.concatenate([back @ (position - goal.position[k]), back @ (velocity - goal.velocity[k])])
        near = np.minimum(np.maximum(near, -ERROR_LIMITS), ERROR_LIMITS)
        angle = small_rotation(goal.quaternion[k].tolist(), x[self.e0 : self.e0 + 4].tolist())
        rates = x[self.p : self.p + 3] - back[:, 2] * goal.turn_rate[k]
        return np.concatenate([near, angle, rates, x[self.lags] - self.trim_lags])


def small_rotation(a: Sequence[float], b: Sequence[float]) -> list[float]:
    """Return `rotations.vectors_of` of conj(a) b for small angles; on single quaternions fifty times as fast."""
    a0, a1, a2, a3 = a
    b0, b1, b2, b3 = b
    twice = 2.0 if a0 * b0 + a1 * b1 + a2 * b2 + a3 * b3 >= 0.0 else -2.0
    return [
        twice * (a0 * b1 - a1 * b0 - a2 * b3 + a3 * b2),
        twice * (a0 * b2 - a2 * b0 - a3 * b1 + a1 * b3),
        twice * (a0 * b3 - a3 * b0 - a1 * b2 + a2 * b1),
    ]
