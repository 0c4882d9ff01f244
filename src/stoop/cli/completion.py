"""`stoop completion`: a script by which a shell completes verbs, options, choices, built-in vehicles and files.

shtab writes it from the parsers of all verbs, those of other packages among them. The script is static: completing
starts no Python, which would have to import the modules of a verb for each press of the key.
"""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterable
from typing import Any

from stoop.base.text import show
from stoop.base.verbs import Verb, add_options, verbs
from stoop.cli.main import DEBUG_HELP


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
    added, known = parser.add_subparsers(), verbs()
    parsers = {name: _parser(verb, BUILT_IN) for name, verb in known.items()}
    for name in (name for name in known if " " not in name):
        verb = _add(added, name, parsers[name], known[name].summary)
        seconds = [other for other in known if other.startswith(f"{name} ")]
        if seconds:
            options = [action for action in parsers[name]._actions if action.option_strings]
            verb._actions[:] = parsers[name]._actions[:] = options
            words = verb.add_subparsers()
            for second in seconds:
                _add(words, second.partition(" ")[2], parsers[second], known[second].summary)
            for vehicle in BUILT_IN:
                _add(words, vehicle, parsers[name], builtin_title(vehicle))
    return parser


def _add(words: Any, name: str, verb: argparse.ArgumentParser, purpose: str) -> argparse.ArgumentParser:
    added: argparse.ArgumentParser = words.add_parser(
        name, parents=[verb], add_help=False, description=purpose, help=purpose
    )
    return added


def _parser(verb: Verb, vehicles: Iterable[str]) -> argparse.ArgumentParser:
    """Return the parser of a verb, its arguments marked by what completes them beside choices."""
    import shtab

    kinds: dict[str, Any] = {
        "vehicle": _vehicles(vehicles), **dict.fromkeys(("data", "folder"), shtab.DIRECTORY),
        **dict.fromkeys(("file", "page", "source", "output", "output-or-print"), shtab.FILE),
    }  # fmt: skip
    parser = argparse.ArgumentParser()
    added = add_options(parser, verb.options)
    parser.add_argument("--debug", action="store_true", help=DEBUG_HELP)
    for option in verb.options:
        action = added[option.key]
        if option.kind in kinds:
            action.complete = kinds[option.kind]  # type: ignore[attr-defined]
        if action.metavar and (":" in action.metavar or not isinstance(action.metavar, str)):
            action.metavar = action.dest.upper()  # a colon would end the name in the script for zsh
    return parser


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
