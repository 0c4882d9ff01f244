"""Options that verbs share, their numbers and windows, and what follows from them."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from stoop.base.numbers import MAX_NUMBER
from stoop.base.text import show
from stoop.errors import FlightError, IdentificationError

if TYPE_CHECKING:
    from stoop.input_design.windows import Found
    from stoop.vehicle import Vehicle

COMPILING: Final = "preparing the equations (some seconds the first time)"
BUILT_IN_HELP: Final = "a built-in vehicle: twin-boom, quad-x, quad-plus, hexa-x, octo-x, quadplane"
VEHICLE_HELP: Final = f"vehicle file (TOML), or {BUILT_IN_HELP}"
LOG_HELP: Final = (
    ".ulg, .bin, .log, .usd, .bbl, .nc, .mat, .parquet, .csv, a ROS bag, or a folder of CSV files"
)
PAGE: Final = "PAGE.html"
WINDOW: Final = "[FLIGHT@]START:STOP[#LOADING]"
HOVERING: Final = "the vehicle's reference; hover for a vehicle with rotors"
SEVERAL: Final[dict[str, Any]] = {"nargs": "+", "action": "extend", "default": []}


def _reader(allowed: Callable[[Any], bool], what: str, whole: bool = False) -> Callable[[str], Any]:
    """Return what reads a number and refuses others in one line."""

    def read(text: str) -> Any:
        try:
            value = (int(text) if text.isascii() and text.isdigit() else math.nan) if whole else float(text)
        except ValueError:
            value = math.nan
        if not allowed(value):
            raise argparse.ArgumentTypeError(f"'{text}' is not {what}")
        return value

    return read


count = _reader(lambda n: n >= 0, "a whole number, zero or above", whole=True)
at_least_one = _reader(lambda n: n >= 1, "a whole number, one or above", whole=True)
positive = _reader(lambda x: 1.0 / MAX_NUMBER <= x <= MAX_NUMBER, "a positive number from 1e-30 to 1e30")
finite = _reader(lambda x: abs(x) <= MAX_NUMBER, "a number up to 1e30")


def within(low: float, high: float, unit: str, factor: float = 1.0) -> Callable[[str], float]:
    """Return what reads a number between two limits, in a unit, and returns it times a factor."""

    def read(text: str) -> float:
        value: float = finite(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is not between {low:g} and {high:g} {unit}")
        return value * factor

    return read


def ends(text: str) -> tuple[float, float]:
    """Return the two numbers of LOW:HIGH; NaN, which no limits hold, where it is of another form."""
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        return math.nan, math.nan
    return low, high


def add_flight(
    parser: argparse.ArgumentParser, what: str = "flight log(s)", several: bool = True, mapping: bool = True
) -> None:
    """Add one flight log or several, and their mapping."""
    many: Any = {"nargs": "+"} if several else {}
    parser.add_argument("flight", metavar="FLIGHT", type=Path, help=f"{what}: {LOG_HELP}", **many)
    if mapping:
        add_mapping(parser)


def add_mapping(parser: argparse.ArgumentParser) -> None:
    """Add the mapping of a log."""
    text = "TOML: columns, units and axes of the log (drafted by stoop map)"
    parser.add_argument("--mapping", metavar="M.toml", type=Path, help=text)


def add_window(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --window START:STOP, which may be given several times or several at a time."""
    parser.add_argument(
        "--window", metavar="START:STOP", **SEVERAL, help=f"{what}; in seconds of the log's clock"
    )


def add_free_fix(parser: argparse.ArgumentParser) -> None:
    """Add which numbers are estimated."""
    add, each = parser.add_argument, {"metavar": "NAME", "action": "append", "default": list[str]()}
    add("--free", **each, help="estimate this number of the vehicle file")  # type: ignore[arg-type]
    add("--fix", **each, help="do not estimate this number")  # type: ignore[arg-type]


def add_output(
    parser: argparse.ArgumentParser,
    what: str,
    replaced: str = "the output file if it exists",
    metavar: str = "DIR",
    required: bool = True,
) -> None:
    """Add the output folder or file, and the permission to replace what an earlier run has written there."""
    text = f"folder for {what}" if metavar == "DIR" else what
    kind = page_path if metavar == PAGE else Path
    parser.add_argument("-o", "--output", metavar=metavar, type=kind, required=required, help=text)
    parser.add_argument("--overwrite", action="store_true", help=f"replace {replaced}")


def page_path(text: str) -> Path:
    """Return the file of a page: a name without an ending gets ``.html``, unless a folder has it; others are refused."""
    path = Path(text)
    if path.suffix.lower() not in ("", ".html", ".htm") and not path.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: a page is written as .html; name it so")
    return path if path.suffix or path.is_dir() or not path.name else path.with_name(f"{path.name}.html")


def add_verbose(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --verbose, which prints `what` too."""
    parser.add_argument("--verbose", action="store_true", help=f"also print {what}")


def add_condition(parser: argparse.ArgumentParser, speed: str, high: float | None = 200.0) -> None:
    """Add airspeed and altitude, within what the standard atmosphere of the equations reaches."""
    above = "m above sea level (default: " + ("200)" if high is not None else "the flight's, else 200)")
    add = parser.add_argument
    add("--airspeed", metavar="V", type=within(0.1, 10_000.0, "m/s"), help=speed)
    add("--altitude", metavar="H", type=within(-1000.0, 11_000.0, "m"), default=high, help=above)


def add_climb_angle(parser: argparse.ArgumentParser) -> None:
    """Add the angle of climb."""
    angle = within(-89.0, 89.0, "degrees", math.radians(1.0))
    parser.add_argument("--climb-angle", metavar="DEG", type=angle, default=0.0, help="degrees (default: 0)")


def windows(texts: Sequence[str]) -> tuple[tuple[float, float], ...]:
    """Read windows START:STOP of one flight, s on the log's own clock.

    Raises `FlightError` if one is not of this form, the wrong way round, or overlaps another.
    """
    found = []
    for text in texts:
        try:
            start, stop = (float(part) for part in text.split(":"))
        except ValueError:
            raise FlightError(f"--window {text}: write START:STOP in seconds, for example 140:145") from None
        if not (math.isfinite(start) and math.isfinite(stop) and start < stop):
            raise FlightError(f"--window {text}: the start must come before the stop")
        found.append((start, stop))
    for one, following in pairwise(sorted(found)):
        if following[0] < one[1]:
            raise FlightError(
                f"--window {following[0]:g}:{following[1]:g}: overlaps {one[0]:g}:{one[1]:g}; give windows that lie apart"
            )
    return tuple(sorted(found))


def command_line() -> str:
    """Return the command as it was given, quoted for the shell."""
    return shlex.join(["stoop", *sys.argv[1:]])


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
    changes = {name: {"free": True} for name in free if name not in added} | {
        name: {"free": False} for name in fix
    }
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
