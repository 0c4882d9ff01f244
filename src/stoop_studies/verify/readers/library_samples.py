"""Small logs made by the libraries of their formats: MATLAB, HDF5, netCDF, Parquet, and ROS bags of both kinds."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop_studies.verify.readers.damage import Sample, single

N: Final = 40  #: samples of an array
MESSAGES: Final = 12  #: of a topic
START: Final = 1_700_000_000 * 10**9  #: ns, of a bag
MAPPING: Final = b"""\
[variables]
p = { column = "gyro.x", unit = "rad/s" }
q = { column = "q", unit = "rad/s", optional = true }
"""
FLAT_MAPPING: Final = b'[variables]\nq = { column = "q[0]", unit = "rad/s" }\n'
NETCDF_MAPPING: Final = b'[variables]\nq = { column = "q", unit = "rad/s" }\n'
BAG_MAPPING: Final = b"""\
[group.rates]
variables = ["p", "q", "r"]
unit = "rad/s"
frame = "flu"
sources = [{ stream = "/imu", columns = ["angular_velocity.x", "angular_velocity.y", "angular_velocity.z"] }]
"""


def _time() -> FloatArray:
    return np.asarray(5.0 + 0.02 * np.arange(N))


def _gyro() -> FloatArray:
    return np.asarray(np.random.default_rng(1).normal(size=(N, 3)))


def old_matlab() -> list[Sample]:
    """Return files of version 5, packed and not, and of version 4."""
    from scipy.io import savemat

    ins = {
        "t": _time()[:, None], "gyro": {"x": _gyro()[:, :1], "all": _gyro()}, "name": "imu",
        "cell": np.array([1, "a"], object),
    }  # fmt: skip
    air = {"time_ms": np.arange(0.0, 100.0, 5.0)[:, None], "p": np.arange(20, dtype=np.int16)}
    deep = {"ins": ins, "air": air, "mass": 2.5, "turned": _gyro().T}
    flat = {"t": _time()[:, None], "q": _gyro()}
    found = []
    for content, mapping, form, how in (
        (deep, MAPPING, "words", {"do_compression": False}),
        ({"ins": ins}, MAPPING, "matlab", {"do_compression": True}),
        (flat, FLAT_MAPPING, "words", {"format": "4"}),
    ):
        file: Any = io.BytesIO()  # SciPy's stubs know names only
        options: dict[str, Any] = dict(how)
        savemat(file, content, **options)
        raw = file.getvalue()
        undated = raw if "format" in how else b"MATLAB 5.0 MAT-file".ljust(116) + raw[116:]
        found.append(single("a.mat", undated, form, mapping))
    return found


def hdf5_matlab() -> list[Sample]:
    """Return a file of version 7.3."""
    arrays = {
        "ins/t": _time()[None], "ins/gyro/x": _gyro()[None, :, 0], "ins/gyro/all": _gyro().T, "air/p": np.arange(20.0)[None],
        "mass": np.array([[2.5]]),
    }  # fmt: skip
    raw = _hdf5(arrays, {"MATLAB_class": np.bytes_("double")}, 512)
    return [single("a.mat", b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + raw[128:], "hdf5", MAPPING)]


def hdf5_netcdf() -> list[Sample]:
    """Return files of version 4: plain, and in packed pieces with a checksum."""
    arrays = {"time": _time(), "q": _gyro()[:, 1], "h": np.arange(N, dtype="i2")}
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


def netcdf3() -> list[Sample]:
    """Return a classic file with a fill value and a scale, and one with records."""
    from scipy.io import netcdf_file

    found = []
    columns = (("time", _time(), b"seconds since 2026-01-01"), ("q", _gyro()[:, 1], b"rad/s"))
    for length in (N, None):
        raw = io.BytesIO()
        file = netcdf_file(raw, "w")
        file.createDimension("time", length)
        for name, values, unit in columns:
            variable: Any = file.createVariable(name, "d", ("time",))
            variable[:], variable.units = values, unit
        packed: Any = file.createVariable("h", "h", ("time",))
        packed[:], packed.scale_factor, packed._FillValue = np.arange(N), 0.5, 3
        file.flush()
        found.append(single("a.nc", raw.getvalue(), "words", NETCDF_MAPPING))
    return found


def parquet() -> list[Sample]:
    """Return tables plain and packed, with nested columns, gaps and a dictionary."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    gyro = pa.FixedSizeListArray.from_arrays(pa.array(_gyro().ravel()), 3)
    nested = pa.StructArray.from_arrays([pa.array(_gyro()[:, 0])], ["x"])
    stamp = pa.array((1e6 * _time()).astype(np.int64), pa.timestamp("us"))
    gaps = pa.array([None, *range(N - 1)], pa.int32())
    rich = pa.table({"time": stamp, "all": gyro, "gyro": nested, "n": gaps, "name": ["a"] * N})
    flat = pa.table({"time": _time(), "gyro.x": _gyro()[:, 0], "k": np.arange(N) % 3})
    found = []
    for table, how in (
        (rich, {"compression": "none"}),
        (flat, {"compression": "snappy", "row_group_size": 16}),
        (flat, {"compression": "zstd", "data_page_version": "2.0", "use_dictionary": False}),
        (flat, {"compression": "gzip", "write_page_checksum": True}),
    ):
        sink = io.BytesIO()
        pq.write_table(table, sink, **how)
        found.append(single("a.parquet", sink.getvalue(), "parquet", MAPPING))
    return found


def bags() -> list[Sample]:
    """Return bags of ROS 1, plain and packed, and of ROS 2 in both kinds of storage."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    first, second = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
    plugins = rosbag2.StoragePlugin
    found = []
    with TemporaryDirectory(prefix="stoop-") as name:
        folder = Path(name)
        for how in (None, rosbag1.Writer.CompressionFormat.BZ2, rosbag1.Writer.CompressionFormat.LZ4):
            path = folder / f"{how and how.name}.bag"
            writer = rosbag1.Writer(path)
            if how is not None:
                writer.set_compression(how)
            _fill(writer, first, first.serialize_ros1)
            found.append(single("a.bag", path.read_bytes(), "words", BAG_MAPPING))
        for packed, plugin in ((False, plugins.SQLITE3), (False, plugins.MCAP), (True, plugins.MCAP)):
            place = folder / f"{plugin.name}{packed}"
            writer = rosbag2.Writer(place, version=9, storage_plugin=plugin)
            if packed:
                writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
            _fill(writer, second, second.serialize_cdr)
            files = {file.name: file.read_bytes() for file in sorted(place.iterdir())}
            (bag,) = (file for file in files if not file.endswith(".yaml"))
            found.append(single(bag, files[bag], "pages" if bag.endswith(".db3") else "words", BAG_MAPPING))
            whole = {**files, "mapping.toml": BAG_MAPPING}
            found.append(Sample(whole, "words", targets=tuple(files), mapping="mapping.toml"))
    return found


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
