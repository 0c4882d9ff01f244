"""A log of the V-tail as PX4 writes it, of a simulated flight: closed loop, gusts, dropouts, faulty pitot, time on the ground."""

from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.simulation import trim
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, parse_vehicle, trajectories
from stoop_plan.log_bytes import Topic, ulog, ulog_dropout

EXAMPLE: Final = Path(__file__).parents[2] / "examples" / "vtail.toml"
GROUND, AIRBORNE, RATE = 12.0, 62.0, 50.0  #: s on the ground, s in the air, Hz
WIND: Final = (-1.5, -3.2)  #: m/s, north and east
SCALE, OFFSET = 0.93, -3.0  #: of the pitot: it reads SCALE V + OFFSET
#: control, shape, start [s after take-off], step [s], size
INPUTS = (
    ("control_roll", "pulse", 3.0, 26.0, 0.35), ("control_roll", "doublet", 34.0, 0.6, 0.35),
    ("control_pitch", "3-2-1-1", 40.0, 0.35, 0.25), ("control_yaw", "doublet", 47.0, 0.8, 0.35),
    ("control_roll", "doublet", 55.0, 0.6, -0.35),
)  # fmt: skip
WINDOWS = ("146.5:152", "152.5:158.5", "159.5:167")  #: of roll, pitch and yaw, s of the clock
VALIDATE = "167.5:174"
LAW = {
    "control_roll": {"phi": -0.8, "p": -0.15}, "control_pitch": {"theta": -0.6, "q": -0.1}, "control_throttle": {"V": -0.04},
}  #: of the autopilot, per rad, rad/s and m/s above trim  # fmt: skip
LAW_ORDER = ("control_roll", "control_pitch", "control_yaw", "control_throttle")
NOISE = dict.fromkeys(EULER, 0.002) | dict.fromkeys(RATES, 0.006) | dict.fromkeys(SPECIFIC_FORCE, 0.12)
START: Final = 100.0  #: s of the clock
LOST = ((148.9, 149.2), (168.6, 169.0))  #: s of the clock: nothing was recorded
GUSTS = "\n[turbulence]\nairspeed = 24.0\n" + "".join(
    f"{a} = {{intensity = 0.4, length = 50}}\n" for a in "uvw"
)


def flown(truth: Vehicle, seed: int = 1) -> dict[str, FloatArray]:
    """Return what happens, without noise: outputs of the vehicle, velocity over ground, height and commands."""
    rng, dt = np.random.default_rng(seed), 1.0 / RATE
    vehicle = parse_vehicle(truth.text + GUSTS, "truth").with_numbers({})
    inputs = [
        {"control": c, "shape": shape, "start": start, "amplitude": size, "duration" if shape == "pulse" else "step": step}
        for c, shape, start, step, size in INPUTS
    ]  # fmt: skip
    maneuver = Maneuver.model_validate({"duration": AIRBORNE, "rate": RATE, "input": inputs})
    count, point = len(maneuver.time), trim(vehicle, None, 250.0)
    commands = point.inputs_about(vehicle, maneuver.deflections(), count)
    rows = vehicle.parameter_rows(point.changes)
    gains = np.zeros((len(vehicle.inputs), len(vehicle.outputs)))
    for control, law in LAW.items():
        for channel, gain in law.items():
            gains[vehicle.inputs.index(control), vehicle.outputs.index(channel)] = gain
    level = np.array([point.start.get(c, 0.0) for c in vehicle.outputs])
    errors = np.array([NOISE.get(c, 0.1) for c in vehicle.outputs]) * rng.standard_normal((count, len(level)))
    gusts = trajectories.gust_noise(vehicle, count, dt, rng)
    states = np.empty((count, len(vehicle.states)))
    begin = {**point.start, **vehicle.gust_start(rng)}
    states[0] = vehicle.initial_states(begin, rows, commands[0])[:, 0]
    for k in range(count - 1):
        read = vehicle.readings_along(rows, states[k : k + 1], commands[k : k + 1])[0]
        commands[k + 1] += gains @ (read + errors[k] - level)
        noise = gusts[trajectories.FINER * k : trajectories.FINER * (k + 1) + 1]
        states[k + 1] = vehicle.next_states(
            rows, states[k][:, None], commands[k : k + 2][:, :, None], [noise], dt
        )[:, 0]
    readings = vehicle.readings_along(rows, states, commands)
    columns = dict(zip(vehicle.outputs, readings.T, strict=True))
    over_ground = point.over_ground(vehicle, states) + np.array([*WIND, 0.0])
    columns |= dict(zip(VELOCITY, over_ground.T, strict=True))
    columns |= {c: commands[:, i] for i, c in enumerate(vehicle.recorded)}
    return columns | {"altitude": states[:, vehicle.states.index("h")]}


def write(path: Path, truth: Vehicle, seed: int = 1) -> Path:
    """Write the log: sensors with noise and a bias, slow topics every fifth sample, and no row where nothing was recorded."""
    rng, still = np.random.default_rng([seed, 1]), round(GROUND * RATE)
    rest = {"az": -9.80665, "altitude": 250.0, "density": 1.17, "control_throttle": 0.0}
    told = flown(truth, seed)
    columns = {n: np.concatenate([np.full(still, rest.get(n, 0.0)), x]) for n, x in told.items()}
    time = START + np.arange(len(columns["p"])) / RATE
    time[still:] += 1.0  # the logger began anew at take-off
    for name, sigma in (*NOISE.items(), ("vn", 0.05), ("ve", 0.05), ("vd", 0.05)):
        columns[name] = columns[name] + sigma * rng.standard_normal(len(time))
    columns["pitot"] = SCALE * columns["V"] + OFFSET + 0.25 * rng.standard_normal(len(time))
    parts = quaternions_of(np.column_stack([columns[n] for n in EULER])).T

    def array(name: str, *names: str) -> dict[str, FloatArray]:
        return {f"{name}[{i}]": floats[n] for i, n in enumerate(names)}

    floats = {name: x.astype("f4") for name, x in columns.items()}
    valid = dict.fromkeys(("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"), np.ones(len(time), dtype=bool))
    velocity = {f"v{axis}": floats[n] for axis, n in zip("xyz", VELOCITY, strict=True)}
    fast = {
        "vehicle_attitude": {f"q[{i}]": x.astype("f4") for i, x in enumerate(parts)},
        "vehicle_angular_velocity": array("xyz", *RATES),
        "sensor_combined": array("gyro_rad", *RATES) | array("accelerometer_m_s2", *SPECIFIC_FORCE),
        "actuator_controls_0": array("control", *LAW_ORDER),
    }
    slow = {
        "vehicle_local_position": {**velocity, **valid},
        "airspeed": {"true_airspeed_m_s": floats["pitot"]},
        "vehicle_air_data": {"rho": floats["density"], "baro_alt_meter": floats["altitude"]},
    }
    kept = np.flatnonzero(np.all([(time < first) | (time > last) for first, last in LOST], axis=0))
    asked = [(name, kept, topic) for name, topic in fast.items()]
    asked += [(name, kept[::5], topic) for name, topic in slow.items()]
    topics = [Topic(name, time[rows], {n: x[rows] for n, x in topic.items()}) for name, rows, topic in asked]
    dropouts = b"".join(ulog_dropout(round(1e3 * (last - first))) for first, last in LOST)
    path.write_bytes(ulog(topics, {"SYS_AUTOSTART": 2100}, {"sys_name": "PX4"}) + dropouts)
    return path
