"""`stoop identify`: the main job."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli import assessments
from stoop.cli.arguments import (
    VEHICLE_HELP,
    WINDOW,
    add_flights,
    add_folder,
    add_free_fix,
    command_line,
    given_paths,
    with_free,
)
from stoop.cli.numbers import at_least_one, count, finite, positive
from stoop.cli.page import page

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stoop.base.notices import Notice
    from stoop.cli.progress import Watch
    from stoop.estimate.fit import Options
    from stoop.flight import Flight
    from stoop.optimize import Progress
    from stoop.vehicle import Vehicle
    from stoop.workflow import Job
    from stoop.workflow.checkpoint import Checkpoint

INTERRUPTED = 130


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add, many = parser.add_argument, "give up after so many (default: {})"
    fit = "windows to fit, seconds of the log's clock, or the windows.toml of stoop maneuvers"
    predict = "windows to predict; nothing is fitted there (default: those of windows.toml)"
    noise = "noise covariance (variances in a row, or a square matrix) instead of estimating it"
    methods = (
        "output-error, multiple-shooting or another of docs/method.md "
        "(default: output-error; with rotors multiple-shooting, or equation-error where motors were logged below 100 Hz)"
    )
    names = "optimizer: ps-gde-lm (default), ps-gde, scipy-least-squares or another of docs/optimizers.md"
    add_flights(parser)
    add("--vehicle", metavar="V.toml", required=True, help=VEHICLE_HELP)
    add("--maneuver", metavar=WINDOW, nargs="+", action="extend", required=True, help=fit)
    add("--validate", metavar=WINDOW, nargs="+", action="extend", default=[], help=predict)
    add_free_fix(parser)
    add("--noise", metavar="Q.csv", type=Path, help=noise)
    add("--method", metavar="NAME", default="", help=methods)
    add("--optimizer", metavar="NAME", default="ps-gde-lm", help=names)
    add("--seed", metavar="N", type=count, default=0, help="of the search (default: 0)")
    add("--generations", metavar="N", type=at_least_one, default=2000, help=many.format(2000))
    add("--budget", metavar="TRAJECTORIES", type=positive, default=100_000.0, help=many.format(100000))
    add("--target-cost", metavar="J", type=finite, default=-math.inf, help="stop at this cost")
    assessments.add_arguments(parser)
    add_folder(parser, "result, vehicle, flight and report", "a result in DIR")
    add("--repeatability", action="store_true", help="fit each maneuver alone too, and compare")
    add("--resume", action="store_true", help="go on from an unfinished search in DIR")


def run(arguments: argparse.Namespace) -> int:
    """Identify, write, and print what was found."""
    _check_output(arguments)
    from stoop.cli.progress import Watch
    from stoop.problem.windows import expanded

    arguments.maneuver, arguments.validate = expanded(arguments.maneuver, arguments.validate)
    vehicle, flights, options = _read(arguments)
    assessed = assessments.wanted(arguments)
    with Watch() as watch:
        for doubt in _doubts(arguments, vehicle, flights):
            watch.warn(str(doubt))
        checkpoint = _checkpoint(arguments, vehicle, flights, options, watch.warn)
        job, stopped = _identify(arguments, vehicle, flights, options, checkpoint, watch)
        if assessed and not stopped:
            job = assessments.assess(job, arguments, watch)
        if not (assessed and stopped):
            checkpoint.forget(job.fit.outcome)
    show(job, arguments.output)
    return INTERRUPTED if stopped else 0


def _doubts(arguments: argparse.Namespace, vehicle: Vehicle, flights: Sequence[Flight]) -> list[Notice]:
    """Return what contradicts the vehicle, before a search that may be long; the report holds it too."""
    from stoop.checks.vehicle import check_vehicle
    from stoop.problem.windows import parse_window

    known = {flight.name: flight for flight in flights}
    return check_vehicle(vehicle, known, [parse_window(text, known) for text in arguments.maneuver])


def _check_output(arguments: argparse.Namespace) -> None:
    from stoop.flight.flight import flight_name
    from stoop.problem.windows import files_among
    from stoop.workflow.outputs import check_folder

    names = [flight_name(path) for path in arguments.flight]
    windows = files_among([*arguments.maneuver, *arguments.validate])
    others = given_paths(arguments.mapping, arguments.noise)
    inputs = [Path(arguments.vehicle), *arguments.flight, *windows, *others]
    replaced = arguments.overwrite or arguments.resume
    check_folder(arguments.output, names, replaced, inputs, assessments.files(arguments))


def _read(arguments: argparse.Namespace) -> tuple[Vehicle, list[Flight], Options]:
    from stoop.estimate.fit import Options
    from stoop.estimate.methods import find
    from stoop.estimate.noise import read_covariance
    from stoop.flight import load
    from stoop.optimize import create
    from stoop.vehicle.builtin import resolve_vehicle

    vehicle = with_free(resolve_vehicle(arguments.vehicle), arguments.free, arguments.fix)
    find(arguments.method)
    create(arguments.optimizer)
    given = read_covariance(arguments.noise, vehicle.outputs) if arguments.noise is not None else None
    options = Options(
        arguments.optimizer, arguments.seed, arguments.generations, arguments.budget, arguments.target_cost, given,
        arguments.method,
    )  # fmt: skip
    flights = [load(path, arguments.mapping) for path in arguments.flight]
    assessments.check(arguments, vehicle, flights)
    return vehicle, flights, options


def _checkpoint(
    arguments: argparse.Namespace,
    vehicle: Vehicle,
    flights: Sequence[Flight],
    options: Options,
    warn: Callable[[str], None],
) -> Checkpoint:
    from stoop.estimate.methods import choose_method
    from stoop.workflow.checkpoint import Checkpoint, identity
    from stoop.workflow.provenance import file_hashes, flight_files

    files = file_hashes([*flight_files(flights), *given_paths(arguments.mapping)])
    options = replace(options, method=choose_method(options.method, vehicle, flights).name)
    problem = identity(vehicle, files, arguments.maneuver, arguments.validate, options)
    return Checkpoint(arguments.output, problem, warn)


def _identify(
    arguments: argparse.Namespace,
    vehicle: Vehicle,
    flights: Sequence[Flight],
    options: Options,
    checkpoint: Checkpoint,
    watch: Watch,
) -> tuple[Job, bool]:
    """Return the job, its results written, and whether Ctrl-C came."""
    from stoop.workflow.checkpoint import deferred_interrupt
    from stoop.workflow.identification import finish, search
    from stoop.workflow.outputs import place_outputs
    from stoop.workflow.repeat import fit_alone, with_repeatability

    state = checkpoint.load() if arguments.resume else None
    watch.count_from(0.0 if state is None else state.evaluations.trajectories)

    def see(progress: Progress) -> None:
        checkpoint.keep(progress.state)
        watch.see(progress)

    others = given_paths(arguments.mapping, arguments.noise)
    windows = arguments.maneuver, arguments.validate
    done = search(vehicle, flights, *windows, options, see, state, command_line(), others)
    singles = []
    if arguments.repeatability:
        checkpoint.keep_last(done.fit.outcome)  # the search that was done is safe meanwhile
        singles = fit_alone(done, watch.turn_to)
    with deferred_interrupt() as ctrl_c:
        checkpoint.keep_last(done.fit.outcome)
        watch.turn_to("error bars, predictions and report")
        job = with_repeatability(finish(done), singles)
        place_outputs(job, arguments.output, arguments.overwrite or arguments.resume)
    return job, ctrl_c.came or done.fit.outcome.status == "interrupted"


def show(job: Job, folder: Path) -> None:
    """Print what was found and where it lies."""
    from stoop.workflow import summary

    result, out = job.identification.result, page()
    out.heading("estimates")
    out.text(summary.estimates_table(result))
    if len(result.uncertainty) > len(summary.BASIC_METHODS):
        out.heading("standard errors by method")
        out.text(summary.methods_table(result))
        out.bullets(f"{name}: {note}" for name, m in result.uncertainty.items() for note in m.notes)
    if result.trust:
        out.heading("which error bars to trust")
        out.bullets(result.trust)
    advice = summary.advice_by_doubt(result.identifiability.parameters)
    if advice:
        out.heading("what would make the doubtful parameters identifiable")
    for doubt, advised in advice.items():
        out.line(f"{doubt}:")
        out.bullets(advised)
    out.heading("fit and prediction")
    out.text(summary.figures_table(result.maneuvers))
    if job.forces:
        out.heading("specific force below 5 Hz, from the measured motion: rms residual, m/s2")
        out.text(summary.forces_table(job.forces))
    lists = {
        "repeatability: each maneuver fitted alone": summary.repeatability_lines(result.repeatability),
        "wind and pitot": [note for wind in result.wind for note in wind.notes],
        "warnings": result.warnings,
        "how to read this": result.basis,
    }
    for title, lines in lists.items():
        if lines or (title == "wind and pitot" and result.wind):
            out.heading(title)
            out.bullets(lines)
    out.line()
    ended = f"{result.status}: {result.advice}" if result.advice else result.status
    out.line(f"{ended} ({result.trajectories:.0f} trajectories, {result.seconds:.1f} s)")
    out.line(f"report: {folder / 'report.html'}")
