"""What is wrong with a flight or its mapping is said in words, with the line to change: simulated flights, damaged."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stoop.base.units import DEGREE, STANDARD_GRAVITY
from stoop.cli.main import main

INPUT = '[[input]]\ncontrol = "{}"\nshape = "{}"\nstart = {}\nstep = {}\namplitude = {}\n'
HOVER = "rate = 100.0\nduration = 8.0\naltitude = 200.0\n" + "".join(
    INPUT.format(*x)
    for x in (
        ("roll", "3-2-1-1", 1.0, 0.15, 15.0),
        ("pitch", "3-2-1-1", 3.0, 0.15, 15.0),
        ("yaw", "doublet", 5.0, 0.4, 1.0),
    )
)
CRUISE = "rate = 100.0\nduration = 10.0\nairspeed = 35.0\n" + "".join(
    INPUT.format(*x)
    for x in (
        ("elevator", "3-2-1-1", 1.0, 0.3, 0.1),
        ("aileron", "doublet", 5.0, 0.5, 0.1),
        ("rudder", "doublet", 7.0, 0.6, 0.1),
    )
)
FLOWN = {"quad": ("quad-x", HOVER), "twin": ("twin-boom", CRUISE)}
RATES, FORCE = ("p", "q", "r"), ("ax", "ay", "az")
WHOLE = {names: "variables.{}, variables.{} and variables.{}".format(*names) for names in (RATES, FORCE)}
MOTORS = tuple(f"motor_{n}" for n in range(1, 5))
G = 1 / STANDARD_GRAVITY
Columns = dict[str, np.ndarray]
Cli = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bad")
    for name, (vehicle, maneuver) in FLOWN.items():
        (folder / f"{name}.toml").write_text(maneuver)
        words = ["simulate", vehicle, "--maneuver", folder / f"{name}.toml", "-o", folder / f"{name}.csv"]
        assert main([*map(str, words)]) == 0
    return folder


@pytest.fixture
def here(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the flights; commands run in an empty one, so that names in messages are short."""
    monkeypatch.chdir(tmp_path)
    return place


def put(
    place: Path, name: str, change: Callable[[Columns], Columns], units: dict[str, str], out: str = "x"
) -> None:
    """Write a flight with its columns changed, and its mapping with other units, into the working folder."""
    table = np.genfromtxt(place / f"{name}.csv", delimiter=",", names=True)
    columns = change({key: table[key].copy() for key in table.dtype.names or ()})
    rows, head = np.column_stack(list(columns.values())), ",".join(columns)
    np.savetxt(f"{out}.csv", rows, delimiter=",", header=head, comments="", fmt="%.9g")
    lines = (place / f"{name}.csv.toml").read_text().splitlines()
    kept = [line for line in lines if " = { column" not in line or line.split()[0] in columns]
    for key, unit in units.items():
        kept = [
            f'{key} = {{ column = "{key}", unit = "{unit}" }}' if line.startswith(f"{key} = ") else line
            for line in kept
        ]
    mapped = {line.split()[0] for line in kept if line}
    added = [
        f'{key} = {{ column = "{key}", unit = "1" }}' for key in columns if key != "t" and key not in mapped
    ]
    Path(f"{out}.csv.toml").write_text("\n".join([*kept, *added, ""]))


def scaled(names: tuple[str, ...], by: float) -> Callable[[Columns], Columns]:
    return lambda c: {key: by * x if key in names else x for key, x in c.items()}


def said(cli: Cli, command: str) -> str:
    """Return all that a command prints, on one line; a refusal is one line already."""
    code, out, err = cli(command)
    assert code in (0, 2)
    assert code == 0 or err.count("\n") == 1
    return " ".join((out + err).split())


@pytest.mark.parametrize(
    ("name", "keys", "by", "unit", "words"),
    [
        ("quad", ("q",), 1.0, "deg/s", 'write unit = "rad/s" for variables.q in x.csv.toml'),
        ("twin", ("r",), 1 / DEGREE, "rad/s", 'write unit = "deg/s" for variables.r in x.csv.toml'),
        ("quad", ("phi",), 1.0, "deg", 'write unit = "rad" for variables.phi in x.csv.toml'),
        ("quad", RATES, 1 / DEGREE, "rad/s", f'write unit = "deg/s" for {WHOLE[RATES]} in x.csv.toml'),
        ("twin", FORCE, G, "m/s2", f'write unit = "g" for {WHOLE[FORCE]} in x.csv.toml'),
        ("quad", ("p",), -1.0, "rad/s", "write scale = -1 for variables.p in x.csv.toml"),
    ],
)
def test_a_wrong_unit_names_its_own_line(
    here: Path, cli: Cli, name: str, keys: tuple[str, ...], by: float, unit: str, words: str
) -> None:
    put(here, name, scaled(keys, by), dict.fromkeys(keys, unit))
    assert words in said(cli, "info x.csv")


def silent(c: Columns) -> Columns:
    return {key: x for key, x in c.items() if key not in RATES}


def test_two_logs_of_unlike_vehicles(here: Path, cli: Cli) -> None:
    logs = " ".join(str(here / f"{name}.csv") for name in FLOWN)
    windows = " ".join(f"{name}@0.5:7.5" for name in FLOWN)
    for vehicle, words in (("quad-x", "twin: input 'motor_1'"),
                           ("twin-boom", "quad: input 'elevator', 'aileron', 'rudder'")):  # fmt: skip
        told = said(cli, f"identify {logs} --vehicle {vehicle} --maneuver {windows} -o out")
        assert words in told
        assert "another? check --vehicle" in told or "another vehicle? check --vehicle" in told


def test_stoop_info_tells_a_log_that_shows_nothing_and_accuses_none_as_flown(here: Path, cli: Cli) -> None:
    for change, words in (
        (scaled(MOTORS, 0.0), "the motors never ran"), (silent, "p, q and r not recorded: moments"),
        (dict, "Suspected faults - none found"),
    ):  # fmt: skip
        put(here, "quad", change, {})
        assert words in said(cli, "info x.csv")
    put(here, "twin", dict, {})
    assert "Suspected faults - none found" in said(cli, "info x.csv")
