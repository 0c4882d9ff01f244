"""PX4 topics -> registry variables.

Each group of variables names its sources in order of trust; the first that is there wins, unless a later
one was logged more than twice as fast. A source that never held a valid value gives way to the others.
Layouts follow the message definitions of PX4 v1.9 to v1.15.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from stoop.flight.channels import WILD, Channels
from stoop.flight.variables import MOTORS, OUTPUT_PINS, SERVOS
from stoop.logs import FloatArray, Recording, Stream
from stoop.units import MICROSECOND, ZERO_CELSIUS

BoolArray = npt.NDArray[np.bool_]

MAX_TRANSPORT: Final = 0.2  #: s; a sample stamp further from its publication is not believed


@dataclass(frozen=True)
class Source:
    """One topic that can supply a group of variables.

    Attributes
    ----------
    topic : stream of the recording
    columns : one per variable of the group
    offset : added to each value, to reach SI
    valid : columns that must be positive for a sample to count, one for all or one per column
    sampled : the stamp of the sample rather than of its publication is the time of the measurement
    """

    topic: str
    columns: tuple[str, ...]
    offset: float = 0.0
    valid: tuple[str, ...] = ()
    sampled: bool = True


def _vector(field: str, size: int, first: int = 0) -> tuple[str, ...]:
    return tuple(f"{field}[{i}]" for i in range(first, first + size))


GROUPS: Final[tuple[tuple[tuple[str, ...], tuple[Source, ...]], ...]] = (
    (("q0", "q1", "q2", "q3"), (
        Source("vehicle_attitude", _vector("q", 4)),
        Source("estimator_states", _vector("states", 4)),
        Source("estimator_status", _vector("states", 4)),
    )),
    (("p", "q", "r"), (
        Source("vehicle_angular_velocity", _vector("xyz", 3)),
        Source("sensor_combined", _vector("gyro_rad", 3)),
        Source("vehicle_attitude", ("rollspeed", "pitchspeed", "yawspeed")),
    )),
    (("p_dot", "q_dot", "r_dot"), (
        Source("vehicle_angular_acceleration", _vector("xyz", 3)),
        Source("vehicle_angular_velocity", _vector("xyz_derivative", 3)),
    )),
    (("ax", "ay", "az"), (
        Source("sensor_combined", _vector("accelerometer_m_s2", 3)),
        Source("vehicle_acceleration", _vector("xyz", 3)),
    )),
    (("control_roll", "control_pitch", "control_yaw"), (
        Source("actuator_controls_0", _vector("control", 3), sampled=False),
        Source("vehicle_torque_setpoint", _vector("xyz", 3), sampled=False),
    )),
    (("control_throttle",), (
        Source("actuator_controls_0", ("control[3]",), sampled=False),
        Source("vehicle_thrust_setpoint", ("xyz[0]",), sampled=False),
    )),
    (("vn", "ve", "vd"), (
        Source("vehicle_local_position", ("vx", "vy", "vz"), valid=("v_xy_valid", "v_xy_valid", "v_z_valid")),
        Source("vehicle_gps_position", ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s"), valid=("vel_ned_valid",)),
        Source("sensor_gps", ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s"), valid=("vel_ned_valid",)),
    )),
    (("pn", "pe", "pd"), (Source("vehicle_local_position", ("x", "y", "z"), valid=("xy_valid", "xy_valid", "z_valid")),)),
    (("airspeed_pitot",), (
        Source("airspeed", ("true_airspeed_m_s",)),
        Source("airspeed_validated", ("true_airspeed_m_s",)),
    )),
    (("wind_n", "wind_e"), tuple(
        Source(topic, ("windspeed_north", "windspeed_east"), valid=("variance_north",), sampled=False)
        for topic in ("wind_estimate", "wind", "estimator_wind", "airspeed_wind")
    )),
    (("density",), (Source("vehicle_air_data", ("rho",)),)),
    (("pressure",), (Source("vehicle_air_data", ("baro_pressure_pa",)),)),
    (("temperature",), (
        Source("airspeed", ("air_temperature_celsius",), offset=ZERO_CELSIUS),
        Source("vehicle_air_data", ("ambient_temperature",), offset=ZERO_CELSIUS),
    )),
    (("voltage",), (Source("battery_status", ("voltage_v",), sampled=False),)),
    (("current",), (Source("battery_status", ("current_a",), sampled=False),)),
)  # fmt: skip


def px4_channels(recording: Recording) -> list[Channels]:
    """Pick the registry variables out of a recording of PX4 topics."""
    picked = [_best(recording, names, sources) for names, sources in GROUPS]
    picked += [_altitude(recording), _pulses(recording), *_actuators(recording)]
    return [channels for channels in picked if channels is not None and channels.values]


def _best(recording: Recording, names: tuple[str, ...], sources: tuple[Source, ...]) -> Channels | None:
    found = [channels for source in sources if (channels := _supply(recording, names, source)) is not None]
    whole = [channels for channels in found if _finite(channels).all(axis=0).any()]
    some = [channels for channels in found if _finite(channels).any()]
    return _fastest(whole or some)


def _finite(channels: Channels) -> BoolArray:
    """Return (k, n): where each of the variables holds a value."""
    return np.array([np.isfinite(x) for x in channels.values.values()])


def _fastest(found: list[Channels]) -> Channels | None:
    best: Channels | None = None
    for channels in found:
        if best is None or channels.rate > 2.0 * best.rate:
            best = channels
    return best


def _supply(recording: Recording, names: tuple[str, ...], source: Source) -> Channels | None:
    stream = recording.streams.get(source.topic)
    if stream is None or not set(source.columns) <= set(stream.columns):
        return None
    flags = source.valid if len(source.valid) == len(names) else (source.valid or ("",)) * len(names)
    values = {
        name: _valid(stream, column, flag) + source.offset
        for name, column, flag in zip(names, source.columns, flags, strict=True)
    }
    return Channels(source.topic, sample_time(stream) if source.sampled else stream.time, values)


def _valid(stream: Stream, column: str, flag: str) -> FloatArray:
    """Return a column with NaN where its flag says so; a log without the flag is believed."""
    good = stream.columns.get(flag)
    values = stream.columns[column]
    return values if good is None else np.where(good > 0.0, values, np.nan)


def sample_time(stream: Stream) -> FloatArray:
    """Return when the samples were taken [s], where the topic says so and it can be believed."""
    stamp = stream.columns.get("timestamp_sample")
    if stamp is None:
        return stream.time
    taken = stamp * MICROSECOND
    late = stream.time - taken
    believable = np.all((late >= 0.0) & (late < MAX_TRANSPORT)) and np.all(np.diff(taken) > 0.0)
    return taken if believable else stream.time


def _altitude(recording: Recording) -> Channels | None:
    """Height above sea level: from the estimator, else from the barometer."""
    local = recording.streams.get("vehicle_local_position")
    if local is not None and {"z", "ref_alt"} <= set(local.columns):
        height = local.columns["ref_alt"] - local.columns["z"]
        if np.isfinite(height).any():
            return Channels("vehicle_local_position", sample_time(local), {"altitude": height})
    return _best(recording, ("altitude",), (Source("vehicle_air_data", ("baro_alt_meter",)),))


def px4_notes(recording: Recording) -> list[str]:
    """Say which outputs were left out, because the variables hold those of one instance only."""
    taken, *others = _driven(recording) or [""]
    return [
        f"pwm_1 to pwm_16 are the pulses of {taken}, whose outputs move most; those of {other} were left out"
        for other in others
    ]


def _pulses(recording: Recording) -> Channels | None:
    """Pulses of the outputs in use; those that are never driven stay at zero and are left out."""
    driven = _driven(recording)
    if not driven:
        return None
    stream = recording.streams[driven[0]]
    return Channels(driven[0], stream.time, _outputs(stream))


def _driven(recording: Recording) -> list[str]:
    """Return the instances that drive any output, the most moved first."""
    movement = {
        name: sum(float(np.std(x[np.abs(x) < WILD])) for x in _outputs(stream).values())
        for name, stream in recording.streams.items()
        if name.split("/")[0] == "actuator_outputs" and _outputs(stream)
    }
    return sorted(movement, key=lambda name: (-movement[name], name))


def _outputs(stream: Stream) -> dict[str, FloatArray]:
    columns = {f"pwm_{n + 1}": stream.columns.get(f"output[{n}]") for n in range(OUTPUT_PINS)}
    return {name: x for name, x in columns.items() if x is not None and (x[np.abs(x) < WILD] != 0.0).any()}


def _actuators(recording: Recording) -> list[Channels]:
    """Take the normalized commands of PX4 from v1.14 on; those of actuators that are not there are NaN."""
    found = []
    for kind, size in (("servo", SERVOS), ("motor", MOTORS)):
        topic = f"actuator_{kind}s"
        stream = recording.streams.get(topic)
        if stream is not None:
            columns = {f"{kind}_{n + 1}": stream.columns.get(f"control[{n}]") for n in range(size)}
            used = {name: x for name, x in columns.items() if x is not None and np.isfinite(x).any()}
            found.append(Channels(topic, stream.time, used))
    return found
