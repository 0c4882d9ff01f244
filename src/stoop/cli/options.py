"""Options of verbs for argparse, their numbers, and what follows from them."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from stoop.base.files import check_target as check_target
from stoop.base.files import note_input
from stoop.base.numbers import MAX_NUMBER
from stoop.base.text import show
from stoop.base.verbs import Option, plain
from stoop.errors import IdentificationError, OutputError

if TYPE_CHECKING:
    from stoop.flight.windows import Found
    from stoop.vehicle import Vehicle

STDOUT: Final = Path("-")  #: the file that stands for standard output
#: largest whole number of an option that has no range of its own: any generator of random numbers takes it as a seed
MAX_COUNT: Final = 2**32 - 1
COMPILING: Final = "preparing the equations (some seconds the first time)"


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


def page_path(text: str) -> Path:
    """Return the file of a page: a name without an ending gets ``.html``, unless a folder or device has it; others raise."""
    path = Path(text)
    if path.suffix.lower() not in ("", ".html", ".htm") and not path.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: a page is written as .html; name it so")
    taken = path.exists() and not path.is_file()
    return path if path.suffix or taken or not path.name else path.with_name(f"{path.name}.html")


def names(text: str) -> tuple[str, ...]:
    """Return names that commas separate, each once."""
    found = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not found:
        raise argparse.ArgumentTypeError("names are missing; separate them by commas")
    return found


#: kind of a number -> which are allowed, in code and in words
NUMBERS: Final[Mapping[str, tuple[Callable[[float], bool], str]]] = {
    "positive": (lambda x: 1.0 / MAX_NUMBER <= x <= MAX_NUMBER, "a positive number from 1e-30 to 1e30"),
    "finite": (lambda x: abs(x) <= MAX_NUMBER, "a number up to 1e30"),
}
positive = _reader(*NUMBERS["positive"])
#: kind of a whole number -> the smallest
WHOLE: Final = {"count": 0, "at-least-one": 1}
#: kind of an option's value -> what reads it
READERS: Final[dict[str, Callable[[str], Any]]] = {
    **dict.fromkeys(("text", "vehicle", "source"), str),
    **dict.fromkeys(("file", "data", "folder", "output", "output-or-print"), Path),
    "page": page_path,
    "names": names,
}


def reader(option: Option) -> Callable[[str], Any]:
    """Return what reads a value of an option; an angle within limits is returned in rad."""
    if (least := WHOLE.get(option.kind)) is not None:
        first, last = option.range or (least, MAX_COUNT)
        what = f"a whole number from {first:.0f} to {last:.0f}"
        return _reader(lambda n: first <= n <= last, what, whole=True)
    if option.range is None and option.kind not in NUMBERS:
        return READERS[option.kind]
    allowed, what = NUMBERS["positive" if option.kind == "positive" else "finite"]
    base = _reader(allowed, f"{what}; write it in {option.unit}, without the unit" if option.unit else what)
    if option.range is None:
        return base
    low, high = option.range

    def read(text: str) -> Any:
        value = base(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(
                f"{text} is not between {low:g} and {high:g} {option.unit}".rstrip()
            )
        return math.radians(value) if option.unit == "deg" else value

    return read


def add_options(parser: argparse.ArgumentParser, options: Sequence[Option]) -> dict[str, argparse.Action]:
    """Add the options of a verb; return what argparse made of them, by their names in the program."""
    groups: dict[str, Any] = {"": parser}
    for option in options:
        if option.group not in groups:
            groups[option.group] = parser.add_mutually_exclusive_group()
    return {option.key: _add(groups[option.group], option) for option in options}


def _add(parser: Any, option: Option) -> argparse.Action:
    usual = f" (default: {option.usual})" if option.usual else ""
    settings: dict[str, Any] = {"help": plain(option.meaning + usual).replace("%", "%%")}
    if option.kind == "switch":
        settings["action"] = "store_true"
    else:
        default = [] if option.repeat and not option.required else option.default
        settings |= {"type": reader(option), "metavar": option.metavar or None, "default": default}
        settings |= {"choices": tuple(option.choices) or None, "const": option.const}
        settings |= {"nargs": option.many} if option.many else {}
        if option.repeat:
            settings["action"] = "extend" if option.many else "append"
    if not option.positional:
        settings |= {"dest": option.key, "required": option.required}
    added: argparse.Action = parser.add_argument(*filter(None, (option.short, option.name)), **settings)
    return added


def check_outputs(options: Sequence[Option], arguments: argparse.Namespace) -> None:
    """Record the files that a verb is given to read, and refuse outputs that would replace what they may not.

    Raises
    ------
    OutputError
        Before any work is done.
    """
    given = [(option.kind, getattr(arguments, option.key)) for option in options]
    for kind, value in given:
        for one in value if isinstance(value, list | tuple) else [value]:
            if kind in ("file", "vehicle", "source") and one is not None:
                note_input(one)
    targets: list[Path] = []
    for kind, value in given:
        if kind in ("output", "page") or (kind == "output-or-print" and value != STDOUT):
            targets += [] if value is None else [value]
    for target in targets:
        check_target(target, arguments.overwrite)
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
