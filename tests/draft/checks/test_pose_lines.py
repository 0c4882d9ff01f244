"""Wrong lines of a log of pose alone: each is named, the drafted mapping corrects it, and a sound log is not accused."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from core.logs.test_capture_csv import RATE, motive, vicon, written
from helpers.flown import maneuver
from helpers.made_logs import csv_log
from scipy.spatial.transform import Rotation

from stoop.base.arrays import FloatArray
from stoop.errors import FlightError
from stoop.flight import load_flight
from stoop.flight.apply_mapping import Mapped
from stoop.flight.mapping import FlightMapping
from stoop.logs import Recording, Stream
from stoop.simulation.fly import simulate_flight
from stoop.vehicle.builtin import load_vehicle
from stoop_draft.mapping_draft import draft, draft_of
from stoop_studies.verify import capture

Columns = dict[str, FloatArray]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Columns, str]:
    flown, _ = capture.fly("wings", 0, tmp_path_factory.mktemp("room"))
    table = np.genfromtxt(flown.path, delimiter=",", names=True)
    return {n: table[n] for n in table.dtype.names}, draft(flown.path).text


def test_wrong_lines_are_named_and_drafts_correct_them(sound: tuple[Columns, str], tmp_path: Path) -> None:
    c, mapping = sound

    def but(*names: str) -> Columns:
        return {n: -c[n] for n in names}

    for wrong, found, corrected in (
        ({}, set(), True),
        ({n: 1000.0 * c[n] for n in ("x_n", "y_n", "z_n")}, {("mapping-unit", "pn")}, True),
        (but("z_n"), {("mapping-sign", "pd")}, True),
        (but("y_n"), {("mapping-sign", "pe")}, True),
        ({"x_n": c["y_n"], "y_n": c["x_n"]}, {("mapping-exchange", "pn")}, False),
        (but("roll"), {("mapping-sign", "phi")}, True),
        (but("y_n", "z_n", "pitch", "yaw"), {("mapping-frame", "theta")}, True),
        ({"roll": c["roll"] + 0.4 * (c["t"] > 35.0)}, {("pose-jumps", "log.csv")}, False),  # no line is wrong
    ):
        written = csv_log(tmp_path / "log.csv", c | wrong)
        for text, expected in ((mapping, found), (draft(written).text, set() if corrected else found)):
            assert warnings(written, text) == expected, (found, text)
    degrees = csv_log(tmp_path / "log.csv", c | {n: np.degrees(c[n]) for n in ("roll", "pitch", "yaw")})
    with pytest.raises(FlightError, match='write unit = "deg"'):
        warnings(degrees, mapping)
    assert warnings(degrees, draft(degrees).text) == set()


def warnings(path: Path, mapping: str) -> set[tuple[str, str]]:
    path.with_name("map.toml").write_text(mapping, encoding="utf-8")
    notices = load_flight(path, path.with_name("map.toml")).notices
    return {(n.code, n.subject) for n in notices if n.severity == "warning"}


def test_a_pose_in_a_bag_of_ros_comes_out_north_east_down() -> None:
    """A draft takes the axes of ROS, forward-left-up and east-north-up, unless what it shows speaks against them."""
    frames = {"body frame": "flu", "world frame": "enu"}
    enu, flu = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), np.diag([1.0, -1.0, -1.0])
    steps = maneuver(15.0, ("north", "doublet", 1, 2.0, 3), ("east", "doublet", 7, 2.0, 3), rate=100.0)
    flown = simulate_flight(load_vehicle("quad-x"), steps, seed=1, name="f")
    attitude = Rotation.from_euler("ZYX", np.column_stack([flown.column(n) for n in ("psi", "theta", "phi")]))
    motors = {f"data[{i}]": flown.column(f"motor_{i + 1}") for i in range(4)}
    for world, body, framed in ((enu, flu, True), (np.eye(3), np.eye(3), False)):
        place = np.column_stack([flown.column(n) for n in ("pn", "pe", "pd")]) @ world.T
        turn = (Rotation.from_matrix(world) * attitude * Rotation.from_matrix(body)).as_quat()
        columns = {f"pose.position.{axis}": x for axis, x in zip("xyz", place.T, strict=True)}
        columns |= {f"pose.orientation.{axis}": x for axis, x in zip("xyzw", turn.T, strict=True)}
        streams = {"/quad/pose": Stream(flown.time, columns), "/motors": Stream(flown.time, motors)}
        log = Recording(Path("bag"), "rosbag", streams, info=frames)
        text = draft_of(log).text
        assert ('frame = ["flu", "enu"]' in text) is framed
        channels = Mapped.of(FlightMapping.parse("m.toml", tomllib.loads(text)), log).channels
        found = {name: (group.time, x) for group in channels for name, x in group.values.items()}
        for name in ("pn", "pe", "pd", "motor_3"):
            time, x = found[name]
            np.testing.assert_allclose(x, np.interp(time, flown.time, flown.column(name)), atol=1e-9)
        ours = Rotation.from_quat(np.column_stack([found[f"q{i}"][1] for i in (1, 2, 3, 0)]))
        assert np.max((ours * attitude.inv()).magnitude()) < 1e-6


def test_a_pose_comes_out_north_east_down(tmp_path: Path) -> None:
    metres = motive({"Quad, 1": 0}, unit="Meters")
    for text in (motive({"Quad": 0}), metres, "\ufeff" + motive({"Q": 0}), vicon()):
        path, mapping = written(tmp_path, text), tmp_path / "mapping.toml"
        mapping.write_text(draft(path).text, encoding="utf-8")
        flight = load_flight(path, mapping, rate=RATE)
        for name, speed in (("pn", 1.0), ("pe", 3.0), ("pd", -2.0)):
            known = np.isfinite(flight.column(name))
            slope = np.polyfit(flight.time[known], flight.column(name)[known], 1)[0]
            assert slope == pytest.approx(speed, abs=1e-4)
        assert flight.column("psi")[20] == pytest.approx(np.radians(-30.0), abs=1e-4)
        assert flight.column("phi")[20] == pytest.approx(0.0, abs=1e-4)


def test_commands_stand_in_a_file_beside_it(tmp_path: Path) -> None:
    written(tmp_path, motive({"Quad": 0}))
    rows = [f"{k / 50:.3f},{0.5 + 0.1 * np.sin(k / 9):.4f}" for k in range(150)]
    (tmp_path / "commands.csv").write_text("t,motor_1\n" + "\n".join(rows) + "\n", encoding="utf-8")
    mapping = tmp_path / "mapping.toml"
    mapping.write_text(draft(tmp_path).text, encoding="utf-8")
    flight = load_flight(tmp_path, mapping, rate=RATE)
    assert {"pn", "pe", "pd", "psi", "motor_1"} <= flight.names
    assert np.isfinite(flight.column("motor_1")).mean() > 0.95
