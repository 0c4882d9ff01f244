"""A bag of ROS is drafted in the axes of ROS, forward-left-up and east-north-up, unless what it shows speaks against them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from stoop.base.arrays import FloatArray
from stoop.flight import load
from stoop.flight.mapping_draft import draft
from stoop_studies.verify import capture

START = 1_700_000_000 * 10**9  #: ns
ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  #: of north, east, down
FLU = np.diag([1.0, -1.0, -1.0])
POSE, ODOMETRY = "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry"

Flown = dict[str, FloatArray]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """Return the log of a quadrotor in a room, at 50 Hz."""
    made, _ = capture.fly("rotors", 18, tmp_path_factory.mktemp("room"))
    table = np.genfromtxt(made.path, delimiter=",", names=True)[::4]
    assert table.dtype.names is not None
    return {n: table[n] for n in table.dtype.names}


def messages(
    store: Any, kind: str, flown: Flown, world: FloatArray, body: FloatArray
) -> Iterator[tuple[int, Any]]:
    T = store.types
    place = np.column_stack([flown[n] for n in ("x_n", "y_n", "z_n")]) @ world.T
    angles = np.column_stack([flown[n] for n in ("yaw", "pitch", "roll")])
    turn = Rotation.from_matrix(world) * Rotation.from_euler("ZYX", angles) * Rotation.from_matrix(body)
    vector = T["geometry_msgs/msg/Vector3"]
    still = T["geometry_msgs/msg/Twist"](vector(0.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    for t, x, q in zip(flown["t"], place.tolist(), turn.as_quat().tolist(), strict=True):
        stamp = START + round(t * 1e9)
        time = T["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        header = T["std_msgs/msg/Header"](stamp=time, frame_id="world")
        pose = T["geometry_msgs/msg/Pose"](
            T["geometry_msgs/msg/Point"](*x), T["geometry_msgs/msg/Quaternion"](*q)
        )
        if kind == POSE:
            yield stamp, T[kind](header, pose)
        else:
            covariance = np.zeros(36)
            whole = T["geometry_msgs/msg/PoseWithCovariance"](pose, covariance)
            yield (
                stamp,
                T[kind](header, "quad", whole, T["geometry_msgs/msg/TwistWithCovariance"](still, covariance)),
            )


def bag(path: Path, kind: str, flown: Flown, world: FloatArray = ENU, body: FloatArray = FLU) -> Path:
    """Write a bag with the pose, and the commands of the motors as an array."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    T, commands = store.types, "std_msgs/msg/Float32MultiArray"
    motors = np.column_stack([flown[f"motor_{i}"] for i in (1, 2, 3, 4)]).astype(np.float32)
    layout = T["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with Writer(path, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        pose = writer.add_connection("/vrpn/quad/pose", kind, typestore=store)
        sent = writer.add_connection("/motors", commands, typestore=store)
        for (stamp, message), x in zip(messages(store, kind, flown, world, body), motors, strict=True):
            writer.write(pose, stamp, store.serialize_cdr(message, kind))
            writer.write(sent, stamp, store.serialize_cdr(T[commands](layout, x), commands))
    return path


@pytest.mark.parametrize(
    ("kind", "world", "body", "framed"),
    [(POSE, ENU, FLU, True), (ODOMETRY, ENU, FLU, True), (POSE, np.eye(3), np.eye(3), False)],
)
def test_a_pose_comes_out_north_east_down(
    tmp_path: Path, flown: Flown, kind: str, world: FloatArray, body: FloatArray, framed: bool
) -> None:
    path, mapping = bag(tmp_path / "bag", kind, flown, world, body), tmp_path / "mapping.toml"
    text = draft(path).text
    mapping.write_text(text, encoding="utf-8")
    assert ('frame = ["flu", "enu"]' in text) is framed
    flight = load(path, mapping, rate=50.0)
    assert not flight.faults
    for name, column in (
        ("pn", "x_n"),
        ("pe", "y_n"),
        ("pd", "z_n"),
        ("phi", "roll"),
        ("theta", "pitch"),
        ("psi", "yaw"),
    ):
        true = np.interp(flight.time, flown["t"], flown[column])
        assert flight.column(name)[5:-5] == pytest.approx(true[5:-5], abs=0.02)
    assert flight.column("motor_3")[5:-5] == pytest.approx(
        np.interp(flight.time, flown["t"], flown["motor_3"])[5:-5], abs=0.1
    )
