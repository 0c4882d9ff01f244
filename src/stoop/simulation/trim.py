"""A steady straight flight, its recorded channels, and flights about it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from stoop.base.arrays import FloatArray
from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.base.rotations import to_ground
from stoop.simulation.initial import mixed_inputs, parameter_rows, rigid_states
from stoop.simulation.rotors import accelerations, channel_range
from stoop.vehicle import Vehicle

if TYPE_CHECKING:
    from stoop.simulation.steady_flight import SteadyFlight

OUT_OF_GROUND_EFFECT: Final = 1e4  #: m


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
        rows = parameter_rows(vehicle, changes, count)
        return Trims(self.start, self.deflections, self.thrust, inputs, rows)


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


def neutral_inputs(
    vehicle: Vehicle, density: float = SEA_LEVEL_DENSITY, height: float = OUT_OF_GROUND_EFFECT
) -> FloatArray:
    """Return channels (n_u,) at their centers, rotors and propellers at idle, the battery at its nominal voltage.

    The density, kg/m3, and the height above the ground, m, are those of the channels that have them.
    """
    file, area = vehicle.file, channel_range(vehicle)
    at = [(c, f"controls.{name}.center.{c}") for name in vehicle.controls for c in vehicle.channels_of(name)]
    at.append(("voltage", "rotors.nominal_voltage"))
    if file.propulsion is not None and file.propulsion.kind == "propeller":
        at.append((file.propulsion.channel, "propulsion.idle"))
    values = {channel: vehicle.value(number) for channel, number in at if number in vehicle.rows}
    values |= dict(zip(area.names, area.idle.tolist(), strict=True))
    values["density"] = density
    if file.ground_effect is not None:
        values[file.ground_effect.channel] = height
    return np.array([values.get(channel, 0.0) for channel in vehicle.inputs])


def surface_moments(vehicle: Vehicle, point: Trim, control: str) -> FloatArray:
    """Return p', q', r' (3,) per rad of a surface about a steady flight; zero about axes that reduced equations do not have."""
    step = 1e-3
    inputs = inputs_about(vehicle, point, {control: np.array([step, -step])}, 2)
    rows = parameter_rows(vehicle, point.changes, 2)
    kept = [axis for axis in "pqr" if axis in vehicle.states]
    up, down = accelerations(vehicle, point.start, inputs.T, rows, kept).T
    moments = dict(zip(kept, (up - down) / (2.0 * step), strict=True))
    return np.array([moments.get(axis, 0.0) for axis in "pqr"])


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
