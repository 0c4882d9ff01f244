"""Verbs in odd surroundings: folders, clocks, memory, terminals, homes, locales, names of files, threads and workers."""

from __future__ import annotations

import contextlib
import io
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import pytest
from studies.robustness import disk_full
from studies.robustness.interruptions import Kill, differences, run_and_kill
from studies.robustness.small_runs import (
    COMMANDS,
    OUT,
    Ended,
    inputs,
    reproducible_outputs,
    run,
    undisturbed,
)
from studies.robustness.trials import PAGE, lay_out

from stoop.base import files
from stoop.cli.main import all_verbs, main
from stoop.flight.flight import flight_name
from stoop.parallel import pools

QUICK = ("maneuvers", "simulink", "flight", "table", "linearize", "map", "vehicle", "figure")
READ_ONLY = 1  #: of mount.h
MODEL = ("--vehicle", "v.toml", "--maneuver", "0:8")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    lay_out(tmp_path, inputs())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def complaint(ended: Ended) -> str:
    """Return the line of an error of ours, the only one."""
    (line,) = (line for line in ended.stderr_lines if "rror" in line)
    assert ended.code == 2
    assert line.startswith("stoop: error: ")
    return line


WAYS: dict[str, Callable[[Path], None]] = {
    "dangling link": lambda out: out.symlink_to("nowhere"),
    "link to itself": lambda out: out.symlink_to(out.name),
    "file": Path.touch,
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", [*QUICK, "identify", "compare"])
def test_an_output_folder_that_is_none(name: str, way: str, place: Path) -> None:
    WAYS[way](place / OUT)
    assert OUT in complaint(run(COMMANDS[name]))


@pytest.mark.parametrize("name", [*QUICK, "identify", "compare"])
def test_a_folder_on_a_disk_that_is_read_only(name: str, place: Path) -> None:
    """Of a file system, not of a mode: that holds for root, too."""
    if not disk_full.has_name_spaces():
        pytest.skip("this system lets nobody make file systems")
    (place / OUT).mkdir()

    def tried() -> str:
        disk_full.Disk(place / OUT).resize("", 0, READ_ONLY)
        return complaint(run(COMMANDS[name]))

    assert OUT in disk_full.in_a_copy(tried)


@pytest.mark.parametrize("name", QUICK)
def test_a_folder_that_vanishes_meanwhile(name: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (place / OUT).mkdir()
    scratch = files.scratch

    @contextlib.contextmanager
    def late(folder: Path) -> Iterator[Path]:
        shutil.rmtree(place / OUT)
        with scratch(folder) as made:
            yield made

    monkeypatch.setattr(files, "scratch", late)
    assert f"error: {OUT}/" in complaint(run(COMMANDS[name]))
    assert not (place / OUT).exists()


@pytest.mark.parametrize("name", ["identify", "compare", "table"])
def test_a_clock_that_goes_backwards(name: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = undisturbed(COMMANDS[name])
    past = count(2_000_000_000, -86_400)
    monkeypatch.setattr(time, "time", lambda: float(next(past)))
    (place / OUT).mkdir()
    assert run(COMMANDS[name]).code == 0
    assert differences(expected, place / OUT) == ""


@pytest.mark.parametrize("more", [0, 2**18, 2**22])
@pytest.mark.parametrize("name", ["identify", "simulink", "table", "info"])
def test_little_memory(name: str, more: int, place: Path) -> None:
    """The verb ends as ever or in one line, and what it writes is whole."""
    words = ("info", "sim.nc") if name == "info" else COMMANDS[name]
    (place / OUT).mkdir()
    if name != "info":
        undisturbed(words)

    def tried() -> str:
        size = int(Path("/proc/self/statm").read_text().split()[0]) * PAGE + more
        resource.setrlimit(resource.RLIMIT_AS, (size, resource.RLIM_INFINITY))
        ended = run(words)
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        return complaint(ended) if ended.code else ""

    message = disk_full.in_a_copy(tried)
    assert message == "" or "memory" in message
    if name != "info" and not message:
        assert differences(undisturbed(words), place / OUT) == ""


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("name", [*QUICK, "identify", "info", "trim", "vehicles"])
def test_a_terminal_of_one_column(name: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = {"info": ("info", "sim.nc"), "trim": ("trim", "v.toml"), "vehicles": ("vehicle",)}
    monkeypatch.setenv("COLUMNS", "1")
    monkeypatch.setenv("TERM", "xterm")
    (place / OUT).mkdir()
    stderr = Terminal()
    with (
        reproducible_outputs(),
        contextlib.redirect_stdout(Terminal()) as stdout,
        contextlib.redirect_stderr(stderr),
    ):
        assert main(shown.get(name) or COMMANDS[name]) == 0, stderr.getvalue()
    assert stdout.getvalue()


def test_help_on_a_terminal_of_one_column(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "1")
    for verb in all_verbs():
        assert main([*verb.split(), "--help"]) == 0
    assert "usage" in capsys.readouterr().out


SURROUNDINGS = {
    "no home": {"HOME": None, "XDG_CACHE_HOME": "/proc/nowhere", "STOOP_CACHE_DIR": None, "TMPDIR": None},
    "ASCII": {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii:strict"},
    "Turkish": {"LC_ALL": "tr_TR.UTF-8", "PYTHONIOENCODING": "iso8859-9:strict"},
}


@pytest.mark.parametrize("name", SURROUNDINGS)
def test_homes_and_locales(name: str, place: Path) -> None:
    """A flight and a vehicle with names beyond ASCII are read, and a mapping is drafted."""
    text = (place / "v.toml").read_text("utf-8").replace('name = "', 'name = "Flügel \N{AIRPLANE} ', 1)
    (place / "v.toml").write_text(text, "utf-8")
    shutil.copy(place / "sim.nc", place / "flügé \N{AIRPLANE}.nc")
    changes = SURROUNDINGS[name]
    kept = {
        key: value
        for key, value in os.environ.items()
        if key not in changes and key not in ("LANG", "PYTHONUTF8")
    }
    environment = kept | {key: value for key, value in changes.items() if value is not None}
    commands = [
        ["info", "flügé \N{AIRPLANE}.nc"],
        ["map", "table.csv"],
        ["maneuvers", "flügé \N{AIRPLANE}.nc", "-o", OUT],
    ]
    for words in commands if name != "no home" else commands[:2]:
        done = subprocess.run([sys.executable, "-m", "stoop", *words], env=environment, capture_output=True)
        assert done.returncode == 0, done.stderr.decode(errors="replace")
        assert done.stdout


NAMES = {
    "new line": "two\nlines",
    "no text": "byte\udcff",
    "dash": "-dash",
    "long": "x" * 240,
    "symbols": "\N{AIRPLANE}\N{PILE OF POO} e\u0301\u202ert",
    "quotes": "q'u\"o`t$(e) %s {} <b>&amp;",
    "control": "\x1b[31mred ~*?",
    "blank": " ",
}


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_names_of_files(name: str, place: Path) -> None:
    """Each verb reads, writes and prints them; the page and the tables are text."""
    flight, vehicle, out = (f"./{name}{ending}" for ending in (".nc", ".toml", ""))
    shutil.copy("sim.nc", flight)
    shutil.copy("v.toml", vehicle)
    window = "0:8" if name in ("-dash", " ") else f"{flight_name(Path(flight))}@0:8"
    identify = (
        "identify",
        flight,
        "--vehicle",
        vehicle,
        "--maneuver",
        window,
        "--generations",
        "1",
        "-o",
        out,
    )
    commands = (
        ("info", flight),
        identify,
        ("export", out, "--to", "state-space", "-o", f"{out}e"),
        ("maneuvers", flight, "-o", f"{out}w"),
        ("simulate", vehicle, "--maneuver", "m.toml", "-o", f"{out}.csv"),
    )
    for words in commands:
        ended = run(words)
        assert ended.code == 0, ended.stderr_lines
        assert all(line.isprintable() for line in ended.stderr_lines)
    document = json.loads((place / out / "result.json").read_text("utf-8"))
    assert document["maneuvers"][0]["flight"] == name.replace("\udcff", "?")
    assert (place / out / "report.html").read_text("utf-8").rstrip().endswith("</html>")
    assert complaint(run(("info", f"{flight}x"))).isprintable()
    assert complaint(run(identify)).isprintable()


def test_two_drivers(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second of two equal commands leaves the first alone."""
    monkeypatch.setattr("stoop.parallel.store._PATIENCE", 0.0)
    (place / OUT).mkdir()
    seen: list[str] = []
    perform = pools.perform

    def again(*given: object) -> object:
        if not seen:
            seen.append("")
            seen[0] = complaint(run(COMMANDS["compare"]))
        return perform(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(pools, "perform", again)
    assert run(COMMANDS["compare"]).code == 0
    assert "in use by another process" in seen[0]
    assert differences(undisturbed(COMMANDS["compare"]), place / OUT) == ""


def test_sigterm_keeps_the_best_and_the_search_goes_on(place: Path) -> None:
    (place / OUT).mkdir()
    expected = undisturbed(COMMANDS["search"])
    assert run_and_kill(COMMANDS["search"], place, Kill(signal.SIGTERM, change=30)) == 130
    assert json.loads((place / OUT / "result.json").read_text())["status"] == "interrupted"
    assert run((*COMMANDS["search"], "--resume")).code == 0
    assert differences(expected, place / OUT) == ""


@pytest.mark.parametrize("threads", [2, 3, 4])
def test_the_same_bits_on_any_number_of_threads(threads: int, place: Path) -> None:
    (place / OUT).mkdir()
    assert run(COMMANDS["bootstrap"], threads).code == 0
    assert differences(undisturbed(COMMANDS["bootstrap"]), place / OUT) == ""


@pytest.mark.parametrize("workers", ["1", "2", "3", "4"])
def test_the_same_bits_on_any_number_of_workers(workers: str, place: Path) -> None:
    (place / OUT).mkdir()
    command = [sys.executable, "-m", "stoop", *COMMANDS["compare"], "--workers", workers]
    assert subprocess.run(command, capture_output=True).returncode == 0
    assert differences(undisturbed(COMMANDS["compare"]), place / OUT) == ""
