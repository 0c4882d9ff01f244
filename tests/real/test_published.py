"""Beside what others published and logged: a polar, cut propellers, derivatives, and laws of real firmware."""

import csv
from pathlib import Path

import numpy as np
import pytest
from real.replay import replay_px4

from stoop.errors import FlightError, StoopError
from stoop.flight import Flight, load_flight
from stoop.logs.read import read
from stoop_analysis.performance.polar import Propulsion
from stoop_analysis.workflow.polar import drag_polar
from stoop_studies.findings import Setting
from stoop_studies.verify import handbook
from stoop_studies.verify.propellers import EXPERIMENT, read_flights
from stoop_tune.control_laws import ardupilot, px4

PUBLISHED = {0.5: (0.052, 0.046, 0.063), 1.0: (0.065, 0.056, 0.072)}
"""CL -> CD and its 75 % interval, read off the published figure (SOURCE.md, figures of the repository)."""
QUANTILE_75 = 1.150  #: of the normal distribution
WINDOW = (1116.3, 1379.3)  #: s on the log's clock; flight window of SOURCE.md


def test_drag_agrees_with_the_published_polar_within_both_errors(shared_data: Path, tmp_path: Path) -> None:
    flight = load_flight(shared_data / "mit-solar-surfer-px4csv")
    polar = drag_polar(flight, 9.4, 1.499, [WINDOW])[0]
    for CL, (CD, low, high) in PUBLISHED.items():
        value, std = polar.drag(np.array([CL]))
        theirs = (high - low) / 2.0 / QUANTILE_75
        assert abs(value[0] - CD) < 1.96 * np.hypot(std[0], theirs)
        assert 0.003 < std[0] < 0.015
    # about 92 W at 9.8 m/s, 150 W at 13 m/s, 300 W at 16 m/s, read off the figure
    value, std = polar.level_power(np.array([9.8, 13.0, 16.0]))
    assert np.all(np.abs(value - [92.0, 150.0, 300.0]) < 2.0 * std)
    fine = np.linspace(8.5, 16.0, 200)
    assert fine[int(np.argmin(polar.level_power(fine)[0]))] == pytest.approx(9.8, abs=1.5)
    value, error = polar.summary["efficiency"]  # an assumption that stays one
    assert 0.5 < value < 0.9
    assert error > 0.05
    units = "check the units"  # grams, square decimeters, and percent
    wrong = ((9400.0, 1.499, 0.7), (9.4, 149.9, 0.7), (1e300, 1.499, 0.7), (9.4, 1.499, 70.0))
    for mass, area, efficiency in wrong:
        with pytest.raises(FlightError, match="more than all" if efficiency > 1.0 else units):
            drag_polar(flight, mass, area, [WINDOW], Propulsion(efficiency))
    p = 'p = {column = "p_rps", unit = "rad/s", file = "plane_bodyrate.csv"}'
    (tmp_path / "m.toml").write_text(f'time = {{column = "t_s", unit = "s"}}\n[variables]\n{p}\n')
    bare = load_flight(shared_data / "stanford-skywalker-10hz", tmp_path / "m.toml")
    with pytest.raises(FlightError, match="a drag polar needs V, alpha"):
        drag_polar(bare, 2.47, 0.39)


def test_a_flight_in_which_power_tells_nothing_says_so(vtail_flight: Flight) -> None:
    _, notices = drag_polar(vtail_flight, 8.5, 0.66)
    assert any(one.code == "drag-not-identifiable" for one in notices)


DOCS = Path(__file__).parents[2] / "docs" / "verify"


def test_the_committed_tables_are_made_again(shared_data: Path, tmp_path: Path) -> None:
    findings = EXPERIMENT.findings(Setting(1, data=shared_data), {})
    for part, name in (("", "propellers.csv"), ("conditions", "propellers-conditions.csv")):
        written = (DOCS / name).read_text(encoding="utf-8").splitlines()
        made = (findings.part(part) if part else findings.csv).splitlines()
        for one, other in zip(written, made, strict=True):
            for a, b in zip(one.split(","), other.split(","), strict=True):
                assert a == b or abs(float(a) - float(b)) < 0.02 + 0.02 * abs(float(a))
    verdicts = {claim.statement: claim.verdict for claim in findings.claims}
    assert verdicts["The rotor that was cut is the one that explains most, after every cut"] == "holds"
    assert verdicts["No normal flight is accused, each compared with the others"] == "holds"
    assert verdicts["Of every weight near M3 it is said: propeller or mass near M3"] == "holds"
    with pytest.raises(StoopError, match="holds none of its flights"):
        read_flights(tmp_path)


def test_published_numbers(shared_data: Path) -> None:
    with (DOCS / "handbook.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for key, name, value in (("x8", "CLalpha", 4.0203), ("a430", "Claileron", 0.350364)):
        found, airplane = handbook.published(key, shared_data), handbook.airplanes()[key]["name"]
        assert found[name] == pytest.approx(value, rel=1e-4)
        told = {r["derivative"]: float(r["published"]) for r in rows if r["airplane"] == airplane}
        assert told == pytest.approx(found)


def test_px4_commands_what_its_law_does(shared_data: Path) -> None:
    """A VTOL in hover mode: within half a percent of the rms, by the right law with the right gains only."""
    recording = read(shared_data / "px4-ulog-reader-samples" / "sample_log_small.ulg")
    for axis in ("roll", "pitch", "yaw"):
        found = replay_px4(recording, px4.multicopter(recording.parameters, axis))
        assert found.error < 0.005
        assert len(found.time) > 250
        assert replay_px4(recording, px4.fixed_wing(recording.parameters, axis)).error > 0.3
    wrong = {**recording.parameters, "MC_PITCHRATE_P": 1.1 * recording.parameters["MC_PITCHRATE_P"]}
    assert replay_px4(recording, px4.multicopter(wrong, "pitch")).error > 0.05
    # PX4 1.6 logged the gyro before the filters of the loop, and commands at 10 Hz
    old = read(shared_data / "px4-ulog-reader-samples" / "sample_appended_multiple.ulg")
    with pytest.raises(StoopError, match="the log has no vehicle_angular_velocity: set SDLOG_PROFILE"):
        replay_px4(old, px4.multicopter(old.parameters, "roll"))


def test_a_plane_of_version_3_8_scales_both_axes_alike(shared_data: Path) -> None:
    """P over the demanded rate, in degrees: about roll and pitch the law needs the same ratio of airspeeds, over EAS2TAS."""
    log = read(shared_data / "ardupilot-dataflash-sample" / "test.BIN", topics=frozenset({"PIDR", "PIDP"}))
    ratios = []
    for axis, message in (("roll", "PIDR"), ("pitch", "PIDP")):
        law, logged = ardupilot.old_plane(log.parameters, axis), log.streams[message].columns
        demanded = np.radians(logged["Des"])
        terms = law.outputs({"setpoint": demanded, "rate": np.zeros(len(demanded))})
        ratios.append(np.median(logged["P"] / ardupilot.FULL / terms["P"]))
        np.testing.assert_array_equal(terms["FF"], logged["FF"])
    assert ratios[0] == pytest.approx(ratios[1], rel=1e-4)
    least, most = (ardupilot.airspeed_ratio(log.parameters, v) for v in (100.0, 0.0))
    assert least < ratios[0] < most
