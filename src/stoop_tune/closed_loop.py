"""Flight of the nonlinear model under an autopilot's law: its filters and limits sample by sample, its actuators, wind and gusts.

The law commands channels about a trim, held over a sample of the loop; the model moves in finer steps. Attitudes are set, and
velocities drift: thrust stays that of the trim. Errors of the attitude become rates as a multicopter turns the shortest
way [1]_, as a fixed wing turns its Euler angles, with the yaw rate of a coordinated turn [2]_, or by a law of each Euler angle.

References
----------
.. [1] D. Brescianini, M. Hehn and R. D'Andrea, Nonlinear Quadrocopter Attitude Control, ETH Zurich, 2013.
.. [2] R. W. Beard and T. W. McLain, Small Unmanned Aircraft, 2012, sections 5.3 and 9.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import ValidationError

from stoop import Flight, Vehicle
from stoop.extend import arrays, motion
from stoop.extend.arrays import rotations
from stoop.extend.errors import ManeuverError, SimulationError, StoopError
from stoop.extend.files import first_complaint
from stoop.extend.notices import notice
from stoop.extend.units import SEA_LEVEL_DENSITY, STANDARD_GRAVITY, standard_density
from stoop.extend.variables import FAMILIES
from stoop_tune.control_laws.parameters import read_parameters
from stoop_tune.control_laws.rate_law import AXES
from stoop_tune.control_laws.recursion import LawRecursion
from stoop_tune.control_laws.table import Firmware, firmware_of
from stoop_tune.judgment import commands_of

STEP_RATE: Final = 400.0  #: Hz, least at which the model moves
LOST: Final = math.radians(75.0)  #: error of roll or pitch at which a flight ends
EULER, RATES = FAMILIES["euler"], FAMILIES["rates"]
WIND_CHANGES: Final = motion.Maneuver.UNDER_LAW[3:]  #: m/s
QUATERNION: Final = ("e0", "e1", "e2", "e3")


def simulate_under_law(
    vehicle: Vehicle,
    maneuver: motion.Maneuver,
    autopilot: str | Path | Sequence[str | Path] | Mapping[str, float],
    seed: int = 0,
    noise: bool = True,
    name: str = "simulated",
) -> Flight:
    """Return the flight of a maneuver under the law of an autopilot, as the instruments of the vehicle would record it.

    Parameters
    ----------
    vehicle : Vehicle
    maneuver : Maneuver
        Its inputs are changes from the trim: of the attitude's setpoints (``phi``, ``theta``, on rotors ``psi``, rad), of
        the wind (``wind_n``, ``wind_e``, ``wind_d``, m/s), and of channels and controls, added to what the law commands.
    autopilot : path, paths or mapping of str to float
        Its parameters, by which its law is known: a log or files that hold them, later ones over earlier ones, or by name.
    seed : int
        Of the measurement noise and of the gusts.
    noise : bool
        Of the sensors; there are gusts without it too.
    name : str

    Returns
    -------
    Flight
        At the rate of the loop over a whole number, near that of the maneuver.

    Raises
    ------
    ManeuverError
        An input that there is not.
    SimulationError
        No trim, or the attitude is lost.
    StoopError
        The law does not move the vehicle.
    """
    parameters = read_parameters(*([autopilot] if isinstance(autopilot, str | Path | Mapping) else autopilot))
    firmware = firmware_of(parameters, on_rotors(vehicle, maneuver))
    flown = fly_under_law(vehicle, maneuver, firmware, parameters, seed)
    flight = motion.recorded(vehicle, maneuver, flown, seed, noise, name)
    roll, pitch = np.sqrt(np.mean(flown.attitude_error[:, :2] ** 2, axis=0)).tolist()
    full = float(np.mean(flown.saturated.any(axis=1)))
    found = notice("flown-under-law", name, firmware=firmware.title, roll=roll, pitch=pitch, saturated=full)
    return flight.with_notices([found])


def on_rotors(vehicle: Vehicle, maneuver: motion.Maneuver) -> bool:
    """Return whether a maneuver is flown on rotors, not on wings."""
    return bool(vehicle.rotors) and maneuver.airspeed is None


@dataclass(frozen=True)
class FlownUnderLaw(motion.Flown):
    """A flight under a law, with the errors of its attitude."""

    #: (n, 3), setpoint minus attitude, rad; none of yaw on wings
    attitude_error: arrays.FloatArray = field(kw_only=True)
    #: (n, axes), where actuators did not do what the law commanded
    saturated: arrays.BoolArray = field(kw_only=True)


def fly_under_law(
    vehicle: Vehicle,
    maneuver: motion.Maneuver,
    firmware: Firmware,
    parameters: Mapping[str, float],
    seed: int = 0,
) -> FlownUnderLaw:
    """Return the flight of :func:`simulate_under_law` without noise of sensors."""
    if vehicle.reduce != "full":
        raise StoopError(f"{vehicle.where}: an autopilot flies about all axes; simulate the full model")
    moved = commands_of(vehicle, firmware, parameters, maneuver.altitude)
    laws = [firmware.law(parameters, a) for a in moved.axes]
    course = Course.of(vehicle, at_rate(maneuver, laws[0].rate))
    body = _Body(vehicle, course, np.random.default_rng([seed, 1]))
    loop = AttitudeLoop(firmware, parameters, moved.axes, course)
    law, mixer = LawRecursion(laws, body.rates[loop.axes]), _Mixer(vehicle, moved.outputs)
    every = max(1, round(course.rate / maneuver.rate))
    states, received, errors, clipped, saturated = [], [], [], [], []
    achieved = np.zeros((len(laws), 1))
    ground = vehicle.file.ground_effect
    height = [] if ground is None else [vehicle.inputs.index(ground.channel)]
    terrain = course.inputs[:, height] - body.height
    for k in range(len(course.time)):
        body.change_wind(course.wind[k] - (course.wind[k - 1] if k else 0.0))
        quaternion, speed = body.state[body.attitude, 0], float(np.linalg.norm(body.state[body.velocity, 0]))
        setpoints, error = loop.setpoints(k, quaternion, speed)
        commands = law.commands(setpoints, body.rates[loop.axes], loop.scale(speed), achieved)
        course.inputs[k, height] = body.height + terrain[k]
        course.inputs[k], ends, achieved = mixer.channels(course.inputs[k], commands)
        states.append(body.state[:, 0])
        received.append(body.move(k, course.inputs[k]))
        errors.append(error)
        clipped.append(ends)
        saturated.append(law.excess(achieved)[:, 0] != 0.0)
    sampled = slice(None, None, every)
    kept = np.array(states[sampled])
    readings = vehicle.readings_along(body.rows, kept, np.array(received[sampled]))[None]
    return FlownUnderLaw(
        course.point,
        course.time[sampled],
        centered_means(course.inputs, every),
        vehicle.late_outputs(readings, body.rows, every / course.rate)[0],
        course.point.over_ground(vehicle, kept) + course.wind[sampled],
        np.array(clipped[sampled]),
        kept,
        attitude_error=np.array(errors[sampled]),
        saturated=np.array(saturated[sampled]),
    )


def at_rate(maneuver: motion.Maneuver, rate: float) -> motion.Maneuver:
    """Return the maneuver at another rate, Hz; ManeuverError where it cannot be."""
    raw = {**maneuver.model_dump(), "rate": rate}
    try:
        return motion.Maneuver.model_validate(raw)
    except ValidationError as error:
        raise ManeuverError(
            f"at {rate:g} Hz, the rate of the loop: {first_complaint(error, raw, motion.Maneuver)}"
        ) from None


def centered_means(held: arrays.FloatArray, every: int) -> arrays.FloatArray:
    """Return channels (n, n_u), each held over a sample, as their means about every so many samples.

    Straight lines between these have the integral of what was held; samples of it would look late by half a sample.
    """
    whole = np.vstack([np.zeros(held.shape[1]), np.cumsum(held, axis=0)])
    ends = np.arange(0, len(held), every)[:, None] + np.array([-0.5, 0.5]) * every
    ends = np.clip(ends, 0.0, len(held))
    below = np.minimum(ends.astype(np.intp), len(held) - 1)
    integral = whole[below] + (ends - below)[:, :, None] * held[below]
    return np.asarray((integral[:, 1] - integral[:, 0]) / (ends[:, 1] - ends[:, 0])[:, None])


@dataclass(frozen=True, eq=False)
class Course:
    """What a maneuver asks for at the samples of a loop (n)."""

    point: motion.Trim
    rate: float  #: Hz, of the loop
    altitude: float  #: m
    time: arrays.FloatArray  #: (n,), s
    inputs: arrays.FloatArray  #: (n, n_u), channels to which commands are added
    attitude: arrays.FloatArray  #: (n, 3), Euler angles, rad
    wind: arrays.FloatArray  #: (n, 3), change from the trim's, m/s
    pitot: float  #: reading of the airspeed over what it is

    @classmethod
    def of(cls, vehicle: Vehicle, maneuver: motion.Maneuver) -> Course:
        """Return the course of a maneuver at the rate of the loop."""
        if len(maneuver.time) > maneuver.MAX_ROTOR_SAMPLES:
            raise ManeuverError(
                f"duration: more than {maneuver.MAX_ROTOR_SAMPLES} samples of the loop at {maneuver.rate:g} Hz; lower it"
            )
        if maneuver.battery is not None:
            raise ManeuverError("battery: under the law of an autopilot its voltage stays; remove it")
        angles = EULER if on_rotors(vehicle, maneuver) else EULER[:2]
        known = dict.fromkeys((*angles, *WIND_CHANGES, *motion.OnWings.movable(vehicle)))
        for spec in maneuver.input:
            if spec.control not in known:
                raise ManeuverError(
                    f"the maneuver moves '{spec.control}', but under a law it may move {', '.join(known)}; correct the file"
                )
        others = tuple(one for one in maneuver.input if one.control not in maneuver.UNDER_LAW)
        maneuver.model_copy(update={"input": others}).check(vehicle)
        signals, none = maneuver.deflections(), np.zeros(len(maneuver.time))
        point = maneuver.trim(vehicle)
        attitude, wind = (
            np.column_stack([signals.pop(n, none) for n in names]) for names in (EULER, WIND_CHANGES)
        )
        inputs = point.inputs_about(vehicle, signals, len(none))
        trimmed = np.array([point.start.get(n, 0.0) for n in EULER])
        pitot = vehicle.value("sensors.V.scale", 1.0)
        return cls(
            point, maneuver.rate, maneuver.altitude, maneuver.time, inputs, trimmed + attitude, wind, pitot
        )


class _Mixer:
    """Commands about the axes as channels, each rotor's within its range."""

    def __init__(self, vehicle: Vehicle, outputs: arrays.FloatArray) -> None:
        self.outputs, self.back, self.area = outputs, np.linalg.pinv(outputs), vehicle.rotor_range

    def channels(
        self, before: arrays.FloatArray, commands: arrays.FloatArray
    ) -> tuple[arrays.FloatArray, arrays.BoolArray, arrays.FloatArray]:
        """Return channels (n_u,), which of the rotors' were clipped, and the commands (k, 1) that were achieved."""
        wanted, columns = before + self.outputs @ commands[:, 0], self.area.columns
        found = wanted.copy()
        found[columns] = self.area.clip(wanted[columns])
        return found, found[columns] != wanted[columns], self.back @ (found - before)[:, None]


class _Body:
    """The vehicle and its actuators, from one sample of the loop to the next."""

    def __init__(self, vehicle: Vehicle, course: Course, rng: np.random.Generator) -> None:
        self.vehicle, self.rows = vehicle, course.point.lanes(vehicle).rows
        start = {**course.point.start, **vehicle.gust_start(rng)}
        self.state = vehicle.initial_states(start, self.rows, course.inputs[0])
        self.steps = max(1, math.ceil(STEP_RATE / course.rate))
        self.dt = 1.0 / (course.rate * self.steps)
        # at these short steps the gusts need no finer noise
        count = self.steps * len(course.time) + 1
        self.noise = rng.standard_normal((count, len(vehicle.gusts))) / math.sqrt(self.dt)
        self.gusts = [vehicle.inputs.index(f"gust.{axis}.noise") for axis in vehicle.gusts]
        self.actuators = [
            _Held(a.column, a.numbers(self.rows, self.dt)[:, 0], course.inputs[0])
            for a in vehicle.actuators()
        ]
        self.gyros = np.array([[vehicle.value(f"sensors.{n}.scale", 1.0)] for n in RATES])
        self.velocity, self.attitude, self.turning = (
            [vehicle.states.index(n) for n in names] for names in ("uvw", QUATERNION, "pqr")
        )

    @property
    def height(self) -> float:
        """Return the altitude, m."""
        return float(self.state[self.vehicle.states.index("h"), 0])

    @property
    def rates(self) -> arrays.FloatArray:
        """Return p, q and r (3, 1) as gyros read them, rad/s."""
        return np.asarray(self.state[self.turning] * self.gyros)

    def change_wind(self, change: arrays.FloatArray) -> None:
        """Change the wind (3,), m/s; the velocity over ground stays."""
        if change.any():
            self.state = self.state.copy()
            self.state[self.velocity, 0] -= rotations.to_body(self.state[self.attitude, 0], change)

    def move(self, k: int, channels: arrays.FloatArray) -> arrays.FloatArray:
        """Move through sample k of the loop with channels (n_u,) held; return those that arrived first."""
        arrived = []
        for part in range(self.steps * k, self.steps * (k + 1)):
            arriving = channels.copy()
            for one in self.actuators:
                arriving[one.column] = one.received(channels[one.column])
            arrived.append(arriving)
            now, then = arriving[:, None].copy(), arriving[:, None].copy()
            now[self.gusts, 0], then[self.gusts, 0] = self.noise[part], self.noise[part + 1]
            self.state, _ = self.vehicle.kernel().step(self.rows, self.state, now, then, self.dt)
        return arrived[0]


class _Held:
    """An actuator whose commands are held over a step: dead zone, rate limit, then delay."""

    def __init__(self, column: int, numbers: arrays.FloatArray, inputs: arrays.FloatArray) -> None:
        self.column, start = column, float(inputs[column])
        dead_zone, self.largest_step, delay = numbers.tolist()
        whole = math.floor(delay)
        self.half_width, self.share = 0.5 * dead_zone, delay - whole
        self.after_play = self.position = start
        self.delayed = deque([start] * (whole + 2), maxlen=whole + 2)

    def received(self, command: float) -> float:
        """Return the mean over a step of what arrives."""
        half, largest = self.half_width, self.largest_step
        self.after_play = min(max(self.after_play, command - half), command + half)
        self.position = min(max(self.after_play, self.position - largest), self.position + largest)
        self.delayed.append(self.position)
        return float((1.0 - self.share) * self.delayed[1] + self.share * self.delayed[0])


class AttitudeLoop:
    """Setpoints of rates from errors of the attitude.

    Attributes
    ----------
    axes : numbers of the axes, of roll, pitch and yaw, that the law turns about
    """

    def __init__(
        self, firmware: Firmware, parameters: Mapping[str, float], axes: Sequence[str], course: Course
    ) -> None:
        self.firmware, self.parameters, self.course = firmware, parameters, course
        self.axes, self.target = [AXES.index(a) for a in axes], rotations.quaternions_of(course.attitude)
        self.gains = np.array([firmware.attitude_gain(parameters, a) for a in AXES])
        self.law = None
        if firmware.attitude is not None:
            start = np.array([[course.point.start.get(n, 0.0)] for n in EULER])
            self.law = LawRecursion([firmware.attitude(parameters, a) for a in AXES], start)
        elif not self.gains[:2].all():
            raise StoopError(
                f"{firmware.title}: its attitude loop has no gain, and rates alone hold no attitude: raise the gain"
            )
        self.calibrated = math.sqrt(standard_density(np.array(course.altitude)) / SEA_LEVEL_DENSITY)

    def scale(self, speed: float) -> arrays.FloatArray:
        """Return the ratio of trim airspeed to airspeed (1,), at a true airspeed, m/s."""
        reading = self.course.pitot * self.calibrated * speed
        return np.array([self.firmware.airspeed_ratio(self.parameters, reading)])

    def setpoints(
        self, k: int, quaternion: arrays.FloatArray, speed: float
    ) -> tuple[arrays.FloatArray, arrays.FloatArray]:
        """Return rates (axes, 1), rad/s, and errors (3,), rad, at sample k for an attitude (4,) and a true airspeed, m/s.

        Raises
        ------
        SimulationError
            The attitude is lost.
        """
        if self.law is not None:
            target = self.course.attitude[k]
            error = (target - rotations.euler_angles(quaternion) + np.pi) % (2.0 * np.pi) - np.pi
            asked, turned = target[:, None], (target - error)[:, None]
            rates = self.law.commands(asked, turned, np.ones(1), self.law.unlimited)[:, 0]
        elif self.firmware.rotors:
            error = rotations.between(quaternion, self.target[k])
            rates = self.gains * error
        else:
            phi, theta, _ = rotations.euler_angles(quaternion).tolist()
            error = self.course.attitude[k] - (phi, theta, self.course.attitude[k, 2])
            turn = STANDARD_GRAVITY / speed * math.tan(phi) * math.cos(theta)
            rates = _body_rates(phi, theta, self.gains * error + (0.0, 0.0, turn))
        if not math.hypot(*error[:2]) < LOST:  # also NaN
            raise SimulationError(
                f"the attitude is lost at {self.course.time[k]:.2f} s: {math.degrees(math.hypot(*error[:2])):.0f} deg from its "
                f"setpoint, and more than {math.degrees(LOST):.0f} deg is lost; lower gains, setpoints or gusts"
            )
        return np.asarray(rates[self.axes, None]), np.asarray(error)


def _body_rates(phi: float, theta: float, euler: arrays.FloatArray) -> arrays.FloatArray:
    """Return p, q and r for rates of the Euler angles (3,)."""
    (roll, pitch, yaw), level = euler.tolist(), math.cos(theta)
    return np.array(
        [
            roll - yaw * math.sin(theta),
            pitch * math.cos(phi) + yaw * level * math.sin(phi),
            yaw * level * math.cos(phi) - pitch * math.sin(phi),
        ]
    )
