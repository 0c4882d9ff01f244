"""`stoop frequency` and `stoop rotors`: what flights show, and what is said of those that cannot tell."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.command_line import Done, Refused

import stoop
from stoop.cli.main import main
from stoop.flight import Flight, flight_bytes
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle.builtin import load_vehicle
from stoop_plan.log_bytes import Event, crazyflie_bytes


def swept(control: str, rate: float, duration: float, amplitude: float, band: float, noisy: str) -> Maneuver:
    shape = {"control": control, "shape": "multisine", "start": 1.0, "duration": duration - 2.0, "first": 5}
    table = shape | {"amplitude": amplitude, "band": band}
    told = {"duration": duration, "rate": rate, "input": [table], "noise": {noisy: 0.002}}
    return Maneuver.model_validate(told)


@pytest.fixture(scope="module")
def flown() -> Flight:
    maneuver = swept("elevator", 50.0, 24.0, 0.03, 3.0, "q")
    return simulate_flight(load_vehicle("twin-boom"), maneuver, name="sweep")


@pytest.fixture
def flight(flown: Flight, here: Path) -> Path:
    (path := here / "sweep.nc").write_bytes(flight_bytes(flown))
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
    assert "Response of q to elevator" in Path("f.html").read_text(encoding="utf-8")
    assert main(["frequency", str(flight), "-o", "f.html"]) == 2
    assert "exists" in capsys.readouterr().err


def test_rotors_are_taken_by_the_axes_that_they_command() -> None:
    """The response of p to the commanded roll acceleration is a lag before an integrator, by the rotors' lag alone."""
    vehicle = load_vehicle("quad-x")
    flight = simulate_flight(vehicle, swept("roll", 100.0, 30.0, 8.0, 4.0, "p"), name="hover")
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
        "--input rudder --vehicle twin-boom": "it does not move", "--channel qq": "no such channel",
        "--input elevater --vehicle twin-boom": "did you mean elevator", "--band 9:1": "LOW:HIGH, the lower number first",
        "--maneuver 3:3.2": "longer or more windows", "--band 0.01:0.02": "resolve nothing below",
        "--maneuver 0:0.9": "no input moves",
    }.items():  # fmt: skip
        assert words in refused(f"frequency {flight} {more}"), more


VEHICLE = str(Path(__file__).parents[2] / "examples" / "crazyflie.toml")
LEVELS = {
    "a": (42000, 42300, 41800, 42100), "b": (42200, 42100, 42000, 41900), "c": (41900, 42000, 42150, 42050),
    "fine": (42000, 42050, 42000, 42000), "weak": (42000, 42050, 53000, 42000), "low": (42000, 42050, 42000, 42000),
}  # fmt: skip


def hop(commands: tuple[float, ...], seed: int, volts: float = 3.6) -> bytes:
    rng = np.random.default_rng(seed)
    time = 5.0 + 0.01 * np.arange(1400)
    up = (time > 7.0) & (time < 17.0)
    columns = {
        f"motor.m{i}": (up * (level + rng.normal(0.0, 500.0, time.size))).clip(0.0).astype(np.uint32)
        for i, level in enumerate(commands, 1)
    }
    battery = {"pm.vbatMV": np.full(time.size, 1e3 * volts, np.uint16)}
    return crazyflie_bytes({"fixedFrequency": Event(0, time, columns | battery)})


@pytest.fixture
def logs(tmp_path: Path) -> None:
    for seed, (name, levels) in enumerate(LEVELS.items()):
        (tmp_path / f"{name}.usd").write_bytes(hop(levels, seed, 3.3 if name == "low" else 3.6))


@pytest.mark.usefixtures("logs")
def test_weak_rotor_is_named_and_a_healthy_flight_is_not(here: Path, done: Done) -> None:
    said = done(f"rotors weak.usd fine.usd --healthy a.usd b.usd c.usd --vehicle {VEHICLE}")
    by_name = {line.split()[0]: line for line in said.splitlines() if line.strip()}
    assert "propeller or mass near M3" in by_name["weak"]
    for name in ("a", "b", "c", "fine"):
        assert "as healthy" in by_name[name]
    out = done(f"rotors fine.usd low.usd --healthy a.usd --vehicle {VEHICLE} --together")
    assert "2 flights" in out
    assert "low: the battery's voltage is more than 5 % from that of the healthy flights" in out
    out = " ".join(done(f"rotors weak.usd --healthy a.usd --vehicle {VEHICLE}").split())
    sharper = "more healthy flights, on several days: with 8 the smallest detectable loss"
    assert f"What would make it sharper - {sharper}" in out
    assert "swap the propeller of M3 with that of a rotor that turns the same way" in out


@pytest.mark.usefixtures("logs")
def test_what_cannot_be_done_is_said(refused: Refused) -> None:
    for words, complaint in {
        f"a.usd --healthy a.usd --vehicle {VEHICLE}": "a.usd: given twice",
        f"weak.usd --healthy a.usd a.usd --vehicle {VEHICLE}": "a.usd: given twice",
        "weak.usd --healthy a.usd --vehicle twin-boom": "has no rotors",
        f"weak.usd --healthy a.usd --vehicle {VEHICLE} --chance 0.7": "write a small share",
        "weak.usd --healthy a.usd --vehicle hexa-x": "motor_5, motor_6 not recorded",
    }.items():
        assert complaint in refused(f"rotors {words}"), words
