"""Exports of an identification: its flight, its estimates with all their digits, its covariance."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.command_line import Done
from helpers.flown import with_few_free

from stoop.errors import OutputError
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_text
from stoop.workflow import FittedModel, fit
from stoop.workflow.load import load, model_or_vehicle
from stoop_analysis.known_model import Condition
from stoop_export.export import model_data, write
from stoop_export.exporter import ModelData
from stoop_export.jsbsim import EXPORT_PAGE as PAGE
from stoop_export.targets import export


@pytest.fixture(scope="module")
def model(folder: Path) -> ModelData:
    return model_data(model_or_vehicle(folder))


def test_estimates_and_starts_are_those_of_the_fit_to_the_last_digit(
    job: FittedModel, model: ModelData
) -> None:
    assert {n: model.vehicle.value(n) for n in job.estimate.estimates} == job.estimate.estimates
    assert model.covariance is not None
    assert np.array_equal(model.covariance.covariance, job.result.covariance.matrix)
    assert [m.title.partition(" (")[2] for m in model.maneuvers] == ["fitted)", "predicted)"]
    found = job.result.initial_states[0].values
    assert {n: model.maneuvers[0].start[n] for n in found} == {n: q.estimate for n, q in found.items()}
    assert model.maneuvers[0].vehicle.value("sensors.q.bias") == job.result.biases[0].values["q"].estimate


def test_our_simulation_of_a_maneuver_is_the_one_of_the_report(job: FittedModel, model: ModelData) -> None:
    from stoop_export.jsbsim_flight import differences, own_readings

    fitted = model.maneuvers[0]
    vehicle = fitted.vehicle
    apart = differences(vehicle.outputs, own_readings(fitted), fitted.measured)
    rms = dict(zip(vehicle.outputs, np.sqrt(np.nanmean(apart**2, axis=0)), strict=True))
    assert rms == pytest.approx({c: f.rmse for c, f in job.result.maneuvers[0].channels.items()}, rel=1e-9)


def test_jsbsim_flies_the_maneuvers(model: ModelData, tmp_path: Path) -> None:
    made = export(model, "jsbsim")
    write(made, tmp_path)
    assert "flight less JSBSim, rms" in (tmp_path / PAGE).read_text(encoding="utf-8")
    flown = [note for note in made.notes if "JSBSim within" in note]
    assert len(flown) == 3
    assert max(float(note.split("within ")[1].split()[0]) for note in flown) < 1e-3
    with pytest.raises(OutputError, match="add --overwrite"):
        write(made, tmp_path)
    write(made, tmp_path, overwrite=True)


def test_without_its_flight_it_says_so(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "r")
    (tmp_path / "r" / "flight.nc").unlink()
    alone = model_data(load(tmp_path / "r" / "result.json"))
    assert alone.maneuvers == ()
    assert alone.notes[0].startswith("No comparison with the flight: ")


def test_state_space_carries_standard_errors(model: ModelData) -> None:
    made = export(model, "state-space", Condition(airspeed=33.0))
    document = json.loads(made.files[made.main])
    assert document["states"][0] == {"name": "V", "unit": "m/s", "trim": 33.0}
    assert np.max(document["standard_errors"]["A"]) > 0.0


def test_a_maneuver_flies_with_its_own_loading(model: ModelData) -> None:
    """Another mass: JSBSim gets an aircraft of that mass, or it would be far off."""
    first = model.maneuvers[0]
    heavy = first.vehicle.with_numbers({"mass.mass": {"value": 1.2 * model.vehicle.value("mass.mass")}})
    loaded = replace(first, vehicle=heavy, title="heavy", loaded=True)
    made = export(replace(model, maneuvers=(loaded,)), "jsbsim")
    (note,) = [note for note in made.notes if note.startswith("heavy: ")]
    assert float(note.split("within ")[1].split()[0]) < 1e-3


GUSTS = """
[turbulence]
w = { intensity = { value = 0.6, free = true, bounds = [0.05, 6.0] }, length = 100.0 }
[loadings.rough]
"turbulence.w.length" = 80.0
"mass.mass" = 190.0
"""


def test_gusts_that_were_estimated_stay_behind(flight: Flight, tmp_path: Path) -> None:
    """A result by filter error, an intensity among its estimates, one maneuver in a loading that names a length."""
    vehicle = parse_vehicle(builtin_text("twin-boom") + GUSTS, "gusty").reduced("longitudinal")
    few, options = with_few_free(vehicle, ("Cmq", "turbulence.w.intensity")), Options(method="filter-error")
    found = fit(few, flight, ["0:8", "8:16#rough"], options=options)
    model = model_data(model_or_vehicle(found.save(tmp_path / "result")))
    assert model.covariance is not None
    assert model.covariance.names == ("Cmq",)
    assert model.covariance.covariance.shape == (1, 1)
    assert any("is not exported: the simulator" in note for note in export(model, "state-space").notes)
    assert [m.loaded for m in model.maneuvers] == [False, True]
    assert model.maneuvers[1].vehicle.value("mass.mass") == 190.0


def test_a_model_exported_without_jsbsim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: Done) -> None:
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    said = done(f"export twin-boom --to jsbsim -o {tmp_path}")
    assert "pip install '.[jsbsim]'" in said
    channels = ", ".join(f"stoop/channel/{name} (rad)" for name in ("elevator", "aileron", "rudder"))
    assert f"To be set in flight: {channels}, stoop/thrust-N (N)." in said
    written = [p for p in tmp_path.rglob("*") if p.is_file()]
    assert said.count("wrote ") == len(written) > 0
    assert all(str(path) in said for path in written)
    assert list(tmp_path.glob("aircraft/*/*.xml"))
    assert not (tmp_path / "export.html").exists()
