"""States and inputs of vehicles: names, kernel parameters, initial states, and the mixing of deflections into channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from stoop.base.arrays import FloatArray
from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.base.rotations import quaternions_of
from stoop.base.text import nearest
from stoop.base.variables import EULER
from stoop.errors import SimulationError
from stoop.vehicle.schema import CHANNELS, WIND

if TYPE_CHECKING:
    from stoop.vehicle.vehicle import Vehicle

RIGID_STATES = ("u", "v", "w", "p", "q", "r", "e0", "e1", "e2", "e3", "h")
#: of the Dryden filters, m/s
GUST_STATES = {"u": ("gust.u",), **{axis: (f"gust.{axis}.fast", f"gust.{axis}.slow") for axis in "vw"}}


@dataclass(frozen=True)
class Frame:
    """Frame in which the velocity of a kind of vehicle is observed: of the air, or of the ground.

    Every package attaches to it what differs by the kind: equations, checks, the usual method, how windows begin.
    """

    outputs: tuple[str, ...]
    start: tuple[str, ...]  #: names of an initial state: m/s and rad, rad/s, rad, m
    reductions: tuple[str, ...]  #: sets of equations that it can be reduced to


#: of an aircraft: airspeed and flow angles
AIR_FRAME = Frame(CHANNELS, (*CHANNELS[:9], "h"), ("full", "longitudinal", "lateral"))
#: of a vehicle with rotors
GROUND_FRAME = Frame((*WIND, *CHANNELS[3:]), ("u", "v", "w", *CHANNELS[3:9], "h"), ("full",))


OUT_OF_GROUND_EFFECT: Final = 1e4  #: m
START_NAMES = AIR_FRAME.start  #: of a vehicle without rotors; Vehicle.start_names has those of any


def noise_input(axis: str) -> str:
    """Return the name of the white noise (unit intensity) that drives the gust along an axis."""
    return f"gust.{axis}.noise"


def motion_input(state: str) -> str:
    """Return the name of the input that stands for a state which a reduced model takes from the record."""
    return f"motion.{state}"


def slope_input(channel: str) -> str:
    """Return the name of the slope of a recorded channel, per s."""
    return f"{channel}.slope"


def parameter_rows(
    vehicle: Vehicle, changes: Mapping[str, ArrayLike] | None = None, count: int = 1
) -> FloatArray:
    """Return kernel parameters (n_p, B): the file's values, some replaced by scalars or (B,) arrays."""
    rows = np.repeat(vehicle.values[:, None], count, axis=1)
    for name, value in (changes or {}).items():
        rows[vehicle.rows[name]] = value
    return rows


def rigid_states(start: Mapping[str, ArrayLike], vehicle: Vehicle | None = None) -> dict[str, FloatArray]:
    """Return the rigid-body states (each of shape (B,)) of an initial state; absent entries are zero.

    The velocity is given by V, alpha and beta, or along the body axes by u, v and w. The quaternion of a `vehicle` that takes
    angles from the record holds the others only.
    """
    names = (GROUND_FRAME if any(axis in start for axis in "uvw") else AIR_FRAME).start
    shapes = (np.shape(v) for k, v in start.items() if k in names)
    zero = np.zeros(np.broadcast_shapes(*shapes) or (1,))
    g = {name: zero + np.asarray(start.get(name, 0.0), dtype=float) for name in names}
    if "V" in g:
        plane = g["V"] * np.cos(g["beta"])
        g |= {
            "u": plane * np.cos(g["alpha"]),
            "v": g["V"] * np.sin(g["beta"]),
            "w": plane * np.sin(g["alpha"]),
        }
    turned = EULER if vehicle is None or not vehicle.motion else vehicle.modeled_angles
    e = quaternions_of(np.stack([g[a] if a in turned else zero for a in EULER], axis=-1))
    return {n: g[n] for n in "uvwhpqr"} | {f"e{i}": e[..., i] for i in range(4)}


def initial_states(
    vehicle: Vehicle,
    start: Mapping[str, ArrayLike],
    rows: FloatArray,
    inputs: FloatArray,
    rigid: Mapping[str, FloatArray] | None = None,
) -> FloatArray:
    """Return kernel states (n_x, B).

    Parameters
    ----------
    start : mapping
        The vehicle's ``start_names`` -> scalar or (B,); ``NAME.lag`` adds to a lagged deflection, rad, or to x
        of a rotor; absent gust states, m/s, are zero.
    rows : (n_p, B) array
        Kernel parameters of each candidate.
    inputs : (n_u,) array
        Recorded channels at the start: a lagged surface or rotor starts at its command.
    rigid : mapping, optional
        Rigid-body states, where they are known; those of :func:`rigid_states` when absent.
    """
    rigid = rigid_states(start, vehicle) if rigid is None else rigid
    out = np.empty((len(vehicle.states), rows.shape[1]))
    for i, name in enumerate(vehicle.states):
        if name.endswith(".lag"):
            command = vehicle.commanded(name.removesuffix(".lag"), rows, inputs)
            out[i] = command + np.asarray(start.get(name, 0.0))
        else:
            out[i] = rigid[name] if name in rigid else np.asarray(start.get(name, 0.0))
    return out


def check_states(vehicle: Vehicle, states: Mapping[str, float]) -> None:
    """Refuse an initial state, SI, that the vehicle does not have, or that is not finite: SimulationError."""
    known = (*vehicle.start_names, *(name for name in vehicle.states if name.endswith(".lag")))
    for name, value in states.items():
        if name not in known:
            raise SimulationError(f"initial state: no state is called '{name}'; {nearest(name, known)}")
        if not (np.issubdtype(np.asarray(value).dtype, np.number) and np.isfinite(value)):
            raise SimulationError(f"initial state: {name} is {value}; give a finite number, SI")


def commanded(vehicle: Vehicle, control: str, rows: FloatArray, inputs: FloatArray) -> FloatArray:
    """Return the commanded deflection of a control, rad, or the commanded x of a rotor, in its own unit, (B,).

    `rows` are kernel parameters (n_p, B), `inputs` recorded channels (n_u,) or (n_u, B).
    """
    index = vehicle.rows
    if control in vehicle.file.rotor:
        column = vehicle.inputs.index(vehicle.file.rotor[control].channel)
        raw = rows[index["rotors.gain"]] * (inputs[column] - rows[index["rotors.idle"]])
        if "rotors.nominal_voltage" in index:
            raw = raw * inputs[vehicle.inputs.index("voltage")] / rows[index["rotors.nominal_voltage"]]
        return np.asarray(np.maximum(raw, 0.0))

    def number(name: str, default: float) -> FloatArray:
        name = f"controls.{control}.{name}"
        return rows[index[name]] if name in index else np.full(rows.shape[1], default)

    total = number("offset", 0.0)
    for channel in vehicle.channels_of(control):
        centered = inputs[vehicle.inputs.index(channel)] - number(f"center.{channel}", 0.0)
        total = total + number(f"mix.{channel}", 1.0) * centered
    return np.asarray(total)


def mixed_inputs(vehicle: Vehicle, deflections: Mapping[str, float], base: FloatArray) -> FloatArray:
    """Return recorded channels (n_u,) for deflections by control, rad: the smallest change of `base` (n_u,)."""
    names = vehicle.controls
    if not names:
        return base
    rows = vehicle.parameter_rows()
    now = np.array([vehicle.commanded(c, rows, base)[0] for c in names])
    wanted = np.array([deflections.get(c, n) for c, n in zip(names, now, strict=True)])
    return np.asarray(base + vehicle.mixing(rows)[0] @ (wanted - now))


def mixing(vehicle: Vehicle, rows: FloatArray) -> FloatArray:
    """Return the smallest changes of the channels (B, n_u, c) for one radian of each control, by kernel parameters (n_p, B)."""
    gains = vehicle.channel_gains(rows)
    return np.asarray(np.linalg.pinv(gains)) if vehicle.controls else gains.transpose(0, 2, 1)


def channel_gains(vehicle: Vehicle, rows: FloatArray) -> FloatArray:
    """Return the changes of the controls (B, c, n_u), rad, for one unit of each channel, by kernel parameters (n_p, B)."""
    gains = np.zeros((rows.shape[1], len(vehicle.controls), len(vehicle.inputs)))
    for j, control in enumerate(vehicle.controls):
        for channel in vehicle.channels_of(control):
            row = vehicle.rows.get(f"controls.{control}.mix.{channel}")
            gains[:, j, vehicle.inputs.index(channel)] = 1.0 if row is None else rows[row]
    return gains


def neutral_inputs(
    vehicle: Vehicle, density: float = SEA_LEVEL_DENSITY, height: float = OUT_OF_GROUND_EFFECT
) -> FloatArray:
    """Return channels (n_u,) at their centers, rotors and propellers at idle, the battery at its nominal voltage.

    The density, kg/m3, and the height above the ground, m, are those of the channels that have them.
    """
    file, area = vehicle.file, vehicle.rotor_range
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


def model_inputs(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of the linear model's inputs: controls, then channels of thrust and rotors."""
    propulsion = vehicle.file.propulsion
    channels = [rotor.channel for rotor in vehicle.file.rotor.values()]
    if propulsion is not None and propulsion.kind != "constant":
        channels.insert(0, propulsion.channel)
    return tuple(dict.fromkeys((*vehicle.controls, *channels)))


def model_mixing(vehicle: Vehicle, rows: FloatArray) -> FloatArray:
    """Return the channels (B, n_u, m) for one unit of each of the inputs of linear models, by kernel parameters (n_p, B)."""
    direct = [vehicle.inputs.index(name) for name in vehicle.model_inputs()[len(vehicle.controls) :]]
    single = np.eye(len(vehicle.inputs))[:, direct]
    single = np.broadcast_to(single, (rows.shape[1], *single.shape))
    return np.concatenate([vehicle.mixing(rows), single], axis=2)


_PRODUCTS: Final = (("xx", "xy", "xz"), ("xy", "yy", "yz"), ("xz", "yz", "zz"))


def inertia_tensor(vehicle: Vehicle) -> FloatArray:
    """Return the tensor (3, 3) about the center of gravity, kg m2, axes forward, right, down."""
    products = np.array([[vehicle.value(f"mass.inertia.{n}", 0.0) for n in row] for row in _PRODUCTS])
    return np.asarray(products * (2.0 * np.eye(3) - 1.0))
