"""No verb replaces a file that it reads, a file without --overwrite, or what is no regular file; no input is without end."""

import os
import socket
import sys
from pathlib import Path

import pytest
from helpers.command_line import Cli, Refused

from stoop.base.verbs import verbs
from stoop.cli.main import main

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no FIFOs, no devices")
MANEUVER = "initial = { airspeed = 20.0 }\n"
#: a command, and its input that an output names
REPLACED = {
    "identify LOG.nc --vehicle V.toml --maneuver 0:20 -o out --progress LOG.nc": "LOG.nc",
    "identify LOG.nc --vehicle V.toml --maneuver 0:20 -o out --progress V.toml": "V.toml",
    "identify LOG.nc --vehicle V.toml --maneuver W.toml -o out --progress W.toml": "W.toml",
    "identify LOG.nc --vehicle V.toml --maneuver 0:20 --noise Q.csv -o out --progress Q.csv": "Q.csv",
    "info LOG.nc --save LOG.nc": "LOG.nc", "look LOG.html -o LOG.html": "LOG.html",
    "map LOG.csv -o LOG.csv": "LOG.csv", "map folder -o folder/table.csv": "folder/table.csv",
    "linearize V.toml --airspeed 25 --json V.toml": "V.toml", "simulate V.nc --maneuver M.toml -o V.nc": "V.nc",
    "vehicle new LOG.csv --geometry G.toml --template twin-boom -o G.toml": "G.toml",
    "derivatives V.csv -o V.csv": "V.csv", "frequency LOG.html -o LOG.html": "LOG.html",
    "propagate V.html -o V.html": "V.html", "rotors LOG.nc --healthy H.html --vehicle quad-x -o H.html": "H.html",
}  # fmt: skip


@pytest.fixture
def place(here: Path, flight_file: Path) -> Path:
    assert main(["vehicle", "twin-boom", "-o", "V.toml"]) == 0
    for name in ("V.csv", "V.nc", "V.html"):
        Path(name).write_bytes(Path("V.toml").read_bytes())
    for name in ("LOG.nc", "LOG.html", "H.html"):
        Path(name).write_bytes(flight_file.read_bytes())
    Path("folder").mkdir()
    for name in ("LOG.csv", "folder/table.csv"):
        Path(name).write_text("t_s,roll,roll_rate\n" + "".join(f"{0.02 * i},{i},{i}\n" for i in range(100)))
    Path("folder/mapping.toml").write_text('[time]\ncolumn = "t_s"\nunit = "s"\n')
    for name in ("M.toml", "W.toml", "Q.csv", "G.toml"):
        Path(name).write_text(MANEUVER)
    return here


def test_nothing_that_is_read_is_replaced(place: Path, refused: Refused) -> None:
    for command, name in REPLACED.items():
        for extra, said in ("", "exists already"), (" --overwrite", "is read by this run"):
            error = refused(command + extra)
            assert f"{name}: " in error, command
            assert said in error or "is read by this run" in error, command
    os.link("LOG.csv", "other.toml")
    assert "other.toml: is read by this run" in refused("map LOG.csv -o other.toml --overwrite")
    assert "a.html: named for two outputs" in refused("info LOG.nc -o a.html --save a.html")


#: a command whose output is TARGET
WRITTEN = (
    "vehicle twin-boom -o TARGET", "map LOG.csv -o TARGET", "linearize V.toml --airspeed 25 --json TARGET",
    "derivatives V.toml --airspeed 25 -o TARGET.csv",
    "identify LOG.nc --vehicle V.toml --maneuver 0:20 -o out --progress TARGET", "info LOG.nc --save TARGET",
    "look LOG.nc -o TARGET.html",
)  # fmt: skip


def state(path: Path) -> tuple[int, ...]:
    """Return what replacing or writing a file changes; following a link changes its time of access, too."""
    own = path.lstat()
    return own.st_mode, own.st_ino, own.st_dev, own.st_nlink, own.st_size, own.st_mtime_ns, own.st_ctime_ns


def unusual(target: Path, kind: str) -> None:
    target.unlink(missing_ok=True)
    if kind == "fifo":
        os.mkfifo(target)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as one:
            one.bind(str(target))
    else:
        target.symlink_to({"link": "V.toml", "dangling": "nowhere", "device": "/dev/full"}[kind])


def test_nothing_but_a_regular_file_is_replaced(place: Path, cli: Cli) -> None:
    def check(command: str, target: Path) -> None:
        before = state(target)
        code, _, error = cli(f"{command} --overwrite")
        assert (code, error.count("\n"), "would be replaced" in error) == (2, 1, True), command
        assert state(target) == before, command

    every = ("link", "dangling", "fifo", "socket", "device")
    for command in WRITTEN:
        for kind in every if command in WRITTEN[:2] else ("link",):
            unusual(target := Path(next(w for w in command.split() if w.startswith("TARGET"))), kind)
            check(command, target)
    exported = "export V.toml --to state-space --airspeed 25 -o EXPORT"
    assert main(exported.split()) == 0
    unusual(target := min(Path("EXPORT").iterdir()), "link")
    check(exported, target)


#: a command that reads endless.toml or folder/result.json
READ = (
    "info LOG.csv --mapping endless.toml", "validate folder LOG.nc -o out", "info endless.toml",
    "trim endless.toml --airspeed 25", "simulate twin-boom --maneuver endless.toml -o made.nc",
    "identify LOG.nc --vehicle V.toml --maneuver endless.toml -o out",
    "identify LOG.nc --vehicle V.toml --maneuver 0:20 --noise endless.toml -o out",
    "vehicle new --template twin-boom --geometry endless.toml -o made.toml", "propagate folder",
)  # fmt: skip


def test_an_input_without_end_is_refused(place: Path, cli: Cli) -> None:
    for kind, commands in (("device", READ), ("fifo", READ[:3]), ("growing", READ[:2])):
        for name in [Path("endless.toml"), Path("folder/result.json")]:
            name.unlink(missing_ok=True)
            if kind == "fifo":
                os.mkfifo(name)  # nobody writes into it
            elif kind == "device":
                name.symlink_to("/dev/zero")
            else:
                with name.open("wb") as file:
                    file.truncate(2**36)
        for command in commands:
            code, _, error = cli(command)
            assert (code, error.count("\n")) == (2, 1), (kind, command)
            assert "endless.toml" in error or "result.json" in error, (kind, command)


def test_every_output_of_the_table_asks_for_overwrite() -> None:
    for verb in verbs().values():
        if any(o.kind in ("output", "output-or-print", "page") for o in verb.options):
            assert any(option.key == "overwrite" for option in verb.options), verb.name
        assert not any(o.key == "output" and o.kind == "file" for o in verb.options), verb.name
