"""Options that verbs share, and what follows from them."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from stoop.cli.numbers import within
from stoop.errors import IdentificationError

if TYPE_CHECKING:
    from stoop.vehicle import Vehicle

COMPILING: Final = "preparing the equations (some seconds the first time)"
BUILT_IN_HELP: Final = "a built-in vehicle: twin-boom, quad-x, quad-plus, hexa-x, octo-x, quadplane"
VEHICLE_HELP: Final = f"vehicle file (TOML), or {BUILT_IN_HELP}"
LOG_HELP: Final = ".ulg, .bin, .log, .usd, .nc, .mat, .parquet, .csv, a ROS bag, or a folder of CSV files"
WINDOW: Final = "[FLIGHT@]START:STOP[#LOADING]"
airspeed = within(0.1, 10_000.0, "m/s")
altitude = within(-1000.0, 11_000.0, "m")  # that the standard atmosphere of the equations reaches
climb_angle = within(-89.0, 89.0, "degrees", math.radians(1.0))


def add_flight(parser: argparse.ArgumentParser) -> None:
    """Add one flight log and its mapping."""
    parser.add_argument("flight", metavar="FLIGHT", type=Path, help=f"flight log: {LOG_HELP}")
    add_mapping(parser)


def add_flights(parser: argparse.ArgumentParser, what: str = "flight log(s)") -> None:
    """Add flight logs and their mapping."""
    parser.add_argument("flight", metavar="FLIGHT", nargs="+", type=Path, help=f"{what}: {LOG_HELP}")
    add_mapping(parser)


def add_mapping(parser: argparse.ArgumentParser) -> None:
    """Add the mapping of a log."""
    mapping = "TOML: columns, units and axes of the log (drafted by stoop map)"
    parser.add_argument("--mapping", metavar="M.toml", type=Path, help=mapping)


def add_window(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --window START:STOP, which may be given several times or several at a time."""
    text = f"{what}; s of the log's clock"
    parser.add_argument("--window", metavar="START:STOP", nargs="+", action="extend", default=[], help=text)


def add_free_fix(
    parser: argparse.ArgumentParser, free: str = "estimate this number of the vehicle file"
) -> None:
    """Add which numbers are estimated."""
    add = parser.add_argument
    add("--free", metavar="NAME", action="append", default=[], help=free)
    add("--fix", metavar="NAME", action="append", default=[], help="hold this number")


def add_folder(parser: argparse.ArgumentParser, what: str, earlier: str, *, required: bool = True) -> None:
    """Add the output folder, and the permission to replace what an earlier run has written there."""
    add = parser.add_argument
    add("-o", "--output", metavar="DIR", type=Path, required=required, help=f"folder for {what}")
    add("--overwrite", action="store_true", help=f"replace {earlier}")


def add_file(parser: argparse.ArgumentParser, metavar: str, text: str, *, required: bool = False) -> None:
    """Add the output file, and the permission to replace it."""
    parser.add_argument("-o", "--output", metavar=metavar, type=Path, required=required, help=text)
    add_overwrite(parser)


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Add the permission to replace a file."""
    parser.add_argument("--overwrite", action="store_true", help="replace the output file if it exists")


def command_line() -> str:
    """Return the command as it was given, quoted for the shell."""
    return shlex.join(["stoop", *sys.argv[1:]])


def given_paths(*paths: Path | None) -> list[Path]:
    """Return the paths that were given."""
    return [path for path in paths if path is not None]


def with_free(vehicle: Vehicle, free: Sequence[str], fix: Sequence[str]) -> Vehicle:
    """Return the vehicle with numbers freed and fixed by ``--free`` and ``--fix``.

    Raises
    ------
    StoopError
        A number that does not exist, is tied to another, is not in the equations, or has no bounds.
    """
    both = set(free) & set(fix)
    if both:
        raise IdentificationError(f"--free and --fix both name '{min(both)}'; keep one of them")
    for option, names in (("--free", free), ("--fix", fix)):
        for name in names:
            _check_has_effect(vehicle, option, name)
    changes = {name: {"free": True} for name in free} | {name: {"free": False} for name in fix}
    changed = vehicle.with_numbers(changes) if changes else vehicle
    for p in changed.parameters:
        if p.name in free and not p.lower < p.upper:
            raise IdentificationError(
                f"--free {p.name}: it has no bounds and its value is {p.value:g}; write bounds = [low, high] in {vehicle.where}"
            )
    return changed


def _check_has_effect(vehicle: Vehicle, option: str, name: str) -> None:
    own = {p.name for p in vehicle.parameters}
    row = vehicle.rows.get(name)
    if row is None and _is_optional(vehicle, name):
        table, _, last = name.rpartition(".")
        raise IdentificationError(
            f"{option} {name}: {vehicle.where} does not hold it; write {last} = {{ value = ..., bounds = [low, high] }} into "
            f"[{table}]"
        )
    if row is not None and name not in own:
        raise IdentificationError(f"{option} {name}: tied to {vehicle.parameters[row].name}; name that one")
    if name in own and not _in_equations(vehicle, name):
        raise IdentificationError(
            f"{option} {name}: the equations of {vehicle.where} ({vehicle.reduce}) do not contain it; leave it out"
        )


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
