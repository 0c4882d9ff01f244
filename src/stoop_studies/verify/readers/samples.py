"""Small logs of every kind: made by our own writers, by those of the libraries, and beginnings of published ones."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Mapping
from functools import cache
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.variables import RATES, SPECIFIC_FORCE
from stoop.errors import StoopError
from stoop.exporters.log_bytes import (
    Event,
    Table,
    Topic,
    crazyflie_bytes,
    dataflash_bytes,
    ulog,
    ulog_definitions,
    ulog_dropout,
    ulog_message,
    ulog_rows,
    ulog_text,
)
from stoop.flight import load, save
from stoop_studies.verify.readers.damage import ULOG_HEAD, Sample, folder_of, single, ulog_messages
from stoop_studies.verify.readers.library_samples import (
    bags,
    hdf5_matlab,
    hdf5_netcdf,
    netcdf3,
    old_matlab,
    parquet,
)

N: Final = 40  #: samples of the fastest stream
ALIGNABLE: Final = 400  #: the same where clocks are to be aligned
REAL_LINES: Final = 12  #: of a published table
RATE: Final = 50.0  #: Hz
CSV_MAPPING: Final = b"""\
[time]
column = "t_ms"
unit = "ms"

[variables]
p = { column = "p", unit = "deg/s" }
az = { column = "az", unit = "g", scale = -1.0 }
phi = { column = "phi", unit = "deg" }
"""
RICH_MAPPING: Final = b"""\
extends = "px4"

[time]
column = "timestamp"
unit = "us"
offset = 0.5

[variables]
airspeed_pitot = { stream = "airspeed", column = "true_airspeed_m_s", unit = "kt", scale = 1.0, optional = true }

[group.specific_force]
variables = ["ax", "ay", "az"]
unit = "m/s2"
frame = "flu"
sources = [
  { stream = "sensor_combined", columns = ["accelerometer_m_s2[0]", "accelerometer_m_s2[1]", "accelerometer_m_s2[2]"] },
]

[group.height]
variables = ["altitude"]
choose = "first"
sources = [{ stream = "vehicle_local_position", columns = [{ ref_alt = 1, z = -1 }] }]

[calibration.motor_1]
points = [[0.0, -21.0], [0.5, 0.5], [1.0, 20.0]]
unit = "deg"

[calibration.motor_2]
points = [[0.0, -0.4], [0.3, -0.2], [0.5, 0.0], [0.7, 0.2], [1.0, 0.38]]
degree = 3

[surface.aileron]
from = { motor_1 = 1.0 }

[mixer.tail]
kind = "v-tail"
left = "motor_1"
right = "motor_2"
"""
ALIGNED: Final = b"""\
[align.sensor_combined]
with = "vehicle_attitude"
using = ["p"]
drift = false
longest = 0.2
"""


def clock(n: int = N) -> FloatArray:
    """Return times (n,) from 2 s on."""
    return np.asarray(2.0 + np.arange(n) / RATE)


def motion(n: int = N) -> dict[str, FloatArray]:
    """Return angles, rates and specific force (n,) that fit each other."""
    t, rng = clock(n), np.random.default_rng(1)
    phi = 0.3 * np.sin(3.0 * t)
    noise = {name: 0.01 * rng.normal(size=n) for name in ("q", "r", "ax", "ay", "az")}
    return {"phi": phi, "p": 0.9 * np.cos(3.0 * t), **noise, "az": noise["az"] - 9.8}


def px4_topics(n: int = N) -> list[Topic]:
    """Return what PX4 logs, in little."""
    t, m = clock(n), {k: v.astype("f4") for k, v in motion(n).items()}
    one, none = np.ones(n, "f4"), np.zeros(n, "f4")
    half = {"q[0]": np.cos(m["phi"] / 2), "q[1]": np.sin(m["phi"] / 2), "q[2]": none, "q[3]": none}
    place = {"x": 12 * one, "y": none, "z": -50 * one, "vx": 12 * one, "vy": none, "vz": none, "ref_alt": one}
    valid = {key: np.ones(n, bool) for key in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid")}
    return [
        Topic("vehicle_attitude", t, half),
        Topic("sensor_combined", t, {"gyro_rad[0]": m["p"], "gyro_rad[1]": m["q"], "gyro_rad[2]": m["r"],
              **{f"accelerometer_m_s2[{i}]": m[name] for i, name in enumerate(("ax", "ay", "az"))}}),
        Topic("vehicle_local_position", t[::2], {k: v[::2] for k, v in (place | valid).items()}),
        Topic("actuator_motors", t[::2], {f"control[{i}]": (0.4 + 0.1 * np.sin(t[::2] + i)).astype("f4") for i in range(4)}),
        Topic("battery_status", t[::9], {"voltage_v": 15.8 * one[::9], "current_a": 9 * one[::9]}),
        Topic("battery_status", t[::9], {"voltage_v": 15.7 * one[::9], "current_a": 8 * one[::9]}, 1),
    ]  # fmt: skip


def _ulogs() -> list[Sample]:
    said = [(2.0, "INFO", "armed"), (2.1, "WARNING", "wind")]
    whole = ulog(px4_topics(), {"SYS_AUTOSTART": 4001, "MC_ROLL_P": 6.5}, {"ver_sw": "abc", "n": 3}, said)
    inner = ulog_message("F", b"vec:float x;float y;uint8_t[2] _padding0;")
    outer = ulog_message("F", b"twin:uint64_t timestamp;vec[3] esc;char[4] tag;bool ok;uint8_t[7] _padding0;")
    body = b"".join(
        ulog_message("D", b"\0\0" + (2_000_000 + 20_000 * k).to_bytes(8, "little") + bytes([k % 251]) * 35)
        for k in range(N)
    )
    topics = [Topic("rpm", clock(), {"indicated": np.arange(N, dtype="f8")})]
    nested = (
        ulog_definitions(topics) + inner + outer + ulog_message("A", b"\0\0\0twin") + ulog_message("A", b"\0\1\0rpm")
        + ulog_message("M", b"\0\x0bchar[3] logabc") + ulog_message("Q", b"\1\x07float P" + bytes(4))
        + body[:960] + ulog_dropout(40) + ulog_text(2.2, "ERROR", "motor") + body[960:]
        + ulog_message("R", b"\1\0") + ulog_message("S", bytes.fromhex("2f731320250cbb12"))
    )  # fmt: skip
    mixed = ulog_definitions(topics) + bytes(ulog_rows(topics)[0])
    return [single("a.ulg", content, "ulog") for content in (whole, nested, mixed)]


def _tables() -> list[Table]:
    t, m = 1e6 * clock(), motion()
    stamp = t.astype(np.int64)
    gyro = dict(
        zip(
            ("GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ"),
            (m[k] for k in RATES + SPECIFIC_FORCE),
            strict=True,
        )
    )
    pack: dict[str, Any] = {
        "Volt": np.full(8, 15.8),
        "Curr": np.full(8, 9.0),
        "Name": [f"pack {k % 2}" for k in range(8)],
    }
    return [
        Table("IMU", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", "QBffffff", "s#EEEooo", "F-000000",
              {"TimeUS": stamp, "I": np.arange(N) % 2, **gyro}),
        Table("ATT", "TimeUS,Roll,Pitch,Yaw", "Qccc", "sdhh", "FBBB",
              {"TimeUS": stamp + 5, "Roll": np.degrees(m["phi"]), "Pitch": np.zeros(N), "Yaw": np.full(N, 90.0)}),
        Table("RCOU", "TimeUS,C1,C2,C3", "QHHH", "sYYY", "F000",
              {"TimeUS": stamp[::2], **{f"C{i}": 1500 + np.arange(N // 2) for i in (1, 2, 3)}}),
        Table("BAT", "TimeUS,Volt,Curr,Name", "QffN", "svA-", "F00-", {"TimeUS": stamp[::5], **pack}),
        Table("TST", "TimeUS,L,e,D,g,q,M", "QLedgqM", "sDm----", "FGB----",
              {"TimeUS": stamp[::4], **{key: np.arange(10) for key in "LeDgqM"}}),
    ]  # fmt: skip


def _dataflashes() -> list[Sample]:
    told = {"ARSPD_RATIO": 2.0, "INS_POS1_X": -0.05}
    whole = dataflash_bytes(_tables(), told, ["ArduPlane V4.5.7 (1a2b)", "Hi"])
    short = dataflash_bytes(_tables()[:2], {"A": 1.0})
    return [single("a.bin", content, "dataflash") for content in (whole, short)]


def _dataflash_texts() -> list[Sample]:
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += [f"FMT, {k + 1}, 50, {t.name}, {t.letters}, {t.columns}" for k, t in enumerate(_tables())]
    for table in _tables():
        columns = [table.values[name] for name in table.columns.split(",")]
        lines += [
            ", ".join([table.name, *(c if isinstance(c, str) else repr(np.asarray(c).item()) for c in row)])
            for row in zip(*columns, strict=True)
        ]
    return [single("a.log", ("\n".join(lines) + "\n").encode(), "lines")]


def _crazyflies() -> list[Sample]:
    t, m = clock(), motion()
    events = {
        "fixedFrequency": Event(1, t, {"gyro.x": np.degrees(m["p"]).astype("f4"), "gyro.y": np.zeros(N, "f4"),
                                       "motor.m1": np.full(N, 30_000, "u2"), "pm.vbat": np.full(N, 3.9, "f4")}),
        "estAcceleration": Event(2, t[::3], {"acc.x": m["ax"][::3], "acc.z": m["az"][::3], "n": np.arange(14, dtype="i1")}),
        "mark": Event(700, t[::8], {}),
    }  # fmt: skip
    return [single("a.usd", crazyflie_bytes(events, version), "crazyflie") for version in (1, 2)]


def _csv() -> bytes:
    t, m = clock(), motion()
    rows_ = zip(1e3 * t, np.degrees(m["p"]), m["az"] / -9.80665, np.degrees(m["phi"]), strict=True)
    return b"t_ms,p,az,phi\n" + b"".join(b"%.0f,%.4f,%.4f,%.4f\n" % row for row in rows_)


def _csvs() -> list[Sample]:
    plain = single("a.csv", _csv(), "lines", CSV_MAPPING)
    packed = single("a.csv.gz", gzip.compress(_csv(), mtime=0), "gzip", CSV_MAPPING)
    both = CSV_MAPPING
    for column, file in ((b"p", b"a"), (b"az", b"a"), (b"phi", b"b")):
        both = both.replace(b'column = "%s"' % column, b'column = "%s", file = "%s.csv"' % (column, file))
    folder = {"a.csv": _csv(), "b.csv": _csv(), "mapping.toml": both}
    return [plain, packed, Sample(folder, "lines", targets=("a.csv", "b.csv"), mapping="mapping.toml")]


def _px4_folders() -> list[Sample]:
    files = {}
    for topic in px4_topics():
        names = ",".join(["timestamp", *topic.columns])
        stamps = np.round(1e6 * topic.time)
        table = np.column_stack([stamps, *(np.asarray(x, np.float64) for x in topic.columns.values())])
        lines = "\n".join(",".join(f"{x:.9g}" for x in row) for row in table)
        files[f"log_1_{topic.name}_{topic.instance}.csv"] = f"{names}\n{lines}\n".encode()
    packed = {f"{name}.gz": gzip.compress(content, mtime=0) for name, content in files.items()}
    return [folder_of(files, "lines"), folder_of(packed, "gzip")]


def _mappings() -> list[Sample]:
    log, long = ulog(px4_topics()[:4]), ulog(px4_topics(ALIGNABLE)[:4])
    cases = (
        ("a.csv", _csv(), CSV_MAPPING), ("a.ulg", log, RICH_MAPPING), ("a.ulg", long, RICH_MAPPING + ALIGNED),
    )  # fmt: skip
    return [
        Sample({name: content, "mapping.toml": mapping}, "lines", name, ("mapping.toml",), "mapping.toml")
        for name, content, mapping in cases
    ]


def _own_netcdfs() -> list[Sample]:
    with TemporaryDirectory(prefix="stoop-") as name:
        folder = Path(name)
        path, mapping = _csvs()[0].write(folder)
        save(load(path, mapping), folder / "a.nc")
        (folder / "b.ulg").write_bytes(ulog(px4_topics()))
        save(load(folder / "b.ulg"), folder / "b.nc")
        return [single("a.nc", (folder / f"{x}.nc").read_bytes(), "words") for x in "ab"]


def real(reader: str, data: Path) -> list[Sample]:
    """Return published logs of a reader, cut small; none for kinds of which there is no sample.

    Raises
    ------
    StoopError
        The folder does not hold them.
    """
    try:
        return [_REAL[reader](data)] if reader in _REAL else []
    except OSError as error:
        raise StoopError(
            f"verify readers: {data}: {error.strerror}: {error.filename}; name the folder of the published data"
        ) from None


def _real_ulog(data: Path) -> Sample:
    """Leave out parameters and hardware, which are half of the beginning."""
    whole = _begin(data / "px4-ulog-reader-samples" / "sample_log_small.ulg", 70_000)
    kept = (whole[a:b] for a, b in ulog_messages(whole) if whole[a + 2 : a + 3] not in (b"P", b"M"))
    return single("a.ulg", whole[:ULOG_HEAD] + b"".join(kept), "ulog")


def _real_dataflash(data: Path) -> Sample:
    return single("a.bin", _begin(data / "ardupilot-dataflash-sample" / "test.BIN", 20_000), "dataflash")


def _real_crazyflie(data: Path) -> Sample:
    path = data / "crazypad-propeller-damage" / "normal_flight__E8_log00.usd"
    return single("a.usd", _begin(path, 8_000), "crazyflie")


def _real_px4_csv(data: Path) -> Sample:
    files = {}
    for path in sorted((data / "mit-solar-surfer-px4csv").glob("*.csv.gz"))[:5]:
        with gzip.open(path) as file:
            files[path.name.removesuffix(".gz")] = b"".join(islice(file, REAL_LINES))
    return folder_of(files, "lines")


def _real_csv(data: Path) -> Sample:
    path = data / "a430-micro-fixedwing-mocap" / "short_straight_4_20230215_133852.csv"
    content = b"".join(path.read_bytes().splitlines(keepends=True)[:REAL_LINES])
    mapping = b"[time]\ncolumn = 'Systime'\nunit = 's'\n[variables]\np = { column = 'p', unit = 'deg/s' }\n"
    return single("a.csv", content, "lines", mapping)


def _begin(path: Path, size: int) -> bytes:
    with path.open("rb") as file:
        return file.read(size)


_REAL: Final[Mapping[str, Callable[[Path], Sample]]] = {
    "ulog": _real_ulog,
    "dataflash": _real_dataflash,
    "crazyflie": _real_crazyflie,
    "px4-csv": _real_px4_csv,
    "csv": _real_csv,
}
SAMPLES: Final[Mapping[str, Callable[[], list[Sample]]]] = {
    "ulog": _ulogs,
    "px4-csv": _px4_folders,
    "dataflash": _dataflashes,
    "dataflash-text": _dataflash_texts,
    "crazyflie": _crazyflies,
    "csv": _csvs,
    "mapping": _mappings,
    "stoop-netcdf": _own_netcdfs,
    "matlab": old_matlab,
    "matlab-7.3": hdf5_matlab,
    "netcdf-3": netcdf3,
    "netcdf-4": hdf5_netcdf,
    "parquet": parquet,
    "rosbag": bags,
}  #: reader -> its sound logs


@cache
def samples(reader: str, data: str = "") -> tuple[Sample, ...]:
    """Return the sound logs of a reader, the same in every call; with a folder of data, beginnings of real ones, too."""
    return (*SAMPLES[reader](), *(real(reader, Path(data)) if data else ()))
