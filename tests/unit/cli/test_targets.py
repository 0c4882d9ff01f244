"""No verb replaces a file that it reads, a file without --overwrite, or what is no regular file; no input is without end."""

from __future__ import annotations

import os
import socket
import sys
from pathlib import Path

import pytest

from stoop.base.verbs import verbs
from stoop.cli.main import main
from stoop_studies.cli.verbs import VERBS as STUDIES

MANEUVER = "initial = { airspeed = 20.0 }\n"
#: a command, and its input that an output names: LOG.nc, LOG.csv, V.toml, M.toml or Q.csv
REPLACED = [
    ("identify LOG.nc --vehicle V.toml --maneuver 0:20 -o out --progress LOG.nc", "LOG.nc"),
    ("identify LOG.nc --vehicle V.toml --maneuver 0:20 -o out --progress V.toml", "V.toml"),
    ("identify LOG.nc --vehicle V.toml --maneuver W.toml -o out --progress W.toml", "W.toml"),
    ("identify LOG.nc --vehicle V.toml --maneuver 0:20 --noise Q.csv -o out --progress Q.csv", "Q.csv"),
    ("info LOG.nc --save LOG.nc", "LOG.nc"),
    ("look LOG.html -o LOG.html", "LOG.html"),
    ("map LOG.csv -o LOG.csv", "LOG.csv"),
    ("map folder -o folder/table.csv", "folder/table.csv"),
    ("linearize V.toml --airspeed 25 --json V.toml", "V.toml"),
    ("simulate V.nc --maneuver M.toml -o V.nc", "V.nc"),
    ("vehicle new LOG.csv --geometry G.toml --template twin-boom -o G.toml", "G.toml"),
    ("derivatives V.csv -o V.csv", "V.csv"),
    ("frequency LOG.html -o LOG.html", "LOG.html"),
    ("propagate V.html -o V.html", "V.html"),
    ("rotors LOG.nc --healthy H.html --vehicle quad-x -o H.html", "H.html"),
]


@pytest.fixture
def place(tmp_path: Path, flight_file: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    assert main(["vehicle", "twin-boom", "-o", "V.toml"]) == 0
    for name in ("V.csv", "V.nc", "V.html"):
        Path(name).write_bytes(Path("V.toml").read_bytes())
    for name in ("LOG.nc", "LOG.html", "H.html"):
        Path(name).write_bytes(flight_file.read_bytes())
    table = "t_s,roll,roll_rate\n" + "".join(f"{0.02 * i},{i},{i}\n" for i in range(100))
    Path("folder").mkdir()
    for name in ("LOG.csv", "folder/table.csv"):
        Path(name).write_text(table)
    Path("folder/mapping.toml").write_text('[time]\ncolumn = "t_s"\nunit = "s"\n')
    for name in ("M.toml", "W.toml", "Q.csv", "G.toml"):
        Path(name).write_text(MANEUVER)
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize(("command", "name"), REPLACED, ids=[command for command, _ in REPLACED])
def test_nothing_that_is_read_is_replaced(
    command: str, name: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(place)
    capsys.readouterr()
    for extra, said in (([], "exists already"), (["--overwrite"], "is read by this run")):
        code, error = main([*command.split(), *extra]), capsys.readouterr().err
        assert (code, error.count("\n")) == (2, 1)
        assert f"{name}: " in error
        assert said in error or "is read by this run" in error
        assert contents(place) == before


#: a command whose output is TARGET; files and folders
WRITTEN = [
    "vehicle twin-boom -o TARGET",
    "map LOG.csv -o TARGET",
    "linearize V.toml --airspeed 25 --json TARGET",
    "derivatives V.toml --airspeed 25 -o TARGET",
    "identify LOG.nc --vehicle V.toml --maneuver 0:20 -o out --progress TARGET",
    "info LOG.nc --save TARGET",
    "look LOG.nc -o TARGET.html",
    "export V.toml --to state-space --airspeed 25 -o EXPORT",
]


@pytest.mark.skipif(sys.platform == "win32", reason="no FIFOs")
def state(path: Path) -> tuple[int, ...]:
    """Return what replacing or writing a file changes; following a link changes its time of access, too."""
    own = path.lstat()
    return own.st_mode, own.st_ino, own.st_dev, own.st_nlink, own.st_size, own.st_mtime_ns, own.st_ctime_ns


@pytest.mark.parametrize("kind", ["link", "dangling", "fifo", "socket", "device"])
@pytest.mark.parametrize("command", WRITTEN)
def test_nothing_but_a_regular_file_is_replaced(
    kind: str, command: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    suffix = ".csv" if command.startswith("derivatives") else ""
    Path("EXPORT").mkdir()
    name = "TARGET.html" if command.startswith("look") else "TARGET"
    if command.startswith("export"):
        assert main(command.split()) == 0
        name = str(min(p for p in Path("EXPORT").iterdir()))
        Path(name).unlink()
    target = Path(name + suffix)
    if kind == "fifo":
        os.mkfifo(target)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as one:
            one.bind(str(target))
    else:
        target.symlink_to({"link": "V.toml", "dangling": "nowhere", "device": "/dev/full"}[kind])
    capsys.readouterr()
    before = state(target)
    assert main([*command.replace("TARGET", "TARGET" + suffix).split(), "--overwrite"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "would be replaced" in error
    assert state(target) == before


def test_a_hard_link_to_an_input_is_the_input(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.link("LOG.csv", "other.toml")
    assert main(["map", "LOG.csv", "-o", "other.toml", "--overwrite"]) == 2
    assert "other.toml: is read by this run" in capsys.readouterr().err


def test_two_outputs_of_one_name(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "LOG.nc", "-o", "a.html", "--save", "a.html"]) == 2
    assert "a.html: named for two outputs" in capsys.readouterr().err
    assert not Path("a.html").exists()


#: a command that reads ENDLESS
READ = [
    "trim ENDLESS --airspeed 25",
    "info LOG.csv --mapping ENDLESS",
    "info ENDLESS",
    "simulate twin-boom --maneuver ENDLESS -o made.nc",
    "identify LOG.nc --vehicle V.toml --maneuver ENDLESS -o out",
    "identify LOG.nc --vehicle V.toml --maneuver 0:20 --noise ENDLESS -o out",
    "vehicle new --template twin-boom --geometry ENDLESS -o made.toml",
    "validate folder LOG.nc -o out",
    "propagate folder",
]


@pytest.mark.skipif(sys.platform == "win32", reason="no devices")
@pytest.mark.parametrize("kind", ["device", "fifo", "growing"])
@pytest.mark.parametrize("command", READ)
def test_an_input_without_end_is_refused(
    kind: str, command: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [Path("endless.toml"), Path("folder/result.json")]
    if kind == "growing" and command == "info ENDLESS":
        return  # a log may be large
    for name in names:
        if kind == "fifo":
            os.mkfifo(name)  # nobody writes into it
        elif kind == "device":
            name.symlink_to("/dev/zero")
        else:
            with name.open("wb") as file:
                file.truncate(2**36)
    capsys.readouterr()
    assert main(command.replace("ENDLESS", "endless.toml").split()) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "endless.toml" in error or "result.json" in error


def test_every_output_of_the_table_asks_for_overwrite() -> None:
    """What an option writes is told from what it reads by its kind; nothing is written without --overwrite."""
    for verb in (*verbs().values(), *STUDIES.values()):
        written = [o.key for o in verb.options if o.kind in ("output", "output-or-print", "page")]
        if written:
            assert any(option.key == "overwrite" for option in verb.options), verb.name
        assert not any(o.key == "output" and o.kind == "file" for o in verb.options), verb.name


def test_structure_runs_without_candidates(place: Path) -> None:
    """Several values that are not given are an empty tuple in the table."""
    windows = ["--maneuver", "0.4:4.1", "-o", "out"]
    assert main(["structure", "V.toml", "LOG.nc", *windows]) == 0
    assert Path("out/vehicle.toml").is_file()
