from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stoop
from stoop.base.variables import WRAPPED
from stoop.errors import FlightError, StoopError
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.results.result import read_result
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle
from stoop.workflow import FittedModel, identify
from stoop.workflow.curves import unwrapped
from stoop.workflow.identification import search
from stoop.workflow.outputs import with_values
from stoop.workflow.summary import estimates_table, figures_table

ONE = Options(generations=1)


def test_writes_everything_and_reads_it_back(job: FittedModel, tmp_path: Path) -> None:
    folder = job.save(tmp_path / "out")
    assert sorted(p.name for p in folder.iterdir()) == [
        "estimate.npz",
        "flight.nc",
        "report.html",
        "result.json",
        "traces.npz",
        "vehicle.toml",
    ]
    result = read_result(folder / "result.json")
    assert result.parameters.keys() == job.result.parameters.keys()
    again = load_vehicle(folder / "vehicle.toml")
    for name, value in job.estimate.estimates.items():
        assert again.value(name) == pytest.approx(value, rel=1e-9)
    assert stoop.load_flight(folder / "flight.nc").time.size == job.flights[0].time.size


def test_result_has_the_documented_keys(job: FittedModel) -> None:
    document = json.loads(job.result.to_json())
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


def test_covariance_agrees_with_the_standard_errors(job: FittedModel) -> None:
    result = job.result
    sigma = np.sqrt(np.diag(result.covariance.matrix))
    assert sigma == pytest.approx([p.std_error for p in result.parameters.values()])


def test_no_maneuver_and_twice_the_same_flight_are_errors(wrong: Vehicle, flight: Flight) -> None:
    with pytest.raises(FlightError, match="no maneuver"):
        identify(wrong, flight, [])
    with pytest.raises(FlightError, match="two flights"):
        identify(wrong, [flight, flight], ["0:20"])


def test_tables_say_estimate_and_truth(job: FittedModel) -> None:
    table = estimates_table(job.result.parameters, {"CLalpha": 4.78})
    assert "CLalpha" in table
    assert "4.78" in table
    fitted, predicted = figures_table(job.result.maneuvers).split("20:28 (validation)")
    assert "0:20 (fit)" in fitted
    channel = job.result.maneuvers[1].channels["V"]
    (band,) = (line.split() for line in predicted.splitlines() if line.endswith("band %"))
    assert band[0] == f"{100.0 * channel.within:.0f}"
    assert not any(line.endswith("band %") for line in fitted.splitlines())


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
    new = with_values(
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


def test_identified_file_keeps_priors_about_their_own_means(wrong: Vehicle, flight: Flight) -> None:
    """A fit that begins from the identified file gives the same estimate: the prior is not about the estimate of before."""
    prior = 0.05
    tight = wrong.with_numbers({"CLalpha": {"value": 4.6, "prior": prior}})
    first = identify(tight, flight, ["0:15"])
    again = parse_vehicle(with_values(first.vehicle, first.estimate.estimates), "again.toml")
    p = again.parameters[again.rows["CLalpha"]]
    assert (p.prior, p.prior_mean) == (prior, 4.6)
    assert p.value == pytest.approx(first.estimate.estimates["CLalpha"], rel=1e-9)
    assert abs(p.value - 4.6) > prior, "the data move it"
    second = identify(again, flight, ["0:15"])
    sigma = first.parameters["CLalpha"].std_error
    assert second.estimate.estimates["CLalpha"] == pytest.approx(
        first.estimate.estimates["CLalpha"], abs=0.1 * sigma
    )
    assert second.result.parameters["CLalpha"].prior_mean == 4.6


def test_overlapping_windows_of_a_flight_are_refused(wrong: Vehicle, flight: Flight) -> None:
    with pytest.raises(FlightError, match=r"sim@10:20: overlaps the fitted sim@0:15; the same samples"):
        identify(wrong, flight, ["0:15", "10:20"])
    with pytest.raises(FlightError, match="overlaps"):
        identify(wrong, flight, ["0:15", "0:15"])
    with pytest.raises(FlightError, match="nothing may be fitted in a window that is predicted"):
        identify(wrong, flight, ["0:15"], ["14:20"])


def test_windows_that_touch_or_are_of_two_flights_do_not_overlap(wrong: Vehicle, flight: Flight) -> None:
    flights = {name: replace(flight, name=name) for name in ("a", "b")}
    done = search(wrong, list(flights.values()), ["a@0:10", "a@10:15", "b@0:10"], ["a@15:20", "b@10:20"], ONE)
    windows = [str(w) for w in (*done.estimate.prepared.windows, *done.setup.held_back)]
    assert windows == ["a@0:10", "a@10:15", "b@0:10", "a@15:20", "b@10:20"]


def test_what_is_predicted_is_judged_before_the_search(
    wrong: Vehicle, flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("the search began")

    monkeypatch.setattr("stoop.estimate.fit.fit", never)
    with pytest.raises(FlightError, match="outside the record"):
        identify(wrong, flight, ["0:20"], ["500:510"])
    with pytest.raises(StoopError, match="no loading is called 'heavy'"):
        identify(wrong, flight, ["0:20"], ["20:28#heavy"])


def test_angles_on_a_circle_are_shown_without_jumps() -> None:
    time = np.arange(200) / 50.0
    heading = 3.0 + 0.5 * time
    wrapped = (heading + np.pi) % (2.0 * np.pi) - np.pi
    measured, simulated = unwrapped(wrapped, wrapped - 0.01, "psi" in WRAPPED)
    assert measured == pytest.approx(heading)
    assert simulated == pytest.approx(heading - 0.01)
