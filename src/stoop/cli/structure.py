"""`stoop structure`: which terms a vehicle needs, chosen from flights."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from stoop.cli.outputs import check_targets
from stoop.cli.page import busy, page
from stoop.cli.point import COMPILING, LOG_HELP, MAPPING_HELP, VEHICLE_HELP
from stoop.cli.tables import numbers, words
from stoop.errors import IdentificationError

if TYPE_CHECKING:
    from stoop.estimate.regression.domain import Domain
    from stoop.vehicle import Vehicle
    from stoop.workflow.structure import Determined

CRITERIA: Final = ("f", "press", "pse")
_BAND: Final = "0.1:2"
_MOST: Final = 1_000_000
WHAT: Final = """\
criteria:
  f      stepwise regression, partial F-ratio against chance among all candidates (the default)
  press  stepwise regression, prediction sum of squares
  pse    multivariate orthogonal functions, predicted squared error

candidates, one line per coefficient, in a file or on the command line:
  Cm: alpha, q, elevator, alpha^2, alpha*elevator"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = WHAT
    add = parser.add_argument
    add("vehicle", metavar="VEHICLE", help=VEHICLE_HELP)
    add(
        "flight",
        metavar="FLIGHT",
        nargs="+",
        type=Path,
        help=f"flight log(s): {LOG_HELP}",
    )
    window = "windows to use, seconds of the log's clock"
    add(
        "--maneuver",
        metavar="[FLIGHT@]START:STOP[#LOADING]",
        nargs="+",
        action="extend",
        required=True,
        help=window,
    )
    add("--mapping", metavar="M.toml", type=Path, help=MAPPING_HELP)
    what = (
        "file of candidates, or lines such as 'Cm: alpha, q, alpha^2' (default: those of docs/structure.md)"
    )
    add("--candidates", metavar="FILE|LINE", nargs="+", default=[], help=what)
    add("--criterion", choices=CRITERIA, default="f", help="how terms are judged (default: f)")
    band = f"frequencies to use, Hz (default: {_BAND})"
    add("--band", metavar="LOW:HIGH", default=_BAND, help=band)
    add("-o", "--output", metavar="DIR", type=Path, required=True, help="folder for vehicle, table and page")
    add("--overwrite", action="store_true", help="replace an earlier structure in DIR")


def run(arguments: argparse.Namespace) -> int:
    """Choose, write, and say what was chosen."""
    from stoop.workflow.structure import FILES

    inputs = [Path(arguments.vehicle), *arguments.flight]
    check_targets(arguments.output, FILES, arguments.overwrite, inputs)
    domain = _band(arguments.band)
    from stoop.base.csv_text import csv_text
    from stoop.flight import load
    from stoop.vehicle.builtin import resolve_vehicle
    from stoop.workflow.structure import HEAD, rows, structure, write_structure

    vehicle = resolve_vehicle(arguments.vehicle)
    candidates = _candidates(arguments.candidates, vehicle)
    flights = [load(path, arguments.mapping) for path in arguments.flight]
    with busy(COMPILING):
        found = structure(
            vehicle, _by_name(flights), arguments.maneuver, candidates, _choice(arguments.criterion), domain
        )
    command = shlex.join(["stoop", *sys.argv[1:]])
    write_structure(found, arguments.output, csv_text(HEAD, rows(found.structure)), command)
    _tell(found, arguments)
    return 0


def _by_name(flights: list[Any]) -> dict[str, Any]:
    out = {flight.name: flight for flight in flights}
    if len(out) < len(flights):
        raise IdentificationError("structure: two flights have the same name; rename one of the files")
    return out


def _band(text: str) -> Domain:
    from stoop.estimate.regression.domain import FrequencyDomain

    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        low = high = 0.0
    if not 0.0 <= low < high < 1e4:
        raise IdentificationError(f"--band {text}: write LOW:HIGH in Hz, for example {_BAND}")
    return FrequencyDomain(low, high)


def _choice(name: str) -> Callable[[Any], Any]:
    from stoop.estimate.regression.selection import Press, orthogonal, stepwise

    return {"f": stepwise, "press": lambda rows: stepwise(rows, Press()), "pse": orthogonal}[name]


def _candidates(texts: list[str], vehicle: Vehicle) -> dict[str, tuple[str, ...]]:
    from stoop.base.toml import read_source
    from stoop.estimate.regression.structure import parse_candidates, standard_candidates

    if not texts:
        return standard_candidates(vehicle)
    out: dict[str, tuple[str, ...]] = {}
    for text in texts:
        if ":" in text and not Path(text).exists():
            found = parse_candidates([text], vehicle, "--candidates")
        else:
            lines = read_source(text, "candidates", IdentificationError).splitlines()
            found = parse_candidates(lines, vehicle, text)
        out |= {c: (*out.get(c, ()), *terms) for c, terms in found.items()}
    return out


def _tell(found: Determined, arguments: argparse.Namespace) -> None:
    out = page()
    for coefficient, chosen in found.structure.chosen.items():
        model = chosen.selection.model
        out.heading(
            f"{coefficient}: {len(chosen.terms)} of {len(chosen.candidates)} candidates, R2 {model.r2:.3f}"
        )
        told = [
            (t, n, *found.estimates.get(n, (float("nan"),) * 2)) for t, n in found.names[coefficient].items()
        ]
        columns = [list(c) for c in zip(*told, strict=True)] or [[], [], [], []]
        out.table(
            [
                words("term", columns[0]), words("parameter", columns[1]), numbers("estimate", columns[2]),
                numbers("std error", columns[3]),
            ]
        )  # fmt: skip
    every = found.structure.chosen.values()
    notes = [str(n) for n in (*(n for c in every for n in c.notices), *found.structure.notices)]
    if notes:
        out.heading("what to mind")
        out.bullets(notes)
    out.line()
    out.line(f"page: {arguments.output / 'structure.html'}")
    flights, maneuvers = [str(f) for f in arguments.flight], list(arguments.maneuver)
    target = str(arguments.output / "vehicle.toml")
    command = ["stoop", "identify", *flights, "--vehicle", target, "--maneuver", *maneuvers]
    out.command("next: ", [*command, "-o", f"{arguments.output}-result"])
