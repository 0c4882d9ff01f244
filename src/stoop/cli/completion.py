"""`stoop completion`: a script by which a shell completes verbs, options, choices, built-in vehicles and files.

shtab writes it from the parsers of all verbs, those of other packages among them. The script is static: completing
starts no Python, which would have to import the modules of a verb for each press of the key.
"""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from stoop.base.text import show
from stoop.cli.main import DEBUG_HELP, all_verbs, load_verb
from stoop.cli.options import PAGE, WINDOW

SHELLS: Final = ("bash", "zsh", "fish")
VEHICLE_NAMES: Final = ("vehicle", "subject")  #: arguments that take a vehicle file, or a built-in vehicle
FILES: Final = (
    "PATH",
    PAGE,
    "FILE|LINE",
    WINDOW,
)  #: what else takes a file; windows are also read from a file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument("shell", metavar="SHELL", choices=SHELLS, help=f"one of {', '.join(SHELLS)}")


def run(arguments: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    show(shtab.complete(all_parsers(), arguments.shell))
    return 0


def all_parsers() -> argparse.ArgumentParser:
    """Return a parser of the whole command, whose arguments tell shtab by an attribute `complete` what they take.

    The second word of a verb such as ``vehicle new`` is a verb of the first; the names of built-in vehicles, which the
    first takes in its place, are such verbs too.
    """
    from stoop.vehicle.builtin import BUILT_IN, builtin_title

    parser = argparse.ArgumentParser(prog="stoop")
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    parser.add_argument("--debug", action="store_true", help=DEBUG_HELP)
    verbs, known = parser.add_subparsers(), all_verbs()
    parsers = {name: _parser(place, BUILT_IN) for name, (place, _) in known.items()}
    for name in (name for name in known if " " not in name):
        verb = _add(verbs, name, parsers[name], known[name][1])
        seconds = [other for other in known if other.startswith(f"{name} ")]
        if seconds:
            options = [action for action in parsers[name]._actions if action.option_strings]
            verb._actions[:] = parsers[name]._actions[:] = options
            words = verb.add_subparsers()
            for second in seconds:
                _add(words, second.partition(" ")[2], parsers[second], known[second][1])
            for vehicle in BUILT_IN:
                _add(words, vehicle, parsers[name], builtin_title(vehicle))
    return parser


def _add(verbs: Any, name: str, verb: argparse.ArgumentParser, purpose: str) -> argparse.ArgumentParser:
    added: argparse.ArgumentParser = verbs.add_parser(
        name, parents=[verb], add_help=False, description=purpose, help=purpose
    )
    return added


def _parser(place: str, vehicles: Iterable[str]) -> argparse.ArgumentParser:
    """Return the parser of a verb, its arguments marked."""
    parser = argparse.ArgumentParser()
    load_verb(place)[0](parser)
    parser.add_argument("--debug", action="store_true", help=DEBUG_HELP)
    for action in parser._actions:
        completed = _completed(action, vehicles)
        if completed is not None:
            action.complete = completed  # type: ignore[attr-defined]
        if action.metavar and (":" in action.metavar or not isinstance(action.metavar, str)):
            action.metavar = action.dest.upper()  # a colon would end the name in the script for zsh
    return parser


def _completed(action: argparse.Action, vehicles: Iterable[str]) -> Any:
    """Return what shtab completes an argument by, beside choices; None where it takes numbers or free text."""
    import shtab

    if action.dest in VEHICLE_NAMES:
        return _vehicles(vehicles)
    if action.metavar == "DIR":
        return shtab.DIRECTORY
    return shtab.FILE if action.type is Path or action.metavar in FILES else None


def _vehicles(names: Iterable[str]) -> dict[str, Any]:
    """Return functions of each shell that complete built-in vehicles and TOML files.

    The script for bash lets folders be completed further where a function has `_file` in its name.
    """
    words, function = shlex.join(names), "_stoop_vehicle_files"
    return {
        "bash": function,
        "zsh": function,
        "fish": f"({function})",
        "preamble": {
            "bash": f"""{function}() {{
  compgen -W "{words}" -- "$1"
  compgen -f -X '!*.toml' -- "$1"
  compgen -d -- "$1"
}}""",
            "zsh": f"""{function}() {{
  _alternative 'names:built-in vehicle:({words})' 'files:vehicle file:_files -g "*.toml(-.)"'
}}""",
            "fish": f"""function {function}
  printf '%s\\tbuilt-in vehicle\\n' {words}
  __fish_complete_suffix .toml
end""",
        },
    }
