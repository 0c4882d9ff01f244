"""Other axes turned into ours, against matrices written by hand; outputs become deflections by tables, curves, mixers."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from helpers.made_logs import mapped_log
from scipy.spatial.transform import Rotation

from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.base.variables import EULER, POSITION, QUATERNION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.errors import LogError
from stoop.flight import load_flight
from stoop.flight.conversion import Surfaces, check_frame, rotate_axes
from stoop.flight.gridding import Channels
from stoop.flight.mapping import FlightMapping

BODY = {"frd": np.eye(3), "flu": np.diag([1.0, -1.0, -1.0])}
GROUND = {
    "ned": np.eye(3),
    "nwu": np.diag([1.0, -1.0, -1.0]),
    "enu": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
}  #: columns of that frame -> ours
FRAMES = [(body, ground) for body in BODY for ground in GROUND]
POINTS = "points = [[1100, -0.4], [1500, 0.0], [1900, 0.38]]\n"
ELEVATOR = f"[calibration.pwm_3]\n{POINTS}[surface.elevator]\nfrom = {{pwm_3 = 1}}\n"


def columns(names: tuple[str, ...], rows: FloatArray) -> dict[str, FloatArray]:
    return dict(zip(names, rows.T, strict=True))


def test_vectors() -> None:
    rows = np.random.default_rng(1).normal(size=(5, 3))
    for frame, names in (("flu", RATES), ("flu", SPECIFIC_FORCE), ("enu", VELOCITY), ("nwu", POSITION)):
        found = rotate_axes(columns(names, rows), check_frame("m", names, frame))
        turn = (BODY | GROUND)[frame]
        np.testing.assert_allclose(np.column_stack([found[n] for n in names]), rows @ turn.T)
    both = ("wind_n", "wind_e")
    wind = rotate_axes(columns(both, rows[:, :2]), check_frame("m", both, "enu"))
    np.testing.assert_array_equal((wind["wind_n"], wind["wind_e"]), (rows[:, 1], rows[:, 0]))


def test_attitudes() -> None:
    """The same rotation, told in other axes: R_ours = G R B'. By REP 103 yaw is zero to the east, and counts to the left."""
    theirs = Rotation.random(20, random_state=np.random.RandomState(2))
    parts, angles = np.roll(theirs.as_quat(), 1, axis=1), theirs.as_euler("ZYX")[:, ::-1]
    for body, ground in FRAMES:
        truth = GROUND[ground] @ theirs.as_matrix() @ BODY[body].T
        found = rotate_axes(columns(QUATERNION, parts), check_frame("m", QUATERNION, [body, ground]))
        turned = Rotation.from_quat(np.column_stack([found[n] for n in (*QUATERNION[1:], QUATERNION[0])]))
        np.testing.assert_allclose(turned.as_matrix(), truth, atol=1e-12)
        found = rotate_axes(columns(EULER, angles), check_frame("m", EULER, [body, ground]))
        back = Rotation.from_euler("ZYX", np.column_stack([found[n] for n in EULER])[:, ::-1]).as_matrix()
        np.testing.assert_allclose(back, truth, atol=1e-9)
    ros = rotate_axes(columns(EULER, np.array([[0.1, -0.2, 0.3]])), ("flu", "enu"))
    assert [ros[n][0] for n in EULER] == pytest.approx([0.1, 0.2, np.pi / 2 - 0.3])
    for names in (("phi",), ("vn",), ("V",), ("p", "vn"), ("q0", "q1")):
        with pytest.raises(LogError, match="says nothing about"):
            check_frame("m.toml: group.x", names, "enu")


def surfaces(text: str) -> Surfaces:
    return FlightMapping.parse("m.toml", {"extends": "px4", **tomllib.loads(text)}).surfaces


def made(text: str, **outputs: FloatArray) -> dict[str, FloatArray]:
    time = np.arange(next(iter(outputs.values())).size) * 0.02
    found, _ = surfaces(text).deflections([Channels("out", time, outputs)])
    return {name: x for group in found for name, x in group.values.items()}


def test_tables_are_read_between_and_beyond_their_points_and_fitted_curves_go_through_them() -> None:
    pulses = np.array([1100.0, 1300.0, 1500.0, 1700.0, 1900.0, 2000.0, 1000.0, 0.0])
    expected = [-0.4, -0.2, 0.0, 0.19, 0.38, 0.475, -0.5, np.nan]
    np.testing.assert_allclose(made(ELEVATOR, pwm_3=pulses)["elevator"], expected, atol=1e-6)
    text = ELEVATOR.replace("points", "degree = 2\npoints")
    x = np.linspace(1100, 1900, 9)
    lagrange = -0.4 * (x - 1500) * (x - 1900) / (400 * 800) + 0.38 * (x - 1100) * (x - 1500) / (800 * 400)
    np.testing.assert_allclose(made(text, pwm_3=x)["elevator"], lagrange, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "symmetric", "opposite", "left_down"),
    [("v-tail", "elevator", "rudder", 1), ("inverted v-tail", "elevator", "rudder", -1),
     ("elevon", "elevator", "aileron", 1), ("flaperon", "flap", "aileron", 1)],
)  # fmt: skip
def test_mixers(kind: str, symmetric: str, opposite: str, left_down: int) -> None:
    """Both panels down is the symmetric surface; left down and right up is the opposite one."""
    text = (
        "[calibration.servo_1]\npoints = [[-1, -20], [1, 20]]\nunit = 'deg'\n"
        "[calibration.servo_2]\npoints = [[-1, 20], [1, -20]]\nunit = 'deg'\n"
        f"[mixer.tail]\nkind = '{kind}'\nleft = 'servo_1'\nright = 'servo_2'\n"
    )
    found = made(text, servo_1=np.array([1.0, 1.0]), servo_2=np.array([-1.0, 1.0]))
    full = np.radians(20.0)
    np.testing.assert_allclose(found[symmetric], [full, 0.0], atol=1e-12)
    np.testing.assert_allclose(found[opposite], [0.0, left_down * full], atol=1e-12)


def test_weights_and_outputs_of_two_clocks() -> None:
    text = (
        "[calibration.pwm_1]\npoints = [[1000, -0.5], [2000, 0.5]]\n[calibration.pwm_2]\npoints = [[1000, 0.5], "
        "[2000, -0.5]]\n[surface.aileron]\nfrom = {pwm_1 = 0.5, pwm_2 = -0.5}\n"
    )
    slow, fast = np.arange(10) * 0.1, np.arange(100) * 0.01
    groups = [Channels(f"{i}", t, {f"pwm_{i}": 1000 + 1000 * t}) for i, t in ((1, slow), (2, fast))]
    (found,), notices = surfaces(text).deflections(groups)
    np.testing.assert_allclose(found.values["aileron"], slow - 0.5, atol=1e-12)
    assert notices == []
    groups = [Channels("a", np.arange(4.0), {"pwm_3": np.array([1500.0, 1500.0, 1500.0, 2000.0])})]
    _, (found,) = surfaces(ELEVATOR).deflections(groups)
    assert found == notice("output-beyond-calibration", "pwm_3", low=1100.0, high=1900.0, share=0.25)
    with pytest.raises(LogError, match="mixed from pwm_3, which this log does not hold; it holds pwm_1"):
        made(ELEVATOR, pwm_1=np.zeros(5))


def test_tables_that_cannot_be() -> None:
    for text, words in (
        ("[calibration.pwm_3]\npoints = [[1100, -0.4]]", r"calibration\.pwm_3\.points: list should have at least 2 items"),
        ("[calibration.pwm_3]\npoints = [[1100, -0.4], [1500]]", r"points\.1: list should have at least 2 items"),
        ("[calibration.pwm_3]\npoints = [[1100, -0.4], [1500, 0.2], [1900, 0.1]]", "points turn back: the deflection must"),
        ("[calibration.pwm_3]\npoints = [[1100, -0.4], [1100, 0.2]]", "holds the input 1100 twice"),
        ("[calibration.pwm_3]\npoints = [[1100, -25], [1900, 25]]", 'are they degrees. write unit = "deg"'),
        ("[calibration.pwm_3]\npoints = [[1100, -0.4], [1900, nan]]", r"points\.1\.1: it must be a finite number"),
        ("[calibration.pwm_33]\n" + POINTS, "'pwm_33' is no variable of stoop"),
        ("[calibration.pwm_3]\ndegree = 3\n" + POINTS, "degree is to be a whole number from 1 to 2 for 3 points"),
        ("[calibration.pwm_3]\ndegree = true\n" + POINTS, r"degree: it must be a valid integer"),
        ("[calibration.pwm_3]\ndegree = 3\npoints = [[0, 0.0], [1, 0.4], [9, 0.41], [10, 0.9]]", "curve turns back between"),
        ("[surface.elevator]\nfrom = {pwm_3 = 1}", r"mixed from pwm_3, which has no calibration; add \[calibration\.pwm_3\]"),
        ("[calibration.pwm_3]\n" + POINTS + "[surface.wing]\nfrom = {pwm_3 = 1}", "leads to one of elevator"),
        ("[calibration.pwm_3]\n" + POINTS + "[mixer.a]\nkind = 'x'\nleft = 'pwm_3'\nright = 'pwm_4'", r"kind: it must be"),
        ("[calibration.pwm_3]\n" + POINTS + "[mixer.a]\nkind = 'elevon'\nleft = 'pwm_3'\nright = 'pwm_3'", "name two"),
    ):  # fmt: skip
        with pytest.raises(LogError, match=words) as caught:
            surfaces(text)
        assert "\n" not in str(caught.value)
        assert str(caught.value).startswith("m.toml: ")


def test_from_a_table_to_a_flight(tmp_path: Path) -> None:
    t = np.arange(300) * 0.02
    path = mapped_log(tmp_path / "f.csv", {"t": t, "pwm_3": 1500 + 200 * np.sin(t), "q": 0.1 * np.cos(t)})
    with path.with_name("f.csv.toml").open("a") as mapping:
        mapping.write("[calibration.pwm_3]\npoints = [[1100, -0.4], [1900, 0.4]]\n")
        mapping.write("[surface.elevator]\nfrom = {pwm_3 = -1}\n")
    flight = load_flight(path)
    np.testing.assert_allclose(flight.column("elevator"), -1e-3 * (flight.column("pwm_3") - 1500), atol=1e-9)
    assert flight.sources["elevator"].source == "f.csv (calibrated)"
