"""`stoop structure`: which terms a vehicle needs, chosen from flights."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from stoop.base.files import check_targets
from stoop.cli.arguments import COMPILING, VEHICLE_HELP, WINDOW, add_flights, add_folder, command_line
from stoop.cli.page import busy, page
from stoop.cli.tables import numbers, words
from stoop.errors import IdentificationError

if TYPE_CHECKING:
    from stoop.estimate.regression.least_squares import Domain
    from stoop.vehicle import Vehicle
    from stoop.workflow.structure import Determined

CRITERIA: Final = ("f", "press", "pse")
BAND: Final = "0.1:2"
EPILOG: Final = """\
criteria:
  f      stepwise regression, partial F-ratio against chance among all candidates (the default)
  press  stepwise regression, prediction sum of squares
  pse    multivariate orthogonal functions, predicted squared error

candidates, one line per coefficient, in a file or on the command line:
  Cm: alpha, q, elevator, alpha^2, alpha*elevator"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = EPILOG
    add = parser.add_argument
    window = "windows to use, seconds of the log's clock"
    terms = (
        "file of candidates, or lines such as 'Cm: alpha, q, alpha^2' (default: those of docs/structure.md)"
    )
    add("vehicle", metavar="VEHICLE", help=VEHICLE_HELP)
    add_flights(parser)
    add("--maneuver", metavar=WINDOW, nargs="+", action="extend", required=True, help=window)
    add("--candidates", metavar="FILE|LINE", nargs="+", default=[], help=terms)
    add("--criterion", choices=CRITERIA, default="f", help="how terms are chosen (default: f)")
    add("--band", metavar="LOW:HIGH", default=BAND, help=f"frequencies to use, Hz (default: {BAND})")
    add_folder(parser, "vehicle, table and page", "an earlier structure in DIR")


def run(arguments: argparse.Namespace) -> int:
    """Choose, write, and print what was chosen."""
    from stoop.workflow.structure import FILES, structure, write_structure

    inputs = [Path(arguments.vehicle), *arguments.flight]
    check_targets(arguments.output, FILES, arguments.overwrite, inputs)
    domain = _band(arguments.band)
    from stoop.estimate.regression.structure import Press, orthogonal, stepwise
    from stoop.flight import load
    from stoop.vehicle.builtin import resolve_vehicle
    from stoop.workflow.provenance import by_name

    criteria: dict[str, Any] = {
        "f": stepwise,
        "press": lambda rows: stepwise(rows, Press()),
        "pse": orthogonal,
    }
    vehicle = resolve_vehicle(arguments.vehicle)
    candidates = _candidates(arguments.candidates, vehicle)
    flights = by_name([load(path, arguments.mapping) for path in arguments.flight], "structure")
    choose = criteria[arguments.criterion]
    with busy(COMPILING):
        found = structure(vehicle, flights, arguments.maneuver, candidates, choose, domain)
    write_structure(found, arguments.output, command_line())
    _print(found, arguments)
    return 0


def _band(text: str) -> Domain:
    from stoop.estimate.regression.least_squares import FrequencyDomain

    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        low = high = 0.0
    if not 0.0 <= low < high < 1e4:
        raise IdentificationError(f"--band {text}: write LOW:HIGH in Hz, for example {BAND}")
    return FrequencyDomain(low, high)


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


def _print(found: Determined, arguments: argparse.Namespace) -> None:
    out, nothing = page(), (float("nan"),) * 2
    for coefficient, chosen in found.structure.chosen.items():
        share = f"{len(chosen.terms)} of {len(chosen.candidates)} candidates"
        out.heading(f"{coefficient}: {share}, R2 {chosen.selection.model.r2:.3f}")
        names = found.names[coefficient]
        values = [found.estimates.get(name, nothing) for name in names.values()]
        out.table(
            [
                words("term", names), words("parameter", names.values()), numbers("estimate", [v for v, _ in values]),
                numbers("std error", [s for _, s in values]),
            ]
        )  # fmt: skip
    every = found.structure.chosen.values()
    notes = [str(n) for n in (*(n for c in every for n in c.notices), *found.structure.notices)]
    if notes:
        out.heading("notes")
        out.bullets(notes)
    out.line()
    out.line(f"page: {arguments.output / 'structure.html'}")
    flights, target = map(str, arguments.flight), str(arguments.output / "vehicle.toml")
    command = ["stoop", "identify", *flights, "--vehicle", target, "--maneuver", *arguments.maneuver]
    out.command("next: ", [*command, "-o", f"{arguments.output}-result"])
