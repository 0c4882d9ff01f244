"""Text of files comes to a terminal by one border only: printable, on as many lines as were meant, and never as markup."""

from __future__ import annotations

import ast
import io
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rich.text import Text

import stoop
import stoop_studies
from stoop.base.text import printable, show
from stoop.cli.main import VERBS, main
from stoop.cli.page import Page, words
from stoop.cli.progress import LiveLine, Timed
from stoop.flight import load
from stoop.vehicle import load_vehicle

SOURCES = [p for package in (stoop, stoop_studies) for p in Path(package.__file__ or "").parent.rglob("*.py")]
NASTY = "\x1b[31m[red]\u202e\x9b2J\x07"  #: colors, markup, reversed text, an escape of one byte, a bell
VEHICLE = Path(stoop.__file__ or "").parent / "data" / "twin_boom.toml"
EXAMPLES = Path(__file__).parents[3] / "examples"


# The rule, by the source: only the border prints.


def calls(path: Path) -> Iterator[tuple[Path, str, ast.Call]]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            yield path, name, node


CALLS = [call for path in SOURCES for call in calls(path)]


def test_only_the_border_prints() -> None:
    named = {"print", "pprint", "print_exc", "print_exception", "Console", "input"}
    found = {(name, path.name) for path, name, _ in CALLS if name in named}
    assert found == {
        ("print", "text.py"),  # `show`
        ("Console", "page.py"), ("print", "page.py"),  # of rich, given a Text
        ("Console", "progress.py"), ("print", "progress.py"),
        ("input", "vehicle_new.py"),
    }  # fmt: skip


def test_rich_is_given_texts_or_told_that_there_is_no_markup() -> None:
    for path, name, call in CALLS:
        if path.name in ("page.py", "progress.py") and name in ("print", "status", "update"):
            given = ast.unparse(call)
            kinds = ("Text(", "Timed(", "markup=False", "print(grid)")
            assert any(kind in given for kind in kinds), given
    line = Timed("[bold]a\x1b[2J", time.perf_counter()).__rich__()
    assert isinstance(line, Text)
    assert line.plain.startswith("[bold]a")
    assert line.plain.isprintable()


def test_nothing_writes_to_the_terminal_directly() -> None:
    """`os.write` to stderr in a signal's handler writes a constant."""
    for path, name, call in CALLS:
        if name in ("write", "writelines") and isinstance(call.func, ast.Attribute):
            assert "std" not in ast.unparse(call.func.value), path
        if name == "write" and ast.unparse(call.func) == "os.write" and "stderr" in ast.unparse(call):
            assert ast.unparse(call.args[1]) == "MESSAGE.encode()"


# The border: any text.


def check(shown: str, text: str) -> None:
    assert all(line.isprintable() for line in shown.split("\n"))
    assert printable(text) in shown, "markup and emoji are text"


@given(st.text(st.characters(exclude_categories=())))
def test_plain_text(text: str) -> None:
    out = io.StringIO()
    show(text, out)
    assert all(line.isprintable() for line in out.getvalue().split("\n"))
    assert out.getvalue().count("\n") == text.count("\n") + 1


@given(
    st.text(st.characters(exclude_categories=()))
    | st.sampled_from([NASTY, "[/]", "[link=a]b[/link]", ":bug:", "\\["])
)
def test_every_part_of_a_page(text: str) -> None:
    for terminal in (False, True):
        out, before = io.StringIO(), sys.stdout
        console = Console(
            file=out, width=9999, color_system=None, force_terminal=terminal, legacy_windows=False
        )
        page = Page(console if terminal else None)
        sys.stdout = out
        try:
            page.line(text)
            page.heading(text)
            page.bullets([text])
            page.table(words("head", [text]), words(text, ["last"]))
            page.command("next: ", [text])
        finally:
            sys.stdout = before
        shown = out.getvalue()
        lines = shown.removesuffix("\n").split("\n")
        assert len(lines) == 7, "no text makes a line of its own"
        assert all(line.isprintable() for line in lines)
        stripped = printable(text).strip()
        assert sum(stripped in line for line in lines) >= 5


@given(st.text(st.characters(exclude_categories=())))
def test_the_live_line(text: str) -> None:
    out, before = io.StringIO(), sys.stderr
    sys.stderr = out
    try:
        with LiveLine(text) as live:
            live.show(text, 1e9, news=True)
            live.warn(text)
    finally:
        sys.stderr = before
    assert out.getvalue().split("\n") == [printable(text), f"stoop: {printable(text)}", ""]


# Every verb that prints text of a file, given a file whose texts and name are nasty.


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A vehicle, maneuver, log and flight whose names, notes and texts are nasty, in a folder whose name is."""
    from unit.logs.dataflash_case import tables

    from stoop.exporters.log_bytes import dataflash_bytes

    place = tmp_path_factory.mktemp("border") / NASTY
    place.mkdir()
    escaped = "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in NASTY)
    text = VEHICLE.read_text(encoding="utf-8")
    text = text.replace('name = "', f'name = "{escaped}').replace("notes = [", f'notes = [\n  "{escaped}",')
    (place / "w.toml").write_text(text, encoding="utf-8")
    text = text.replace("notes = [", 'model = { reduce = "longitudinal" }\nnotes = [')
    (place / "v.toml").write_text(text, encoding="utf-8")
    maneuver = (EXAMPLES / "maneuver_3211.toml").read_text(encoding="utf-8")
    (place / "m.toml").write_text(maneuver, encoding="utf-8")
    (place / "log.bin").write_bytes(
        dataflash_bytes(tables(2000), {"A": 1.0}, [f"ArduPlane V4.5.7 {NASTY}", NASTY])
    )
    rows = "".join(f"{k / 50},{k % 7 / 10},1,2\n" for k in range(100))
    head = f'time,p,{NASTY},"[bold]x[/]"\n'
    (place / "a.csv").write_text(head + rows, encoding="utf-8")
    mapping = (
        f'[time]\ncolumn = "time"\nunit = "s"\n[variables]\np = {{ column = "{escaped}", unit = "rad/s" }}\n'
    )
    (place / "a.csv.toml").write_text(mapping, encoding="utf-8")
    flown = "".join(f"{NASTY}{k},{NASTY},{86400 * k},{NASTY},{5 * (k > 15) + k % 2},1\n" for k in range(30))
    (place / "fleet.csv").write_text(f"flight,vehicle,time,figure,value,std_error\n{flown}", encoding="utf-8")
    for vehicle, flight in (("v.toml", "f.nc"), ("w.toml", "g.nc")):
        command = ["simulate", place / vehicle, "--maneuver", place / "m.toml", "-o", place / flight]
        assert main(list(map(str, command))) == 0
    return place


def argument(folder: Path, word: str) -> str:
    return str(folder / word[1:]) if word.startswith("@") else word


def run(capsys: pytest.CaptureFixture[str], folder: Path, command: str) -> tuple[int, str]:
    capsys.readouterr()
    code = main([argument(folder, word) for word in command.split()])
    shown = "".join(capsys.readouterr())
    assert shown
    assert all(line.isprintable() for line in shown.split("\n")), command
    return code, shown


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("look @f.nc -o @look.html", 0),
        ("info @f.nc", 0),
        ("info @log.bin", 0),
        ("info @log.bin --json", 0),
        ("info @a.csv", 0),
        ("info @lost.ulg", 2),
        ("info @f.nc --mapping @v.toml", 2),
        ("map @a.csv", 0),
        ("map @log.bin", 0),
        ("maneuvers @g.nc -o @windows", 0),
        ("compatibility @g.nc", 0),
        ("trim @v.toml", 0),
        ("trim @v.toml --json", 0),
        ("linearize @v.toml", 0),
        ("linearize @v.toml --json -", 0),
        ("simulate @v.toml --maneuver @m.toml -o @f.nc", 2),
        ("export @v.toml --to state-space -o @export", 0),
        ("vehicle @none", 2),
        ("vehicle new @log.bin --template conventional --mass 2 --span 2 --chord 0.2 --engine electric -o @new.toml", 0),
        ("design @v.toml --duration 8 --evaluations 20 -o @design", 0),
        ("polar @f.nc --vehicle @v.toml", None),
        ("rotors @f.nc --healthy @f.nc --vehicle @v.toml", None),
        ("structure @f.nc --vehicle @v.toml --maneuver 0:99 -o @structure", None),
        ("validate @v.toml @f.nc -o @wrong", None),
        ("agreement @v.toml @v.toml", None),
        ("identify @f.nc --vehicle @v.toml --maneuver 0:99 -o @far", 2),
        ("propagate @far --expression @f.nc=CL0", 2),
        ("derivatives @w.toml", 0),
        ("frequency @g.nc --vehicle @w.toml", 0),
        ("frequency @g.nc --input @none", 2),
        ("export @w.toml --to fmu -o @fmu", 0),
        ("export @w.toml --to gazebo -o @gazebo", 0),
        ("fleet @fleet.csv -o @fleet", 3),
        ("fleet @fleet.csv @fleet.csv -o @fleet", 2),
        ("fleet @none", 2),
    ],
)  # fmt: skip
def test_a_verb_prints_nasty_texts(
    command: str, expected: int | None, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, shown = run(capsys, folder, command)
    assert code in ((0, 2) if expected is None else (expected,)), shown


def test_the_verbs_of_a_fit_print_nasty_texts(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command, expected in (
        ("identify @f.nc --vehicle @v.toml --maneuver 0:20 --validate 20:28 --budget 300 -o @fit", 0),
        ("validate @fit @g.nc --maneuver 5:18 -o @validation", 0),
        ("agreement @fit @fit", 2),
        ("export @fit --to jsbsim -o @fdm", 0),
        ("derivatives @fit --axes body", 2),
        ("propagate @fit --draws 100", 0),
        ("tune @fit @none", 2),
    ):
        code, shown = run(capsys, folder, command)
        assert code == expected, shown


def test_every_verb_is_among_these() -> None:
    text = Path(__file__).read_text(encoding="utf-8")
    others = ["demo", "app", "example", "completion"]  # which read no file themselves
    assert [verb for verb in VERBS if f'"{verb} ' not in text] == others


def test_objects_say_of_themselves_what_is_printable(folder: Path) -> None:
    """In an interactive session the interpreter prints what `repr` returns."""
    vehicle, flight = load_vehicle(folder / "v.toml"), load(folder / "f.nc")
    for one in (vehicle, flight, *flight.notices):
        assert repr(one).isprintable()
        assert str(one).isprintable()
