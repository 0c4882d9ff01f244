"""Fleets that are made up: what is drawn, what changes, and what the logs say."""

from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from stoop.base.files import write_files
from stoop.cli.main import main
from stoop.errors import StoopError
from stoop.flight.apply_mapping import Mapped
from stoop.flight.load import load_flight
from stoop.vehicle.builtin import load_vehicle
from stoop_fleet.headers import CLOCKS, header
from stoop_fleet.log_figures import rotors
from stoop_fleet.parts import read_parts
from stoop_fleet.simulation import FACTOR_SPREAD, FleetFile, MadeFlight, drawn, read_fleet, ready

QUAD = load_vehicle("quad-x")
THRUST = "rotor.m1.factor"
CALM = "vehicles = 2\nflights = 3\ndays = 3.0\nwind = 0.0\ngusts = 0.0\n[part.m1]\n"
WEAK = CALM + f'[[change]]\nvehicle = 2\nflight = 2\nnumber = "{THRUST}"\nby = -0.03\npart = "m1"\n'
SHORT = "duration = 8.0\nrate = 50.0\n"


def fleet(tmp_path: Path, text: str) -> FleetFile:
    path = tmp_path / "fleet.toml"
    path.write_text(text)
    return read_fleet(str(path), QUAD)


def flights(made: FleetFile, seed: int = 1) -> list[MadeFlight]:
    return drawn(made, ready(QUAD, made), seed)[0]


def test_a_change_is_all_that_two_fleets_differ_by(tmp_path: Path) -> None:
    head = 'vehicles = 3\nflights = 5\nvehicle = { "mass.mass" = 0.01 }\n'
    plain = flights(fleet(tmp_path, head))
    for kind, course in (("step", [0, 0, -0.03, -0.03, -0.03]), ("drift", [0, 0, -0.01, -0.02, -0.03])):
        change = f'[[change]]\nvehicle = 2\nflight = 3\nnumber = "{THRUST}"\nby = -0.03\nkind = "{kind}"\n'
        for one, other in zip(plain, flights(fleet(tmp_path, head + change)), strict=True):
            added = course[int(one.name[-3:]) - 1] if one.vehicle == "V2" else 0.0
            expected = {**one.numbers, THRUST: pytest.approx(one.numbers[THRUST] + added, abs=1e-15)}
            assert vars(other) | {"wind": 0} == vars(one) | {"wind": 0, "numbers": expected}
            assert np.array_equal(one.wind, other.wind)


def test_a_vehicle_is_the_same_whatever_the_number_of_vehicles(tmp_path: Path) -> None:
    few, many = (flights(fleet(tmp_path, f"vehicles = {n}\nflights = 4\n")) for n in (2, 5))
    assert len(many) == 20
    for one, other in zip(few, many, strict=False):
        assert vars(one) | {"wind": 0} == vars(other) | {"wind": 0}
        assert np.array_equal(one.wind, other.wind)


def test_differences_have_the_spreads_of_the_file_and_parts_keep_theirs(tmp_path: Path) -> None:
    made = fleet(tmp_path, 'vehicles = 200\nflights = 4\nvehicle = { "mass.mass" = 0.05 }\n')
    every, fittings = drawn(made, ready(QUAD, made), 3)
    masses = np.array([[f.numbers["mass.mass"] for f in every[4 * v : 4 * v + 4]] for v in range(200)])
    assert np.ptp(masses, axis=1).max() == 0.0
    assert masses[:, 0].mean() == pytest.approx(1.5, abs=4 * 0.05 / np.sqrt(200))
    assert masses[:, 0].std() == pytest.approx(0.05, rel=0.2)
    thrust: dict[str, set[float]] = {}
    for one in every:
        own = (f for f in fittings if (f.vehicle, f.part) == (one.vehicle, "m2"))
        (part,) = (f for f in own if f.begin <= one.begin < f.end)
        thrust.setdefault(part.serial, set()).add(one.numbers["rotor.m2.factor"])
    assert [len(values) for values in thrust.values()] == [1] * 400, "one exchange on each vehicle"
    assert np.std([*map(min, thrust.values())]) == pytest.approx(FACTOR_SPREAD, rel=0.15)


def test_the_logs_say_what_flew_and_a_weak_rotor_asks_for_more(tmp_path: Path, capsys: Any) -> None:
    """The share of a rotor in the commands is its lift over its factor, over the mean of all."""
    maneuver, folder = tmp_path / "m.toml", tmp_path / "logs"
    maneuver.write_text(SHORT)
    (tmp_path / "fleet.toml").write_text(WEAK + '[[update]]\nflight = 3\nsoftware = "1.1"\n')
    command = ["simulate", "quad-x", "--fleet", str(tmp_path / "fleet.toml"), "--maneuver", str(maneuver)]
    assert main([*command, "-o", str(folder), "--seed", "4"]) == 0
    out = capsys.readouterr().out
    assert "2 vehicles, 6 flights, seed 4" in out
    assert out.splitlines()[-1].startswith(f"next: stoop fleet {folder}/*.ulg --vehicle quad-x --parts ")
    truth = pd.read_csv(folder / "truth.csv", index_col="flight")
    assert truth[THRUST].tolist() == pytest.approx([1.0, 1.0, 1.0, 1.0, 0.97, 0.97])
    ((old, new),) = read_parts(folder / "parts.csv").exchanges("V2")
    assert (old.serial, new.serial) == ("m1-2-1", "m1-2-2")
    shares = {}
    for name, row in truth.iterrows():
        said = header(Mapped.read(folder / f"{name}.ulg", None, CLOCKS)[0])
        assert (said.vehicle, said.software) == (row.vehicle, "1.1" if str(name).endswith("3") else "1.0")
        assert said.zero == pytest.approx(pd.Timestamp(row.time).timestamp(), abs=0.51)
        found = {f.name: f.value for f in islice(rotors(load_flight(folder / f"{name}.ulg"), QUAD), 4)}
        shares[name] = np.array([found[f"share.m{i}"] for i in range(1, 5)])
    assert shares["V2-001"] == pytest.approx(shares["V1-003"], abs=1e-5)
    weak = shares["V2-001"] / [0.97, 1.0, 1.0, 1.0]
    assert shares["V2-003"] == pytest.approx(weak / weak.mean(), abs=1e-4)
    again = [*command, "-o", str(tmp_path / "again"), "--seed", "4"]
    assert main(again) == 0
    for path in folder.iterdir():
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes()
    assert main(again) == 2
    assert "exists already; add --overwrite" in capsys.readouterr().err


def test_gusts_move_the_commands_and_a_fleet_may_be_a_number(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(SHORT)
    words = ["simulate", "quad-x", "--fleet", "1", "--maneuver", str(tmp_path / "m.toml")]
    assert main([*words, "-o", str(tmp_path / "a")]) == 0
    assert len(list((tmp_path / "a").glob("*.ulg"))) == 12
    motors, other = (load_flight(tmp_path / "a" / f"V1-00{i}.ulg").column("motor_1") for i in (1, 2))
    assert 1e-4 < motors.std() < 0.05
    assert abs(np.corrcoef(motors, other)[0, 1]) < 0.9, "gusts of their own"


def test_a_wrong_fleet_is_named_and_nothing_is_written(tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    change = '[[change]]\nvehicle = {}\nflight = {}\nnumber = "mass.mass"\nby = 1.0'
    for text, said in (
        ("vehicels = 2", "vehicels: unknown key"), ("flights = 1", "flights: "), ("vehicles = 2.5", "vehicles: "),
        (change.format(9, 2), "vehicle 9 of 4"), (change.format(1, 20), "flight 20 of 12"),
        (WEAK.replace('part = "m1"', 'part = "m9"'), "there is no part 'm9'"),
        ('[[update]]\nflight = 1\nsoftware = "2"', "update.0.flight"), ('vehicle = { "mass.mass" = -1.0 }', "vehicle.mass.mass"),
    ):  # fmt: skip
        with pytest.raises(StoopError, match=said):
            fleet(tmp_path, text)
    monkeypatch.chdir(tmp_path)
    write_files(tmp_path, {"with-others/flown.ulg": b""})
    for text, words, said in (
        ('vehicle = { "mass.mas" = 0.1 }', [], "no number is called 'mass.mas'; did you mean mass.mass"),
        ("flights = 100\ndays = 0.01", [], "100 flights do not fit into 0.01 days; raise days"),
        ("", ["--autopilot", "fleet.toml"], "--autopilot flies one flight"),
        ('vehicles = 1\nflights = 2\nflight = { "mass.mass" = 2.0 }', [], "flight V1-00"),
        ("", ["-o", "with-others"], "holds flown.ulg, which is no log of this fleet"),
    ):
        Path("fleet.toml").write_text(text)
        assert main(["simulate", "quad-x", "--fleet", "fleet.toml", "-o", "logs", *words]) == 2
        assert said in capsys.readouterr().err.splitlines()[-1]
        assert not list(tmp_path.glob("logs/*"))
