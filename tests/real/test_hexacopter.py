"""A real hexacopter: what `stoop verify hexacopter` says, and what it rests on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.checks.motors import check_motors
from stoop.errors import StoopError
from stoop.flight import Flight, load
from stoop.problem.windows import parse_window, whole
from stoop.strategy.run import choose_method
from stoop_studies.findings import Findings, Setting
from stoop_studies.verify.hexacopter import EXPERIMENT, FOLDER, METHOD, Blades, read_log, vehicle

COMMITTED = Path(__file__).parents[2] / "docs" / "verify"
MAPPING = Path(__file__).parents[2] / "examples" / "hexacopter_mapping.toml"


@pytest.fixture(scope="module")
def findings(shared_data: Path) -> Findings:
    return EXPERIMENT.findings(Setting(1, data=shared_data), {})


@pytest.fixture(scope="module")
def flight(shared_data: Path) -> Flight:
    return load(shared_data / FOLDER, MAPPING)


@pytest.mark.parametrize("part", ["", "coefficients", "without"])
def test_the_committed_tables_are_made_again(findings: Findings, part: str) -> None:
    name = f"hexacopter-{part}.csv" if part else "hexacopter.csv"
    written = (COMMITTED / name).read_text(encoding="utf-8").splitlines()
    made = (findings.part(part) if part else findings.csv).splitlines()
    for one, other in zip(written, made, strict=True):
        for a, b in zip(one.split(","), other.split(","), strict=True):
            assert a == b or abs(float(a) - float(b)) < 0.01 * abs(float(a)) + 1e-4


def test_what_is_claimed(findings: Findings) -> None:
    missed = [claim.statement for claim in findings.claims if claim.verdict != "holds"]
    assert missed == ["ax is predicted as closely as the authors' fit follows it"]
    rows = {(r[1], r[2]): r for r in findings.rows}
    assert float(rows["214:260", "ax"][3]) < 0.21, "by how little"


def test_the_attitude_is_brought_to_the_gyros(flight: Flight) -> None:
    (moved,) = (found for found in flight.notices if found.code == "clock-aligned")
    assert moved.values["shift"] == pytest.approx(-0.168, abs=0.01)
    assert "attitude-follows-rates" in {found.code for found in flight.notices}


def test_its_motors_are_not_accused(flight: Flight) -> None:
    """Hover and climbs without maneuvers, commands logged at 43 Hz: they explain a third of the motion at most."""
    flights = {flight.name: flight}
    for window in ("140:214", "214:260", "140:260"):
        assert check_motors(vehicle(), flight, [parse_window(window, flights)]) == []
    assert check_motors(vehicle(), flight, whole(flights)) == []


def test_its_motors_choose_the_method(flight: Flight) -> None:
    """So that the command of the page needs none, and prints the verified table."""
    found = choose_method("", vehicle(), [flight])
    assert found.name == METHOD
    assert [n.code for n in found.notices] == ["motors-logged-slowly"]


def test_velocity_and_accelerometers_agree_then(shared_data: Path, flight: Flight) -> None:
    """The time derivative of the velocity is gravity and specific force, turned by the attitude; nothing is fitted."""
    assert disagreement(flight) < 0.5 * disagreement(load(shared_data / FOLDER)), "m/s2, horizontal"


def disagreement(flight: Flight) -> float:
    from scipy.signal import butter, sosfiltfilt

    q = np.column_stack([flight.column(f"q{i}") for i in range(4)])
    felt = np.column_stack([flight.column(c) for c in ("ax", "ay", "az")])
    velocity = np.column_stack([flight.column(c) for c in ("vn", "ve", "vd")])
    inside = (flight.time > 225.0) & (flight.time < 240.0)
    w, x, y, z = q[inside].T
    north = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)])
    east = np.column_stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)])
    felt, velocity = felt[inside], velocity[inside]
    turned = np.column_stack([(north * felt).sum(axis=1), (east * felt).sum(axis=1)])
    sos = butter(2, 2.0, fs=flight.rate, output="sos")
    gained = np.gradient(velocity[:, :2], 1.0 / flight.rate, axis=0)
    off = sosfiltfilt(sos, turned - gained, axis=0)
    return float(np.std(off[50:-50]))


def test_their_thrust_is_that_of_momentum() -> None:
    """Blade elements and momentum give the same thrust, and six of them carry the weight at hover."""
    blades = Blades(0.01318, 0.0306, 0.0053, -0.177)
    U = np.linspace(50.0, 120.0, 8)
    for climb in (-2.0, 0.0, 6.0):
        drawn = blades.inflow(U, np.full(8, climb)) - climb
        momentum = 2.0 * 1.204 * np.pi * 0.11**2 * drawn * (drawn + climb)
        np.testing.assert_allclose(blades.thrust(U, np.full(8, climb)), momentum, rtol=1e-9)
    assert 6.0 * blades.thrust(np.array([blades.hover_speed()]), np.zeros(1))[0] == pytest.approx(
        1.895 * 9.81
    )


def test_a_folder_without_the_flight_is_said(tmp_path: Path) -> None:
    with pytest.raises(StoopError, match="holds no flight of the hexacopter"):
        read_log(tmp_path)
