"""`stoop identify`: the main job."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stoop.cli.page import page
from stoop.cli.point import VEHICLE_HELP
from stoop.errors import IdentificationError

if TYPE_CHECKING:
    from stoop.flight import Flight
    from stoop.job import Job
    from stoop.vehicle import Vehicle

_WINDOW = "[FLIGHT@]START:STOP[#LOADING]"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add(
        "flight",
        metavar="FLIGHT",
        nargs="+",
        type=Path,
        help="flight log(s): .ulg, PX4 CSV folder, .nc, .csv",
    )
    add("--vehicle", metavar="V.toml", required=True, help=VEHICLE_HELP)
    add("--mapping", metavar="M.toml", type=Path, help="columns and units of a CSV log")
    add(
        "--maneuver",
        metavar=_WINDOW,
        nargs="+",
        action="extend",
        required=True,
        help="windows to fit, seconds of the log's clock",
    )
    add(
        "--validate",
        metavar=_WINDOW,
        nargs="+",
        action="extend",
        default=[],
        help="windows to predict; nothing is fitted there",
    )
    add(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        required=True,
        help="folder for result, vehicle, flight and report",
    )
    add(
        "--free", metavar="NAME", action="append", default=[], help="estimate this number of the vehicle file"
    )
    add("--fix", metavar="NAME", action="append", default=[], help="hold this number")
    add(
        "--noise",
        metavar="Q.csv",
        type=Path,
        help="noise covariance (variances in a row, or a square matrix) instead of estimating it",
    )
    _add_search(parser)
    add("--resume", action="store_true", help="go on from an interrupted search in DIR")
    add("--overwrite", action="store_true", help="replace a result in DIR")


def _add_search(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--optimizer",
        metavar="NAME",
        default="ps-gde-lm",
        help="ps-gde-lm (default), ps-gde, de-rand-1-bin, de-best-2-bin",
    )
    add("--seed", metavar="N", type=_count, default=0, help="of the search (default: 0)")
    add("--generations", metavar="N", type=_count, default=2000, help="give up after so many (default: 2000)")
    add(
        "--budget",
        metavar="TRAJECTORIES",
        type=_positive,
        default=100_000.0,
        help="give up after so many (default: 100000)",
    )
    add("--target-cost", metavar="J", type=float, default=-math.inf, help="stop at this cost")


def _count(text: str) -> int:
    if not text.isascii() or not text.isdigit():
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number, zero or above")
    return int(text)


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"'{text}' is not a positive number")
    return value


def run(arguments: argparse.Namespace) -> int:
    """Identify, write, and say what was found."""
    from stoop.job.outputs import check_folder

    check_folder(arguments.output, arguments.overwrite or arguments.resume)
    from stoop.flight import load
    from stoop.job import identify
    from stoop.job.checkpoint import Checkpoint
    from stoop.vehicle.builtin import resolve_vehicle

    vehicle = freed(resolve_vehicle(arguments.vehicle), arguments.free, arguments.fix)
    flights = [load(path, arguments.mapping) for path in arguments.flight]
    options = _options(arguments, vehicle)
    checkpoint = Checkpoint(arguments.output, _identity(arguments, vehicle))
    state = checkpoint.load() if arguments.resume else None
    from stoop.cli.progress import Watch

    with Watch(checkpoint.keep) as watch:
        job = identify(
            vehicle, flights, arguments.maneuver, arguments.validate, options,
            watch.see, state, shlex.join(["stoop", *sys.argv[1:]]),
        )  # fmt: skip
    folder = job.save(arguments.output, overwrite=True)
    if job.fit.outcome.status != "interrupted":
        checkpoint.forget()
    tell(job, folder)
    return 130 if job.fit.outcome.status == "interrupted" else 0


def _identity(arguments: argparse.Namespace, vehicle: Vehicle) -> str:
    """Return what an interrupted search must share with the one that resumes it."""
    parts = [
        vehicle.structure,
        repr(vehicle.parameters),
        *map(str, arguments.flight),
        *arguments.maneuver,
        *arguments.validate,
    ]
    return "\n".join([*parts, arguments.optimizer, str(arguments.seed)])


def freed(vehicle: Vehicle, free: Sequence[str], fix: Sequence[str]) -> Vehicle:
    """Return the vehicle with numbers freed and fixed as the command line says."""
    both = set(free) & set(fix)
    if both:
        raise IdentificationError(f"--free and --fix both name '{min(both)}'; keep one of them")
    changes: dict[str, dict[str, Any]] = {name: {"free": True} for name in free} | {
        name: {"free": False} for name in fix
    }
    changed = vehicle.with_numbers(changes) if changes else vehicle
    for p in changed.parameters:
        if p.name in free and not p.lower < p.upper:
            raise IdentificationError(
                f"--free {p.name}: it has no bounds and its value is {p.value:g}; write bounds = [low, high] in {vehicle.where}"
            )
    return changed


def _options(arguments: argparse.Namespace, vehicle: Vehicle) -> Any:
    from stoop.identify.fit import Options
    from stoop.identify.given import read_covariance
    from stoop.optimize import create

    create(arguments.optimizer)
    given = read_covariance(arguments.noise, vehicle.outputs) if arguments.noise is not None else None
    return Options(
        arguments.optimizer,
        arguments.seed,
        arguments.generations,
        arguments.budget,
        arguments.target_cost,
        given,
    )


def tell(job: Job, folder: Path, flights: Sequence[Flight] = ()) -> None:
    """Print what was found and where it lies."""
    from stoop.job.summary import estimates_table, figures_table

    result, out = job.identification.result, page()
    out.heading("estimates")
    print(estimates_table(result))
    out.heading("fit and prediction")
    print(figures_table(result))
    if result.wind:
        out.heading("wind and pitot")
        out.bullets(note for w in result.wind for note in w.notes)
    if result.warnings:
        out.heading("warnings")
        out.bullets(result.warnings)
    if job.identification.statements:
        out.heading("how to read this")
        out.bullets(job.identification.statements)
    out.line()
    advice = f": {result.advice}" if result.advice else ""
    out.line(f"{result.status}{advice} ({result.trajectories:.0f} trajectories, {result.seconds:.1f} s)")
    out.line(f"report: {folder / 'report.html'}")
