"""Steady flight on rotors: hover, or any velocity over ground in any wind."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import matrices_of_angles
from stoop.errors import SimulationError
from stoop.simulation.rotors import accelerations, allocation, channel_range, effects
from stoop.simulation.steady import TOLERANCE, Trim
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import WIND_NUMBERS

_MOST = 1e6  #: of a channel without bound
_STEPS = np.array([0.1, 0.1, 1.0, 1.0, 1.0, 1.0])  #: of the unknowns: rad, rad/s2, m/s2


def steady_wind(vehicle: Vehicle, wind: Sequence[float] | None) -> FloatArray:
    """Return the wind that blows north, east, down, m/s: the vehicle file's, if it has one, where none is asked for."""
    if wind is not None:
        return np.array(wind, dtype=float)
    return np.array([vehicle.value(n) if n in vehicle.rows else 0.0 for n in WIND_NUMBERS])


@dataclass(frozen=True, eq=False)
class Hover:
    """The equations of steady flight on rotors; unknowns, scaled, are phi, theta and four accelerations."""

    vehicle: Vehicle
    velocity: FloatArray  #: over ground, m/s north-east-down
    wind: FloatArray  #: blowing north, east, down, m/s
    heading: float
    altitude: float
    level: FloatArray  #: channels (n_u,) about which is allocated
    mixing: FloatArray  #: (m, 4)
    numbers: Mapping[str, float] = field(default_factory=dict)  #: of the vehicle, in place of its own

    def point(self, x: FloatArray) -> Trim:
        """Return the flight that a scaled vector describes, its residual still open."""
        phi, theta, *wanted = (x * _STEPS).tolist()
        area, inputs = channel_range(self.vehicle), self.level.copy()
        inputs[area.columns] += self.mixing @ wanted
        rotation = matrices_of_angles(np.array([phi, theta, self.heading]))
        u, v, w = (rotation.T @ (self.velocity - self.wind)).tolist()
        start = {
            "u": u, "v": v, "w": w, "phi": phi, "theta": theta, "psi": self.heading, "h": self.altitude,
        }  # fmt: skip
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


def hover_about(vehicle: Vehicle, point: Trim) -> tuple[Hover, FloatArray]:
    """Return the equations of a known trim on rotors, and the scaled vector that solves them."""
    s = point.start
    mixing = allocation(vehicle, effects(vehicle, s, point.inputs, point.changes))
    velocity, wind = np.array(point.velocity), np.array(point.wind)
    known = Hover(vehicle, velocity, wind, s["psi"], s["h"], point.inputs, mixing, point.changes)
    return known, np.array([s["phi"], s["theta"], 0.0, 0.0, 0.0, 0.0]) / _STEPS


def hover_trim(
    vehicle: Vehicle,
    quiet: FloatArray,
    altitude: float = 200.0,
    velocity: Sequence[float] | None = None,
    wind: Sequence[float] | None = None,
    heading: float = 0.0,
) -> Trim:
    """Find steady flight on rotors; surfaces are neutral, a pusher is off.

    Among the channels that hold it, those are taken that differ least from one and the same command for all rotors.

    Parameters
    ----------
    vehicle : Vehicle
    quiet : (n_u,) array
        All other channels.
    altitude : float, m
    velocity : (3,), m/s
        Over ground, north-east-down; zero when absent.
    wind : (3,), m/s
        Blowing north, east, down; the vehicle file's when absent.
    heading : float, rad

    Raises
    ------
    SimulationError
        It is too heavy, a rotor would need more than its full command, or there is no steady flight.
    """
    ground = np.array((0.0, 0.0, 0.0) if velocity is None else velocity, dtype=float)
    air = steady_wind(vehicle, wind)
    changes = {} if wind is None else dict(zip(WIND_NUMBERS, air.tolist(), strict=True))
    level = _level(vehicle, quiet, altitude)
    at = {"h": altitude}
    mixing = allocation(vehicle, effects(vehicle, at, level, changes))
    point = _solved(Hover(vehicle, ground, air, heading, altitude, level, mixing, changes))
    _check_range(vehicle, point)
    return point


def _level(vehicle: Vehicle, quiet: FloatArray, altitude: float) -> FloatArray:
    """Return channels in which all rotors, commanded alike, lift the weight in still air."""
    from scipy.optimize import brentq

    area = channel_range(vehicle)

    def channels(command: float) -> FloatArray:
        out = quiet.copy()
        out[area.columns] = command
        return out

    def sinks(command: float) -> float:
        return float(accelerations(vehicle, {"h": altitude}, channels(command)[:, None], {})[2, 0])

    low, high = float(area.idle[0]), _lifting(sinks, float(area.idle[0]), float(area.full.min()))
    gravity = vehicle.value("environment.gravity")
    if not sinks(high) < 0.0:
        share = 1.0 - sinks(high) / gravity
        raise SimulationError(
            f"{vehicle.where}: it is too heavy to hover: at full command ({high:g}) the rotors lift {share:.0%} of the "
            "weight; check mass, T2 and gain, or the voltage"
        )
    if not sinks(low) > 0.0:
        raise SimulationError(
            f"{vehicle.where}: it rises with its rotors at idle ({low:g}); check mass, T0 and idle"
        )
    return channels(float(brentq(sinks, low, high, xtol=1e-12 * high)))


def _lifting(sinks: Callable[[float], float], low: float, full: float) -> float:
    """Return a command that lifts, or the largest there is."""
    if math.isfinite(full):
        return full
    step = 1.0
    while low + step < _MOST and sinks(low + step) >= 0.0:
        step *= 2.0
    return low + step


def _solved(equations: Hover) -> Trim:
    from scipy.optimize import least_squares

    x = least_squares(equations.residuals, np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=300).x
    residual = float(np.max(np.abs(equations.residuals(x))))
    if not residual < TOLERANCE:
        speed = float(np.linalg.norm(equations.velocity - equations.wind))
        raise SimulationError(
            f"{equations.vehicle.where}: no steady flight found at {speed:g} m/s through the air (accelerations of "
            f"{residual:.2g} remain); fly slower, in less wind, or check drag and thrust of the rotors"
        )
    return replace(equations.point(x), residual=residual)


def _check_range(vehicle: Vehicle, point: Trim) -> None:
    area = channel_range(vehicle)
    commands = point.inputs[area.columns]
    over, under = commands - area.full, area.idle - commands
    worst = int(np.argmax(np.maximum(over, under)))
    if max(over[worst], under[worst]) <= 0.0:
        return
    limit = area.full[worst] if over[worst] > 0.0 else area.idle[worst]
    raise SimulationError(
        f"{vehicle.where}: no steady flight: {area.names[worst]} would be {commands[worst]:.3g}, and its range ends at "
        f"{limit:g}; make it lighter, move its center of gravity, or fly slower or in less wind"
    )
