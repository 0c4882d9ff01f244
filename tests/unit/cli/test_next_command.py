"""The command that follows another verb repeats what was given to it, and identify takes it."""

from __future__ import annotations

from stoop.cli.main import parser_for
from stoop.cli.options import identify_command

GIVEN = {
    "structure": "structure v.toml one.csv two.csv --mapping m.toml --maneuver one@1:5 two@2:9#heavy -o out",
    "maneuvers": "maneuvers one.csv two.csv --mapping m.toml --vehicle v.toml --free Cmq --free mass.mass --fix CD0 -o out",
    "info": "info one.csv --mapping m.toml",
}


def test_flights_mapping_vehicle_windows_and_free_numbers_are_repeated() -> None:
    for verb, text in GIVEN.items():
        words = text.split()
        arguments = parser_for(words).parse_args(words)
        changed = {} if verb == "structure" else {"maneuver": ["out/windows.toml"]}
        command = identify_command(arguments, "result", **changed)
        again = parser_for(command[1:]).parse_args(command[1:])
        assert str(again.mapping) == "m.toml"
        assert again.flight == (
            arguments.flight if isinstance(arguments.flight, list) else [arguments.flight]
        )
        assert again.vehicle == ("V.toml" if verb == "info" else "v.toml")
        assert again.maneuver == changed.get("maneuver", getattr(arguments, "maneuver", None))
        for option in ("free", "fix"):
            assert getattr(again, option) == getattr(arguments, option, []), verb
        assert str(again.output) == "result"
        written = identify_command(arguments, "result", **changed, vehicle="out/vehicle.toml")
        assert written[written.index("--vehicle") + 1] == "out/vehicle.toml", "replaces what was given"
