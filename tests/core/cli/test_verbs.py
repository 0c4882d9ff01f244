"""Parsers, help, completion, docs/commands.md and defaults of the Python interface agree with the table of verbs."""

import argparse
import importlib
import inspect
import re
import runpy
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import pytest

import stoop
from stoop.base.verbs import NUMBERS, READERS, WHOLE, Option, Verb, plain, read_verb, reader, verbs
from stoop.cli.completion import all_parsers
from stoop.cli.main import parser_for
from stoop.cli.options import identify_command
from stoop.vehicle.builtin import BUILT_IN

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "commands.md"
COMPLETED = ("data", "file", "folder", "output", "output-or-print", "page", "source", "vehicle")
NOTHING = (None, "", (), {}, [], float("-inf"))  #: defaults by which nothing is given


def parameters(verb: Verb) -> dict[str, Any]:
    """Return the parameters of a verb's Python function and their defaults; a fit takes fields of its options too."""
    module, _, name = verb.python.partition(":")
    function = inspect.unwrap(getattr(importlib.import_module(module), name))
    found = {n: p.default for n, p in inspect.signature(function).parameters.items()}
    if "settings" in found:
        found |= {f.name: f.default for f in fields(stoop.Options) if f.default is not MISSING}
    return found


def test_all_that_a_verb_shows_follows_from_its_row() -> None:
    completed, text = all_parsers(), PAGE.read_text("utf-8")
    page = runpy.run_path(str(ROOT / "scripts" / "commands.py"))["page"]
    assert page(text) == text, "`python scripts/commands.py` writes it"
    for name, verb in verbs().items():
        check_verb(name, verb, completed)


def check_verb(name: str, verb: Verb, completed: argparse.ArgumentParser) -> None:
    module, _, function = verb.run.partition(":")
    assert callable(getattr(importlib.import_module(module), function))
    parser = parser_for([name]).verbs[name]
    actions = {a.dest: a for a in parser._actions if a.dest not in ("help", "debug")}
    assert list(actions) == [option.key for option in verb.options]
    assert len({option.name for option in verb.options}) == len(verb.options)
    assert f"{verb.summary[0].upper()}{verb.summary[1:]}." in " ".join(parser.format_help().split())
    shell = completed
    for word in name.split():
        (shell,) = (a.choices[word] for a in shell._actions if isinstance(a, argparse._SubParsersAction))
    shells = {a.dest: a for a in shell._actions}
    for option in verb.options:
        action = actions[option.key]
        assert plain(option.meaning) in (action.help or "").replace("%%", "%")
        assert option.usual == "" or f"(default: {plain(option.usual)})" in (action.help or "")
        assert tuple(action.choices or ()) == tuple(option.choices)
        if option.key in shells:  # `stoop vehicle` completes the names of vehicles as verbs
            assert hasattr(shells[option.key], "complete") == (option.kind in COMPLETED)
    if verb.python:
        check_python(verb)


def check_python(verb: Verb) -> None:
    known = parameters(verb)
    shared = {o.parameter or o.key: o for o in verb.options if (o.parameter or o.key) in known}
    assert {o.parameter for o in verb.options if o.parameter} <= known.keys()
    assert len(shared) >= min(2, len(known))
    for name, option in shared.items():
        default = False if option.kind == "switch" else option.default
        if known[name] is inspect.Parameter.empty:
            assert option.required or option.positional, name
        elif not isinstance(default, (bool, int, float, str)) or default in NOTHING:
            assert known[name] in NOTHING, name
        else:
            assert known[name] == default, name


def test_vehicles_in_the_help_are_the_built_in_ones() -> None:
    listed = re.findall(r"built-in vehicle: ([\w, -]+)", verbs()["identify"].option("vehicle").help)
    assert listed == [", ".join(BUILT_IN)]


def test_an_angle_becomes_radians_within_its_limits() -> None:
    read = reader(verbs()["trim"].option("climb_angle"))
    assert read("45") == pytest.approx(0.7853981633974483)
    with pytest.raises(argparse.ArgumentTypeError, match="90 is not between -89 and 89 deg"):
        read("90")


def test_every_kind_has_a_reader_and_a_whole_number_limits_that_its_program_can_take() -> None:
    for verb in verbs().values():
        for option in verb.options:
            assert option.kind in {"switch", *READERS, *NUMBERS, *WHOLE}
            if option.kind not in WHOLE:
                continue
            read = reader(option)
            for wrong in ("99999999999999999999", str(2**128), "9" * 4301, "-1", "1.5", "\u0663", ""):
                with pytest.raises(argparse.ArgumentTypeError, match="is not a whole number from"):
                    read(wrong)
            assert option.default is None or read(str(option.default)) == option.default
            assert option.const is None or read(str(option.const)) == option.const


def test_a_table_of_another_package_may_name_and_change_shared_options() -> None:
    row = {"summary": "s", "run": "m:f", "options": ["flight", {"like": "seed", "default": 7}]}
    verb = read_verb("other", row)
    assert verb.options[0] is verbs()["info"].options[0]
    assert (verb.option("seed").default, verb.option("seed").kind) == (7, "count")


def test_marks_of_markdown_do_not_reach_a_terminal() -> None:
    option = Option("--x", "a [link](page.md#part), [here](#x), `code`")
    assert plain(option.meaning) == "a link (docs/page.md), here, code"


GIVEN = {
    "structure": "structure v.toml one.csv two.csv --mapping m.toml --maneuver one@1:5 two@2:9#heavy -o out",
    "maneuvers": "maneuvers one.csv two.csv --mapping m.toml --vehicle v.toml --free Cmq --free mass.mass --fix CD0 -o out",
    "info": "info one.csv --mapping m.toml",
}


def test_the_next_command_repeats_flights_mapping_vehicle_windows_and_free_numbers() -> None:
    for verb, text in GIVEN.items():
        arguments = parser_for(text.split()).parse_args(text.split())
        changed = {} if verb == "structure" else {"maneuver": ["out/windows.toml"]}
        command = identify_command(arguments, "result", **changed)
        again = parser_for(command[1:]).parse_args(command[1:])
        flights = arguments.flight if isinstance(arguments.flight, list) else [arguments.flight]
        assert (str(again.mapping), again.flight, str(again.output)) == ("m.toml", flights, "result")
        assert again.vehicle == ("V.toml" if verb == "info" else "v.toml")
        assert again.maneuver == changed.get("maneuver", getattr(arguments, "maneuver", None))
        assert all(getattr(again, one) == getattr(arguments, one, []) for one in ("free", "fix")), verb
        written = identify_command(arguments, "result", **changed, vehicle="out/vehicle.toml")
        assert written[written.index("--vehicle") + 1] == "out/vehicle.toml", "replaces what was given"
