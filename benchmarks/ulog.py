"""A gigabyte of ULog: speed and memory of our reader, beside pyulog's own load of the same topics."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from benchmarks.table import Row
from stoop_plan.log_bytes import Topic, ulog_definitions, ulog_rows, ulog_text

PART = "ulog"
SIZE = 10**9  #: bytes
PERIOD = 8.0  #: s of flight that are repeated, with new times
REPEATS = 3
MIX: dict[str, tuple[float, str]] = {
    "actuator_controls_0": (279, "Qfffffffff"), "actuator_controls_1": (279, "Qfffffffff"),
    "actuator_outputs": (10, "I" + 16 * "f"), "airspeed": (92, "ffff"), "battery_status": (3, 20 * "f" + "HHHHHBBBBB"),
    "cpuload": (2, "ff"), "ekf2_timestamps": (200, "hhhhhh"), "estimator_innovations": (5, "Q" + 32 * "f"),
    "estimator_status": (98, "QQ" + 62 * "f" + "HHBBBB"), "input_rc": (2, "Qiii" + 18 * "H" + "BB"),
    "manual_control_setpoint": (5, 14 * "f" + "BBBB"), "sensor_combined": (200, "fffIffffffIIB"),
    "system_power": (2, "ffBBBBBBB"), "telemetry_status": (2, 24 * "f"), "vehicle_air_data": (18, "Qffffff"),
    "vehicle_angular_acceleration": (279, "Qfff"), "vehicle_angular_velocity": (279, "Qfff"),
    "vehicle_attitude": (200, "QffffffffB"), "vehicle_attitude_setpoint": (10, 12 * "f" + "B"),
    "vehicle_gps_position": (5, "Qiiii" + 15 * "f" + "BBBBBBB"), "vehicle_imu": (2, "QIIIfffffffHHB"),
    "vehicle_local_position": (98, "QQ" + 32 * "f" + "BBBBBBBBBBBB"), "vehicle_magnetometer": (49, "Qfff"),
    "vehicle_rates_setpoint": (49, "ffffff"), "vehicle_status": (2, "QQ" + 27 * "B"), "wind_estimate": (1, "Qfffffff"),
}  # fmt: skip  #: topic -> Hz and types of its columns, as a fixed-wing aircraft of PX4 v1.11 logged them
USEFUL = (
    "actuator_controls_0", "actuator_outputs", "airspeed", "battery_status", "sensor_combined", "vehicle_air_data",
    "vehicle_angular_acceleration", "vehicle_angular_velocity", "vehicle_attitude", "vehicle_gps_position",
    "vehicle_local_position", "wind_estimate",
)  # fmt: skip
_HEAD = """
import json, sys, time
from pathlib import Path
def peak():
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(x for x in lines if x.startswith("VmHWM")).split()[1])
path, topics = sys.argv[1], sys.argv[2].split(",")
"""
_OURS = """
from stoop.logs.ulog import read_ulog
begun, used = time.perf_counter(), time.process_time()
streams = read_ulog(Path(path), frozenset(topics)).streams
wall, used = time.perf_counter() - begun, time.process_time() - used
kept = sum(s.time.nbytes + s.columns.nbytes for s in streams.values())
rows = {name: s.time.size for name, s in streams.items()}
"""
_THEIRS = """
from pyulog import ULog
begun, used = time.perf_counter(), time.process_time()
log = ULog(path, topics)
wall, used = time.perf_counter() - begun, time.process_time() - used
rows = {d.name: len(d.data["timestamp"]) for d in log.data_list}
kept = sum(len(d.data["timestamp"]) * sum(x.dtype.itemsize for x in d.data.values()) for d in log.data_list)
"""
_TAIL = """
print(json.dumps({"wall": wall, "used": used, "kept": kept, "peak": peak(), "rows": rows}))
"""


def run() -> list[Row]:
    """Measure both in processes of their own."""
    with tempfile.TemporaryDirectory(prefix="stoop-ulog-") as folder:
        path = Path(folder) / "flight.ulg"
        size = make(path, SIZE)
        return list(_rows(path, size))


def _rows(path: Path, size: int) -> Iterator[Row]:
    _child(_OURS, path)  # compiles, where that was not done before
    ours = [_child(_OURS, path) for _ in range(REPEATS)]
    theirs = _child(_THEIRS, path)
    if ours[0]["rows"] != theirs["rows"]:
        raise RuntimeError("the two readers do not find the same rows")
    wall = float(np.median([run["wall"] for run in ours]))
    kept, peak = ours[0]["kept"], max(run["peak"] for run in ours)
    megabytes = f"{size / 1e6:.0f} MB, {len(USEFUL)} of {len(MIX)} topics, {kept / 1e6:.0f} MB of them kept"
    yield Row(PART, "file read per second", size / wall / 1e6, "MB/s", at_least=200.0, note=megabytes)
    yield Row(
        PART,
        "useful channels per second",
        kept / wall / 1e6,
        "MB/s",
        note=f"{wall:.2g} s in all, median of {REPEATS}",
    )
    yield Row(
        PART, "largest memory over what is kept", peak / kept, at_most=2.0,
        note=f"whole process, {peak / 1e6:.0f} MB; pyulog {theirs['peak'] / 1e6:.0f} MB",
    )  # fmt: skip
    yield Row(
        PART,
        "times faster than pyulog",
        theirs["wall"] / wall,
        note=f"the same topics; it takes {theirs['wall']:.2g} s",
    )
    used = float(np.median([run["used"] for run in ours]))
    yield Row(PART, "times faster than pyulog, processor time", theirs["used"] / used)
    yield Row(PART, "memory over that of pyulog", peak / theirs["peak"])


def make(path: Path, size: int) -> int:
    """Write a log of about so many bytes: one stretch of flight again and again, with new times."""
    topics = _topics(np.random.default_rng(5))
    content, begins = ulog_rows(topics)
    stretch = np.frombuffer(content, dtype=np.uint8)
    places = begins[:, None] + np.arange(5, 13)
    stamps = stretch[places].view("<u8")
    with path.open("wb") as file:
        file.write(
            ulog_definitions(topics, {"SYS_AUTOSTART": 2100, "FW_AIRSPD_TRIM": 15.0}, {"sys_name": "PX4"})
        )
        for n in range(size // len(content)):
            _stretch(file, stretch, places, stamps + np.uint64(n * PERIOD * 1e6))
        file.write(ulog_text(1.0, "INFO", "end"))
    return path.stat().st_size


def _stretch(file: BinaryIO, stretch: Any, places: Any, stamps: Any) -> None:
    stretch[places] = stamps.view(np.uint8)
    file.write(stretch.data)


def _topics(rng: np.random.Generator) -> list[Topic]:
    codes = {"f": "f4", "d": "f8", "Q": "u8", "I": "u4", "i": "i4", "H": "u2", "h": "i2", "B": "u1"}
    topics = []
    for name, (rate, types) in MIX.items():
        time = 1.0 + np.arange(round(PERIOD * rate)) / rate + 1e-3 * rng.random()
        columns = {f"x{i}": (100 * rng.random(time.size)).astype(codes[c]) for i, c in enumerate(types)}
        topics.append(Topic(name, time, columns))
    return topics


def _child(code: str, path: Path) -> dict[str, Any]:
    command = [sys.executable, "-c", _HEAD + code + _TAIL, str(path), ",".join(USEFUL)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    told: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return told
