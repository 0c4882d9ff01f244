"""Steady straight flight, eq. (14) of the paper: on wings at an airspeed, or on rotors at a velocity over ground."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import matrices_of_angles
from stoop.errors import SimulationError
from stoop.simulation.initial import initial_states, mixed_inputs, parameter_rows
from stoop.simulation.rotors import accelerations, allocation, channel_range, effects
from stoop.vehicle import Vehicle
from stoop.vehicle.defaults import WIND_NUMBERS

TOLERANCE: Final = 1e-7  #: of the accelerations that remain, m/s2 and rad/s2
OUT_OF_GROUND_EFFECT: Final = 1e4  #: m
_ROTOR_SCALES: Final = np.array([0.1, 0.1, 1.0, 1.0, 1.0, 1.0])  #: of phi, theta and the accelerations


@dataclass(frozen=True)
class Trim:
    """A steady straight flight."""

    start: dict[str, float]  #: initial state, SI and rad: V and flow angles on wings; u, v and w on rotors
    deflections: dict[str, float]  #: of the controls, rad
    thrust: dict[str, float]  #: number or channel that holds the speed, N or its unit; all channels of rotors
    inputs: FloatArray  #: (n_u,), recorded channels of this flight, in the vehicle's order
    changes: dict[str, float]  #: numbers of the vehicle that the trim sets (a constant thrust, the wind)
    residual: float  #: largest acceleration that remains, m/s2 or rad/s2
    velocity: tuple[float, ...] = (0.0, 0.0, 0.0)  #: on rotors: over ground, north-east-down, m/s
    wind: tuple[float, ...] = (0.0, 0.0, 0.0)  #: blowing north, east, down, m/s


def flies_on_rotors(vehicle: Vehicle, airspeed: float | None) -> bool:
    """Return whether rotors carry the vehicle: it has some, and no airspeed is given."""
    return bool(vehicle.rotors) and airspeed is None


def trim(
    vehicle: Vehicle,
    airspeed: float | None = None,
    altitude: float = 200.0,
    climb_angle: float = 0.0,
    density: float | None = None,
    velocity: Sequence[float] | None = None,
    wind: Sequence[float] | None = None,
    heading: float = 0.0,
) -> Trim:
    """Find steady straight flight.

    On wings it is free of sideslip, unless no control can hold the sideslip at zero; a lateral model is trimmed with
    the full equations. A vehicle with rotors is trimmed in hover or at a velocity over ground, its surfaces neutral and
    its pusher off; with an airspeed it is trimmed on its wings, rotors at idle. Of the rotor channels that hold the
    flight, those nearest to one common command are taken.

    Parameters
    ----------
    airspeed : float, m/s, optional
        The vehicle's V* when absent.
    altitude : float, m
        Also the height above the ground, for a vehicle with a ground effect: the ground lies at zero.
    climb_angle : float, rad
    density : float, kg/m3, optional
        Only where the vehicle takes the density from the log.
    velocity : (3,), m/s, optional
        On rotors: over ground, north-east-down; zero when absent.
    wind : (3,), m/s, optional
        On rotors: blowing north, east, down; the vehicle file's when absent.
    heading : float, rad
        On rotors.

    Raises
    ------
    SimulationError
        No steady flight at this speed with these controls; the vehicle is too heavy, or a rotor would need more than
        its full command.
    """
    quiet = neutral_inputs(vehicle, density, altitude)
    if flies_on_rotors(vehicle, airspeed):
        return _trim_on_rotors(vehicle, quiet, altitude, velocity, wind, heading)
    if vehicle.file.reference is None:
        raise SimulationError(
            f"{vehicle.where}: it has no wings to fly {airspeed:g} m/s on; leave the airspeed out and write velocity"
        )
    if vehicle.reduce == "lateral":
        return trim(vehicle.reduced("full"), airspeed, altitude, climb_angle, density)
    V = vehicle.value("reference.airspeed") if airspeed is None else airspeed
    for angles in _ANGLES[vehicle.reduce]:
        condition = _OnWings(vehicle, angles, V, altitude, climb_angle, quiet)
        # A propeller at rest has no slope: three starts of its thrust.
        first = [0.5, 0.5, *[0.0] * (len(condition.unknowns) - len(condition.thrust) - 2)]
        starts = [[*first, *[power] * len(condition.thrust)] for power in (1.0, 4.0, 16.0)]
        x, residual = _solved(condition, starts[: 1 + 2 * len(condition.thrust)], 500)
        if residual < TOLERANCE:
            break
    point = condition.point(x)
    named = {name: point.start[name] for name in angles} | point.deflections
    worst = max(named, key=lambda name: abs(named[name]))
    if not residual < TOLERANCE or abs(named[worst]) > math.pi / 2.0:
        unsolved = residual >= TOLERANCE or not math.isfinite(residual)
        why = (
            f"accelerations of {residual:.2g} remain"
            if unsolved
            else f"{worst} would be {named[worst]:.3g} rad"
        )
        raise SimulationError(
            f"{vehicle.where}: no steady flight found at {V:g} m/s ({why}); "
            "try another airspeed, check thrust, CL and Cm, or trim the longitudinal model"
        )
    return replace(point, residual=residual)


def neighbors(
    vehicle: Vehicle, point: Trim, climb_angle: float = 0.0, density: float | None = None
) -> Callable[[Mapping[str, float]], Trim]:
    """Return a function that gives the trim of the vehicle with some numbers slightly changed.

    It takes one Newton step from the known trim (the implicit function theorem): its derivative by the numbers is
    exact, its error of second order. The numbers are among the changes of the returned trim; climb angle, rad, and
    density, kg/m3, are those that were given to :func:`trim`.
    """
    if vehicle.reduce == "lateral":
        return neighbors(vehicle.reduced("full"), point, climb_angle, density)
    known: _OnWings | OnRotors
    if "V" in point.start:
        angles = next(n for n in _ANGLES[vehicle.reduce] if ("beta" in point.start) == ("beta" in n))
        quiet = neutral_inputs(vehicle, density, point.start["h"])
        known = _OnWings(vehicle, angles, point.start["V"], point.start["h"], climb_angle, quiet)
        values = {**point.start, **point.deflections, **point.thrust}
        x = np.array([values[name] for name in known.unknowns]) / known.scale
    else:
        known, x = trim_equations(vehicle, point)
    step = 1e-5 * np.eye(len(x))
    slope = np.array([(known.residuals(x + d) - known.residuals(x - d)) / 2e-5 for d in step]).T
    inverse = np.linalg.pinv(slope)

    def near(numbers: Mapping[str, float]) -> Trim:
        changed = replace(known, numbers={**known.numbers, **numbers})
        return changed.point(x - inverse @ (changed.residuals(x) - known.residuals(x)))

    return near


def neutral_inputs(
    vehicle: Vehicle, density: float | None = None, height: float = OUT_OF_GROUND_EFFECT
) -> FloatArray:
    """Return channels (n_u,) at their centers, rotors and their pusher at idle, the battery at its nominal voltage.

    The density, kg/m3, 1.225 when absent, and the height above the ground, m, are those of the channels that have them.
    """
    out = np.zeros(len(vehicle.inputs))

    def assign(channel: str, number: str) -> None:
        if number in vehicle.rows:
            out[vehicle.inputs.index(channel)] = vehicle.value(number)

    for control in vehicle.controls:
        for channel in vehicle.channels_of(control):
            assign(channel, f"controls.{control}.center.{channel}")
    if "density" in vehicle.inputs:
        out[vehicle.inputs.index("density")] = 1.225 if density is None else density
    if vehicle.file.ground_effect is not None:
        out[vehicle.inputs.index(vehicle.file.ground_effect.channel)] = height
    if vehicle.rotors:
        area, propulsion = channel_range(vehicle), vehicle.file.propulsion
        out[area.columns] = area.idle
        assign("voltage", "rotors.nominal_voltage")
        if propulsion is not None and propulsion.kind == "propeller":
            assign(propulsion.channel, "propulsion.idle")
    return out


def inputs_about(vehicle: Vehicle, point: Trim, signals: Mapping[str, FloatArray], count: int) -> FloatArray:
    """Return recorded channels (n, n_u) of a trim, plus changes of controls and of single channels.

    `signals` are changes (n,) by control, rad, or by channel, its unit; mixing is affine, so one column per control is
    enough.
    """
    out = np.repeat(point.inputs[None, :], count, axis=0)
    for name, signal in signals.items():
        if name in vehicle.controls:
            deflections = {**point.deflections, name: point.deflections[name] + 1.0}
            out += np.outer(signal, mixed_inputs(vehicle, deflections, point.inputs) - point.inputs)
        else:
            out[:, vehicle.inputs.index(name)] += signal
    return out


_ANGLES: Final[dict[str, tuple[tuple[str, ...], ...]]] = {
    "longitudinal": (("alpha", "theta"),),
    "full": (("alpha", "theta", "phi"), ("alpha", "theta", "phi", "beta")),
}  #: unknown angles: first without sideslip, then with it, for a vehicle that cannot hold it at zero


@dataclass(frozen=True, eq=False)
class _OnWings:
    """Equations of steady straight flight at one speed, height and climb angle.

    Unknowns, scaled, are angles, deflections and thrust.
    """

    vehicle: Vehicle
    angles: tuple[str, ...]
    airspeed: float
    altitude: float
    climb_angle: float
    quiet: FloatArray  #: channels (n_u,) before mixing
    numbers: Mapping[str, float] = field(default_factory=dict)  #: of the vehicle, in place of its own

    @property
    def thrust(self) -> tuple[str, ...]:
        """Number or channel of the thrust, if there is any."""
        propulsion = self.vehicle.file.propulsion
        if propulsion is None:
            return ()
        return ("propulsion.thrust" if propulsion.kind == "constant" else propulsion.channel,)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return (*self.angles, *self.vehicle.controls, *self.thrust)

    @property
    def scale(self) -> FloatArray:
        """Scale of each unknown: rad, then N or the channel's unit."""
        step = 0.1 * (self.vehicle.value("mass.mass") * 9.80665)
        if "propulsion.speed_gain" in self.vehicle.rows:
            step = 20.0 / max(self.vehicle.value("propulsion.speed_gain"), 1e-6)
        return np.array(
            [*[0.1] * (len(self.angles) + len(self.vehicle.controls)), *[step] * len(self.thrust)]
        )

    def point(self, x: FloatArray) -> Trim:
        """Return the flight of a scaled vector, its residual still open."""
        values = dict(zip(self.unknowns, (float(v) for v in x * self.scale), strict=True))
        controls = {name: values[name] for name in self.vehicle.controls}
        thrust = {name: values[name] for name in self.thrust}
        inputs = mixed_inputs(self.vehicle, controls, self.quiet)
        changes = dict(self.numbers)
        for name, value in thrust.items():
            if name == "propulsion.thrust":
                changes[name] = value
            else:
                inputs[self.vehicle.inputs.index(name)] = value
        start = {"V": self.airspeed, "h": self.altitude, **{name: values[name] for name in self.angles}}
        return Trim(start, controls, thrust, inputs, changes, math.inf)

    def residuals(self, x: FloatArray) -> FloatArray:
        """Return accelerations, m/s2 and rad/s2, and the climb angle's error."""
        vehicle, point = self.vehicle, self.point(x)
        rows = parameter_rows(vehicle, point.changes)
        states = initial_states(vehicle, point.start, rows, point.inputs)
        rates, _ = vehicle.kernel().evaluate(rows, states, point.inputs[:, None])
        balanced = [i for i, s in enumerate(vehicle.states) if s in ("u", "v", "w", "p", "q", "r")]
        climb = rates[vehicle.states.index("h"), 0] / self.airspeed - math.sin(self.climb_angle)
        return np.append(rates[balanced, 0], climb)


@dataclass(frozen=True, eq=False)
class OnRotors:
    """Equations of steady flight on rotors; unknowns, scaled, are phi, theta and four accelerations."""

    vehicle: Vehicle
    velocity: FloatArray  #: over ground, m/s north-east-down
    wind: FloatArray  #: blowing north, east, down, m/s
    heading: float
    altitude: float
    level: FloatArray  #: channels (n_u,) about which is allocated
    mixing: FloatArray  #: (m, 4)
    numbers: Mapping[str, float] = field(default_factory=dict)  #: of the vehicle, in place of its own

    def point(self, x: FloatArray) -> Trim:
        """Return the flight of a scaled vector, its residual still open."""
        phi, theta, *wanted = (x * _ROTOR_SCALES).tolist()
        area, inputs = channel_range(self.vehicle), self.level.copy()
        inputs[area.columns] += self.mixing @ wanted
        rotation = matrices_of_angles(np.array([phi, theta, self.heading]))
        start = dict(zip("uvw", (rotation.T @ (self.velocity - self.wind)).tolist(), strict=True))
        start |= {"phi": phi, "theta": theta, "psi": self.heading, "h": self.altitude}
        return Trim(
            start,
            dict.fromkeys(self.vehicle.controls, 0.0),
            dict(zip(area.names, inputs[area.columns].tolist(), strict=True)),
            inputs,
            dict(self.numbers),
            math.inf,
            tuple(self.velocity.tolist()),
            tuple(self.wind.tolist()),
        )

    def residuals(self, x: FloatArray) -> FloatArray:
        """Return accelerations, m/s2 and rad/s2."""
        point = self.point(x)
        return accelerations(self.vehicle, point.start, point.inputs[:, None], self.numbers)[:, 0]


def trim_equations(vehicle: Vehicle, point: Trim) -> tuple[OnRotors, FloatArray]:
    """Return the equations of a known trim on rotors, and the scaled vector that solves them."""
    s = point.start
    mixing = allocation(vehicle, effects(vehicle, s, point.inputs, point.changes))
    velocity, wind = np.array(point.velocity), np.array(point.wind)
    known = OnRotors(vehicle, velocity, wind, s["psi"], s["h"], point.inputs, mixing, point.changes)
    return known, np.array([s["phi"], s["theta"], 0.0, 0.0, 0.0, 0.0]) / _ROTOR_SCALES


def _solved(
    equations: _OnWings | OnRotors, starts: Sequence[Sequence[float]], evaluations: int
) -> tuple[FloatArray, float]:
    """Return the scaled solution and the largest residual, from the first start that converges."""
    from scipy.optimize import least_squares

    tight = 1e-15
    for start in starts:
        found = least_squares(
            equations.residuals, np.array(start), ftol=tight, xtol=tight, gtol=tight, max_nfev=evaluations
        )
        x = found.x
        residual = float(np.max(np.abs(equations.residuals(x))))
        if residual < TOLERANCE:
            break
    return x, residual


def steady_wind(vehicle: Vehicle, wind: Sequence[float] | None) -> FloatArray:
    """Return the wind that blows north, east, down, m/s: the given one, else that of the vehicle file, if any."""
    if wind is not None:
        return np.array(wind, dtype=float)
    return np.array([vehicle.value(n) if n in vehicle.rows else 0.0 for n in WIND_NUMBERS])


def _trim_on_rotors(
    vehicle: Vehicle,
    quiet: FloatArray,
    altitude: float,
    velocity: Sequence[float] | None,
    wind: Sequence[float] | None,
    heading: float,
) -> Trim:
    ground = np.array((0.0, 0.0, 0.0) if velocity is None else velocity, dtype=float)
    air = steady_wind(vehicle, wind)
    changes = {} if wind is None else dict(zip(WIND_NUMBERS, air.tolist(), strict=True))
    level = _level(vehicle, quiet, altitude)
    mixing = allocation(vehicle, effects(vehicle, {"h": altitude}, level, changes))
    equations = OnRotors(vehicle, ground, air, heading, altitude, level, mixing, changes)
    x, residual = _solved(equations, [[0.0] * 6], 300)
    if not residual < TOLERANCE:
        raise SimulationError(
            f"{vehicle.where}: no steady flight found at {float(np.linalg.norm(ground - air)):g} m/s through the air "
            f"(accelerations of {residual:.2g} remain); fly slower, in less wind, or check drag and thrust of the rotors"
        )
    point, area = equations.point(x), channel_range(vehicle)
    commands = point.inputs[area.columns]
    over, under = commands - area.full, area.idle - commands
    worst = int(np.argmax(np.maximum(over, under)))
    if max(over[worst], under[worst]) > 0.0:
        limit = area.full[worst] if over[worst] > 0.0 else area.idle[worst]
        raise SimulationError(
            f"{vehicle.where}: no steady flight: {area.names[worst]} would be {commands[worst]:.3g}, and its range ends at "
            f"{limit:g}; make it lighter, move its center of gravity, or fly slower or in less wind"
        )
    return replace(point, residual=residual)


def _level(vehicle: Vehicle, quiet: FloatArray, altitude: float) -> FloatArray:
    """Return channels (n_u,) at which all rotors, with one common command, lift the weight in still air."""
    from scipy.optimize import brentq

    area = channel_range(vehicle)

    def channels(command: float) -> FloatArray:
        out = quiet.copy()
        out[area.columns] = command
        return out

    def sink_rate(command: float) -> float:  # its derivative, m/s2
        return float(accelerations(vehicle, {"h": altitude}, channels(command)[:, None], {})[2, 0])

    low, high = float(area.idle[0]), float(area.full.min())
    if not math.isfinite(high):  # bracket the command that lifts
        step = 1.0
        while low + step < 1e6 and sink_rate(low + step) >= 0.0:
            step *= 2.0
        high = low + step
    if not sink_rate(high) < 0.0:
        share = 1.0 - sink_rate(high) / vehicle.value("environment.gravity")
        raise SimulationError(
            f"{vehicle.where}: it is too heavy to hover: at full command ({high:g}) the rotors lift {share:.0%} of the "
            "weight; check mass, T2 and gain, or the voltage"
        )
    if not sink_rate(low) > 0.0:
        raise SimulationError(
            f"{vehicle.where}: it rises with its rotors at idle ({low:g}); check mass, T0 and idle"
        )
    return channels(float(brentq(sink_rate, low, high, xtol=1e-12 * high)))
