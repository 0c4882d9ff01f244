"""How the motion of a vehicle is observed, and the state at the first sample that follows from it.

An aircraft is observed in the air frame (airspeed and flow angles), a vehicle with rotors in the ground frame (velocity
over ground, the wind in its biases); :attr:`Vehicle.frame` is the kind.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Final, TypeVar

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of, to_body
from stoop.base.variables import EULER, WRAPPED
from stoop.errors import FlightError
from stoop.simulation import START_NAMES
from stoop.vehicle import Vehicle
from stoop.vehicle.schema import WIND
from stoop.vehicle.vehicle import AIR_FRAME, GROUND_FRAME, Frame

Number = TypeVar("Number", float, FloatArray)
START_TIME: Final = 0.2  #: s of measurements that the first state is read from
LAG_SCALE: Final = 0.1  #: rad; of a rotor, share of its largest x
REQUIRED: Final = {"lateral": ("V", "alpha", "theta")}  #: states that a reduced model holds as measured
REDUCED_STARTS: Final = {
    "longitudinal": ("V", "alpha", "q", "theta"),
    "lateral": ("beta", "p", "r", "phi", "psi"),
}
_ROTATION_SCALES: Final = {"p": 0.2, "q": 0.2, "r": 0.2, "phi": 0.1, "theta": 0.1, "psi": 0.1}


class ObservationModel(ABC):
    """The frame in which a kind of vehicle is observed.

    Attributes
    ----------
    start_scales : mapping
        Prior standard deviation of each initial state about its guess, deliberately wide; m/s, rad, rad/s.
    open_loop : bool
        Whether a simulation from the first sample stays near the record; else predictions begin anew every window.
    """

    start_scales: ClassVar[Mapping[str, float]]
    open_loop: ClassVar[bool]

    @abstractmethod
    def default_start(self, vehicle: Vehicle) -> dict[str, float]:
        """Return the initial state where nothing was measured."""

    @abstractmethod
    def states(self, vehicle: Vehicle, readings: Mapping[str, Number]) -> dict[str, Number]:
        """Return the states for readings without bias and scale error; each entry is a number or (n,)."""

    def start_names(self, vehicle: Vehicle) -> tuple[str, ...]:
        """Return the initial states that are estimated, those of lagged actuators last."""
        lags = (s for s in vehicle.states if s.endswith(".lag"))
        return (*REDUCED_STARTS.get(vehicle.reduce, tuple(self.start_scales)), *lags)


class AirFrame(ObservationModel):
    """Airspeed V and flow angles alpha, beta from vanes or an air data reconstruction."""

    start_scales: ClassVar[Mapping[str, float]] = {"V": 2.0, "alpha": 0.1, "beta": 0.1, **_ROTATION_SCALES}
    open_loop = True

    def default_start(self, vehicle: Vehicle) -> dict[str, float]:
        """Return straight flight at the reference airspeed."""
        return dict.fromkeys(vehicle.start_names, 0.0) | {"V": vehicle.value("reference.airspeed")}

    def states(self, vehicle: Vehicle, readings: Mapping[str, Number]) -> dict[str, Number]:
        """Return the readings with the flow angles at the center of gravity."""
        return at_center_of_gravity(vehicle, dict(readings))


class GroundFrame(ObservationModel):
    """Velocity over ground; its biases are the wind, and the speed through the air is known as well as that."""

    start_scales: ClassVar[Mapping[str, float]] = {"u": 5.0, "v": 5.0, "w": 2.0, **_ROTATION_SCALES}
    open_loop = False

    def default_start(self, vehicle: Vehicle) -> dict[str, float]:
        """Return rest."""
        return dict.fromkeys((*WIND, *vehicle.start_names), 0.0)

    def states(self, vehicle: Vehicle, readings: Mapping[str, Number]) -> dict[str, Number]:
        """Return the readings with the velocity through the air in body axes."""
        return through_air(readings)


_MODELS: Final[Mapping[Frame, ObservationModel]] = {AIR_FRAME: AirFrame(), GROUND_FRAME: GroundFrame()}


def observation_model(vehicle: Vehicle) -> ObservationModel:
    """Return the observation model of a vehicle's frame."""
    return _MODELS[vehicle.frame]


def state_channels(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the channels that the initial state of this vehicle's equations is read from."""
    observed = [c for c in vehicle.outputs if c in START_NAMES or c in WIND]
    return (*observed, *(c for c in REQUIRED.get(vehicle.reduce, ()) if c not in observed))


def first_complete(readings: Mapping[str, FloatArray]) -> int:
    """Return the first sample at which every channel that was recorded at all has a value."""
    present = [np.isfinite(values) for values in readings.values() if np.isfinite(values).any()]
    together = np.logical_and.reduce(present) if present else np.ones(1, dtype=np.bool_)
    return int(np.argmax(together)) if together.any() else 0


def guess_start(
    vehicle: Vehicle, t: FloatArray, readings: Mapping[str, FloatArray], where: str
) -> tuple[dict[str, float], list[str]]:
    """Guess the state at the first sample from a line through the first 0.2 s of each channel.

    Sensor bias, scale and vane position are undone with the vehicle file's values.

    Parameters
    ----------
    t : (n,), s
    readings : mapping
        Channel of :func:`state_channels` -> (n,), NaN where missing.
    where : str
        The maneuver, for messages.

    Returns
    -------
    start : dict
        By the vehicle's ``start_names``, without the altitude.
    missing : list of str
        Observed channels that were not recorded: their start is a default.
    """
    model = observation_model(vehicle)
    start = model.default_start(vehicle)
    missing = []
    for channel in state_channels(vehicle):
        value = _line_at_start(t, readings[channel], channel in WRAPPED)
        if value is not None:
            start[channel] = true_value(vehicle, channel, value)
        elif channel in REQUIRED.get(vehicle.reduce, ()):
            raise FlightError(
                f"{where}: '{channel}' was not recorded, and the {vehicle.reduce} model holds it as measured; "
                "choose another window or the full model"
            )
        else:
            missing.append(channel)
    return model.states(vehicle, start), missing


def _line_at_start(t: FloatArray, y: FloatArray, angle: bool) -> float | None:
    present = np.isfinite(y) & (t <= t[0] + START_TIME)
    if not present.any():
        return None
    early, values = t[present] - t[0], np.unwrap(y[present]) if angle else y[present]
    if present.sum() < 4:
        return float(values[0])
    return float(np.polyfit(early, values, 1)[1])


def through_air(start: Mapping[str, Number]) -> dict[str, Number]:
    """Turn a velocity north, east, down (less the wind) into body axes: ``u``, ``v``, ``w`` for ``vn``, ``ve``, ``vd``.

    Each entry is a number or (n,): one instant, or many.
    """
    ground, angles = (
        np.stack(np.broadcast_arrays(*(start[n] for n in names)), axis=-1)
        for names in (("vn", "ve", "vd"), EULER)
    )
    u, v, w = to_body(quaternions_of(angles), ground).T
    kept: dict[str, Any] = {name: value for name, value in start.items() if name not in WIND}
    return kept | {
        name: value if value.ndim else float(value) for name, value in zip("uvw", (u, v, w), strict=True)
    }


def true_value(vehicle: Vehicle, channel: str, reading: Number, numbers: FloatArray | None = None) -> Number:
    """Undo reading = scale * truth + bias, of one reading or of (n,).

    `numbers` (n_p,) are the kernel parameters of a maneuver; those of the vehicle's file when absent.
    """
    values = vehicle.values if numbers is None else numbers
    scale = f"sensors.{channel}.scale"
    factor: float = values[vehicle.rows[scale]] if scale in vehicle.rows else 1.0
    bias: float = values[vehicle.rows[f"sensors.{channel}.bias"]]
    return (reading - bias) / (factor or 1.0)


def at_center_of_gravity(vehicle: Vehicle, start: dict[str, Number]) -> dict[str, Number]:
    """Take the flow angles from the vanes to the center of gravity (first order in rate times arm over V).

    Each entry is a number or (n,): one instant, or many.
    """
    if "sensors.vane_position.x" not in vehicle.rows:
        return start
    x, y, z = (
        vehicle.value(f"sensors.vane_position.{axis}")
        - (vehicle.value(center) if (center := f"mass.center_of_gravity.{axis}") in vehicle.rows else 0.0)
        for axis in "xyz"
    )
    p, q, r = start["p"], start["q"], start["r"]
    V: Any = np.maximum(start["V"], 1.0)
    flow = {"alpha": start["alpha"] - (p * y - q * x) / V, "beta": start["beta"] - (r * x - p * z) / V}
    return {**start, **flow}
