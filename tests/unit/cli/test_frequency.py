"""`stoop frequency`: a flight beside a vehicle file, and bad input in one line with what would mend it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from unit.cli.conftest import Refused

import stoop
from stoop.cli.main import main
from stoop.flight import Flight, flight_bytes
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import resolve_vehicle

MULTISINE = """
duration = {}
rate = {}
[[input]]
control = "{}"
shape = "multisine"
start = 1.0
duration = {}
amplitude = {}
band = {}
first = 5
[noise]
{} = 0.002
"""


@pytest.fixture(scope="module")
def flown() -> Flight:
    maneuver = parse_maneuver(MULTISINE.format(24.0, 50.0, "elevator", 22.0, 0.03, 3.0, "q"), "sweep")
    return simulate_flight(resolve_vehicle("twin-boom"), maneuver, name="sweep")


@pytest.fixture
def flight(flown: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "sweep.nc"
    path.write_bytes(flight_bytes(flown))
    return path


def test_flight_against_model(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["frequency", str(flight), "--vehicle", "twin-boom", "-o", "f.html", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (q,) = [r for r in found["responses"] if r["output"] == "q"]
    assert q["input"] == "elevator"
    model = np.array(q["model"]["real"]) + 1j * np.array(q["model"]["imag"])
    own = np.array(q["real"]) + 1j * np.array(q["imag"])
    exact = np.interp(q["frequency"], q["model"]["frequency"], np.abs(model))
    good = np.array(q["known"]) & (np.array(q["frequency"]) < 15.0)
    assert good.sum() > 15
    assert np.median(np.abs(np.abs(own) / exact - 1.0)[good]) < 0.1
    assert {n["code"] for n in found["notices"]} >= {"frequency-input-still", "frequency-no-band"}
    page = Path("f.html").read_text(encoding="utf-8")
    assert "Response of q to elevator" in page
    assert main(["frequency", str(flight), "-o", "f.html"]) == 2
    assert "exists" in capsys.readouterr().err


def test_rotors_are_taken_by_the_axes_that_they_command() -> None:
    """The response of p to the commanded roll acceleration is a lag before an integrator, by the rotors' lag alone."""
    vehicle = resolve_vehicle("quad-x")
    maneuver = parse_maneuver(MULTISINE.format(30.0, 100.0, "roll", 28.0, 8.0, 4.0, "p"), "hover")
    flight = simulate_flight(vehicle, maneuver, name="hover")
    found = stoop.frequency_responses(flight, "1:29", vehicle)
    assert "roll" in found.inputs
    p = found.response("roll", "p")
    good = (p.coherence > 0.9) & (p.frequency > 5.0)
    assert good.sum() > 10
    model = found.model["roll", "p"]
    lag = vehicle.value("rotors.lag")
    exact = 1.0 / (1j * model.frequency * (1.0 + 1j * model.frequency * lag))
    above = model.frequency > 25.0  # below, inflow damps the roll
    assert np.abs(model.response / exact - 1.0)[above].max() < 0.03
    flown = np.interp(p.frequency[good], model.frequency, np.abs(model.response)) / np.abs(p.response[good])
    assert np.median(np.abs(flown - 1.0)) < 0.05
    of_flight, of_model = (f.system for f in found.figures if f.output == "p")
    assert of_flight is not None
    assert of_model is not None
    assert of_flight.name == of_model.name == "rotors"
    constant = of_flight.parameters["time_constant"]
    assert constant.ci95_lower < lag < constant.ci95_upper
    assert of_model.parameters["time_constant"].estimate == pytest.approx(lag, rel=0.15)
    single = stoop.frequency_responses(flight, "1:29", vehicle, inputs=["motor_1", "motor_2"])
    assert ("motor_1", "p") in single.model


def test_without_a_model(flown: Flight) -> None:
    found = stoop.frequency_responses(flown, "1:23", outputs=["q"])
    assert found.inputs == ("elevator",)
    data = found.to_xarray()
    assert data.coherence.dims == ("output", "input", "frequency")
    assert float(data.coherence.max()) > 0.95
    assert not found.model


def test_bad_input(flight: Path, refused: Refused) -> None:
    for more, words in {
        "--input rudder --vehicle twin-boom": "it does not move",
        "--input elevater --vehicle twin-boom": "did you mean elevator",
        "--channel qq": "no such channel",
        "--maneuver 3:3.2": "longer or more windows",
        "--band 9:1": "LOW:HIGH in rad/s",
        "--band 0.01:0.02": "resolve nothing below",
        "--maneuver 0:0.9": "no input moves",
    }.items():
        assert words in refused(f"frequency {flight} {more}"), more
