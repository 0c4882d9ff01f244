"""ROS bags of both kinds, as rosbags writes them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from stoop_studies.verify.readers.sample import Sample, single

N: Final = 12
START: Final = 1_700_000_000 * 10**9
MAPPING: Final = b"""\
[group.rates]
variables = ["p", "q", "r"]
unit = "rad/s"
frame = "flu"
sources = [{ stream = "/imu", columns = ["angular_velocity.x", "angular_velocity.y", "angular_velocity.z"] }]
"""


def bags() -> list[Sample]:
    """Return bags of ROS 1, plain and packed, and of ROS 2 in both kinds of storage."""
    from rosbags.rosbag1 import Writer
    from rosbags.rosbag2 import StoragePlugin

    found = []
    with TemporaryDirectory(prefix="stoop-") as name:
        folder = Path(name)
        for how in (None, Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4):
            path = folder / f"{how and how.name}.bag"
            _write_first(path, how)
            found.append(single("a.bag", path.read_bytes(), "words", MAPPING))
        for packed, plugin in (
            (False, StoragePlugin.SQLITE3),
            (False, StoragePlugin.MCAP),
            (True, StoragePlugin.MCAP),
        ):
            place = folder / f"{plugin.name}{packed}"
            _write_second(place, plugin, packed)
            files = {file.name: file.read_bytes() for file in sorted(place.iterdir())}
            (bag,) = (file for file in files if not file.endswith(".yaml"))
            found.append(single(bag, files[bag], "pages" if bag.endswith(".db3") else "words", MAPPING))
            found.append(
                Sample(
                    {**files, "mapping.toml": MAPPING}, "words", victims=tuple(files), mapping="mapping.toml"
                )
            )
    return found  # fmt: skip


def _write_first(path: Path, how: Any) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer(path)
    if how is not None:
        writer.set_compression(how)
    with writer:
        _fill(writer, store, store.serialize_ros1)


def _write_second(path: Path, plugin: Any, packed: bool) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(path, version=9, storage_plugin=plugin)
    if packed:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        _fill(writer, store, store.serialize_cdr)


def _fill(writer: Any, store: Any, serialize: Any) -> None:
    known: dict[str, Any] = {}
    for topic, kind, stamp, message in _messages(store.types):
        known[topic] = known.get(topic) or writer.add_connection(topic, kind, typestore=store)
        writer.write(known[topic], stamp, bytes(serialize(message, kind)))


def _messages(types: Any) -> Iterator[tuple[str, str, int, Any]]:
    """Yield topic, type, time of recording and message, of an inertial sensor, motors and a text."""
    import numpy as np

    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    dimension, layout = types["std_msgs/msg/MultiArrayDimension"], types["std_msgs/msg/MultiArrayLayout"]
    for i in range(N):
        stamp = START + 20_000_000 * i
        time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        extra = {"seq": i} if "seq" in types["std_msgs/msg/Header"].__dataclass_fields__ else {}
        header = types["std_msgs/msg/Header"](stamp=time, frame_id="imu"[: i % 4], **extra)
        turn, none = quaternion(x=0.0, y=0.0, z=0.0, w=1.0), np.zeros(9)
        imu = types["sensor_msgs/msg/Imu"]
        yield "/imu", "sensor_msgs/msg/Imu", stamp, imu(header, turn, none, vector(0.1 * i, 0.0, 0.2), none,
                                                        vector(0.1, 0.2, -9.8), none)  # fmt: skip
        speeds = layout(dim=[dimension("motor", 2, 1)], data_offset=0)
        rpm = types["std_msgs/msg/Float32MultiArray"](speeds, np.array([i, 2.0], np.float32))
        yield "/rpm", "std_msgs/msg/Float32MultiArray", stamp, rpm
        yield "/said", "std_msgs/msg/String", stamp, types["std_msgs/msg/String"](data="hello")
