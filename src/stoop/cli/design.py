"""`stoop design`: what to fly next, so that the error bars become small."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stoop.base.files import check_targets
from stoop.base.variables import EULER, RATES
from stoop.cli.arguments import COMPILING, add_folder, airspeed, altitude, with_free
from stoop.cli.numbers import at_least_one, count, positive
from stoop.cli.page import busy, page
from stoop.cli.tables import numbers, words
from stoop.errors import SimulationError

if TYPE_CHECKING:
    from stoop.input_design.optimization import Proposal
    from stoop.vehicle import Vehicle

FAMILIES = ("square", "3-2-1-1", "doublet", "multisine")
IN_DEGREES = ("alpha", "beta", *EULER, *RATES)  #: channels that are given in degrees


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    several: Any = {"nargs": "+", "action": "extend", "default": []}
    vehicle = "vehicle file, built-in vehicle, or the folder that stoop identify wrote"
    amplitude = "largest deflection from the trim, degrees (default: 3)"
    slew = "largest rate of the controls (default: 60)"
    within = "limits of a channel: angles in degrees, rates in degrees per second, all else SI (default: about the trim)"
    band = "highest frequency of a multisine (default: 2)"
    evaluations = "maneuvers tried for each family (default: 2000)"
    add("vehicle", metavar="VEHICLE", help=vehicle)
    add_folder(parser, "maneuver, page and numbers", "an earlier design in the folder")
    add("--airspeed", metavar="V", type=airspeed, help="m/s (default: the vehicle's reference)")
    add("--altitude", metavar="H", type=altitude, default=200.0, help="m above sea level (default: 200)")
    add("--duration", metavar="S", type=positive, default=20.0, help="seconds (default: 20)")
    add("--amplitude", metavar="[CONTROL=]DEG", **several, help=amplitude)
    add("--slew", metavar="DEG/S", type=positive, default=60.0, help=slew)
    add("--within", metavar="CHANNEL=LOW:HIGH", **several, help=within)
    add("--band", metavar="HZ", type=positive, default=2.0, help=band)
    add("--shape", choices=FAMILIES, nargs="+", default=list(FAMILIES), help="families to try (default: all)")
    add("--free", metavar="NAME", **several, help="numbers to estimate besides those of the file")
    add("--fix", metavar="NAME", **several, help="numbers to leave as they are")
    add("--optimizer", metavar="NAME", default="ps-gde", help="see stoop compare --help (default: ps-gde)")
    add("--evaluations", metavar="N", type=at_least_one, default=2000, help=evaluations)
    add("--seed", metavar="N", type=count, default=0, help="of the search (default: 0)")


def run(arguments: argparse.Namespace) -> int:
    """Design, write, and print the expected standard errors."""
    from dataclasses import replace

    from stoop.input_design import Limits
    from stoop.input_design.optimization import Plan, propose
    from stoop.simulation import trim
    from stoop.workflow.design import FILES, prior_model, write_proposal

    check_targets(arguments.output, FILES, arguments.overwrite)
    model = prior_model(arguments.vehicle)
    model = replace(model, vehicle=with_free(model.vehicle, arguments.free, arguments.fix))
    with busy(COMPILING):
        steady = trim(model.vehicle, arguments.airspeed, arguments.altitude)
    amplitudes = _amplitudes(arguments.amplitude, model.vehicle)
    slew, envelope = math.radians(arguments.slew), _envelope(arguments.within)
    limits = Limits.about(model.vehicle, steady, amplitudes, slew, envelope)
    plan = Plan(
        duration=arguments.duration, band=arguments.band, optimizer=arguments.optimizer,
        evaluations=arguments.evaluations, seed=arguments.seed,
    )  # fmt: skip
    families: list[str] = []

    def see(family: str, _: Any) -> None:
        if family not in families:
            families.append(family)
            print(f"stoop: designing: {family}", file=sys.stderr, flush=True)

    proposal = propose(model, steady, limits, plan, arguments.shape, see)
    write_proposal(proposal, arguments.output, _command(arguments), arguments.overwrite)
    _print(proposal, arguments)
    return 0


def _amplitudes(given: list[str], vehicle: Vehicle) -> dict[str, float]:
    """Read ``3`` (all controls) and ``rudder=5``; degrees."""
    out: dict[str, float] = {}
    for text in given:
        control, equals, value = text.rpartition("=")
        size = math.radians(_number(value, "--amplitude", text, "DEG or CONTROL=DEG"))
        if not 0.0 <= size < math.pi / 2.0:
            raise SimulationError(f"--amplitude {text}: {value} is not between 0 and 90 degrees")
        out |= {control: size} if equals else dict.fromkeys(vehicle.controls, size)
    return out


def _envelope(given: list[str]) -> dict[str, tuple[float, float]]:
    """Read ``alpha=-5:10``."""
    out: dict[str, tuple[float, float]] = {}
    for text in given:
        channel, _, span = text.partition("=")
        factor = math.radians(1.0) if channel in IN_DEGREES else 1.0
        edges = [factor * _number(edge, "--within", text, "CHANNEL=LOW:HIGH") for edge in span.split(":")]
        if len(edges) != 2 or not edges[0] < edges[1]:
            raise SimulationError(
                f"--within {text}: write CHANNEL=LOW:HIGH with LOW below HIGH, for example alpha=-5:10"
            )
        out[channel] = (edges[0], edges[1])
    return out


def _number(text: str, option: str, whole: str, form: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise SimulationError(f"{option} {whole}: '{text}' is not a number; write {form}")
    return value


def _command(arguments: argparse.Namespace) -> str:
    """Return the command that makes this design again."""
    parts = ["stoop", "design", str(arguments.vehicle)]
    for option in ("duration", "airspeed", "altitude", "slew", "band"):
        value = getattr(arguments, option)
        parts += [f"--{option}", f"{value:g}"] if value is not None else []
    for option in ("amplitude", "within", "shape", "free", "fix"):
        given = getattr(arguments, option)
        parts += [f"--{option}", *given] if given else []
    parts += ["--optimizer", arguments.optimizer, "--evaluations", str(arguments.evaluations)]
    return shlex.join([*parts, "--seed", str(arguments.seed), "-o", str(arguments.output)])


def _print(proposal: Proposal, arguments: argparse.Namespace) -> None:
    import numpy as np

    setup, folder, out = proposal.setup, arguments.output, page()
    out.heading("Standard errors")
    now = [value if np.isfinite(value) else math.nan for value in proposal.now]
    columns = {"textbook": proposal.expected, "designed": proposal.best.forecast}
    errors = [numbers(head, list(setup.std(one))) for head, one in columns.items()]
    out.table([words("", setup.names), numbers("now", now), *errors])
    out.line()
    out.bullets(
        f"{one.shape}: mean standard error {proposal.ratio(one):.2f} of the textbook's 3-2-1-1"
        for one in proposal.designs
    )
    robust = proposal.robustness
    if np.any(setup.known):
        outside = f"{robust.outside} left the envelope"
        out.bullets([f"flown with {robust.draws} models drawn from what is known, {outside}"])
    out.line(f"maneuver: {folder / 'maneuver.toml'}")
    out.line(f"page: {folder / 'design.html'}")
    vehicle = Path(arguments.vehicle)
    flown = vehicle / "vehicle.toml" if vehicle.is_dir() else vehicle
    command = ["stoop", "simulate", str(flown), "--maneuver", str(folder / "maneuver.toml")]
    out.command("next: ", [*command, "-o", "designed.nc"])
