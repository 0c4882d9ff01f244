"""Flight on rotors under the autopilot: the loop is closed over true states, at the rate of the maneuver.

A command that is computed from the state of one sample is recorded for a later one, so that a simulation of the
recorded channels alone reproduces the flight. Flights of the same length fly side by side, as lanes b of B; a lane has the
same bits alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.base.rotations import to_ground
from stoop.errors import SimulationError
from stoop.simulation import autopilot
from stoop.simulation.maneuver import Battery, Maneuver
from stoop.simulation.trim import Flown, Trim
from stoop.vehicle import Vehicle, delays, trajectories
from stoop.vehicle.rotor_channels import AXES, EXCITATIONS, SETPOINTS
from stoop.vehicle.trajectories import FINER

DIVERGED: Final = 1e6  #: of any state; a flight ends there
ERROR_LIMITS: Final = np.repeat([1.5, 2.0], 3)  #: of position, m, and velocity, m/s, in the autopilot
EMPTY_BATTERY: Final = 0.05  #: of the nominal voltage, the least there is
#: signs and places (of 16) of the products a_i b_j in real part and vector of conj(a) b
CONJUGATE_SIGNS: Final = np.array([[1, 1, 1, 1], [1, -1, -1, -1], [1, -1, -1, -1], [1, 1, 1, 1]])[:, :, None]
CONJUGATE_PLACES: Final = np.array([[0, 1, 2, 3], [5, 4, 8, 12], [10, 11, 13, 6], [15, 14, 7, 9]])


@dataclass(frozen=True, eq=False)
class Departure:
    """A vehicle in steady flight on rotors, the maneuver that it begins, and the random numbers of its gusts."""

    vehicle: Vehicle
    maneuver: Maneuver
    point: Trim
    rng: np.random.Generator


def fly_on_rotors(departures: Sequence[Departure]) -> list[Flown | SimulationError]:
    """Fly maneuvers from trims on rotors; the error of each that no autopilot holds is in its place."""
    found: dict[int, Flown | SimulationError] = {}
    groups: dict[Any, dict[int, _Start]] = {}
    for i, one in enumerate(departures):
        try:
            start = _Start.of(one)
        except SimulationError as error:
            found[i] = error
        else:
            groups.setdefault(start.group, {})[i] = start
    for starts in groups.values():
        found |= zip(starts, _fly_together([*starts.values()]), strict=True)
    return [found[i] for i in range(len(departures))]


@dataclass(frozen=True, eq=False)
class _Start:
    """A flight before its first sample."""

    departure: Departure
    dt: float
    rows: FloatArray  #: (n_p, 1), kernel parameters
    delay: _Delay
    model: autopilot.LinearErrors
    gains: autopilot.Gains
    reference: autopilot.Reference

    @classmethod
    def of(cls, departure: Departure) -> _Start:
        """Design the autopilot and its reference motion; SimulationError where no autopilot holds the vehicle."""
        vehicle, maneuver, point = departure.vehicle, departure.maneuver, departure.point
        dt, signals = 1.0 / maneuver.rate, maneuver.deflections()
        rows = vehicle.parameter_rows(point.changes)
        delay, model = _Delay.of(vehicle, rows, dt), autopilot.linear_errors(vehicle, point)
        gains = autopilot.design(vehicle, point, model, dt, delay.ahead + delay.arrival)
        setpoints = {n: signals[n] for n in SETPOINTS if n in signals}
        reference = autopilot.reference_motion(setpoints, point, len(maneuver.time), dt)
        return cls(departure, dt, rows, delay, model, gains, reference)

    @property
    def group(self) -> tuple[Any, ...]:
        """What flights side by side have in common."""
        count = len(self.departure.maneuver.time)
        return self.departure.vehicle.kernel().folder, count, self.dt, self.delay.ahead, self.delay.arrival


def _fly_together(starts: Sequence[_Start]) -> list[Flown]:
    """Fly starts of one group; the readings of a flight that diverges are NaN from there on."""
    vehicle, dt, ahead = starts[0].departure.vehicle, starts[0].dt, starts[0].delay.ahead
    flights = [s.departure for s in starts]
    rows, up = np.hstack([s.rows for s in starts]), np.array([s.reference.up for s in starts])
    count = up.shape[1]
    commands, delay = _Commands(starts), _Delays(starts)
    for k in range(min(ahead, count)):
        commands.give(k, up[:, k, None] * np.array([0.0, 0.0, 0.0, 1.0]))
    inputs, gusts = commands.inputs, [f.vehicle.gust_start(f.rng) for f in flights]
    begun = [{**f.point.start, **g} for f, g in zip(flights, gusts, strict=True)]
    each = zip(flights, starts, begun, inputs, strict=True)
    state = np.hstack([f.vehicle.initial_states(own, s.rows, u[0]) for f, s, own, u in each])
    noise = [trajectories.gust_noise(f.vehicle, count, dt, f.rng) for f in flights]
    loop = _Loop(starts, state)
    # Height above the ground, an input where the vehicle has a ground effect; the maneuver may move the ground.
    h, table = vehicle.states.index("h"), vehicle.file.ground_effect
    column = None if table is None else vehicle.inputs.index(table.channel)
    terrain = inputs[:, :, column or 0] - state[h][:, None]

    # Surfaces are moved by the maneuver alone, so what their servos make of it is known before the flight.
    servos = [a.column for a in vehicle.actuators() if a.dead_zones or a.rate_limits]
    pairs = zip(flights, starts, inputs, strict=True)
    surfaces = np.stack([f.vehicle.late_inputs(u, s.rows, dt)[:, servos] for f, s, u in pairs], axis=-1)
    states = np.full((len(starts), count, len(state)), np.nan)
    received = np.full((count, inputs.shape[2], len(starts)), np.nan)
    states[:, 0], received[0] = state.T, delay.received(inputs, 0)
    position, velocity = np.zeros((len(starts), 3)), loop.velocity(state)
    for k in range(count - 1):
        if k + ahead < count:
            command = -loop.feedback(k, state, position, velocity) - delay.underway(commands, k)
            command[:, 3] += up[:, k + ahead]
            commands.give(k + ahead, command)
        if column is not None:  # inputs of a step are known before it
            inputs[:, k + 1, column] = state[h] - dt * velocity[:, 2] + terrain[:, k + 1]
        received[k + 1] = delay.received(inputs, k + 1)
        received[k + 1, servos] = surfaces[k + 1]
        delays.with_slopes(vehicle, received[k : k + 2], dt)
        driving = [one[FINER * k : FINER * (k + 1) + 1] for one in noise]
        state = vehicle.next_states(rows, state, received[k : k + 2], driving, dt)
        lost = ~(np.abs(state).max(axis=0) < DIVERGED)
        state[:, lost] = np.nan
        states[:, k + 1] = state.T
        if lost.all():
            break
        before, velocity = velocity, loop.velocity(state)
        position = position + 0.5 * dt * (before + velocity)
    return [
        _flown(start, inputs[i], received[:, :, i], states[i], commands.clipped[i])
        for i, start in enumerate(starts)
    ]


def _flown(
    start: _Start, inputs: FloatArray, received: FloatArray, states: FloatArray, clipped: BoolArray
) -> Flown:
    """Return the flight of a lane."""
    vehicle, point = start.departure.vehicle, start.departure.point
    readings = vehicle.readings_along(start.rows, states, received)[None]
    outputs = vehicle.late_outputs(readings, start.rows, start.dt)[0]
    ground = point.over_ground(vehicle, states)
    return Flown(point, start.departure.maneuver.time, inputs, outputs, ground, clipped, states)


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
        for column, row in vehicle.input_delays():
            samples[column] = rows[row, 0] / dt
        whole = np.floor(samples)
        offsets = np.array(delays.OFFSETS)[:, None] - whole.astype(np.intp)
        weights = np.array([delays.lagrange(float(f)) for f in samples - whole]).T
        rotors = vehicle.rotor_range.columns
        needed = 1 - whole[rotors] + (samples[rotors] > whole[rotors])
        return cls(offsets, weights, max(1, int(needed.max())), max(0, round(float(samples[rotors].mean()))))


class _Delays:
    """Channels and commands on their way, of lanes whose commands arrive as late."""

    def __init__(self, starts: Sequence[_Start]) -> None:
        self.offsets = np.stack([s.delay.offsets for s in starts], axis=-1)  # (4, n_u, B)
        self.weights = np.stack([s.delay.weights for s in starts], axis=-1)
        self.channels, self.lanes = np.arange(self.offsets.shape[1])[:, None], np.arange(len(starts))
        self.gains = np.array([s.gains.underway for s in starts])  # (B, N, 4, 4)

    def received(self, inputs: FloatArray, k: int) -> FloatArray:
        """Return the channels (n_u, B) that arrive at a sample of (B, n, n_u), as `late_inputs` does for all samples."""
        at = np.minimum(np.maximum(k + self.offsets, 0), inputs.shape[1] - 1)
        return np.asarray((self.weights * inputs[self.lanes, at, self.channels]).sum(axis=0))

    def underway(self, commands: _Commands, k: int) -> FloatArray:
        """Return what the commands that arrive before the next one will do, as accelerations (B, 4)."""
        known = commands.given[:, k : k + self.gains.shape[1]]
        return np.asarray(np.einsum("bkij,bkj->bi", self.gains, known))


class _Commands:
    """The recorded channels of maneuvers, those of the rotors filled sample by sample.

    Attributes
    ----------
    inputs : (B, n, n_u)
    given : (B, a + n, 4)
        Accelerations that the channels give, in excess of the trim's; none in the `a` samples before the flight after which
        a command arrives.
    clipped : (B, n, m)
        Where the range ended.
    """

    def __init__(self, starts: Sequence[_Start]) -> None:
        flights = [s.departure for s in starts]
        vehicle, areas = flights[0].vehicle, [f.vehicle.rotor_range for f in flights]
        signals, count = [f.maneuver.deflections() for f in flights], len(flights[0].maneuver.time)
        names, self.columns, self.arrival = areas[0].names, areas[0].columns, starts[0].delay.arrival
        own, zero = {*EXCITATIONS, *SETPOINTS, *names}, np.zeros(count)
        others = [{name: x for name, x in one.items() if name not in own} for one in signals]
        channels = zip(flights, others, strict=True)
        self.inputs = np.array([f.point.inputs_about(f.vehicle, one, count) for f, one in channels])
        self.idle, self.full = (np.array([getattr(a, end) for a in areas]) for end in ("idle", "full"))
        self.mixing = np.array([s.model.mixing for s in starts])
        self.effect = np.array([s.model.effect for s in starts])
        self.trim = np.array([f.point.inputs[self.columns] for f in flights])
        self.excitations, self.single = (
            np.array([np.column_stack([one.get(name, zero) for name in wanted]) for one in signals])
            for wanted in (AXES, names)
        )
        self.given = np.zeros((len(starts), self.arrival + count, 4))
        self.clipped = np.zeros((len(starts), count, len(names)), dtype=bool)
        self.nominal: FloatArray | None = None
        if "rotors.nominal_voltage" in vehicle.rows:  # the rotors feel the battery
            batteries = [f.maneuver.battery or Battery() for f in flights]
            self.nominal = np.array([f.vehicle.value("rotors.nominal_voltage") for f in flights])
            each = zip(batteries, self.nominal, flights, strict=True)
            full = ((v if b.start is None else b.start, b, f.maneuver.time) for b, v, f in each)
            self.voltage = np.array([v - b.fall * time for v, b, time in full])
            self.sag = np.array([b.sag for b in batteries])
            self.column = vehicle.inputs.index("voltage")

    def give(self, k: int, accelerations: FloatArray) -> None:
        """Record the channels that give accelerations (B, 4) in addition to the excitations, within their range.

        The autopilot measures the voltage, which sags under the current of these channels, and compensates for it.
        """
        idle = self.idle
        wanted = self.trim + _applied(self.mixing, accelerations + self.excitations[:, k]) + self.single[:, k]
        share: Any = 1.0
        if self.nominal is not None:
            load = np.mean(np.square((wanted - idle) / (self.trim - idle)), axis=1)
            volts = np.maximum(self.voltage[:, k] - self.sag * load, EMPTY_BATTERY * self.nominal)
            self.inputs[:, k, self.column] = volts
            share = (volts / self.nominal)[:, None]
        sent = idle + (wanted - idle) / share
        limited = np.minimum(np.maximum(sent, idle), self.full)
        self.clipped[:, k] = limited != sent
        self.inputs[:, k, self.columns] = limited
        self.given[:, self.arrival + k] = _applied(self.effect, idle + (limited - idle) * share - self.trim)


class _Loop:
    """The autopilots' response to errors of states (n_x, B) with respect to the reference motions."""

    def __init__(self, starts: Sequence[_Start], state: FloatArray) -> None:
        vehicle, references = starts[0].departure.vehicle, [s.reference for s in starts]
        names = ("position", "velocity", "quaternion", "rotation", "turn_rate")
        motion = (np.array([getattr(one, name) for one in references]) for name in names)
        self.position, self.velocities, self.quaternion, self.rotation, self.turn_rate = motion
        self.gains = np.array([s.gains.errors for s in starts])
        self.wind = np.array([s.departure.point.wind for s in starts])
        self.u, self.p, self.e0 = (vehicle.states.index(name) for name in ("u", "p", "e0"))
        self.lags = np.array(autopilot.rotor_lags(vehicle), dtype=np.intp)
        self.trim_lags = state[self.lags].T

    def velocity(self, x: FloatArray) -> FloatArray:
        """Return velocities over ground (B, 3), m/s north-east-down."""
        return np.asarray(to_ground(x[self.e0 : self.e0 + 4].T, x[self.u : self.u + 3].T) + self.wind)

    def feedback(self, k: int, x: FloatArray, position: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return gains times errors, accelerations (B, 4), at a sample."""
        back = self.rotation[:, k].transpose(0, 2, 1)
        place, speed = position - self.position[:, k], velocity - self.velocities[:, k]
        near = np.concatenate([_applied(back, place), _applied(back, speed)], axis=1)
        near = np.minimum(np.maximum(near, -ERROR_LIMITS), ERROR_LIMITS)
        angle = small_rotation(self.quaternion[:, k].T, x[self.e0 : self.e0 + 4]).T
        rates = x[self.p : self.p + 3].T - back[:, :, 2] * self.turn_rate[:, k, None]
        lags = x[self.lags].T - self.trim_lags
        return _applied(self.gains, np.concatenate([near, angle, rates, lags], axis=1))


def _applied(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the product (B, i) of each matrix (B, i, j) and its vector (B, j)."""
    return np.asarray(np.matmul(matrices, vectors[:, :, None])[:, :, 0])


def small_rotation(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return `rotations.vectors_of` of conj(a) b, (3, B), for small angles between quaternions (4, B)."""
    products = (a[:, None] * b[None, :]).reshape(16, -1)
    parts = (CONJUGATE_SIGNS * products[CONJUGATE_PLACES]).sum(axis=0)
    return np.asarray(np.where(parts[0] >= 0.0, 2.0, -2.0) * parts[1:])
