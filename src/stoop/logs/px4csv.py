"""A folder of PX4 topics as `ulog2csv` writes them: one CSV file per topic and instance, plain or gzipped."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from stoop.base.units import MICROSECOND
from stoop.errors import LogError
from stoop.logs.recording import Defect, Recording, Stream, clean_stream
from stoop.logs.text import read_table

_TOPICS: Final = (
    "actuator_armed actuator_controls_0 actuator_controls_1 actuator_controls_2 "
    "actuator_controls_3 actuator_motors actuator_outputs actuator_servos airspeed "
    "airspeed_validated airspeed_wind battery_status cpuload differential_pressure "
    "distance_sensor ekf2_innovations ekf2_timestamps esc_status estimator_aid_src_airspeed estimator_attitude "
    "estimator_innovations estimator_local_position estimator_sensor_bias estimator_states "
    "estimator_status estimator_wind home_position input_rc manual_control_setpoint "
    "rate_ctrl_status rpm sensor_accel sensor_baro sensor_combined sensor_gps sensor_gyro "
    "sensor_mag system_power tecs_status vehicle_acceleration vehicle_air_data "
    "vehicle_angular_acceleration vehicle_angular_velocity vehicle_attitude "
    "vehicle_attitude_setpoint vehicle_control_mode vehicle_global_position vehicle_gps_position "
    "vehicle_imu vehicle_imu_status vehicle_land_detected vehicle_local_position "
    "vehicle_local_position_setpoint vehicle_magnetometer vehicle_rates_setpoint vehicle_status "
    "vehicle_thrust_setpoint vehicle_torque_setpoint vtol_vehicle_status wind wind_estimate "
    "yaw_estimator_status "
)
KNOWN_TOPICS: Final = frozenset(_TOPICS.split())
_ENDING: Final = re.compile(r"\.csv(\.gz)?$", re.IGNORECASE)
_INSTANCE: Final = re.compile(r"_(\d{1,2})$")


@dataclass(frozen=True)
class TopicFile:
    """One file of the folder: prefix of the log, topic and instance, read off its name."""

    path: Path
    prefix: str
    topic: str
    instance: int


def read_px4_folder(folder: Path) -> Recording:
    """Read every topic of a folder.

    Raises
    ------
    LogError
        When the folder holds no topic file, two logs, or nothing that can be read.
    """
    files = topic_files(folder)
    streams: dict[str, Stream] = {}
    defects: list[Defect] = []
    for file in files:
        stream, found = _read_topic(file)
        defects.extend(found)
        if stream is not None:
            name = f"{file.topic}/{file.instance}" if file.topic in streams else file.topic
            streams[name] = stream
    if not streams:
        reason = f" ({defects[0]})" if defects else ""
        raise LogError(f"{folder}: no topic holds data{reason}; export the log again with ulog2csv")
    return Recording(folder, "px4-csv", streams, tuple(defects))


def topic_files(folder: Path) -> list[TopicFile]:
    """List the topic files of a folder, by topic and instance; the names begin with one common prefix."""
    try:
        paths = sorted(p for p in folder.iterdir() if _ENDING.search(p.name) and p.is_file())
    except OSError as error:
        raise LogError(f"{folder}: cannot be read ({error.strerror}); check its permissions") from None
    known = [file for p in paths if (file := _split_known(p)) is not None]
    if not known:
        raise LogError(
            f"{folder}: no PX4 topic among its files; "
            "expected names such as log_vehicle_attitude_0.csv, or give a mapping for CSV files of your own"
        )
    prefix = _common_prefix(known)
    mine = [_split_after(p, prefix) for p in paths if p.name.startswith(prefix)]
    strays = [file for file in known if not file.path.name.startswith(prefix)]
    _refuse_two_logs(folder, prefix, known, strays)
    return sorted([*mine, *strays], key=lambda file: (file.topic, file.instance))


def _split_known(path: Path) -> TopicFile | None:
    stem, instance = _stem(path)
    words = stem.split("_")
    for start in range(len(words)):  # the longest known ending wins
        topic = "_".join(words[start:])
        if topic in KNOWN_TOPICS:
            return TopicFile(path, stem[: len(stem) - len(topic)], topic, instance)
    return None


def _split_after(path: Path, prefix: str) -> TopicFile:
    stem, instance = _stem(path)
    return TopicFile(path, prefix, stem[len(prefix) :], instance)


def _stem(path: Path) -> tuple[str, int]:
    stem = _ENDING.sub("", path.name)
    found = _INSTANCE.search(stem)
    if found is None or stem in KNOWN_TOPICS:
        return stem, 0
    return stem[: found.start()], int(found[1])


def _common_prefix(files: list[TopicFile]) -> str:
    """Return the prefix that most topics have; of equals the shortest, as some topics end in another's name."""
    topics = _topics_by_prefix(files)
    return min(topics, key=lambda prefix: (-len(topics[prefix]), len(prefix), prefix))


def _topics_by_prefix(files: list[TopicFile]) -> dict[str, set[tuple[str, int]]]:
    topics: dict[str, set[tuple[str, int]]] = {}
    for file in files:
        topics.setdefault(file.prefix, set()).add((file.topic, file.instance))
    return topics


def _refuse_two_logs(folder: Path, prefix: str, known: list[TopicFile], strays: list[TopicFile]) -> None:
    """Two logs: another prefix holds several topics, or one that does not extend the first repeats a topic."""
    topics = _topics_by_prefix(known)
    several = {p for p, found in topics.items() if p != prefix and len({topic for topic, _ in found}) > 1}
    repeated = {file.prefix for file in strays if (file.topic, file.instance) in topics[prefix]}
    if several | repeated:
        names = ", ".join(sorted({prefix} | several | repeated)[:3])
        raise LogError(
            f"{folder}: more than one log ({names}); put the files of each log in a folder of its own"
        )


def _read_topic(file: TopicFile) -> tuple[Stream | None, tuple[Defect, ...]]:
    """Read one topic; what is wrong with one topic must not lose the others."""
    try:
        columns, defects = read_table(file.path)
    except LogError as error:
        message = str(error).removeprefix(f"{file.path}: ")
        return None, (Defect("skipped", file.path.name, message),)
    stamp = columns.pop("timestamp", None)
    if stamp is None:
        return None, (*defects, Defect("skipped", file.path.name, "no column 'timestamp'"))
    stream, order = clean_stream(file.path.name, stamp * MICROSECOND, columns)
    if not stream.time.size:
        return None, (*defects, *order, Defect("skipped", file.path.name, "no sample with a time is left"))
    return stream, (*defects, *order)
