"""Motion of a pose: that of paths whose derivatives are known, and what is lost where tracking jumps."""

from pathlib import Path

import numpy as np
import pytest
from helpers.made_logs import mapped_log

from stoop.base.arrays import FloatArray
from stoop.flight import Flight, load_flight
from stoop.flight.gridding import Channels
from stoop.flight.pose import without_jumps

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
    return load_flight(mapped_log(folder / "room.csv", {"t": TIME, **columns}))


def test_a_turn_has_the_motion_of_its_closed_form_and_what_was_measured_stays(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("seconds", [1.0, 0.06])
def test_a_receiver_that_is_held_in_fast_rows_does_not_jump(tmp_path: Path, seconds: float) -> None:
    held = np.minimum((TIME / seconds).astype(int) * round(seconds * RATE), len(TIME) - 1)
    noisy = np.random.default_rng(6)
    columns = {n: x + 0.002 * noisy.standard_normal(len(x)) for n, x in POSE.items()}
    assert without_jumps(Channels("room", TIME, columns))[1] == []
    columns |= {n: columns[n][held] for n in ("pn", "pe", "pd")}
    reset = POSE | {"az": np.full(len(TIME), -12.0), "pn": POSE["pn"] + 3.0 * (TIME > 2.0)}
    for shown in (columns, reset):  # an estimator may reset its position beside accelerometers
        flight = recorded(tmp_path, shown)
        assert "pose-jumps" not in [n.code for n in flight.notices]
        assert np.isfinite(flight.column("phi")).all()
