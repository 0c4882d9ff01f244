"""Prediction from the folder of an identification: the figures that identify itself gives, and what is refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stoop
from stoop.base.notices import notice
from stoop.base.variables import SPECIFIC_FORCE
from stoop.errors import FlightError, SimulationError
from stoop.estimate.fit import DEFAULTS
from stoop.flight import Flight, load_flight, save_flight
from stoop.flight.faults import Fault
from stoop.results.decisions import DecisionRecord
from stoop.vehicle import Vehicle
from stoop.workflow import FittedModel
from stoop.workflow.identification import finish, search
from stoop.workflow.validation import validate


def test_the_same_figures_as_identify_gives_for_a_window_set_aside(job: FittedModel, folder: Path) -> None:
    again, expected = validate(folder, job.flights, ["20:28"]).record.maneuvers[0], job.result.maneuvers[1]
    for what in ("role", "segments"):
        assert getattr(again, what) == getattr(expected, what)
    assert again.channels.keys() == expected.channels.keys()
    for name, figures in again.channels.items():
        same = expected.channels[name]
        for key in ("rmse", "theil", "r2", "baseline_theil"):
            assert getattr(figures, key) == pytest.approx(getattr(same, key), rel=1e-9), (name, key)
        assert figures.baseline.rmse == pytest.approx(same.baseline.rmse, rel=1e-9)
        assert figures.whiteness.statistic == pytest.approx(same.whiteness.statistic, rel=1e-6)


def test_a_fit_without_accelerometers_predicts(wrong: Vehicle, flight: Flight, tmp_path: Path) -> None:
    """Files of older versions hold rows without a variance for channels that were never measured."""
    seen = replace(flight, data=flight.data.drop_vars([c for c in flight.channels if c in SPECIFIC_FORCE]))
    options = replace(DEFAULTS, budget=2000.0)
    folder = finish(search(wrong, seen, ["0:20"], options=options)).save(tmp_path / "result")
    result = json.loads((folder / "result.json").read_text())
    noise = result["noise_covariance"]
    assert not {"ax", "az"} & set(noise["channels"])
    for older in (False, True):
        if older:
            variances = [*np.diag(noise["matrix"]).tolist(), None, None]
            noise["channels"] += ["ax", "az"]
            every = range(len(variances))
            noise["matrix"] = [[variances[i] if i == j else 0.0 for j in every] for i in every]
            (folder / "result.json").write_text(json.dumps(result))
        model = stoop.load(folder)
        assert np.linalg.eigvalsh(model.result.noise_covariance.matrix)[0] > 0.0
        found = validate(model, flight, ["20:28"]).record.maneuvers[0].channels
        assert {"q", "az"} <= set(found)  # the flight that is predicted has accelerometers
        assert np.isfinite([one.rmse for one in found.values()]).all()


def test_a_flight_is_known_by_its_content(job: FittedModel, folder: Path, tmp_path: Path) -> None:
    """Not by its name; without windows those are predicted that were not fitted, and windows that touch do not overlap."""
    shutil.copy(folder / "flight.nc", tmp_path / "other.nc")
    flight, other = job.flights[0], load_flight(tmp_path / "other.nc")
    with pytest.raises(FlightError, match="other@10:25: overlaps 0:20, to which the model was fitted"):
        validate(folder, [other], ["10:25"])
    assert validate(folder, [other], ["20:28"]).record.maneuvers
    with pytest.raises(FlightError, match=r"no maneuver was found to predict .*the model was fitted there"):
        validate(folder, [load_flight(folder / "flight.nc")])
    shifted, place = flight.data.assign(q=flight.data["q"] + 1e-3), tmp_path / f"{flight.name}.nc"
    save_flight(replace(flight, data=shifted), place)
    moved = load_flight(place)
    assert validate(folder, [moved], ["0:20"]).record.maneuvers[0].role == "validation"
    assert validate(folder, [moved]).record.maneuvers


def test_without_the_fitted_flight_there_is_no_lag(job: FittedModel, folder: Path, tmp_path: Path) -> None:
    for name in ("result.json", "vehicle.toml"):
        shutil.copy(folder / name, tmp_path / name)
    found = validate(tmp_path / "result.json", [replace(job.flights[0], name="elsewhere")], ["20:28"])
    assert found.record.compared == 0
    assert any("No first-order lag" in note for note in found.record.notes)
    assert np.isnan(found.record.maneuvers[0].channels["q"].baseline_theil)


def test_at_another_rate_the_lag_stands_beside_the_model_too(job: FittedModel, folder: Path) -> None:
    flight = job.flights[0]
    halved = flight.data.isel(time=slice(None, None, 2))
    every = replace(flight, name="slower", data=halved, rate=0.5 * flight.rate, path=None)
    same, slower = (validate(folder, [f], ["20:28"]) for f in (replace(flight, name="again"), every))
    assert slower.record.compared == same.record.compared > 0
    before, now = (found.record.maneuvers[0].channels for found in (same, slower))
    for name in ("q", "alpha", "V"):
        assert now[name].baseline_theil == pytest.approx(before[name].baseline_theil, abs=0.03), name
    assert not any("no first-order lag" in note for note in slower.record.notes)


@pytest.mark.parametrize("steady", [True, False])
def test_a_state_that_was_not_recorded_is_estimated_about_steady_flight_and_named(
    job: FittedModel, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steady: bool
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise SimulationError("none found")

    if not steady:
        monkeypatch.setattr("stoop.prediction.predict.trim", fails)
    first = job.flights[0]
    flight = replace(first, data=first.data.assign_coords(time=first.data["time"] + 100.0))
    blind = replace(flight, name="blind", data=flight.data.assign(alpha=np.nan * flight.data["alpha"]))
    found = validate(folder, [blind], ["100:108"])
    (said,) = [w for w in found.record.warnings if "alpha not recorded at the start" in w]
    assert said.startswith("blind@100:108: ")
    assert ("about steady flight at that airspeed" if steady else "about a default") in said
    assert not any("a default is used" in note for note in found.record.notes)
    found.save(tmp_path)
    for file in ("validation.html", "validation.json"):
        assert "alpha not recorded at the start" in (tmp_path / file).read_text(encoding="utf-8")
    whole = validate(folder, [replace(flight, name="whole")], ["100:108"]).record.maneuvers[0].channels
    for name in ("V", "q", "theta"):  # the others tell the state, wherever the search for it begins
        assert found.record.maneuvers[0].channels[name].rmse < 1.3 * whole[name].rmse


def test_what_is_missing_is_one_line(job: FittedModel, folder: Path) -> None:
    flight = job.flights[0]
    lame = replace(flight, data=flight.data.drop_vars("elevator"))
    motors = {f"motor_{n}": ("time", 0.5 + 0.1 * flight.time % 0.1) for n in range(1, 5)}
    for flights, windows, says in (
        ([lame], ["20:28"], rf"elevator.*check which result {folder} is, the channels in it, or the mapping"),
        ([replace(lame, data=lame.data.assign(motors))], None,
         r"the vehicle of this log is carried by rotors, but .* has none: is it another"),
        ([flight, flight], ["20:28"], "two flights are called"),
    ):  # fmt: skip
        with pytest.raises(FlightError, match=says) as caught:
            validate(folder, flights, *filter(None, [windows]))
        assert "\n" not in str(caught.value)


def test_faulty_samples_are_those_of_the_fit(job: FittedModel) -> None:
    """A fit without the decision takes every sample as measured, and so do its predictions."""
    said = notice("samples-not-measured", variables=("q",))
    faulty = replace(job.flights[0], faults=(Fault("stuck", "q", 0.0, 22.0, 24.0, said),))
    states: tuple[tuple[Any, bool], ...] = (("off", True), ("not needed", False))
    for state, kept in states:
        result = replace(job.result, decisions=(DecisionRecord("faults", state),))
        found = validate(replace(job, result=result), faulty, ["20:28"])
        time, measured = found.model.traces[0].time, found.model.traces[0].channels["q"].measured
        inside = (time >= 22.0) & (time <= 24.0)
        assert np.isfinite(measured[inside]).all() == kept
        assert np.isfinite(measured[~inside]).all()
        assert (str(said) in found.record.notes) != kept
