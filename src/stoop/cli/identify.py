"""`stoop identify`: the main job."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli import assessments
from stoop.cli.freed import freed
from stoop.cli.numbers import at_least_one, count, finite, positive
from stoop.cli.page import page
from stoop.cli.point import LOG_HELP, MAPPING_HELP, VEHICLE_HELP

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stoop.assess.repeatability import SingleFit
    from stoop.cli.progress import Watch
    from stoop.estimate.fit import Options
    from stoop.flight import Flight
    from stoop.optimize import Progress
    from stoop.vehicle import Vehicle
    from stoop.workflow import Job
    from stoop.workflow.checkpoint import Checkpoint
    from stoop.workflow.identification import Search

_WINDOW = "[FLIGHT@]START:STOP[#LOADING]"
_INTERRUPTED = 130


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    _add_data(parser)
    _add_windows(parser)
    _add_model(parser)
    _add_search(parser)
    assessments.add_arguments(parser)
    _add_output(parser)


def _add_data(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    logs = f"flight log(s): {LOG_HELP}"
    add("flight", metavar="FLIGHT", nargs="+", type=Path, help=logs)
    add("--vehicle", metavar="V.toml", required=True, help=VEHICLE_HELP)
    add("--mapping", metavar="M.toml", type=Path, help=MAPPING_HELP)


def _add_windows(parser: argparse.ArgumentParser) -> None:
    fit = "windows to fit, seconds of the log's clock, or the windows.toml of stoop maneuvers"
    predict = "windows to predict; nothing is fitted there (default: those of windows.toml)"
    parser.add_argument("--maneuver", metavar=_WINDOW, nargs="+", action="extend", required=True, help=fit)
    parser.add_argument("--validate", metavar=_WINDOW, nargs="+", action="extend", default=[], help=predict)


def _add_model(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    free, fix = "estimate this number of the vehicle file", "hold this number"
    noise = "noise covariance (variances in a row, or a square matrix) instead of estimating it"
    add("--free", metavar="NAME", action="append", default=[], help=free)
    add("--fix", metavar="NAME", action="append", default=[], help=fix)
    add("--noise", metavar="Q.csv", type=Path, help=noise)


def _add_search(parser: argparse.ArgumentParser) -> None:
    add, many = parser.add_argument, "give up after so many (default: {})"
    methods = (
        "output-error, multiple-shooting or another of docs/method.md "
        "(default: output-error; with rotors multiple-shooting, or equation-error where motors were logged below 100 Hz)"
    )
    add("--method", metavar="NAME", default="", help=methods)
    names = "who searches: ps-gde-lm (default), ps-gde, scipy-least-squares or another of docs/optimizers.md"
    add("--optimizer", metavar="NAME", default="ps-gde-lm", help=names)
    add("--seed", metavar="N", type=count, default=0, help="of the search (default: 0)")
    add("--generations", metavar="N", type=at_least_one, default=2000, help=many.format(2000))
    add("--budget", metavar="TRAJECTORIES", type=positive, default=100_000.0, help=many.format(100000))
    add("--target-cost", metavar="J", type=finite, default=-math.inf, help="stop at this cost")


def _add_output(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    folder = "folder for result, vehicle, flight and report"
    add("-o", "--output", metavar="DIR", type=Path, required=True, help=folder)
    add("--repeatability", action="store_true", help="fit each maneuver alone too, and compare")
    add("--resume", action="store_true", help="go on from an unfinished search in DIR")
    add("--overwrite", action="store_true", help="replace a result in DIR")


def run(arguments: argparse.Namespace) -> int:
    """Identify, write, and say what was found."""
    _check_output(arguments)
    _expand(arguments)
    from stoop.cli.progress import Watch

    vehicle, flights, options = _read(arguments)
    with Watch() as watch:
        for doubt in _doubts(arguments, vehicle, flights):
            watch.warn(doubt)
        checkpoint = _checkpoint(arguments, vehicle, flights, options, watch.warn)
        job, stopped = _identify(arguments, vehicle, flights, options, checkpoint, watch)
        if assessments.wanted(arguments) and not stopped:
            job = assessments.assess(job, arguments, watch)
        if not (assessments.wanted(arguments) and stopped):
            checkpoint.forget(job.fit.outcome)
    tell(job, arguments.output)
    return _INTERRUPTED if stopped else 0


def _doubts(arguments: argparse.Namespace, vehicle: Vehicle, flights: Sequence[Flight]) -> list[str]:
    """Say what speaks against the vehicle before a search that may be long; the report says it again."""
    from stoop.estimate.mismatch import doubts
    from stoop.problem.windows import parse_window

    known = {flight.name: flight for flight in flights}
    return doubts(vehicle, known, [parse_window(text, known) for text in arguments.maneuver])


def _expand(arguments: argparse.Namespace) -> None:
    """Replace windows.toml by the windows that are accepted in it."""
    from stoop.problem.windows_file import expanded

    arguments.maneuver, arguments.validate = expanded(arguments.maneuver, arguments.validate)


def _check_output(arguments: argparse.Namespace) -> None:
    from stoop.flight.flight import flight_name
    from stoop.problem.windows_file import files_among
    from stoop.workflow.outputs import check_folder

    names = [flight_name(path) for path in arguments.flight]
    windows = files_among([*arguments.maneuver, *arguments.validate])
    inputs = [Path(arguments.vehicle), *arguments.flight, *windows, *_others(arguments)]
    replaced = arguments.overwrite or arguments.resume
    check_folder(arguments.output, names, replaced, inputs, assessments.files(arguments))


def _others(arguments: argparse.Namespace) -> list[Path]:
    """Return what is read beside vehicle and flights."""
    return [path for path in (arguments.mapping, arguments.noise) if path is not None]


def _read(arguments: argparse.Namespace) -> tuple[Vehicle, list[Flight], Options]:
    from stoop.flight import load
    from stoop.vehicle.builtin import resolve_vehicle

    vehicle = freed(resolve_vehicle(arguments.vehicle), arguments.free, arguments.fix)
    options = _options(arguments, vehicle)
    flights = [load(path, arguments.mapping) for path in arguments.flight]
    assessments.check(arguments, vehicle, flights)
    return vehicle, flights, options


def _options(arguments: argparse.Namespace, vehicle: Vehicle) -> Options:
    from stoop.estimate.fit import Options
    from stoop.estimate.methods import find
    from stoop.estimate.noise import read_covariance
    from stoop.optimize import create

    find(arguments.method)
    create(arguments.optimizer)
    given = read_covariance(arguments.noise, vehicle.outputs) if arguments.noise is not None else None
    return Options(
        arguments.optimizer,
        arguments.seed,
        arguments.generations,
        arguments.budget,
        arguments.target_cost,
        given,
        arguments.method,
    )


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

    mapping = [arguments.mapping] if arguments.mapping is not None else []
    files = file_hashes([*flight_files(flights), *mapping])
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
    from stoop.workflow.identification import finish, search
    from stoop.workflow.interrupt import deferred_interrupt
    from stoop.workflow.outputs import place_outputs
    from stoop.workflow.repeat import with_repeatability

    state = checkpoint.load() if arguments.resume else None
    watch.count_from(0.0 if state is None else state.evaluations.trajectories)

    def see(progress: Progress) -> None:
        checkpoint.keep(progress.state)
        watch.see(progress)

    done = search(
        vehicle, flights, arguments.maneuver, arguments.validate, options,
        see, state, shlex.join(["stoop", *sys.argv[1:]]), _others(arguments),
    )  # fmt: skip
    singles = _alone(done, checkpoint, watch) if arguments.repeatability else []
    with deferred_interrupt() as ctrl_c:
        checkpoint.keep_last(done.fit.outcome)
        watch.turn_to("error bars, predictions and report")
        job = with_repeatability(finish(done), singles)
        place_outputs(job, arguments.output, arguments.overwrite or arguments.resume)
    return job, ctrl_c.came or done.fit.outcome.status == "interrupted"


def _alone(done: Search, checkpoint: Checkpoint, watch: Watch) -> list[SingleFit]:
    """Fit every maneuver alone; the search that was done is safe meanwhile."""
    from stoop.workflow.repeat import fit_alone

    checkpoint.keep_last(done.fit.outcome)
    return fit_alone(done, watch.turn_to)


def tell(job: Job, folder: Path) -> None:
    """Print what was found and where it lies."""
    from stoop.workflow.summary import (
        BASIC,
        doubts_by_phrase,
        estimates_table,
        figures_table,
        forces_table,
        methods_table,
        repeatability_lines,
    )

    result, out = job.identification.result, page()
    out.heading("estimates")
    print(estimates_table(result))
    if len(result.uncertainty) > len(BASIC):
        out.heading("standard errors by method")
        print(methods_table(result))
        out.bullets(f"{name}: {note}" for name, m in result.uncertainty.items() for note in m.notes)
    if result.trust:
        out.heading("which error bars to trust")
        out.bullets(result.trust)
    doubts = doubts_by_phrase(result.identifiability.parameters)
    if doubts:
        out.heading("what would tell the doubtful parameters")
    for doubt, advised in doubts.items():
        out.line(f"{doubt}:")
        out.bullets(advised)
    out.heading("fit and prediction")
    print(figures_table(result.maneuvers))
    if job.forces:
        out.heading("specific force below 5 Hz, measured motion in: rms residual, m/s2")
        print(forces_table(job.forces))
    if result.repeatability.maneuvers:
        out.heading("repeatability: each maneuver fitted alone")
        out.bullets(repeatability_lines(result.repeatability))
    if result.wind:
        out.heading("wind and pitot")
        out.bullets(note for w in result.wind for note in w.notes)
    if result.warnings:
        out.heading("warnings")
        out.bullets(result.warnings)
    if result.basis:
        out.heading("how to read this")
        out.bullets(map(str, result.basis))
    out.line()
    advice = f": {result.advice}" if result.advice else ""
    out.line(f"{result.status}{advice} ({result.trajectories:.0f} trajectories, {result.seconds:.1f} s)")
    out.line(f"report: {folder / 'report.html'}")
