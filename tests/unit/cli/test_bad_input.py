"""Whatever is wrong with what the user gives: one line that names the file and the fix, code 2, nothing written."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import pytest

from stoop.cli.main import main

TWIN_BOOM = (files("stoop.data") / "twin_boom.toml").read_text()
MANEUVER = (Path(__file__).parents[3] / "examples" / "maneuver_3211.toml").read_text()
MAPPING = """
[time]
column = "t"
unit = "s"
[variables]
q = { column = "q", unit = "rad/s" }
theta = { column = "theta", unit = "rad" }
"""


@pytest.fixture
def refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """Return what runs a command in an empty folder and gives back its one line of complaint."""
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> str:
        before = snapshot(tmp_path)
        assert main(words) == 2
        out, err = capsys.readouterr()
        assert err.startswith("stoop: error: ")
        assert err.endswith("\n")
        assert err.count("\n") == 1
        assert err[:-1].isprintable()
        assert snapshot(tmp_path) == before
        return err + out

    return run


def snapshot(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else b"" for p in folder.rglob("*")}


def table(theta: Callable[[float], float], clock: Callable[[int], float] = lambda i: 0.01 * i) -> str:
    """Return a CSV log of a swinging pitch angle, rad, and its rate, rad/s."""
    rows = (f"{clock(i)},{0.1 * math.cos(0.02 * i)},{theta(0.02 * i)}" for i in range(500))
    return "\n".join(["t,q,theta", *rows, ""])


LOGS = {
    "missing.ulg": (None, "no such file or folder; check the name"),
    "empty.ulg": (b"", "empty"),
    "garbage.ulg": (b"\x00\xff" * 500, "not a ULog file"),
    "empty.csv": (b"", "empty"),
    "empty.nc": (b"", "empty"),
    "text.nc": (b"hello", "not a netCDF-3 file"),
    "damaged.nc": (b"CDF\x01" + bytes(range(256)), "write the flight again"),
    "log.bin": (b"abc", "unknown format; stoop reads .ulg, .nc, .csv"),
    "bare.csv": (b"t,q\n0,1\n1,2\n", "needs a mapping"),
    "\x1b[31mred\x1b[0m.ulg": (b"", "empty"),
    "[bold red]x[1].ulg": (b"", "empty"),
    "two\nlines.ulg": (b"", "empty"),
}  #: name -> content, what the complaint says


@pytest.mark.parametrize("name", LOGS)
def test_log(name: str, refused: Callable[..., str]) -> None:
    content, complaint = LOGS[name]
    if content is not None:
        Path(name).write_bytes(content)
    said = refused("info", name)
    assert complaint in said
    if name.isprintable():
        assert said.startswith(f"stoop: error: {name}: ")


def test_truncated_flight(flight_file: Path, refused: Callable[..., str]) -> None:
    content = flight_file.read_bytes()
    for length in (4, 100, len(content) // 2, len(content) - 1):
        Path("cut.nc").write_bytes(content[:length])
        assert "cut.nc: " in refused("info", "cut.nc")


def test_truncated_ulog(shared_data: Path, refused: Callable[..., str]) -> None:
    content = (shared_data / "px4-ulog-reader-samples" / "sample_log_small.ulg").read_bytes()
    Path("cut.ulg").write_bytes(content[:3000])
    assert "cut.ulg: " in refused("info", "cut.ulg")


def test_folder_without_topics(refused: Callable[..., str]) -> None:
    Path("folder").mkdir()
    assert "folder: no PX4 topic among its files" in refused("info", "folder")


TABLES = {
    "degrees": (table(lambda x: 5.0 * math.sin(x)), MAPPING, "degrees"),
    "no column": (table(math.sin).replace("theta", "pitch"), MAPPING, "'theta' is not in log.csv"),
    "backward": (table(lambda x: 0.0, lambda i: -float(i)), MAPPING, "time"),
    "no time": ("t,q,theta\n" + "x,1,1\n" * 50, MAPPING, "time"),
    "unknown variable": (table(math.sin), MAPPING.replace("q =", "pitch_rate ="), "no variable of stoop"),
    "unknown unit": (table(math.sin), MAPPING.replace('"rad"', '"grad"'), "did you mean rad"),
    "broken mapping": (table(math.sin), "[time", "not valid TOML"),
}  #: what is wrong -> log, mapping, what the complaint says


@pytest.mark.parametrize("what", TABLES)
def test_csv(what: str, refused: Callable[..., str]) -> None:
    log, mapping, complaint = TABLES[what]
    Path("log.csv").write_text(log)
    Path("columns.toml").write_text(mapping)
    said = refused("info", "log.csv", "--mapping", "columns.toml")
    assert complaint in said
    assert ".csv: " in said or ".toml: " in said


def test_missing_mapping(refused: Callable[..., str]) -> None:
    Path("log.csv").write_text(table(math.sin))
    assert "columns.toml: cannot read the mapping file" in refused(
        "info", "log.csv", "--mapping", "columns.toml"
    )


VEHICLES = {
    "zero mass": ("mass = 189.40", "mass = 0.0", "mass.mass"),
    "mass that is no number": ("mass = 189.40", "mass = nan", "mass.mass"),
    "text for a number": ("mass = 189.40", 'mass = "heavy"', "mass.mass"),
    "inertia": ("zz = 200.0", "zz = 300.0", "mass.inertia"),
    "unknown variable": (
        "CLalpha = 4.78",
        'CLx = { term = "alpha*flap", value = 0.1 }',
        "unknown variable 'flap'",
    ),
    "unknown term": ("CLalpha = 4.78", "CLx = 4.78", "CLx"),
    "code": ("CLalpha = 4.78", "CLx = { term = \"__import__('os').abort()\", value = 0.1 }", "not allowed"),
    "unknown key": ("chord =", "cord =", "chord"),
    "degrees": ("alpha = 0.0", "alpha = 5.88", "radians"),
    "no TOML": ("[mass]", "[mass", "TOML"),
    "no lift": ("CLalpha = 4.78", "CLalpha = 0.0", "no steady flight"),
}  #: what is wrong -> written, instead of, what the complaint says


@pytest.mark.parametrize("verb", ["trim", "linearize", "simulate"])
@pytest.mark.parametrize("what", VEHICLES)
def test_vehicle(verb: str, what: str, refused: Callable[..., str]) -> None:
    old, new, complaint = VEHICLES[what]
    assert old in TWIN_BOOM
    Path("v.toml").write_text(TWIN_BOOM.replace(old, new))
    Path("m.toml").write_text(MANEUVER)
    more = ["--maneuver", "m.toml", "-o", "out.nc"] if verb == "simulate" else []
    said = refused(verb, "v.toml", *more)
    assert said.startswith("stoop: error: v.toml: ")
    assert complaint in said


@pytest.mark.parametrize("content", [None, b"", b"\xff\xfe\x00", b"\x00" * 100])
def test_vehicle_file_that_is_none(content: bytes | None, refused: Callable[..., str]) -> None:
    if content is not None:
        Path("v.toml").write_bytes(content)
    assert refused("trim", "v.toml").startswith("stoop: error: v.toml: ")


MANEUVERS = {
    "unknown shape": ('"3-2-1-1"', '"4-3-2"', "3-2-1-1"),
    "unknown control": ('"elevator"', '"elevtor"', "elevator"),
    "negative duration": ("duration = 30.0", "duration = -1.0", "duration"),
    "endless duration": ("duration = 30.0", "duration = inf", "duration"),
    "unknown key": ("step = 0.3", "stp = 0.3", "step"),
    "no TOML": ("[[input]]", "[[input", "TOML"),
    "too slow to fly": ("airspeed = 35.0", "airspeed = 3.0", "no steady flight"),
}  #: what is wrong -> written, instead of, what the complaint says


@pytest.mark.parametrize("what", MANEUVERS)
def test_maneuver(what: str, refused: Callable[..., str]) -> None:
    old, new, complaint = MANEUVERS[what]
    assert old in MANEUVER
    Path("m.toml").write_text(MANEUVER.replace(old, new))
    said = refused("simulate", "twin-boom", "--maneuver", "m.toml", "-o", "out.nc")
    assert complaint in said
    assert "m.toml: " in said or "twin-boom: " in said


def test_unknown_noise_names_the_file(refused: Callable[..., str]) -> None:
    Path("m.toml").write_text(MANEUVER + "\n[noise]\nspeed = 1.0\n")
    assert "m.toml: " in refused("simulate", "twin-boom", "--maneuver", "m.toml", "-o", "out.nc")


@pytest.mark.parametrize(
    ("target", "complaint"),
    [
        ("flight.txt", "end its name in .nc"),
        ("flight", "end its name in .nc"),
        ("", "this is a folder"),
        ("nowhere/flight.nc", "there is no folder nowhere; make it first"),
        ("folder.nc", "this is a folder"),
    ],
)
def test_output(target: str, complaint: str, refused: Callable[..., str]) -> None:
    Path("m.toml").write_text(MANEUVER)
    Path("folder.nc").mkdir()
    assert complaint in refused("simulate", "twin-boom", "--maneuver", "m.toml", "-o", target)


OPTIONS = [
    ["trim", "twin-boom", "--airspeed", "nan"],
    ["trim", "twin-boom", "--airspeed", "-3"],
    ["trim", "twin-boom", "--airspeed", "1e300"],
    ["trim", "twin-boom", "--airspeed", "fast"],
    ["trim", "twin-boom", "--altitude", "20000"],
    ["trim", "twin-boom", "--climb-angle", "90"],
    ["trim", "twin-boom", "--density", "0"],
    ["trim", "twin-boom", "--reduce", "lateral"],
    ["linearize", "twin-boom", "--reduce", "vertical"],
    ["simulate", "twin-boom", "--maneuver", "m.toml", "-o", "a.nc", "--seed", "-1"],
]


@pytest.mark.parametrize("words", OPTIONS, ids=" ".join)
def test_options(words: list[str], refused: Callable[..., str]) -> None:
    assert words[-2] in refused(*words)


def test_maneuver_is_required(refused: Callable[..., str]) -> None:
    assert "--maneuver" in refused("simulate", "twin-boom", "-o", "a.nc")


@pytest.mark.parametrize("name", ["[bold red]x[/] \x1b[31m", "two\\nlines", "\u202ereversed"])
def test_hostile_name_in_a_vehicle_file(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    quoted = name.replace("\x1b", "\\u001b")
    path = tmp_path / "v.toml"
    path.write_text(TWIN_BOOM.replace('name = "Twin-boom', f'name = "{quoted}'), encoding="utf-8")
    for verb in ("trim", "linearize"):
        assert main([verb, str(path), "--reduce", "longitudinal"]) == 0
        out, err = capsys.readouterr()
        assert err == ""
        assert all(line.isprintable() for line in out.split("\n"))
        assert "[bold red]x[/]" in out or "bold" not in name


def test_real_process_leaves_no_traceback(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "stoop", "info", os.fsdecode(b"lost\xff.ulg")],
        cwd=tmp_path,
        capture_output=True,
        check=False,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )
    assert done.returncode == 2
    assert done.stdout == b""
    assert done.stderr == b"stoop: error: lost\\udcff.ulg: no such file or folder; check the name\n"
