import codecs
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from robustness.corpus import sound
from robustness.kills import differences, run_and_kill
from robustness.readers import READER, ask
from robustness.small_runs import COMMANDS, OUT, Ended, inputs, run, undisturbed
from robustness.trials import lay_out

from stoop.base import files
from stoop.base.toml import parse_source
from stoop.errors import LogError, StoopError, VehicleError


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    lay_out(tmp_path, inputs())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def complaint(ended: Ended) -> str:
    (line,) = (line for line in ended.stderr_lines if "rror" in line)
    assert ended.code == 2
    assert line.startswith("stoop: error: ")
    return line


@pytest.mark.parametrize("name", ["maneuvers", "flight", "identify"])
def test_an_output_folder_that_is_none_or_vanishes(name: str, place: Path, monkeypatch: Any) -> None:
    for make in (lambda out: out.symlink_to("nowhere"), lambda out: out.symlink_to(out.name), Path.touch):
        make(place / OUT)
        assert OUT in complaint(run(COMMANDS[name]))
        (place / OUT).unlink()
    (place / OUT).mkdir()
    scratch = files.scratch
    monkeypatch.setattr(files, "scratch", lambda folder: (shutil.rmtree(place / OUT), scratch(folder))[1])
    assert f"error: {OUT}" in complaint(run(COMMANDS[name]))
    assert not (place / OUT).exists()


SURROUNDINGS = {
    "no home": {"HOME": None, "XDG_CACHE_HOME": "/proc/nowhere", "STOOP_CACHE_DIR": None, "TMPDIR": None},
    "ASCII": {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii:strict"},
}


@pytest.mark.parametrize("name", SURROUNDINGS)
def test_homes_and_locales(name: str, place: Path) -> None:
    shutil.copy(place / "sim.nc", place / "flügé \N{AIRPLANE}.nc")
    changes = SURROUNDINGS[name]
    wanted = os.environ | {"LANG": None, "PYTHONUTF8": None} | changes
    environment = {key: value for key, value in wanted.items() if value is not None}
    flight = "flügé \N{AIRPLANE}.nc"
    for words in (["info", flight], ["maneuvers", flight, "-o", OUT])[: 1 if name == "no home" else 2]:
        done = subprocess.run([sys.executable, "-m", "stoop", *words], env=environment, capture_output=True)
        assert done.returncode == 0, done.stderr.decode(errors="replace")
        assert done.stdout


NAMES = {
    "new line": "two\nlines", "no text": "byte\udcff", "dash": "-dash", "long": "x" * 240, "blank": " ",
    "symbols": "\N{AIRPLANE}\N{PILE OF POO} e\u0301\u202ert", "quotes": "q'u\"o`t$(e) %s {} <b>&amp;",
    "control": "\x1b[31mred ~*?",
}  # fmt: skip


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_names_of_files(name: str, place: Path) -> None:
    flight, vehicle, out = (f"./{name}{ending}" for ending in (".nc", ".toml", ""))
    shutil.copy("sim.nc", flight)
    shutil.copy("v.toml", vehicle)
    options = ("--maneuver", "0:8", "--generations", "1", "-o", out)
    identify = ("identify", flight, "--vehicle", vehicle, *options)
    simulate = ("simulate", vehicle, "--maneuver", "m.toml", "-o", f"{out}.csv")
    for words in (("info", flight), identify, ("maneuvers", flight, "-o", f"{out}w"), simulate):
        ended = run(words)
        assert ended.code == 0, ended.stderr_lines
        assert all(line.isprintable() for line in ended.stderr_lines)
    document = json.loads((place / out / "result.json").read_text("utf-8"))
    assert document["maneuvers"][0]["flight"] == name.replace("\udcff", "?")
    assert (place / out / "report.html").read_text("utf-8").rstrip().endswith("</html>")
    assert complaint(run(("info", f"{flight}x"))).isprintable()
    assert complaint(run(identify)).isprintable()


PATHS = ("n" * 300, "/".join(["d" * 200] * 25), "./" * 1900 + "x", "v.toml/x", "\udcff", "a\nb")


def test_odd_paths_are_taken_or_refused_in_one_line(place: Path) -> None:
    for path in PATHS:
        for verb, *words in (("info",), ("trim",), ("map", "table.csv", "-o"), ("agreement", path)):
            ended = run((verb, *words, path))
            assert ended.code == 0 or complaint(ended).isprintable(), (verb, path[:20])
    lost = [name for name, content in inputs().items() if (place / name).read_bytes() != content]
    assert not lost


def test_texts_of_other_encodings_are_read_or_refused_with_advice(tmp_path: Path) -> None:
    """UTF-8 with a mark and old line ends are read; UTF-16, Latin-1 and zeros are refused; so are lines of a megabyte."""
    path, (log, mapping) = tmp_path / "a.csv", sound("csv")[0].write(tmp_path)
    table = log.read_text()
    for content in (codecs.BOM_UTF8 + table.encode(), table.replace("\n", "\r\n").encode()):
        path.write_bytes(content)
        assert not ask(path, mapping, READER)
    assert files.utf8_text(codecs.BOM_UTF8 + b"a\rb") == "a\nb"
    utf16 = codecs.BOM_UTF16_LE + table.encode("utf-16-le"), table.encode("utf-16-be")
    wrong = (*utf16, b"# \xe9\xff\n", b"a\0")
    for content in wrong:
        with pytest.raises(UnicodeError, match="save it as UTF-8"):
            files.utf8_text(content)
    for content in (*wrong, b"", codecs.BOM_UTF8, b"," * 2**20):
        path.write_bytes(content)
        with pytest.raises(LogError) as caught:
            ask(path, mapping, READER)
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 1000
    for line in ("a = " + "[" * 2**20, "0" * 2**20, '"' * 2**20):
        with pytest.raises(StoopError) as refused:
            parse_source(line, "v.toml", VehicleError)
        assert len(str(refused.value)) < 5000


def test_sigterm_keeps_the_best_and_the_search_goes_on(place: Path) -> None:
    (place / OUT).mkdir()
    expected = undisturbed(COMMANDS["search"])
    assert run_and_kill(COMMANDS["search"], place, 30, signal.SIGTERM) == 130
    assert json.loads((place / OUT / "result.json").read_text())["status"] == "interrupted"
    assert run((*COMMANDS["search"], "--resume")).code == 0
    assert differences(expected, place / OUT) == ""


def test_the_same_bits_on_any_number_of_threads_and_workers(place: Path) -> None:
    (place / OUT).mkdir()
    assert run(COMMANDS["bootstrap"], 3).code == 0
    assert differences(undisturbed(COMMANDS["bootstrap"]), place / OUT) == ""
    shutil.rmtree(place / OUT)
    (place / OUT).mkdir()
    command = [sys.executable, "-m", "stoop", *COMMANDS["compare"], "--workers", "2"]
    assert subprocess.run(command, capture_output=True).returncode == 0
    assert differences(undisturbed(COMMANDS["compare"]), place / OUT) == ""
