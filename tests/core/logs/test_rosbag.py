"""ROS bags that the library wrote: the same numbers as it reads; damage is an error in one line, or a defect."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from stoop.logs import read
from stoop.logs.guard import parse
from stoop.logs.rosbag import Decoder, UnreadableError, message_parts

N = 30
START = 1_700_000_000 * 10**9
RATES = np.random.default_rng(2).normal(size=(N, 3))


def messages(store: Any) -> Iterator[tuple[str, str, int, Any]]:
    """Topic, type, time of recording and message, of an inertial sensor, an odometry, a camera and a text."""
    types = store.types
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    for i in range(N):
        stamp = START + 10_000_000 * i
        time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        extra = {"seq": i} if "seq" in types["std_msgs/msg/Header"].__dataclass_fields__ else {}
        header = types["std_msgs/msg/Header"](stamp=time, frame_id="imu"[: i % 4], **extra)
        turn, rates = quaternion(x=0.0, y=0.0, z=0.0, w=1.0), vector(*RATES[i])
        grid = np.zeros(9)
        yield "/imu", "sensor_msgs/msg/Imu", stamp + 2_000_000, types["sensor_msgs/msg/Imu"](
            header, turn, grid, rates, grid, vector(0.1, 0.2, -9.8), grid)  # fmt: skip
        image = types["sensor_msgs/msg/Image"](header, 4, 30, "mono8", 0, 30, np.zeros(120, np.uint8))
        yield "/camera", "sensor_msgs/msg/Image", stamp, image
        dimension = types["std_msgs/msg/MultiArrayDimension"]("motor", 2, 1)
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=[dimension], data_offset=0)
        array = types["std_msgs/msg/Float32MultiArray"](layout, np.array([i, 2.0], np.float32))
        yield "/rpm", "std_msgs/msg/Float32MultiArray", stamp, array
        yield "/said", "std_msgs/msg/String", stamp, types["std_msgs/msg/String"](data="hello")


def write(writer: Any, store: Any, serialize: Any) -> None:
    known: dict[str, Any] = {}
    for topic, kind, stamp, message in messages(store):
        known[topic] = known.get(topic) or writer.add_connection(topic, kind, typestore=store)
        writer.write(known[topic], stamp, bytes(serialize(message, kind)))


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("bags")
    first, second = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
    with Writer1(folder / "a.bag") as writer:
        write(writer, first, first.serialize_ros1)
    for name, plugin in (("db3", StoragePlugin.SQLITE3), ("mcap", StoragePlugin.MCAP)):
        with Writer2(folder / name, version=9, storage_plugin=plugin) as writer:
            write(writer, second, second.serialize_cdr)
    return {"first": folder / "a.bag", "db3": folder / "db3", "mcap": folder / "mcap"}


@pytest.mark.parametrize("name", ["first", "db3", "mcap"])
def test_what_was_written_is_read(bags: dict[str, Path], name: str) -> None:
    recording = read(bags[name])
    assert recording.format == "rosbag"
    assert set(recording.streams) == {"/imu", "/camera", "/rpm"}
    imu = recording.streams["/imu"]
    np.testing.assert_allclose(imu.time, 0.01 * np.arange(N), atol=1e-9)
    for axis, rates in zip("xyz", RATES.T, strict=True):
        np.testing.assert_array_equal(imu.columns[f"angular_velocity.{axis}"], rates)
    np.testing.assert_array_equal(imu.columns["linear_acceleration.z"], np.full(N, -9.8))
    assert not any("covariance" in column for column in imu.columns)
    camera = {"height", "width", "is_bigendian", "step"}
    assert set(recording.streams["/camera"].columns) - {"header.seq"} == camera
    np.testing.assert_array_equal(recording.streams["/rpm"].columns["data[0]"], np.arange(N))
    assert recording.info["body frame"] == "flu"
    assert recording.defects == ()


def test_single_files_and_topics(bags: dict[str, Path]) -> None:
    (file,) = bags["mcap"].glob("*.mcap")
    assert set(parse("rosbag", file, frozenset({"/rpm"})).streams) == {"/rpm"}
    (file,) = bags["db3"].glob("*.db3")
    assert set(parse("rosbag", file).streams) == {"/imu", "/camera", "/rpm"}


def test_definitions_are_not_believed() -> None:
    endless = {"a/msg/A": ([], [("a", (2, "a/msg/A"))])}
    bytes_ = {"a/msg/B": ([], [("x", (1, ("int8", 0)))])}
    many = bytes_ | {"a/msg/A": ([], [("a", (3, ((2, "a/msg/B"), 10**9)))])}
    for definitions in (endless, many, {}):
        with pytest.raises(UnreadableError):
            message_parts("a/msg/A", definitions)
    listed = {"a/msg/A": ([], [("a", (4, ((2, "a/msg/B"), 0)))]), "a/msg/B": ([], [])}
    decoder = Decoder(message_parts("a/msg/A", listed), aligned=False)
    assert decoder.numbers(b"\x05\0\0\0" + bytes(10)) == {}
    with pytest.raises(UnreadableError, match="shorter"):
        decoder.numbers(b"\xff\xff\xff\xff" + bytes(10))
