"""Steady straight flight: the paper's (14), for any vehicle file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import SimulationError
from stoop.simulation.hover import Hover, hover_about, hover_trim
from stoop.simulation.initial import initial_states, parameter_rows
from stoop.simulation.mixing import mixed_inputs
from stoop.simulation.rotors import channel_range
from stoop.simulation.steady import TOLERANCE, Trim, flies_on_rotors
from stoop.vehicle import Vehicle

OUT_OF_GROUND_EFFECT = 1e4  #: m
_POWERS = (1.0, 4.0, 16.0)  #: steps of thrust to begin with: a propeller at rest has no slope


@dataclass(frozen=True)
class _Layout:
    """Which unknown is what in the trim's vector."""

    vehicle: Vehicle
    angles: tuple[str, ...]
    controls: tuple[str, ...]
    thrust: str | None

    @property
    def scale(self) -> FloatArray:
        mass = self.vehicle.value("mass.mass") * 9.80665
        constant = self.thrust is not None and self.vehicle.file.propulsion is not None
        steps = [0.1] * (len(self.angles) + len(self.controls))
        if constant:
            steps.append(
                0.1 * mass if self.thrust == "propulsion.thrust" else _channel_step(self.vehicle, mass)
            )
        return np.array(steps)

    def split(self, x: FloatArray) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
        a, c = len(self.angles), len(self.controls)
        values = [float(v) for v in x]
        thrust = {self.thrust: values[-1]} if self.thrust is not None else {}
        return (
            dict(zip(self.angles, values[:a], strict=True)),
            dict(zip(self.controls, values[a : a + c], strict=True)),
            thrust,
        )


def _channel_step(vehicle: Vehicle, weight: float) -> float:
    if "propulsion.speed_gain" in vehicle.rows:
        return 20.0 / max(vehicle.value("propulsion.speed_gain"), 1e-6)
    return 0.1 * weight


def _layouts(vehicle: Vehicle) -> list[_Layout]:
    """Return what to solve for: first without sideslip, then with it, for who cannot hold it at zero."""
    propulsion = vehicle.file.propulsion
    thrust = None
    if propulsion is not None:
        thrust = "propulsion.thrust" if propulsion.kind == "constant" else propulsion.channel
    if vehicle.reduce == "longitudinal":
        return [_Layout(vehicle, ("alpha", "theta"), vehicle.controls, thrust)]
    angles = (("alpha", "theta", "phi"), ("alpha", "theta", "phi", "beta"))
    return [_Layout(vehicle, names, vehicle.controls, thrust) for names in angles]


def neutral_inputs(
    vehicle: Vehicle, density: float | None = None, height: float = OUT_OF_GROUND_EFFECT
) -> FloatArray:
    """Return channels at their centers, rotors and propellers at idle; density and voltage channels at their values."""
    out = np.zeros(len(vehicle.inputs))
    for control in vehicle.controls:
        for channel in vehicle.channels_of(control):
            name = f"controls.{control}.center.{channel}"
            if name in vehicle.rows:
                out[vehicle.inputs.index(channel)] = vehicle.value(name)
    if "density" in vehicle.inputs:
        out[vehicle.inputs.index("density")] = 1.225 if density is None else density
    if vehicle.file.ground_effect is not None:
        out[vehicle.inputs.index(vehicle.file.ground_effect.channel)] = height
    return _idling(vehicle, out) if vehicle.rotors else out


def _idling(vehicle: Vehicle, out: FloatArray) -> FloatArray:
    """Set the channels of rotors and of a pusher to where they give nothing, the battery to its nominal voltage."""
    area, propulsion = channel_range(vehicle), vehicle.file.propulsion
    out[area.columns] = area.idle
    if "rotors.nominal_voltage" in vehicle.rows:
        out[vehicle.inputs.index("voltage")] = vehicle.value("rotors.nominal_voltage")
    if propulsion is not None and propulsion.kind == "propeller":
        out[vehicle.inputs.index(propulsion.channel)] = vehicle.value("propulsion.idle")
    return out


@dataclass(frozen=True, eq=False)
class _Condition:
    """The equations of steady straight flight at one speed, height and climb angle."""

    layout: _Layout
    airspeed: float
    altitude: float
    climb_angle: float
    quiet: FloatArray  #: channels to start from
    numbers: Mapping[str, float] = field(default_factory=dict)  #: of the vehicle, in place of its own

    def split(self, x: FloatArray) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
        """Return angles, deflections and thrust of a scaled vector."""
        return self.layout.split(x * self.layout.scale)

    def point(self, x: FloatArray) -> Trim:
        """Return the flight that a scaled vector describes, its residual still open."""
        angles, controls, thrust = self.split(x)
        vehicle = self.layout.vehicle
        inputs = mixed_inputs(vehicle, controls, self.quiet)
        changes = {**self.numbers, **{k: v for k, v in thrust.items() if k == "propulsion.thrust"}}
        for channel in set(thrust) - set(changes):
            inputs[vehicle.inputs.index(channel)] = thrust[channel]
        start = {"V": self.airspeed, "h": self.altitude, **angles}
        return Trim(start, controls, thrust, inputs, changes, math.inf)

    def residuals(self, x: FloatArray) -> FloatArray:
        """Return accelerations, m/s2 and rad/s2, and the climb angle's error."""
        vehicle, point = self.layout.vehicle, self.point(x)
        rows = parameter_rows(vehicle, point.changes)
        states = initial_states(vehicle, point.start, rows, point.inputs)
        rates, _ = vehicle.kernel().evaluate(rows, states, point.inputs[:, None])
        watched = [i for i, s in enumerate(vehicle.states) if s in ("u", "v", "w", "p", "q", "r")]
        climb = rates[vehicle.states.index("h"), 0] / self.airspeed - math.sin(self.climb_angle)
        return np.append(rates[watched, 0], climb)


def _starts(layout: _Layout) -> list[FloatArray]:
    first = np.zeros(len(layout.scale))
    first[:2] = 0.5
    return [first] if layout.thrust is None else [np.append(first[:-1], power) for power in _POWERS]


def _solved(condition: _Condition) -> tuple[FloatArray, float]:
    """Return the scaled solution and the largest acceleration left, from the first start that leads to one."""
    from scipy.optimize import least_squares

    for first in _starts(condition.layout):
        x = least_squares(condition.residuals, first, xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=500).x
        residual = float(np.max(np.abs(condition.residuals(x))))
        if residual < TOLERANCE:
            break
    return x, residual


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
    """Find steady straight flight: without sideslip, or with it where no control can hold it at zero.

    A lateral model holds speed and incidence, so its steady flight is that of the full equations. A vehicle with
    rotors hovers, or flies on its rotors at a velocity over ground; with an airspeed it flies on its wings, rotors
    at idle.

    Parameters
    ----------
    vehicle : Vehicle
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
        No steady flight at this speed with these controls.
    """
    if flies_on_rotors(vehicle, airspeed):
        return hover_trim(
            vehicle, neutral_inputs(vehicle, density, altitude), altitude, velocity, wind, heading
        )
    if vehicle.file.reference is None:
        raise SimulationError(
            f"{vehicle.where}: it has no wings to fly {airspeed:g} m/s on; leave the airspeed out and write velocity"
        )
    if vehicle.reduce == "lateral":
        return trim(vehicle.reduced("full"), airspeed, altitude, climb_angle, density)
    V = vehicle.value("reference.airspeed") if airspeed is None else airspeed
    quiet = neutral_inputs(vehicle, density, altitude)
    for layout in _layouts(vehicle):
        condition = _Condition(layout, V, altitude, climb_angle, quiet)
        x, residual = _solved(condition)
        if residual < TOLERANCE:
            break
    angles, controls, _ = condition.split(x)
    named = {**angles, **controls}
    worst = max(named, key=lambda name: abs(named[name]))
    if not residual < TOLERANCE or abs(named[worst]) > math.pi / 2.0:
        wanting = residual >= TOLERANCE or not math.isfinite(residual)
        why = (
            f"accelerations of {residual:.2g} remain"
            if wanting
            else f"{worst} would be {named[worst]:.3g} rad"
        )
        raise SimulationError(
            f"{vehicle.where}: no steady flight found at {V:g} m/s ({why}); "
            "try another airspeed, check thrust, CL and Cm, or trim the longitudinal model"
        )
    return replace(condition.point(x), residual=residual)


def neighbors(
    vehicle: Vehicle, point: Trim, climb_angle: float = 0.0, density: float | None = None
) -> Callable[[Mapping[str, float]], Trim]:
    """Return a function that gives the trim of the vehicle with some numbers changed a little.

    It takes one Newton step from the known trim (the implicit function theorem), so its derivative by the numbers is
    exact and its error of second order. The numbers are among the changes of the trim that it returns.

    Parameters
    ----------
    vehicle : Vehicle
    point : Trim
        Of this vehicle, as :func:`trim` found it.
    climb_angle, density
        As they were given to :func:`trim`.
    """
    if vehicle.reduce == "lateral":
        return neighbors(vehicle.reduced("full"), point, climb_angle, density)
    if "V" not in point.start:
        return _near(*hover_about(vehicle, point))
    layout = next(n for n in _layouts(vehicle) if ("beta" in point.start) == ("beta" in n.angles))
    quiet = neutral_inputs(vehicle, density, point.start["h"])
    known = _Condition(layout, point.start["V"], point.start["h"], climb_angle, quiet)
    return _near(known, _scaled(layout, point))


def _near(known: _Condition | Hover, x: FloatArray) -> Callable[[Mapping[str, float]], Trim]:
    """Return the function of :func:`neighbors` for equations and the scaled vector that solves them."""
    inverse = np.linalg.pinv(_slope(known, x))

    def near(numbers: Mapping[str, float]) -> Trim:
        changed = replace(known, numbers={**known.numbers, **numbers})
        return changed.point(x - inverse @ (changed.residuals(x) - known.residuals(x)))

    return near


def _scaled(layout: _Layout, point: Trim) -> FloatArray:
    values = {**point.start, **point.deflections, **point.thrust}
    names = (*layout.angles, *layout.controls, *(() if layout.thrust is None else (layout.thrust,)))
    return np.array([values[name] for name in names]) / layout.scale


def _slope(condition: _Condition | Hover, x: FloatArray) -> FloatArray:
    """Return the derivative of the residuals by the scaled vector, by central differences."""
    step = 1e-5 * np.eye(len(x))
    return np.array([(condition.residuals(x + d) - condition.residuals(x - d)) / 2e-5 for d in step]).T
