"""Small logs of every kind, made by our own writers and by the libraries of their formats."""

from __future__ import annotations

import gzip
import io
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from studies.robustness.trials import lay_out

from stoop.base.arrays import FloatArray
from stoop.base.variables import RATES, SPECIFIC_FORCE
from stoop.exporters.blackbox_flight import betaflight_log
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
from stoop.flight.flight import from_columns


@dataclass(frozen=True)
class Sample:
    """A small log: content of its files by name, and the form of those that are damaged (key of `damage.FORMS`).

    ``entry`` is the file that is read (empty: their folder), ``targets`` the files that are damaged, ``mapping`` the mapping
    file (empty where a built-in one serves, or none is needed).
    """

    files: Mapping[str, bytes]
    form: str
    entry: str = ""
    targets: tuple[str, ...] = ()
    mapping: str = ""

    def write(self, folder: Path) -> tuple[Path, Path | None]:
        """Write all files; return what is to be read, and the mapping."""
        lay_out(folder, self.files)
        return folder / self.entry, folder / self.mapping if self.mapping else None


def single(name: str, content: bytes, form: str, mapping: bytes = b"") -> Sample:
    """Return a log of one file, and perhaps a mapping of its own beside it."""
    beside = {"mapping.toml": mapping} if mapping else {}
    return Sample({name: content, **beside}, form, name, (name,), "mapping.toml" if mapping else "")


CSV_MAPPING, RICH_MAPPING, ALIGNED, ARRAY_MAPPING, BAG_MAPPING = (
    Path(__file__).with_name("mappings").joinpath(f"{name}.toml").read_bytes()
    for name in ("csv", "px4", "aligned", "arrays", "bag")
)  #: mappings of the logs; that of PX4 uses what a mapping can say, and the next adds an alignment of clocks
N: Final = 40  #: samples of the fastest stream
ALIGNABLE: Final = 400  #: the same where clocks are to be aligned
RATE: Final = 50.0  #: Hz
MESSAGES: Final = 12  #: of a topic
START: Final = 1_700_000_000 * 10**9  #: ns, of a bag
FLAT_MAPPING: Final = b'[variables]\nq = { column = "q[0]", unit = "rad/s" }\n'
NETCDF_MAPPING: Final = b'[variables]\nq = { column = "q", unit = "rad/s" }\n'
TIME: Final = 5.0 + 0.02 * np.arange(N)  #: s, of an array
GYRO: Final = np.random.default_rng(1).normal(size=(N, 3))


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
    texts = [(2.0, "INFO", "armed"), (2.1, "WARNING", "wind")]
    whole = ulog(px4_topics(), {"SYS_AUTOSTART": 4001, "MC_ROLL_P": 6.5}, {"ver_sw": "abc", "n": 3}, texts)
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
    names = ("GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ")
    gyro = dict(zip(names, (m[k] for k in RATES + SPECIFIC_FORCE), strict=True))
    labels = [f"pack {k % 2}" for k in range(8)]
    pack: dict[str, Any] = {"Volt": np.full(8, 15.8), "Curr": np.full(8, 9.0), "Name": labels}
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
    numbers = {"ARSPD_RATIO": 2.0, "INS_POS1_X": -0.05}
    whole = dataflash_bytes(_tables(), numbers, ["ArduPlane V4.5.7 (1a2b)", "Hi"])
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


def _blackboxes() -> list[Sample]:
    t, m = clock(), motion()
    columns = {name: np.asarray(x, dtype=np.float64) for name, x in m.items()}
    columns |= {name: np.full(N, 0.5) for name in ("motor_1", "motor_2", "pn", "pe", "vn", "ve", "vd")}
    flight = from_columns("a", t, {**columns, "motor_3": 0.01 * clock(), "voltage": np.full(N, 16.0)})
    one = betaflight_log(flight)[0]
    return [single("a.bbl", one, "blackbox"), single("b.bfl", one + one, "blackbox")]


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
    return [
        Sample(files, "lines", targets=tuple(sorted(files))),
        Sample(packed, "gzip", targets=tuple(sorted(packed))),
    ]


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


def _old_matlab() -> Iterator[Sample]:
    # files of version 5, packed and not, and of version 4
    from scipy.io import savemat

    ins = {
        "t": TIME[:, None], "gyro": {"x": GYRO[:, :1], "all": GYRO}, "name": "imu",
        "cell": np.array([1, "a"], object),
    }  # fmt: skip
    air = {"time_ms": np.arange(0.0, 100.0, 5.0)[:, None], "p": np.arange(20, dtype=np.int16)}
    deep = {"ins": ins, "air": air, "mass": 2.5, "turned": GYRO.T}
    flat = {"t": TIME[:, None], "q": GYRO}
    for content, mapping, form, how in (
        (deep, ARRAY_MAPPING, "words", {"do_compression": False}),
        ({"ins": ins}, ARRAY_MAPPING, "matlab", {"do_compression": True}),
        (flat, FLAT_MAPPING, "words", {"format": "4"}),
    ):
        file: Any = io.BytesIO()  # SciPy's stubs know names only
        options: dict[str, Any] = dict(how)
        savemat(file, content, **options)
        raw = file.getvalue()
        undated = raw if "format" in how else b"MATLAB 5.0 MAT-file".ljust(116) + raw[116:]
        yield single("a.mat", undated, form, mapping)


def _hdf5_matlab() -> list[Sample]:
    arrays = {
        "ins/t": TIME[None], "ins/gyro/x": GYRO[None, :, 0], "ins/gyro/all": GYRO.T, "air/p": np.arange(20.0)[None],
        "mass": np.array([[2.5]]),
    }  # fmt: skip
    raw = _hdf5(arrays, {"MATLAB_class": np.bytes_("double")}, 512)
    return [single("a.mat", b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + raw[128:], "hdf5", ARRAY_MAPPING)]


def _hdf5_netcdf() -> list[Sample]:
    arrays = {"time": TIME, "q": GYRO[:, 1], "h": np.arange(N, dtype="i2")}
    attributes = {"units": "s", "scale_factor": 1.0}
    chunked = {"chunks": (20,), "compression": "gzip", "fletcher32": True}
    kinds: tuple[dict[str, Any], ...] = ({}, chunked, {"libver": "latest"})
    return [single("a.nc", _hdf5(arrays, attributes, 0, **more), "hdf5", NETCDF_MAPPING) for more in kinds]


def _hdf5(
    arrays: dict[str, Any], attributes: dict[str, Any], block: int, libver: Any = None, **how: Any
) -> bytes:
    import h5py

    file = io.BytesIO()
    with h5py.File(file, "w", userblock_size=block, libver=libver) as hdf:
        for place, values in arrays.items():
            hdf.create_dataset(place, data=values, **how).attrs.update(attributes)
    return file.getvalue()


def _netcdf3() -> Iterator[Sample]:
    from scipy.io import netcdf_file

    columns = (("time", TIME, b"seconds since 2026-01-01"), ("q", GYRO[:, 1], b"rad/s"))
    for length in (N, None):  # with a fill value and a scale, and with records
        raw = io.BytesIO()
        file = netcdf_file(raw, "w")
        file.createDimension("time", length)
        for name, values, unit in columns:
            variable: Any = file.createVariable(name, "d", ("time",))
            variable[:], variable.units = values, unit
        packed: Any = file.createVariable("h", "h", ("time",))
        packed[:], packed.scale_factor, packed._FillValue = np.arange(N), 0.5, 3
        file.flush()
        yield single("a.nc", raw.getvalue(), "words", NETCDF_MAPPING)


def _parquet() -> Iterator[Sample]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    gyro = pa.FixedSizeListArray.from_arrays(pa.array(GYRO.ravel()), 3)
    nested = pa.StructArray.from_arrays([pa.array(GYRO[:, 0])], ["x"])
    stamp = pa.array((1e6 * TIME).astype(np.int64), pa.timestamp("us"))
    gaps = pa.array([None, *range(N - 1)], pa.int32())
    rich = pa.table({"time": stamp, "all": gyro, "gyro": nested, "n": gaps, "name": ["a"] * N})
    flat = pa.table({"time": TIME, "gyro.x": GYRO[:, 0], "k": np.arange(N) % 3})
    for table, how in (
        (rich, {"compression": "none"}),
        (flat, {"compression": "snappy", "row_group_size": 16}),
        (flat, {"compression": "zstd", "data_page_version": "2.0", "use_dictionary": False}),
        (flat, {"compression": "gzip", "write_page_checksum": True}),
    ):
        sink = io.BytesIO()
        pq.write_table(table, sink, **how)
        yield single("a.parquet", sink.getvalue(), "parquet", ARRAY_MAPPING)


def _bags() -> Iterator[Sample]:
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    first, second = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
    plugins = rosbag2.StoragePlugin
    with TemporaryDirectory(prefix="stoop-") as name:
        folder = Path(name)
        for how in (None, rosbag1.Writer.CompressionFormat.BZ2, rosbag1.Writer.CompressionFormat.LZ4):
            path = folder / f"{how and how.name}.bag"
            writer = rosbag1.Writer(path)
            if how is not None:
                writer.set_compression(how)
            _fill(writer, first, first.serialize_ros1)
            yield single("a.bag", path.read_bytes(), "words", BAG_MAPPING)
        for packed, plugin in ((False, plugins.SQLITE3), (False, plugins.MCAP), (True, plugins.MCAP)):
            place = folder / f"{plugin.name}{packed}"
            writer = rosbag2.Writer(place, version=9, storage_plugin=plugin)
            if packed:
                writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
            _fill(writer, second, second.serialize_cdr)
            files = {file.name: file.read_bytes() for file in sorted(place.iterdir())}
            (bag,) = (file for file in files if not file.endswith(".yaml"))
            yield single(bag, files[bag], "pages" if bag.endswith(".db3") else "words", BAG_MAPPING)
            whole = {**files, "mapping.toml": BAG_MAPPING}
            yield Sample(whole, "words", targets=tuple(files), mapping="mapping.toml")


def _fill(writer: Any, store: Any, serialize: Any) -> None:
    connections: dict[str, Any] = {}
    with writer:
        for topic, kind, stamp, message in _messages(store.types):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], stamp, bytes(serialize(message, kind)))


def _messages(types: Any) -> Iterator[tuple[str, str, int, Any]]:
    """Yield topic, type, time of recording and message, of an inertial sensor, motors and a text."""
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    dimension, layout = types["std_msgs/msg/MultiArrayDimension"], types["std_msgs/msg/MultiArrayLayout"]
    imu, array, text = "sensor_msgs/msg/Imu", "std_msgs/msg/Float32MultiArray", "std_msgs/msg/String"
    numbered = "seq" in types["std_msgs/msg/Header"].__dataclass_fields__
    for i in range(MESSAGES):
        stamp = START + 20_000_000 * i
        time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        extra = {"seq": i} if numbered else {}
        header = types["std_msgs/msg/Header"](stamp=time, frame_id="imu"[: i % 4], **extra)
        turn, none = quaternion(x=0.0, y=0.0, z=0.0, w=1.0), np.zeros(9)
        rates, force = vector(0.1 * i, 0.0, 0.2), vector(0.1, 0.2, -9.8)
        yield "/imu", imu, stamp, types[imu](header, turn, none, rates, none, force, none)
        speeds = layout(dim=[dimension("motor", 2, 1)], data_offset=0)
        yield "/rpm", array, stamp, types[array](speeds, np.array([i, 2.0], np.float32))
        yield "/said", text, stamp, types[text](data="hello")


SAMPLES: Final[Mapping[str, Callable[[], Iterable[Sample]]]] = {
    "ulog": _ulogs,
    "px4-csv": _px4_folders,
    "dataflash": _dataflashes,
    "dataflash-text": _dataflash_texts,
    "crazyflie": _crazyflies,
    "blackbox": _blackboxes,
    "csv": _csvs,
    "mapping": _mappings,
    "stoop-netcdf": _own_netcdfs,
    "matlab": _old_matlab,
    "matlab-7.3": _hdf5_matlab,
    "netcdf-3": _netcdf3,
    "netcdf-4": _hdf5_netcdf,
    "parquet": _parquet,
    "rosbag": _bags,
}  #: reader -> its sound logs


@cache
def samples(reader: str) -> tuple[Sample, ...]:
    """Return the sound logs of a reader, the same in every call."""
    return tuple(SAMPLES[reader]())
