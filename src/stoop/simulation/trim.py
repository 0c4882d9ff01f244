"""A steady straight flight, its recorded channels, and flights about it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.atmosphere import standard_density
from stoop.base.rotations import to_ground
from stoop.vehicle import Vehicle
from stoop.vehicle.channels import rigid_states
from stoop.vehicle.defaults import WIND_NUMBERS

if TYPE_CHECKING:
    from stoop.simulation.steady_flight import SteadyFlight


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
    #: the equations that it solves, and their solution, scaled; None for a state that was given
    solution: tuple[SteadyFlight, FloatArray] | None = field(default=None, repr=False, compare=False)

    @property
    def on_wings(self) -> bool:
        """Whether wings carry the vehicle, not rotors."""
        return "V" in self.start

    @property
    def climb_angle(self) -> float:
        """Angle of the flight path on wings, rad."""
        states = rigid_states(self.start)
        names = ("uvw", ("e0", "e1", "e2", "e3"))
        velocity, e = (np.stack([states[n] for n in own], axis=-1) for own in names)
        north, east, down = to_ground(e, velocity)[0].tolist()
        return math.atan2(-down, math.hypot(north, east))

    def lanes(self, vehicle: Vehicle, numbers: Mapping[str, FloatArray] | None = None) -> Trims:
        """Return this flight of a vehicle with some numbers changed, (B,) each; a single lane without any."""
        changes: dict[str, ArrayLike] = {**self.changes, **(numbers or {})}
        count = max((len(x) for x in (numbers or {}).values()), default=1)
        inputs = np.repeat(self.inputs[:, None], count, axis=1)
        rows = vehicle.parameter_rows(changes, count)
        return Trims(self.start, self.deflections, self.thrust, inputs, rows)

    def inputs_about(self, vehicle: Vehicle, signals: Mapping[str, FloatArray], count: int) -> FloatArray:
        """Return recorded channels (n, n_u) of a trim, plus changes of controls and of single channels.

        `signals` are changes (n,) by control, rad, or by channel, its unit; mixing is affine, so one column per control is
        enough.
        """
        out = np.repeat(self.inputs[None, :], count, axis=0)
        for name, signal in signals.items():
            if name in vehicle.controls:
                deflections = {**self.deflections, name: self.deflections[name] + 1.0}
                out += np.outer(signal, vehicle.mixed_inputs(deflections, self.inputs) - self.inputs)
            else:
                out[:, vehicle.inputs.index(name)] += signal
        return out

    def surface_moments(self, vehicle: Vehicle, control: str) -> FloatArray:
        """Return p', q', r' (3,) per rad of a surface; zero about axes that reduced equations do not have."""
        step = 1e-3
        inputs = self.inputs_about(vehicle, {control: np.array([step, -step])}, 2)
        rows = vehicle.parameter_rows(self.changes, 2)
        kept = [axis for axis in "pqr" if axis in vehicle.states]
        up, down = vehicle.accelerations(self.start, inputs.T, rows, kept).T
        moments = dict(zip(kept, (up - down) / (2.0 * step), strict=True))
        return np.array([moments.get(axis, 0.0) for axis in "pqr"])

    def over_ground(self, vehicle: Vehicle, states: FloatArray) -> FloatArray:
        """Return velocities (n, 3) over ground of states (n, n_x), which are relative to the steady wind."""
        x = dict(zip(vehicle.states, states.T, strict=True))
        zero = np.zeros(len(states))
        body, q = ([x.get(name, zero) for name in names] for names in ("uvw", ("e0", "e1", "e2", "e3")))
        return np.asarray(to_ground(np.column_stack(q), np.column_stack(body)) + np.asarray(self.wind))

    def numbers_set(self, vehicle: Vehicle) -> dict[str, float]:
        """Return the numbers that a trim set to a value other than the vehicle file's (by 0.1 %), less the wind."""
        changed = [(n, x, vehicle.value(n)) for n, x in self.changes.items() if n not in WIND_NUMBERS]
        return {name: value for name, value, own in changed if abs(value - own) > 1e-3 * abs(own)}

    def neighbors(self) -> Callable[[Mapping[str, FloatArray]], Trims]:
        """Return a function that gives the trims of the vehicle with some numbers slightly changed, (B,) each.

        It takes one Newton step from the known trim (the implicit function theorem): its derivative by the numbers is
        exact, its error of second order.
        """
        if self.solution is None:
            raise ValueError("a state that was given is no trim")
        known, x = self.solution
        step = 1e-5 * np.eye(len(x))
        ends = known.residuals(x[:, None] + np.hstack([step, -step]))
        inverse = np.linalg.pinv((ends[:, : len(x)] - ends[:, len(x) :]) / 2e-5)

        def near(numbers: Mapping[str, FloatArray]) -> Trims:
            count = len(next(iter(numbers.values())))
            rows = known.at.vehicle.parameter_rows({**known.numbers, **numbers}, count)
            changed, start = replace(known, rows=rows), np.repeat(x[:, None], count, axis=1)
            return changed.trims(start - inverse @ (changed.residuals(start) - known.residuals(start[:, :1])))

        return near

    def density(self, vehicle: Vehicle) -> float:
        """Return the density of a steady flight, kg/m3: that of its channel, of the standard atmosphere, or the vehicle's."""
        choice = vehicle.file.environment.density
        if choice == "log":
            return float(self.inputs[vehicle.inputs.index("density")])
        if choice == "standard":
            return float(standard_density(np.array(self.start.get("h", 0.0))))
        return vehicle.value("environment.density")


@dataclass(frozen=True, eq=False)
class Trims:
    """Steady flights of one vehicle whose numbers differ, one a lane; SI and rad.

    Attributes
    ----------
    start, deflections, thrust : mappings of str to (B,) or number
        As of :class:`Trim`.
    inputs : (n_u, B) array
    rows : (n_p, B) array
        Kernel parameters, those among them that the trim sets.
    """

    start: Mapping[str, ArrayLike]
    deflections: Mapping[str, ArrayLike]
    thrust: Mapping[str, ArrayLike]
    inputs: FloatArray
    rows: FloatArray


@dataclass(frozen=True)
class Flown:
    """A simulated flight without sensor noise."""

    trim: Trim
    time: FloatArray  #: (n,), s
    inputs: FloatArray  #: (n, n_u), recorded channels
    outputs: FloatArray  #: (n, n_y), noise-free readings in the order of ``vehicle.outputs``
    #: (n, 3), over ground, m/s; of aircraft only in the wind of a maneuver
    velocity: FloatArray | None = None
    clipped: BoolArray | None = None  #: (n, m), on rotors: where a channel reached an end of its range
    states: FloatArray | None = None  #: (n, n_x), on rotors


def traveled(velocity: FloatArray, dt: float) -> FloatArray:
    """Return positions (n, 3), m, from velocities (n, 3) by the trapezoidal rule, starting at zero."""
    steps = 0.5 * dt * (velocity[1:] + velocity[:-1])
    return np.vstack([np.zeros((1, velocity.shape[1])), np.cumsum(steps, axis=0)])
