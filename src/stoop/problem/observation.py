"""How the motion of a vehicle is observed, and the state at the first sample that follows from it.

An aircraft is observed in the air frame (airspeed and flow angles), a vehicle with rotors in the ground frame (velocity
over ground, the wind in its biases). The kind is chosen once, by :func:`observation_model`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import euler_angles, matrices_of_angles, product, quaternions_of, to_body
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, WRAPPED
from stoop.errors import FlightError
from stoop.flight.gridding import integrate_rates
from stoop.simulation import START_NAMES
from stoop.vehicle import Vehicle
from stoop.vehicle import channels as vehicle_frames
from stoop.vehicle.channels import motion_input, rigid_states
from stoop.vehicle.delays import delayed
from stoop.vehicle.schema import WIND

Number = TypeVar("Number", float, FloatArray)
START_TIME: Final = 0.2  #: s of measurements that the first state is read from
OTHER_SCALE: Final = 0.1  #: rad of a lag, m of a position; of a rotor, share of its largest x
REQUIRED: Final = {"lateral": ("V", "alpha", "theta")}  #: states that a reduced model holds as measured
REDUCED_STARTS: Final = {
    "longitudinal": ("V", "alpha", "q", "theta"),
    "lateral": ("beta", "p", "r", "phi", "psi"),
}


def through_air(start: Mapping[str, Number]) -> dict[str, Number]:
    """Turn a velocity north, east, down (less the wind) into body axes: ``u``, ``v``, ``w`` for ``vn``, ``ve``, ``vd``.

    Each entry is a number or (n,): one instant, or many.
    """
    vectors = (np.broadcast_arrays(*(start[n] for n in names)) for names in (WIND, EULER))
    ground, angles = (np.stack(vector, axis=-1) for vector in vectors)
    velocity = zip("uvw", to_body(quaternions_of(angles), ground).T, strict=True)
    kept: dict[str, Any] = {name: value for name, value in start.items() if name not in WIND}
    return kept | {name: value if value.ndim else float(value) for name, value in velocity}


def through_true_wind(vehicle: Vehicle, start: Mapping[str, Number]) -> dict[str, Number]:
    """Take the error of the wind by which they were reconstructed off flow angles, and off an airspeed that is no pitot's.

    Each entry is a number or (n,): one instant, or many.
    """
    if "sensors.wind_error.x" not in vehicle.rows or vehicle.reduce != "full":
        return dict(start)
    axes = zip(WIND, "xyz", strict=True)
    error: dict[str, Any] = {c: vehicle.value(f"sensors.wind_error.{a}") for c, a in axes}
    turned = through_air(error | {angle: start[angle] for angle in EULER})
    wind = np.stack([np.asarray(turned[axis]) for axis in "uvw"])
    V = np.asarray(start["V"])
    along = np.stack([rigid_states({**start, "V": 1.0})[axis] for axis in "uvw"]).reshape(wind.shape)
    ahead, read = np.sum(along * wind, axis=0), V
    if "sensors.V.scale" in vehicle.rows:  # V is true: how fast what was reconstructed would be
        read = ahead + np.sqrt(np.maximum(V**2 + ahead**2 - np.sum(wind**2, axis=0), 0.0))
    u, v, w = read * along - wind
    true: dict[str, Any] = {"V": np.sqrt(u**2 + v**2 + w**2), "alpha": np.arctan2(w, u)}
    true["beta"] = np.arctan2(v, np.hypot(u, w))
    found: dict[str, Any] = {n: x if x.ndim else float(x) for n, x in true.items()}
    return {**start, **found}


def at_center_of_gravity(vehicle: Vehicle, start: Mapping[str, Number]) -> dict[str, Number]:
    """Take the flow angles from the vanes to the center of gravity (first order in rate times arm over V).

    Each entry is a number or (n,): one instant, or many.
    """
    start = through_true_wind(vehicle, start)
    if "sensors.vane_position.x" not in vehicle.rows:
        return dict(start)
    center = {axis: vehicle.value(f"mass.center_of_gravity.{axis}", 0.0) for axis in "xyz"}
    x, y, z = (vehicle.value(f"sensors.vane_position.{axis}") - center[axis] for axis in "xyz")
    p, q, r = start["p"], start["q"], start["r"]
    V: Any = np.maximum(start["V"], 1.0)
    flow = {"alpha": start["alpha"] - (p * y - q * x) / V, "beta": start["beta"] - (r * x - p * z) / V}
    return {**start, **flow}


def true_values(
    vehicle: Vehicle, readings: Mapping[str, Number], numbers: FloatArray | None = None
) -> dict[str, Number]:
    """Undo reading = scale * truth + bias, and the alignment of the inertial unit, of numbers or of (n,).

    `numbers` (n_p,) are the kernel parameters of a maneuver; those of the vehicle's file when absent.
    """
    values, out = vehicle.values if numbers is None else numbers, dict[str, Any]()
    for channel, reading in readings.items():
        scale = f"sensors.{channel}.scale"
        factor: float = values[vehicle.rows[scale]] if scale in vehicle.rows else 1.0
        bias: float = values[vehicle.rows[f"sensors.{channel}.bias"]]
        out[channel] = (reading - bias) / (factor or 1.0)
    return along_body(vehicle, out, values)


def imu_axes(vehicle: Vehicle, numbers: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) that takes vectors along body axes to those of the inertial unit; numbers (n_p,)."""
    rows = [vehicle.rows.get(f"sensors.imu_alignment.{axis}") for axis in "xyz"]
    angles = [0.0 if row is None else float(numbers[row]) for row in rows]
    return np.asarray(matrices_of_angles(np.array(angles)).T)


def along_body(
    vehicle: Vehicle, truth: Mapping[str, Number], numbers: FloatArray | None = None
) -> dict[str, Number]:
    """Turn rates and specific force from the axes of the inertial unit to those of the body.

    Components that are not there, those that a reduced model holds, are taken as zero along the body.
    """
    out: dict[str, Any] = dict(truth)
    if "sensors.imu_alignment.x" not in vehicle.rows:
        return out
    mounting = imu_axes(vehicle, vehicle.values if numbers is None else numbers)
    for axes in (RATES, SPECIFIC_FORCE):
        there = [i for i, c in enumerate(axes) if c in out]
        if there:
            read = np.stack([out[axes[i]] for i in there])
            body = np.linalg.solve(mounting[np.ix_(there, there)], read.reshape(len(there), -1))
            out |= {axes[i]: x for i, x in zip(there, body.reshape(read.shape), strict=True)}
    return out


def integrated_attitude(
    vehicle: Vehicle, start: Mapping[str, float], readings: Mapping[str, FloatArray], dt: float
) -> dict[str, FloatArray]:
    """Return the attitude angles (n,), rad, that were not recorded, as the recorded rates turn the vehicle from its start.

    Without a channel for the attitude, integrated rates give its change from window to window; the angles at the start have
    their defaults. Empty where a rate was not recorded either.

    Parameters
    ----------
    vehicle : Vehicle
    start : mapping
        Angles at the first sample, rad.
    readings : mapping
        Recorded channels (n,), NaN where missing.
    dt : float
        s, sample period.
    """
    there = {c: np.flatnonzero(np.isfinite(y)) for c, y in readings.items()}
    unknown = [c for c in EULER if not there.get(c, np.empty(0)).size]
    if not unknown or not all(there.get(c, np.empty(0)).size for c in RATES):
        return {}
    samples = np.arange(len(readings["p"]))
    read = {c: np.interp(samples, there[c], readings[c][there[c]]) for c in RATES}
    rates = [*true_values(vehicle, read).values()]
    first = quaternions_of(np.array([start.get(c, 0.0) for c in EULER]))
    turned = product(np.tile(first, (len(samples), 1)), integrate_rates(np.stack(rates, axis=1), 1.0 / dt))
    return {c: y for c, y in zip(EULER, euler_angles(turned).T, strict=True) if c in unknown}


@dataclass(frozen=True, eq=False)
class ObservationModel:
    """The frame in which a kind of vehicle is observed."""

    #: prior standard deviations of initial states, deliberately wide; m/s, rad, rad/s
    start_scales: Mapping[str, float]
    open_loop: bool  #: whether a simulation stays near the record; else predictions begin anew every window
    default_start: Callable[[Vehicle], dict[str, float]]  #: initial state where nothing was measured
    #: for readings without bias and scale error
    states: Callable[[Vehicle, Mapping[str, Any]], dict[str, Any]]

    def start_names(self, vehicle: Vehicle) -> tuple[str, ...]:
        """Return the initial states that are estimated, those of lagged actuators last."""
        lags = (s for s in vehicle.states if s.endswith(".lag"))
        return (*REDUCED_STARTS.get(vehicle.reduce, tuple(self.start_scales)), *vehicle.positions, *lags)


_ROTATION_SCALES: Final = {"p": 0.2, "q": 0.2, "r": 0.2, "phi": 0.1, "theta": 0.1, "psi": 0.1}
AIR_FRAME: Final = ObservationModel(
    {"V": 2.0, "alpha": 0.1, "beta": 0.1, **_ROTATION_SCALES},
    True,
    lambda vehicle: dict.fromkeys(vehicle.start_names, 0.0) | {"V": vehicle.value("reference.airspeed")},
    at_center_of_gravity,
)  #: airspeed V and flow angles alpha, beta from vanes or an air data reconstruction
GROUND_FRAME: Final = ObservationModel(
    {"u": 5.0, "v": 5.0, "w": 2.0, **_ROTATION_SCALES},
    False,
    lambda vehicle: dict.fromkeys((*WIND, *vehicle.start_names), 0.0),
    lambda _, readings: through_air(readings),
)  #: velocity over ground; its biases are the wind, and the speed through the air is known as well as that


_MODELS: Final = {vehicle_frames.AIR_FRAME: AIR_FRAME, vehicle_frames.GROUND_FRAME: GROUND_FRAME}


def observation_model(vehicle: Vehicle) -> ObservationModel:
    """Return the observation model of a vehicle's frame."""
    return _MODELS[vehicle.frame]


def state_channels(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the channels that the initial state of this vehicle's equations is read from."""
    observed = [c for c in vehicle.outputs if c in START_NAMES or c in WIND or c in vehicle.positions]
    return (*observed, *(c for c in REQUIRED.get(vehicle.reduce, ()) if c not in observed))


def motion_inputs(vehicle: Vehicle, readings: Mapping[str, FloatArray], dt: float) -> FloatArray:
    """Return the inputs (n, m) that stand for held states, at the center of gravity and without errors of the sensors.

    `readings` are recorded channels (n,), NaN where missing: straight lines there; zero, and the reference airspeed, for what
    was not recorded. Sensors are corrected with the values of the vehicle's file.
    """
    count = len(next(iter(readings.values())))
    true = {n: np.full(count, x) for n, x in observation_model(vehicle).default_start(vehicle).items()}
    read = {}
    for channel, y in readings.items():
        there = np.flatnonzero(np.isfinite(y))
        if channel in true and there.size:
            values = np.unwrap(y[there]) if channel in WRAPPED else y[there]
            late = vehicle.value(f"sensors.{channel}.delay", 0.0) / dt
            read[channel] = delayed(np.interp(np.arange(count), there, values), -late)
    true = at_center_of_gravity(vehicle, true | true_values(vehicle, read))
    states: dict[str, FloatArray] = dict(rigid_states(true))
    for angle in EULER:
        states |= {f"sin_{angle}": np.sin(true[angle]), f"cos_{angle}": np.cos(true[angle])}
    columns = {motion_input(n): x for n, x in states.items()}
    return np.column_stack([columns[name] for name in vehicle.motion])


def recorded_motion(
    vehicle: Vehicle, inputs: FloatArray, known: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return the held channels (n,) that inputs (n_u, n) hold, SI; V and beta are `known` where the equations model them."""
    here = {n: inputs[vehicle.inputs.index(n)] for n in vehicle.motion}
    out = {c: here[motion_input(c)] for c in RATES if motion_input(c) in here}
    for angle in (a for a in EULER if motion_input(f"sin_{a}") in here):
        out[angle] = np.arctan2(here[motion_input(f"sin_{angle}")], here[motion_input(f"cos_{angle}")])
    if motion_input("u") in here:
        u, w = here[motion_input("u")], here[motion_input("w")]
        out |= {"V": np.hypot(u, w) / np.cos(known["beta"]), "alpha": np.arctan2(w, u)}
    if motion_input("v") in here:
        out["beta"] = np.arcsin(np.clip(here[motion_input("v")] / np.maximum(known["V"], 1.0), -1.0, 1.0))
    return out


def first_complete(readings: Mapping[str, FloatArray]) -> int:
    """Return the first sample at which every channel that was recorded at all has a value."""
    present = [np.isfinite(values) for values in readings.values() if np.isfinite(values).any()]
    return int(np.argmax(np.logical_and.reduce(present))) if present else 0


def guess_start(
    vehicle: Vehicle, t: FloatArray, readings: Mapping[str, FloatArray], where: str
) -> tuple[dict[str, float], list[str]]:
    """Guess the state at the first sample from a line through the first 0.2 s of each channel.

    Sensor bias, scale, alignment and vane position are undone with the vehicle file's values. Times (n,) are in s, readings
    those of :func:`state_channels`, (n,), NaN where missing; `where` is the maneuver, for messages. The start has the vehicle's
    ``start_names``, without the altitude; observed channels that were not recorded are returned too: their start is a default.
    """
    model, missing, read = observation_model(vehicle), [], dict[str, float]()
    for channel in state_channels(vehicle):
        y = readings[channel]
        present = np.isfinite(y) & (t <= t[0] + START_TIME)
        if present.any():
            values = np.unwrap(y[present]) if channel in WRAPPED else y[present]
            few = len(values) < 4
            read[channel] = float(values[0] if few else np.polyfit(t[present] - t[0], values, 1)[1])
        elif channel in REQUIRED.get(vehicle.reduce, ()):
            raise FlightError(
                f"{where}: '{channel}' was not recorded, and the {vehicle.reduce} model holds it as measured; "
                "choose another window or the full model"
            )
        else:
            missing.append(channel)
    start = model.default_start(vehicle) | {c: float(x) for c, x in true_values(vehicle, read).items()}
    return model.states(vehicle, start), missing
