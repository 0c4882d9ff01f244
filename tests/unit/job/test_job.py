from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

import stoop
from stoop.errors import FlightError, OutputError
from stoop.flight import Flight
from stoop.identify.result import read_result
from stoop.job import Job, identify
from stoop.job.checkpoint import Checkpoint
from stoop.job.outputs import check_folder
from stoop.job.summary import estimates_table, figures_table
from stoop.job.toml import replaced
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle


@pytest.fixture(scope="module")
def job(wrong: Vehicle, flight: Flight) -> Job:
    return identify(wrong, flight, ["0:20"], ["20:28"], command="stoop identify <here>")


def test_writes_everything_and_reads_it_back(job: Job, tmp_path: Path) -> None:
    folder = job.save(tmp_path / "out")
    assert sorted(p.name for p in folder.iterdir()) == [
        "flight.nc",
        "report.html",
        "result.json",
        "vehicle.toml",
    ]
    result = read_result(folder / "result.json")
    assert result.parameters.keys() == job.identification.result.parameters.keys()
    again = load_vehicle(folder / "vehicle.toml")
    for name, value in job.fit.estimates.items():
        assert again.value(name) == pytest.approx(value, rel=1e-9)
    assert stoop.load_flight(folder / "flight.nc").time.size == job.flights[0].time.size


def test_result_has_the_documented_keys(job: Job) -> None:
    document = json.loads(job.identification.result.to_json())
    parameter = document["parameters"]["CLalpha"]
    wanted = {
        "estimate",
        "std_error",
        "ci95_lower",
        "ci95_upper",
        "bound_lower",
        "bound_upper",
        "at_bound",
        "identifiable",
        "unit",
    }
    assert wanted <= parameter.keys()
    keys = {
        "covariance",
        "noise_covariance",
        "initial_states",
        "biases",
        "wind",
        "maneuvers",
        "cost",
        "trajectories",
        "seconds",
        "seed",
        "optimizer",
        "status",
        "advice",
        "versions",
        "inputs",
    }
    assert keys <= document.keys()
    roles = [m["role"] for m in document["maneuvers"]]
    assert roles == ["fit", "validation"]
    assert {"rmse", "theil", "r2", "baseline_theil"} <= document["maneuvers"][1]["channels"]["q"].keys()


def test_covariance_agrees_with_the_standard_errors(job: Job) -> None:
    result = job.identification.result
    sigma = np.sqrt(np.diag(result.covariance.matrix))
    assert sigma == pytest.approx([p.std_error for p in result.parameters.values()])


def test_an_existing_result_is_not_overwritten(job: Job, tmp_path: Path) -> None:
    job.save(tmp_path)
    before = (tmp_path / "result.json").read_bytes()
    with pytest.raises(OutputError, match="--overwrite"):
        job.save(tmp_path)
    assert (tmp_path / "result.json").read_bytes() == before
    job.save(tmp_path, overwrite=True)


def test_a_failing_report_leaves_nothing_behind(
    job: Job, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("stoop.report.write_report", full)
    with pytest.raises(OutputError, match="No space left"):
        job.save(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_folder_is_checked_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="is a file"):
        check_folder(tmp_path / "file", overwrite=False)
    with pytest.raises(OutputError, match="cannot be written"):
        check_folder(Path("/proc/nowhere"), overwrite=False)


def test_no_maneuver_and_twice_the_same_flight_are_errors(wrong: Vehicle, flight: Flight) -> None:
    with pytest.raises(FlightError, match="no maneuver"):
        identify(wrong, flight, [])
    with pytest.raises(FlightError, match="two flights"):
        identify(wrong, [flight, flight], ["0:20"])


def test_tables_say_estimate_and_truth(job: Job) -> None:
    table = estimates_table(job.identification.result, {"CLalpha": 4.78})
    assert "CLalpha" in table
    assert "4.78" in table
    assert "0:20 (fit)" in figures_table(job.identification.result)


def test_identified_file_keeps_comments_and_adds_what_was_left_out() -> None:
    text = """# my aeroplane
name = "x"
[mass]
mass = 8.0 # weighed
inertia = { xx = 1.0, yy = 1.0, zz = 1.5 }
center_of_gravity = [0.1, 0.0, 0.0]
[reference]
area = 0.5
chord = 0.2
span = 2.0
airspeed = 20.0
[aerodynamics.CL]
CLalpha = 5.0
"""
    vehicle = parse_vehicle(text, "x.toml")
    new = replaced(
        vehicle,
        {
            "CLalpha": 4.5,
            "Cmq": -9.0,
            "mass.mass": 8.25,
            "mass.center_of_gravity.x": 0.12,
            "mass.inertia.xx": 1.1,
        },
    )
    assert "# my aeroplane" in new
    assert "# weighed" in new
    again = parse_vehicle(new, "x.toml")
    for name, value in {
        "CLalpha": 4.5,
        "Cmq": -9.0,
        "mass.mass": 8.25,
        "mass.center_of_gravity.x": 0.12,
        "mass.inertia.xx": 1.1,
    }.items():
        assert again.value(name) == value
    assert tomllib.loads(new)["reference"]["span"] == 2.0


def test_checkpoint_belongs_to_one_search(tmp_path: Path, wrong: Vehicle, flight: Flight) -> None:
    kept: list[object] = []
    checkpoint = Checkpoint(tmp_path, "this")

    def see(progress: stoop.optimize.Progress) -> None:
        checkpoint.keep(progress.state)
        kept.append(progress.state)

    identify(wrong, flight, ["0:20"], callback=see)
    assert Checkpoint(tmp_path, "this").load() is not None
    with pytest.raises(OutputError, match="another one"):
        Checkpoint(tmp_path, "that").load()
    (tmp_path / "search.npz").write_bytes(b"damaged")
    with pytest.raises(OutputError, match="--resume"):
        Checkpoint(tmp_path, "this").load()
    checkpoint.forget()
    with pytest.raises(OutputError, match="no interrupted search"):
        checkpoint.load()
