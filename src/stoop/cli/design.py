"""`stoop design`: what to fly next, so that the error bars become small."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stoop.cli.freed import freed
from stoop.cli.numbers import at_least_one, count, positive
from stoop.cli.outputs import check_targets
from stoop.cli.page import busy, page
from stoop.cli.point import COMPILING, airspeed, altitude
from stoop.cli.tables import numbers, words
from stoop.errors import SimulationError

if TYPE_CHECKING:
    from stoop.vehicle import Vehicle
    from stoop.workflow.design import Proposal

FAMILIES = ("square", "3-2-1-1", "doublet", "multisine")
_TURNING = ("alpha", "beta", "phi", "theta", "psi", "p", "q", "r")  #: channels that are given in degrees


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add(
        "vehicle",
        metavar="VEHICLE",
        help="vehicle file, built-in vehicle, or the folder that stoop identify wrote",
    )
    add(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        required=True,
        help="folder for maneuver, page and numbers",
    )
    add("--airspeed", metavar="V", type=airspeed, help="m/s (default: the vehicle's reference)")
    add("--altitude", metavar="H", type=altitude, default=200.0, help="m above sea level (default: 200)")
    add("--duration", metavar="S", type=positive, default=20.0, help="seconds (default: 20)")
    add(
        "--amplitude",
        metavar="[CONTROL=]DEG",
        nargs="+",
        action="extend",
        default=[],
        help="largest deflection from the trim, degrees (default: 3)",
    )
    add(
        "--slew",
        metavar="DEG/S",
        type=positive,
        default=60.0,
        help="largest rate of the controls (default: 60)",
    )
    within = "limits of a channel: angles in degrees, rates in degrees per second, all else SI (default: about the trim)"
    add("--within", metavar="CHANNEL=LOW:HIGH", nargs="+", action="extend", default=[], help=within)
    add(
        "--band",
        metavar="HZ",
        type=positive,
        default=2.0,
        help="highest frequency of a multisine (default: 2)",
    )
    add("--shape", choices=FAMILIES, nargs="+", default=list(FAMILIES), help="families to try (default: all)")
    add(
        "--free",
        metavar="NAME",
        nargs="+",
        action="extend",
        default=[],
        help="numbers to estimate besides those of the file",
    )
    add("--fix", metavar="NAME", nargs="+", action="extend", default=[], help="numbers to leave as they are")
    add("--optimizer", metavar="NAME", default="ps-gde", help="see stoop compare --help (default: ps-gde)")
    add(
        "--evaluations",
        metavar="N",
        type=at_least_one,
        default=2000,
        help="maneuvers tried for each family (default: 2000)",
    )
    add("--seed", metavar="N", type=count, default=0, help="of the search (default: 0)")
    add("--overwrite", action="store_true", help="replace an earlier design in the folder")


def run(arguments: argparse.Namespace) -> int:
    """Design, write, and say what it will tell."""
    from dataclasses import replace

    from stoop.design import Limits
    from stoop.simulate import trim
    from stoop.workflow.design import FILES, believed, propose, write_proposal

    check_targets(arguments.output, FILES, arguments.overwrite)
    model = believed(arguments.vehicle)
    model = replace(model, vehicle=freed(model.vehicle, arguments.free, arguments.fix))
    with busy(COMPILING):
        steady = trim(model.vehicle, arguments.airspeed, arguments.altitude)
    limits = Limits.about(
        model.vehicle, steady, _amplitudes(arguments.amplitude, model.vehicle), math.radians(arguments.slew),
        _envelope(arguments.within),
    )  # fmt: skip
    proposal = propose(model, steady, limits, _plan(arguments), arguments.shape, _Watch().see)
    write_proposal(proposal, arguments.output, _command(arguments), arguments.overwrite)
    _tell(proposal, arguments)
    return 0


def _plan(arguments: argparse.Namespace) -> Any:
    from stoop.design.optimization import Plan

    return Plan(
        duration=arguments.duration, band=arguments.band, optimizer=arguments.optimizer,
        evaluations=arguments.evaluations, seed=arguments.seed,
    )  # fmt: skip


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
        factor = math.radians(1.0) if channel in _TURNING else 1.0
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


class _Watch:
    """Says on stderr which family is being searched."""

    def __init__(self) -> None:
        self._said = ""

    def see(self, family: str, progress: Any) -> None:
        """Say it once for each family."""
        if family != self._said:
            self._said = family
            print(f"stoop: designing: {family}", file=sys.stderr, flush=True)


def _command(arguments: argparse.Namespace) -> str:
    """Return the command that makes this design again."""
    import shlex

    parts = ["stoop", "design", str(arguments.vehicle), "--duration", f"{arguments.duration:g}"]
    parts += ["--airspeed", f"{arguments.airspeed:g}"] if arguments.airspeed is not None else []
    parts += [
        "--altitude",
        f"{arguments.altitude:g}",
        "--slew",
        f"{arguments.slew:g}",
        "--band",
        f"{arguments.band:g}",
    ]
    for option in ("amplitude", "within", "shape", "free", "fix"):
        given = getattr(arguments, option)
        parts += [f"--{option}", *given] if given else []
    parts += ["--optimizer", arguments.optimizer, "--evaluations", str(arguments.evaluations)]
    return shlex.join([*parts, "--seed", str(arguments.seed), "-o", str(arguments.output)])


def _tell(proposal: Proposal, arguments: argparse.Namespace) -> None:
    import numpy as np

    setup, out = proposal.setup, page()
    out.heading("Standard errors")
    textbook, designed = setup.std(proposal.expected), setup.std(proposal.best.forecast)
    now = [value if np.isfinite(value) else math.nan for value in proposal.now]
    out.table(
        [
            words("", setup.names),
            numbers("now", now),
            numbers("textbook", list(textbook)),
            numbers("designed", list(designed)),
        ]
    )
    out.line()
    out.bullets(
        f"{one.shape}: mean standard error {proposal.ratio(one):.2f} of the textbook's 3-2-1-1"
        for one in proposal.designs
    )
    told = proposal.robustness
    if np.any(setup.known):
        out.bullets(
            [f"flown with {told.draws} models drawn from what is known, {told.outside} left the envelope"]
        )
    out.line(f"maneuver: {arguments.output / 'maneuver.toml'}")
    out.line(f"page: {arguments.output / 'design.html'}")
    vehicle = Path(arguments.vehicle)
    flown = vehicle / "vehicle.toml" if vehicle.is_dir() else vehicle
    command = ["stoop", "simulate", str(flown), "--maneuver", str(arguments.output / "maneuver.toml")]
    out.command("next: ", [*command, "-o", "designed.nc"])
