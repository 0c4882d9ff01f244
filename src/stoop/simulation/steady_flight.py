"""Steady straight flight, eq. (14) of the paper: on wings at an airspeed, or on rotors at a velocity over ground."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.base.atmosphere import standard_density
from stoop.base.numbers import within_limits
from stoop.base.rotations import matrices_of_angles
from stoop.base.units import STANDARD_GRAVITY
from stoop.errors import SimulationError
from stoop.simulation.newton import solve
from stoop.simulation.trim import Trim, Trims
from stoop.vehicle import Vehicle
from stoop.vehicle.defaults import WIND_NUMBERS
from stoop.vehicle.rotor_channels import EXCITATIONS, SETPOINTS

TOLERANCE: Final = 1e-7  #: of the accelerations that remain, m/s2 and rad/s2
ROTOR_SCALES: Final = np.array([0.1, 0.1, 1.0, 1.0, 1.0, 1.0])  #: of phi, theta and the accelerations
THRUST: Final = "propulsion.thrust"  #: number of a constant thrust
POWERS: Final = (1.0, 4.0, 16.0)  #: scaled, at which a thrust begins
Lanes = IntArray | slice  #: some lanes
ALL: Final = slice(None)
WING_ANGLES: Final[dict[str, tuple[tuple[str, ...], ...]]] = {
    "longitudinal": (("alpha", "theta"),),
    "full": (("alpha", "theta", "phi"), ("alpha", "theta", "phi", "beta")),
}  #: unknown angles: first without sideslip, then with it, for a vehicle that cannot hold it at zero


@dataclass(frozen=True, eq=False)
class Conditions:
    """What a steady flight is asked for, as of :func:`trim`."""

    vehicle: Vehicle
    airspeed: float
    altitude: float
    climb_angle: float
    velocity: FloatArray  #: (3,)
    wind: FloatArray  #: (3,)
    heading: float
    quiet: FloatArray  #: channels (n_u,) before any of them holds the flight


@dataclass(frozen=True, eq=False)
class SteadyFlight(ABC):
    """Equations of steady straight flight: residuals of unknowns that are scaled to about one, in lanes."""

    at: Conditions
    numbers: Mapping[str, float]  #: of the vehicle, in place of its own
    rows: FloatArray  #: (n_p, B), kernel parameters with these numbers; a single lane serves any number of vectors

    commands: ClassVar[tuple[str, ...]]  #: of the autopilot that flies maneuvers, if one does
    refused: ClassVar[tuple[str, ...]]  #: what the command line does not take, for the reason of `advice`
    advice: ClassVar[str]

    @abstractmethod
    def trims(self, x: FloatArray, lanes: Lanes = ALL) -> Trims:
        """Return the flights of scaled vectors (m, B) of some lanes, their residuals still open."""

    @abstractmethod
    def residuals(self, x: FloatArray, lanes: Lanes = ALL) -> FloatArray:
        """Return what is not in balance (r, B): accelerations, m/s2 and rad/s2, among others."""

    @classmethod
    @abstractmethod
    def of(cls, at: Conditions, numbers: Mapping[str, float], rows: FloatArray) -> Self:
        """Return the equations of a steady flight under some conditions."""

    @classmethod
    def still(cls, vehicle: Vehicle, rows: FloatArray, altitude: float, density: float) -> Self:
        """Return the equations of level flight in still air; the speed is still to be given."""
        calm, quiet = np.zeros(3), vehicle.neutral_inputs(density, altitude)
        return cls.of(Conditions(vehicle, math.nan, altitude, 0.0, calm, calm, 0.0, quiet), {}, rows)

    @classmethod
    def movable(cls, vehicle: Vehicle) -> list[str]:
        """Return what a maneuver may move: commands of the autopilot, controls, and recorded channels that are no weather."""
        recorded = sorted(set(vehicle.recorded) - {"voltage", "density"})
        return list(dict.fromkeys((*cls.commands, *vehicle.controls, *recorded)))

    def solve(self, start: FloatArray, lanes: IntArray | None = None) -> tuple[FloatArray, BoolArray]:
        """Return the solutions (m, B) of some lanes from scaled vectors, and which of them hold to `TOLERANCE`."""
        every = np.arange(start.shape[1]) if lanes is None else lanes
        x, error = solve(lambda y, some: self.residuals(y, every[some]), start, TOLERANCE)
        return x, error < TOLERANCE

    def lane_rows(self, count: int, lanes: Lanes) -> FloatArray:
        """Return a copy of the kernel parameters (n_p, B) of some lanes."""
        rows = self.rows if self.rows.shape[1] == 1 else self.rows[:, lanes]
        return np.repeat(rows, count, axis=1) if rows.shape[1] == 1 else np.array(rows)

    def solved(self, starts: Sequence[Sequence[float]], evaluations: int) -> Trim:
        """Return the solution of one lane from the first start that converges, else that of the last."""
        from scipy.optimize import least_squares

        def residuals(x: FloatArray) -> FloatArray:
            return self.residuals(x[:, None])[:, 0]

        tight = 1e-15
        with np.errstate(all="ignore"):  # of a vehicle that cannot fly residuals overflow
            for guess in starts:
                x = np.array(guess)
                if np.isfinite(residuals(x)).all():
                    x = least_squares(
                        residuals, x, ftol=tight, xtol=tight, gtol=tight, max_nfev=evaluations
                    ).x
                residual = float(np.max(np.abs(residuals(x))))
                if residual < TOLERANCE:
                    break
        found, at = self.trims(x[:, None]), self.at
        parts = (found.start, found.deflections, found.thrust)
        start, deflections, thrust = ({n: np.asarray(x).item() for n, x in own.items()} for own in parts)
        changes = {**self.numbers, **{n: x for n, x in thrust.items() if n in at.vehicle.rows}}
        velocity, wind = (tuple(v.tolist()) for v in (at.velocity, at.wind))
        inputs = found.inputs[:, 0]
        return Trim(start, deflections, thrust, inputs, changes, residual, velocity, wind, (self, x))


@dataclass(frozen=True, eq=False)
class OnWings(SteadyFlight):
    """Flight on wings at one speed, height and climb angle; unknowns are angles, deflections and thrust."""

    angles: tuple[str, ...]
    #: the airspeed, m/s, or the angle of attack, rad, (B,), that is given; the conditions' airspeed when empty
    given: Mapping[str, FloatArray] = field(default_factory=dict)
    #: whether propulsion, where there is one, holds the flight-path angle; it is free without
    powered: bool = True

    commands = ()
    refused = ("velocity", "wind")
    advice = "flies on its wings here; give its steady flight by its airspeed alone"

    @classmethod
    def trim(cls, at: Conditions, numbers: Mapping[str, float]) -> Trim:
        """Solve; a propeller at rest has no slope, so that its thrust starts at three sizes."""
        vehicle = at.vehicle
        if vehicle.file.reference is None:
            raise SimulationError(
                f"{vehicle.where}: it has no wings to fly {at.airspeed:g} m/s on; leave the airspeed out and write velocity"
            )
        if at.climb_angle and vehicle.file.propulsion is None:
            raise SimulationError(
                f"{vehicle.where}: it has no propulsion, and glides at the angle that its airspeed asks for; "
                "leave the climb angle out"
            )
        for angles in WING_ANGLES[vehicle.reduce]:
            flight = replace(cls.of(at, numbers, vehicle.parameter_rows(numbers)), angles=angles)
            point = flight.solved([x.tolist() for x in flight.starts()], 500)
            if point.residual < TOLERANCE:
                break
        named = {name: point.start[name] for name in angles} | point.deflections
        worst = max(named, key=lambda name: abs(named[name]))
        unsolved = not point.residual < TOLERANCE
        if unsolved or abs(named[worst]) > math.pi / 2.0:
            beyond = f"{worst} would be {named[worst]:.3g} rad"
            why = f"accelerations of {point.residual:.2g} remain" if unsolved else beyond
            raise SimulationError(
                f"{vehicle.where}: no steady flight found at {at.airspeed:g} m/s ({why}); "
                "try another airspeed, check thrust, CL and Cm, or trim the longitudinal model"
            )
        return point

    @classmethod
    def of(cls, at: Conditions, numbers: Mapping[str, float], rows: FloatArray) -> OnWings:
        """Return the equations of a steady flight under some conditions, free of sideslip."""
        return cls(at, numbers, rows, WING_ANGLES[at.vehicle.reduce][0])

    def sideslipping(self) -> OnWings:
        """Return the equations with a sideslip that is free, where the vehicle's equations have one."""
        return replace(self, angles=WING_ANGLES[self.at.vehicle.reduce][-1])

    @property
    def thrusts(self) -> bool:
        """Whether a thrust is among the unknowns."""
        return self.powered and self.at.vehicle.file.propulsion is not None

    @cached_property
    def unknowns(self) -> dict[str, float]:
        """Scales by name: angles and deflections, rad, then the number, N, or the channel of the thrust."""
        vehicle, propulsion = self.at.vehicle, self.at.vehicle.file.propulsion
        out = dict.fromkeys((*self.angles, *vehicle.controls), 0.1)
        if "alpha" in self.given:
            out.pop("alpha")
            out["V"] = 0.1 * vehicle.value("reference.airspeed")
        if propulsion is not None and self.thrusts:
            step = 0.1 * (vehicle.value("mass.mass") * STANDARD_GRAVITY)
            if "propulsion.speed_gain" in vehicle.rows:
                step = 20.0 / max(vehicle.value("propulsion.speed_gain"), 1e-6)
            out[THRUST if propulsion.kind == "constant" else propulsion.channel] = step
        return out

    def starts(self) -> list[FloatArray]:
        """Return scaled vectors (m,) to start from; a propeller at rest has no slope, so its thrust starts at three sizes."""
        begin = dict.fromkeys((*self.angles[2:], *self.at.vehicle.controls), 0.0)
        begin = {"alpha": 0.5, "theta": 0.5, "V": 10.0} | begin
        powered = not self.unknowns.keys() <= begin.keys()
        powers = POWERS if powered else POWERS[:1]
        return [np.array([begin.get(name, power) for name in self.unknowns]) for power in powers]

    @cached_property
    def _mixing(self) -> tuple[FloatArray, FloatArray]:
        """Channels (n_u, 1) of neutral controls, and (n_u, c) for a radian of each; by the vehicle's own gains."""
        vehicle, quiet = self.at.vehicle, self.at.quiet
        neutral = vehicle.mixed_inputs(dict.fromkeys(vehicle.controls, 0.0), quiet)
        return neutral[:, None], vehicle.mixing(vehicle.parameter_rows())[0]

    def trims(self, x: FloatArray, lanes: Lanes = ALL) -> Trims:
        """Return the flights of scaled vectors (m, B) of some lanes, their residuals still open."""
        at, vehicle, count = self.at, self.at.vehicle, x.shape[1]
        values = {name: v * s for v, (name, s) in zip(x, self.unknowns.items(), strict=True)}
        given = self.given or {"V": np.array([at.airspeed])}
        values |= {name: value if len(value) == 1 else value[lanes] for name, value in given.items()}
        start: dict[str, ArrayLike] = {name: values.pop(name) for name in ("V", *self.angles)}
        start |= {"h": at.altitude} | ({"psi": at.heading} if at.heading else {})
        controls = {name: values.pop(name) for name in vehicle.controls}
        neutral, columns = self._mixing
        inputs = neutral + columns @ np.reshape([*controls.values()], (len(controls), count))
        rows = self.lane_rows(count, lanes)
        if not self.powered and THRUST in vehicle.rows:
            rows[vehicle.rows[THRUST]] = 0.0
        for name, value in values.items():
            if name in vehicle.rows:
                rows[vehicle.rows[name]] = value
            else:
                inputs[vehicle.inputs.index(name)] = value
        return Trims(start, controls, values, inputs, rows)

    def residuals(self, x: FloatArray, lanes: Lanes = ALL) -> FloatArray:
        """Return accelerations (r, B), m/s2 and rad/s2, and where a thrust is unknown the climb angle's error."""
        balance, climb = self.balance(self.trims(x, lanes))
        return np.vstack([balance, climb - math.sin(self.at.climb_angle)]) if self.thrusts else balance

    def balance(self, found: Trims) -> tuple[FloatArray, FloatArray]:
        """Return accelerations (r, B), m/s2 and rad/s2, and the sine of the flight-path angle (B,)."""
        vehicle = self.at.vehicle
        states = vehicle.initial_states(found.start, found.rows, found.inputs)
        rates, _ = vehicle.kernel().evaluate(found.rows, states, np.ascontiguousarray(found.inputs))
        balanced = [i for i, s in enumerate(vehicle.states) if s in ("u", "v", "w", "p", "q", "r")]
        return rates[balanced], rates[vehicle.states.index("h")] / found.start["V"]


@dataclass(frozen=True, eq=False)
class OnRotors(SteadyFlight):
    """Flight on rotors at a velocity over ground; unknowns are phi, theta and four accelerations."""

    level: FloatArray  #: channels (n_u,) about which is allocated
    mixing: FloatArray  #: (m, 4), channels by accelerations

    commands = (*EXCITATIONS, *SETPOINTS)
    refused = ("climb_angle",)
    advice = "flies on its rotors here; write --velocity, e.g. --velocity 0 0 -2 to climb"

    @classmethod
    def of(cls, at: Conditions, numbers: Mapping[str, float], rows: FloatArray) -> OnRotors:
        """Return the equations of a steady flight under some conditions, allocated about a level hover."""
        level = level_channels(at)
        effects = at.vehicle.rotor_effects({"h": at.altitude}, level, numbers)
        return cls(at, numbers, rows, level, at.vehicle.rotor_allocation(effects))

    @classmethod
    def trim(cls, at: Conditions, numbers: Mapping[str, float]) -> Trim:
        """Solve from a level hover."""
        vehicle, area = at.vehicle, at.vehicle.rotor_range
        flight = cls.of(at, numbers, vehicle.parameter_rows(numbers))
        point = flight.solved([[0.0] * 6], 300)
        if not point.residual < TOLERANCE:
            raise SimulationError(
                f"{vehicle.where}: no steady flight found at {np.linalg.norm(at.velocity - at.wind):g} m/s through the air "
                f"(accelerations of {point.residual:.2g} remain); fly slower, in less wind, or check drag and thrust of the "
                "rotors"
            )
        commands = point.inputs[area.columns]
        over, under = commands - area.full, area.idle - commands
        worst = int(np.argmax(np.maximum(over, under)))
        if max(over[worst], under[worst]) > 0.0:
            limit = area.full[worst] if over[worst] > 0.0 else area.idle[worst]
            raise SimulationError(
                f"{vehicle.where}: no steady flight: {area.names[worst]} would be {commands[worst]:.3g}, and its range ends "
                f"at {limit:g}; make it lighter, move its center of gravity, or fly slower or in less wind"
            )
        return point

    def trims(self, x: FloatArray, lanes: Lanes = ALL) -> Trims:
        """Return the flights of scaled vectors (m, B) of some lanes, their residuals still open."""
        at, area, count = self.at, self.at.vehicle.rotor_range, x.shape[1]
        phi, theta, *wanted = x * ROTOR_SCALES[:, None]
        inputs = np.repeat(self.level[:, None], count, axis=1)
        inputs[area.columns] += self.mixing @ np.array(wanted)
        rotation = matrices_of_angles(np.stack([phi, theta, np.full(count, at.heading)], axis=1))
        through_air = np.einsum("bij,i->jb", rotation, at.velocity - at.wind)
        start: dict[str, ArrayLike] = dict(zip("uvw", through_air, strict=True))
        start |= {"phi": phi, "theta": theta, "psi": at.heading, "h": at.altitude}
        neutral = dict.fromkeys(at.vehicle.controls, 0.0)
        thrust = dict(zip(area.names, inputs[area.columns], strict=True))
        return Trims(start, neutral, thrust, inputs, self.lane_rows(count, lanes))

    def residuals(self, x: FloatArray, lanes: Lanes = ALL) -> FloatArray:
        """Return accelerations (6, B), m/s2 and rad/s2."""
        found = self.trims(x, lanes)
        return self.at.vehicle.accelerations(found.start, found.inputs, found.rows)


def level_channels(at: Conditions) -> FloatArray:
    """Return channels (n_u,) at which all rotors, with one common command, lift the weight in still air."""
    from scipy.optimize import brentq

    vehicle, area = at.vehicle, at.vehicle.rotor_range

    def channels(command: float) -> FloatArray:
        out = at.quiet.copy()
        out[area.columns] = command
        return out

    def sink_rate(command: float) -> float:  # its derivative, m/s2
        return float(vehicle.accelerations({"h": at.altitude}, channels(command)[:, None])[2, 0])

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
    vehicle : Vehicle
    airspeed : float, m/s, optional
        The vehicle's V* when absent.
    altitude : float, m
        Also the height above the ground, for a vehicle with a ground effect: the ground lies at zero.
    climb_angle : float, rad
        On wings, with propulsion: without it the flight is a glide.
    density : float, kg/m3, optional
        Only where the vehicle takes the density from the log; that of the standard atmosphere at the altitude when absent.
    velocity : (3,), m/s, optional
        On rotors: over ground, north-east-down; zero when absent.
    wind : (3,), m/s, optional
        Blowing north, east, down; the vehicle file's when absent.
    heading : float, rad

    Raises
    ------
    SimulationError
        No steady flight at this speed with these controls; the vehicle is too heavy, or a rotor would need more than
        its full command.
    """
    vehicle = vehicle.reduced("full") if vehicle.reduce == "lateral" else vehicle.coupled_to(())
    airspeed = airspeed if airspeed is None else within_limits("airspeed", airspeed)[0]
    (altitude,) = within_limits("altitude", altitude)
    air = np.array([vehicle.value(n, 0.0) for n in WIND_NUMBERS] if wind is None else wind, dtype=float)
    given = () if wind is None else zip(WIND_NUMBERS, air.tolist(), strict=True)
    numbers = {name: value for name, value in given if name in vehicle.rows}
    air_density = float(standard_density(np.array(altitude))) if density is None else density
    quiet = vehicle.neutral_inputs(air_density, altitude)
    speed = vehicle.value("reference.airspeed", math.nan) if airspeed is None else airspeed
    ground = np.array((0.0, 0.0, 0.0) if velocity is None else velocity, dtype=float)
    conditions = Conditions(vehicle, speed, altitude, climb_angle, ground, air, heading, quiet)
    return steady_flight(vehicle, airspeed).trim(conditions, numbers)


def steady_flight(vehicle: Vehicle, airspeed: float | None) -> type[OnWings] | type[OnRotors]:
    """Return the equations of steady flight: rotors carry a vehicle that has some where no airspeed is given."""
    return OnRotors if vehicle.rotors and airspeed is None else OnWings
