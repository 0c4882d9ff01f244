"""Options of verbs for argparse, their numbers, and what follows from them."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from stoop.base.files import check_target as check_target
from stoop.base.files import note_input
from stoop.base.text import show
from stoop.base.verbs import Option
from stoop.base.verbs import positive as positive
from stoop.errors import IdentificationError, OutputError

if TYPE_CHECKING:
    from stoop.flight.windows import Found
    from stoop.vehicle import Vehicle

STDOUT: Final = Path("-")  #: the file that stands for standard output
COMPILING: Final = "preparing the equations (some seconds the first time)"


def check_outputs(options: Sequence[Option], arguments: argparse.Namespace) -> None:
    """Record the files that a verb is given to read, and refuse outputs that would replace what they may not.

    Raises
    ------
    OutputError
        Before any work is done.
    """
    targets = []
    for option in options:
        value = getattr(arguments, option.key)
        for one in value if isinstance(value, list | tuple) else [value] * (value is not None):
            if option.kind in ("file", "vehicle", "source"):
                note_input(one)
            if option.kind in ("output", "page") or (option.kind == "output-or-print" and one != STDOUT):
                targets.append(Path(one))
    for target in targets:
        check_target(target, getattr(arguments, "overwrite", False))
    if len({target.absolute() for target in targets}) < len(targets):
        raise OutputError(f"{targets[-1]}: named for two outputs; name another file for one of them")


def command_line() -> str:
    """Return the command as it was given, quoted for the shell; bytes of a path that are no text become ``?``."""
    return shlex.join(["stoop", *sys.argv[1:]]).encode("utf-8", "replace").decode()


def given_paths(*paths: Path | None) -> list[Path]:
    """Return the paths that were given."""
    return [path for path in paths if path is not None]


def source_arguments(flights: Sequence[Path], mapping: Path | None) -> list[str]:
    """Return the arguments by which another verb reads the same flights."""
    return [*map(str, flights), *([] if mapping is None else ["--mapping", str(mapping)])]


def identify_command(arguments: argparse.Namespace, output: str | Path, **changed: Any) -> list[str]:
    """Return the `stoop identify` that follows another verb: its flights, and each option that both have, as it was given.

    `changed` replaces what was given: `flight`, `mapping`, `vehicle`, `maneuver`, `validate`, `free`, `fix`.
    """
    given = {"mapping": None, "vehicle": "V.toml", **vars(arguments), **changed}
    flights: Sequence[Path] = [given["flight"]] if isinstance(given["flight"], Path) else given["flight"]
    command = ["stoop", "identify", *source_arguments(flights, given["mapping"])]
    command += ["--vehicle", str(given["vehicle"] or "V.toml")]
    for option in ("maneuver", "validate"):
        windows = list(map(str, given.get(option) or ()))
        command += [f"--{option}", *windows] if windows else []
    for option in ("free", "fix"):
        command += [word for name in given.get(option) or () for word in (f"--{option}", name)]
    return [*command, "-o", str(output)]


def windows_of(found: Found) -> dict[str, list[str]]:
    """Return the proposed windows of one flight as the options of `stoop identify`."""
    uses = {"maneuver": "fit", "validate": "predict"}
    return {option: [w.span for w in found.windows if w.purpose == use] for option, use in uses.items()}


def with_free(vehicle: Vehicle, free: Sequence[str], fix: Sequence[str]) -> Vehicle:
    """Return the vehicle with numbers freed and fixed by ``--free`` and ``--fix``.

    A number to be freed that the file leaves out is added if the catalogue of extensions has it, and the line is printed.

    Raises `StoopError` for a number that does not exist, is tied to another, is not in the equations, or has no bounds.
    """
    from stoop.vehicle.extensions import with_free_number

    both = set(free) & set(fix)
    if both:
        raise IdentificationError(f"--free and --fix both name '{min(both)}'; keep one of them")
    added = []  # free as they are written; of several servos with one name
    for name in (n for n in free if n not in vehicle.rows):
        if (found := with_free_number(vehicle, name)) is not None:
            vehicle, line = found
            added.append(name)
            show(f"stoop: --free {name}: {vehicle.where} does not hold it; added: {line}", sys.stderr)
    own = {p.name for p in vehicle.parameters}
    for option, name in (*(("--free", n) for n in free), *(("--fix", n) for n in fix)):
        row, (table, _, last) = vehicle.rows.get(name), name.rpartition(".")
        if row is None and _is_optional(vehicle, name):
            raise IdentificationError(
                f"{option} {name}: {vehicle.where} does not hold it; write {last} = {{ value = ..., bounds = [low, high] }} "
                f"into [{table}]"
            )
        if row is not None and name not in own:
            raise IdentificationError(
                f"{option} {name}: tied to {vehicle.parameters[row].name}; name that one"
            )
        if name in own and not _in_equations(vehicle, name):
            raise IdentificationError(
                f"{option} {name}: the equations of {vehicle.where} ({vehicle.reduce}) do not contain it; leave it out"
            )
    changes = {name: {"free": name not in fix} for name in (*free, *fix) if name not in added}
    changed = vehicle.with_numbers(changes) if changes else vehicle
    for p in changed.parameters:
        if p.name in free and not p.lower < p.upper:
            raise IdentificationError(
                f"--free {p.name}: it has no bounds and its value is {p.value:g}; write bounds = [low, high] in {vehicle.where}"
            )
    return changed


def _is_optional(vehicle: Vehicle, name: str) -> bool:
    """Whether a vehicle file may hold a number that this one leaves out."""
    *tables, last = name.split(".")
    here: Any = vehicle.file
    for table in tables:
        here = here.get(table) if isinstance(here, Mapping) else getattr(here, table, None)
    return last in getattr(type(here), "model_fields", ()) and getattr(here, last) is None


def _in_equations(vehicle: Vehicle, name: str) -> bool:
    """Whether the equations hold a number: a reduced model drops terms, controls and channels."""
    from stoop.vehicle.defaults import COEFFICIENTS
    from stoop.vehicle.schema import CHANNELS, WIND

    table, _, rest = name.partition(".")
    part = rest.partition(".")[0]
    if table == "controls":
        return part in vehicle.controls
    if table == "turbulence":
        return part in vehicle.gusts
    if table == "sensors" and part in (*CHANNELS, *WIND):
        return part in vehicle.outputs
    dropped = (c for c in COEFFICIENTS if c not in vehicle.terms)
    return not any(name in getattr(vehicle.file.aerodynamics, c) for c in dropped)
