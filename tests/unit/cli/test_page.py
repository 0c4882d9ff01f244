"""The same words on a terminal and in a pipe; nothing from a file is markup."""

from __future__ import annotations

import argparse
import io
import json
import math

import pytest
from rich.console import Console

from stoop.cli.options import page_path
from stoop.cli.page import UNLIMITED, Page, numbers, page, to_json, words

HOSTILE = "[bold red]x[/] \x1b[31m [link=file:///etc] :smile:"
SHOWN = "[bold red]x[/] \\x1b[31m [link=file:///etc] :smile:"


def terminal(width: int = 80) -> tuple[Page, io.StringIO]:
    written = io.StringIO()
    console = Console(
        file=written,
        width=width,
        markup=False,
        highlight=False,
        emoji=False,
        color_system=None,
        force_terminal=True,
    )
    return Page(console), written


def fill(out: Page) -> None:
    out.line(HOSTILE)
    out.heading(HOSTILE)
    out.bullets([HOSTILE])
    out.table(words("", [HOSTILE]), numbers(HOSTILE, [1.0]))
    out.command("next: ", ["stoop", "info", HOSTILE])


def test_hostile_text_is_shown_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    fill(Page())
    out, written = terminal(200)
    fill(out)
    for text in (capsys.readouterr().out, written.getvalue()):
        assert text.count(SHOWN) == 6
        assert "\x1b[31m" not in text


def test_terminal_wraps_notes_below_themselves() -> None:
    out, written = terminal(30)
    out.bullets(["a note that is much longer than thirty characters"])
    lines = [line.rstrip() for line in written.getvalue().splitlines()]
    assert lines[0].startswith("- a note")
    assert all(line.startswith("  ") for line in lines[1:])
    assert all(len(line) <= 30 for line in lines)


def test_command_is_quoted_and_never_broken() -> None:
    out, written = terminal(30)
    out.command("next: ", ["stoop", "info", "a file with blanks and a long name.nc", "--json"])
    assert written.getvalue().strip() == "next: stoop info 'a file with blanks and a long name.nc' --json"


def test_terminal_table_fits() -> None:
    out, written = terminal(60)
    out.table(words("name", ["x" * 20]), numbers("value", [1.25]), words("meaning", ["words " * 20]))
    lines = written.getvalue().splitlines()
    assert all(len(line) <= 60 for line in lines)
    assert lines[1].endswith("...")


def test_pipe_is_plain() -> None:
    assert page().width == UNLIMITED


def test_json_is_strict() -> None:
    text = to_json({"nan": math.nan, "deep": [{"inf": (math.inf, 1.0)}], "text": "\x1b\udcff"})
    assert json.loads(text) == {"nan": None, "deep": [{"inf": [None, 1.0]}], "text": "\x1b\udcff"}
    assert text.isascii()


def test_a_page_has_the_ending_of_a_page() -> None:
    assert page_path("a.HTM").name == "a.HTM"
    with pytest.raises(
        argparse.ArgumentTypeError, match=r"^a\.pdf: a page is written as \.html; name it so$"
    ):
        page_path("a.pdf")


def test_a_number_is_written_without_its_unit(capsys: pytest.CaptureFixture[str]) -> None:
    from stoop.cli.main import main

    assert main(["vehicle", "new", "log.ulg", "--mass", "8.5kg", "-o", "own.toml"]) == 2
    assert (
        "'8.5kg' is not a positive number from 1e-30 to 1e30; write it in kg, without the unit"
        in capsys.readouterr().err
    )
