"""Motion of a pose: that of paths whose derivatives are known, and what is lost where tracking jumps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.rotations import euler_angles, quaternions_of
from stoop.base.variables import VARIABLES
from stoop.flight import Flight, load
from stoop.flight.gridding import Channels
from stoop.flight.pose import motion, without_jumps

RATE = 100.0
SPEED, RADIUS = 8.0, 20.0
TIME = np.arange(600) / RATE
RATE_OF_TURN = SPEED / RADIUS
BANK = np.arctan(SPEED**2 / (9.80665 * RADIUS))
POSE = {
    "pn": RADIUS * np.sin(RATE_OF_TURN * TIME),
    "pe": RADIUS * (1.0 - np.cos(RATE_OF_TURN * TIME)),
    "pd": -2.0 - 0.5 * TIME,
    "phi": np.full(len(TIME), BANK),
    "theta": np.full(len(TIME), 0.1),
    "psi": (RATE_OF_TURN * TIME + np.pi) % (2.0 * np.pi) - np.pi,
}  #: of a climbing turn to the right without sideslip force


def recorded(folder: Path, columns: dict[str, FloatArray]) -> Flight:
    rows = np.column_stack([TIME, *columns.values()])
    np.savetxt(folder / "room.csv", rows, delimiter=",", header="t," + ",".join(columns), comments="")
    lines = [f'{n} = {{ column = "{n}", unit = "{VARIABLES[n].unit}" }}' for n in columns]
    (folder / "room.csv.toml").write_text(
        '[time]\ncolumn = "t"\nunit = "s"\n[variables]\n' + "\n".join(lines) + "\n", encoding="utf-8"
    )
    return load(folder / "room.csv")


def test_a_turn_has_the_motion_of_its_closed_form(tmp_path: Path) -> None:
    flight = recorded(tmp_path, POSE)
    speed = np.hypot(SPEED, 0.5)
    np.testing.assert_allclose(flight.column("V"), speed, rtol=1e-6)
    np.testing.assert_allclose(flight.column("vd"), -0.5, rtol=1e-6)
    # body rates of a steady turn (Stevens, Lewis, eq. 1.4-4)
    expected = {"p": -np.sin(0.1), "q": np.sin(BANK) * np.cos(0.1), "r": np.cos(BANK) * np.cos(0.1)}
    for name, share in expected.items():
        np.testing.assert_allclose(flight.column(name), share * RATE_OF_TURN, atol=1e-6)
    # the specific force of a coordinated turn has no side component but that of the climb and pitch
    force = np.sqrt(sum(flight.column(c) ** 2 for c in ("ax", "ay", "az")))
    np.testing.assert_allclose(force[20:-20], np.hypot(9.80665, SPEED**2 / RADIUS), rtol=1e-5)
    assert flight.sources["V"].derived
    assert not flight.sources["pn"].derived
    assert "motion-of-pose" in [n.code for n in flight.notices]


def test_a_vehicle_at_rest_feels_gravity_alone() -> None:
    q = quaternions_of(np.tile([0.0, 0.3, 0.0], (50, 1)))
    found = motion(np.zeros((50, 3)), q, RATE)
    np.testing.assert_allclose(found["ax"], 9.80665 * np.sin(0.3), atol=1e-9)
    np.testing.assert_allclose(found["az"], -9.80665 * np.cos(0.3), atol=1e-9)
    np.testing.assert_allclose(euler_angles(q)[:, 1], 0.3)


def test_what_was_measured_stays(tmp_path: Path) -> None:
    gyro = {**POSE, "r": np.full(len(TIME), 0.123)}
    np.testing.assert_allclose(recorded(tmp_path, gyro).column("r"), 0.123)
    pitot = {**POSE, "az": np.full(len(TIME), -12.0)}
    assert "V" not in recorded(tmp_path, pitot).names


@pytest.mark.parametrize("lost", [(200, 208, 3.0), (200, 600, 0.5)])
def test_where_tracking_jumps_the_pose_is_lost(tmp_path: Path, lost: tuple[int, int, float]) -> None:
    first, last, size = lost
    noisy = np.random.default_rng(3)
    columns = {n: x + 0.001 * noisy.standard_normal(len(x)) for n, x in POSE.items()}
    columns["pn"][first:last] += size
    flight = recorded(tmp_path, columns)
    assert "pose-jumps" in [n.code for n in flight.notices]
    speed = flight.column("V")
    known = np.isfinite(speed)
    assert np.nanmax(speed) < 9.0  # across the jump it would be 50 m/s and more
    assert not known[first]
    assert known[: first - 20].all()
    assert known[min(last, 560) + 20 :].all()


def test_a_sound_pose_has_no_jumps() -> None:
    noisy = np.random.default_rng(4)
    values = {n: x + 0.002 * noisy.standard_normal(len(x)) for n, x in POSE.items()}
    group = Channels("room", TIME, values)
    assert without_jumps(group) == (group, [])


@pytest.mark.parametrize("seconds", [1.0, 0.06])
def test_a_receiver_that_is_held_in_fast_rows_does_not_jump(tmp_path: Path, seconds: float) -> None:
    held = np.minimum((TIME / seconds).astype(int) * round(seconds * RATE), len(TIME) - 1)
    noisy = np.random.default_rng(6)
    columns = {n: x + 0.002 * noisy.standard_normal(len(x)) for n, x in POSE.items()}
    columns |= {n: columns[n][held] for n in ("pn", "pe", "pd")}
    flight = recorded(tmp_path, columns)
    assert "pose-jumps" not in [n.code for n in flight.notices]
    assert np.isfinite(flight.column("phi")).all()


def test_a_position_that_an_estimator_resets_beside_accelerometers_stays(tmp_path: Path) -> None:
    columns = POSE | {"az": np.full(len(TIME), -12.0)}
    columns["pn"] = columns["pn"] + 3.0 * (TIME > 2.0)
    flight = recorded(tmp_path, columns)
    assert "pose-jumps" not in [n.code for n in flight.notices]
    assert np.isfinite(flight.column("phi")).all()
