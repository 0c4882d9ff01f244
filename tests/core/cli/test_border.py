"""Text of files comes to a terminal by one border only: printable, on as many lines as were meant, and never as markup."""

import ast
import io
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.command_line import Cli
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from rich.text import Text

import stoop
from stoop.base.text import printable, show
from stoop.cli.main import main
from stoop.cli.page import Page, words
from stoop.cli.progress import LiveLine, Timed
from stoop.flight import load_flight
from stoop.vehicle import load_vehicle

NASTY = "\x1b[31m[red]\u202e\x9b2J\x07"  #: colors, markup, reversed text, an escape of one byte, a bell
VEHICLE = Path(stoop.__file__ or "").parent / "data" / "twin_boom.toml"
ANY = st.text(st.characters(exclude_categories=()))
CALL = re.compile(r"\b(print|pprint|print_exc|print_exception|Console|input|os\.write|std(out|err)\.write)\(")


def printing_calls() -> Iterator[tuple[str, str, ast.Call]]:
    folder = Path(stoop.__file__ or "").parents[1]
    examples = folder / "stoop" / "data" / "examples"  # of a wheel
    for path in (p for p in folder.glob("stoop*/**/*.py") if not p.is_relative_to(examples)):
        text = path.read_text(encoding="utf-8")
        if not CALL.search(text) and path.name not in ("page.py", "progress.py"):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call):
                yield path.name, getattr(node.func, "attr", getattr(node.func, "id", "")), node


def test_only_the_border_prints_and_rich_is_given_texts() -> None:
    named, found = {"print", "pprint", "print_exc", "print_exception", "Console", "input"}, set()
    for file, name, call in printing_calls():
        given, function = ast.unparse(call), ast.unparse(call.func)
        if name in named:
            found.add((name, file))
        if file in ("page.py", "progress.py") and name in ("print", "status", "update"):
            assert any(kind in given for kind in ("Text(", "Timed(", "markup=False", "print(grid)")), given
        if name in ("write", "writelines"):
            assert not re.search(r"\bstd\w+\.write", function), file
            assert function != "os.write" or "stderr" not in given or "MESSAGE.encode()" in given, file
    assert found == {
        ("print", "text.py"),  # `show`
        ("Console", "page.py"), ("print", "page.py"),  # of rich, given a Text
        ("Console", "progress.py"), ("print", "progress.py"),
        ("input", "vehicle_new.py"),
    }  # fmt: skip


@settings(max_examples=40)
@given(ANY)
def test_plain_text_and_the_live_line(text: str) -> None:
    out, before = io.StringIO(), sys.stderr
    show(text, out)
    assert all(line.isprintable() for line in out.getvalue().split("\n"))
    assert out.getvalue().count("\n") == text.count("\n") + 1
    sys.stderr = out = io.StringIO()
    try:
        with LiveLine(text) as live:
            live.show(text, 1e9, news=True)
            live.warn(text)
    finally:
        sys.stderr = before
    assert out.getvalue().split("\n") == [printable(text), f"stoop: {printable(text)}", ""]
    line = Timed(text, time.perf_counter()).__rich__()
    assert isinstance(line, Text)
    assert line.plain.startswith(printable(text))


@given(ANY | st.sampled_from([NASTY, "[/]", "[link=a]b[/link]", ":bug:", "\\["]))
def test_every_part_of_a_page(text: str) -> None:
    for tty in (False, True):
        out, before = io.StringIO(), sys.stdout
        console = Console(file=out, width=9999, color_system=None, force_terminal=tty, legacy_windows=False)
        page = Page(console if tty else None)
        sys.stdout = out
        try:
            page.line(text)
            page.heading(text)
            page.bullets([text])
            page.table(words("head", [text]), words(text, ["last"]))
            page.command("next: ", [text])
        finally:
            sys.stdout = before
        lines = out.getvalue().removesuffix("\n").split("\n")
        assert len(lines) == 7, "no text makes a line of its own"
        assert all(line.isprintable() for line in lines)
        assert sum(printable(text).strip() in line for line in lines) >= 5, "markup and emoji are text"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, examples: Path) -> Path:
    from core.logs.dataflash_case import tables

    from stoop_plan.log_bytes import dataflash_bytes

    place = tmp_path_factory.mktemp("border") / NASTY
    place.mkdir()
    escaped = "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in NASTY)
    text = VEHICLE.read_text(encoding="utf-8").replace('name = "', f'name = "{escaped}')
    reduced = f'model = {{ reduce = "longitudinal" }}\nnotes = [\n  "{escaped}",'
    (place / "v.toml").write_text(text.replace("notes = [", reduced), encoding="utf-8")
    (place / "m.toml").write_text((examples / "maneuver_3211.toml").read_text("utf-8"), encoding="utf-8")
    messages = [f"ArduPlane V4.5.7 {NASTY}", NASTY]
    (place / "log.bin").write_bytes(dataflash_bytes(tables(600), {"A": 1.0}, messages))
    rows = "".join(f"{k / 50},{k % 7 / 10},1,2\n" for k in range(100))
    (place / "a.csv").write_text(f'time,p,{NASTY},"[bold]x[/]"\n{rows}', encoding="utf-8")
    p = f'p = {{ column = "{escaped}", unit = "rad/s" }}\n'
    (place / "a.csv.toml").write_text(f'[time]\ncolumn = "time"\nunit = "s"\n[variables]\n{p}', "utf-8")
    flown = "".join(f"{NASTY}{k},{NASTY},{86400 * k},{NASTY},{5 * (k > 15) + k % 2},1\n" for k in range(30))
    (place / "fleet.csv").write_text(f"flight,vehicle,time,figure,value,std_error\n{flown}", encoding="utf-8")
    command = ["simulate", place / "v.toml", "--maneuver", place / "m.toml", "-o", place / "f.nc"]
    assert main(list(map(str, command))) == 0
    return place


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("info @log.bin", 0), ("info @log.bin --json", 0), ("info @a.csv", 0), ("info @lost.ulg", 2), ("map @log.bin", 0),
        ("trim @v.toml", 0), ("linearize @v.toml --json -", 0), ("simulate @v.toml --maneuver @m.toml -o @f.nc", 2),
        ("vehicle @none", 2), ("fleet @fleet.csv -o @fleet", 3),
    ],
)  # fmt: skip
def test_a_verb_prints_nasty_texts(command: str, expected: int, folder: Path, cli: Cli) -> None:
    words = [str(folder / word[1:]) if word.startswith("@") else word for word in command.split()]
    code, out, err = cli(words)
    assert out + err
    assert all(line.isprintable() for line in (out + err).split("\n"))
    assert code == expected, (out, err)


def test_objects_say_of_themselves_what_is_printable(folder: Path) -> None:
    vehicle, flight = load_vehicle(folder / "v.toml"), load_flight(folder / "f.nc")
    for one in (vehicle, flight, *flight.notices):
        assert repr(one).isprintable()
        assert str(one).isprintable()
