"""The command that follows another verb repeats what was given to it, and identify takes it."""

from __future__ import annotations

import pytest

from stoop.cli.main import parser_for
from stoop.cli.options import identify_command

GIVEN = {
    "structure": "structure v.toml one.csv two.csv --mapping m.toml --maneuver one@1:5 two@2:9#heavy -o out",
    "maneuvers": "maneuvers one.csv two.csv --mapping m.toml --vehicle v.toml --free Cmq --free mass.mass --fix CD0 -o out",
    "info": "info one.csv --mapping m.toml",
}


@pytest.mark.parametrize("verb", GIVEN)
def test_flights_mapping_vehicle_windows_and_free_numbers_are_repeated(verb: str) -> None:
    words = GIVEN[verb].split()
    arguments = parser_for(words).parse_args(words)
    changed = {} if verb == "structure" else {"maneuver": ["out/windows.toml"]}
    command = identify_command(arguments, "result", **changed)
    again = parser_for(command[1:]).parse_args(command[1:])
    assert str(again.mapping) == "m.toml"
    flights = arguments.flight if isinstance(arguments.flight, list) else [arguments.flight]
    assert again.flight == flights
    assert again.vehicle == {"info": "V.toml"}.get(verb, "v.toml")
    assert again.maneuver == (arguments.maneuver if verb == "structure" else ["out/windows.toml"])
    for option in ("free", "fix"):
        assert getattr(again, option) == getattr(arguments, option, [])
    assert str(again.output) == "result"


def test_what_a_verb_has_written_replaces_what_was_given() -> None:
    words = GIVEN["structure"].split()
    command = identify_command(parser_for(words).parse_args(words), "out-result", vehicle="out/vehicle.toml")
    assert command[command.index("--vehicle") + 1] == "out/vehicle.toml"
    assert command[command.index("--mapping") + 1] == "m.toml"
