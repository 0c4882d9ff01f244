"""`stoop identify`: the main job."""

from __future__ import annotations

import argparse
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from stoop.base.numbers import count
from stoop.base.packages import hook
from stoop.cli import options
from stoop.cli.page import Page, page
from stoop.cli.progress import INTERRUPTED, Watch
from stoop.results import text
from stoop.results.decisions import decision_lines
from stoop.results.verdict import REASONS, grouped, shortened

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stoop.assessment.assessment import Assessment
    from stoop.estimate.fit import Options
    from stoop.flight import Flight
    from stoop.optimize import Progress
    from stoop.prediction.predict import ForceFigures
    from stoop.results.result import ManeuverResult, Result
    from stoop.strategy import Strategy
    from stoop.vehicle import Vehicle
    from stoop.workflow import FittedModel
    from stoop.workflow.checkpoint import Checkpoint

ROWS: Final = 12  #: determined parameters that get a line each, with their interval
STORES: Final = ("bootstrap.sqlite", "profile.sqlite")  #: in the output folder while the assessments go on


def run(arguments: argparse.Namespace) -> int:
    """Identify, write, and print what was found; a refusal leaves no folder."""
    folder: Path = arguments.output
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        return _run(arguments)
    finally:
        for path in made:
            with suppress(OSError):  # it holds something
                path.rmdir()


def _run(arguments: argparse.Namespace) -> int:
    from stoop.assessment.assessment import Assessment
    from stoop.assessment.profile import DOUBTFUL
    from stoop.checks.vehicle import check_vehicle
    from stoop.cli.progress_file import ProgressFile
    from stoop.estimate.iterates import watched
    from stoop.flight.flight import flight_name
    from stoop.problem.windows import Window
    from stoop.strategy.run import choose_method
    from stoop.workflow import Bootstrap, Profile
    from stoop.workflow.checkpoint import Checkpoint, identity
    from stoop.workflow.outputs import check_folder, file_hashes, flight_files

    attached = ("posterior.nc",) if arguments.posterior else ()
    names = [flight_name(path) for path in arguments.flight]
    overwrite = arguments.overwrite or arguments.resume
    check_folder(arguments.output, names, overwrite, arguments.flight, attached)
    windows = arguments.maneuver, arguments.validate
    if any(one.endswith(".toml") for given in windows for one in given):
        windows = hook("windows_of_files", "a file of windows", tuple)(*windows)
    arguments.maneuver, arguments.validate = windows
    strategy, (vehicle, flights, settings) = strategy_of(arguments), _read(arguments)
    known = {flight.name: flight for flight in flights}
    fitted = [Window.parse(one, known) for one in arguments.maneuver]
    stores = [arguments.output / name for name in STORES]
    assessments: list[Assessment] = []
    if arguments.bootstrap:
        assessments.append(Bootstrap(arguments.bootstrap, store=stores[0]))
    if arguments.posterior:
        assessments.append(hook("posterior", "--posterior", Assessment)())
    if arguments.profile is not None:
        assessments.append(Profile(tuple(arguments.profile) or (DOUBTFUL,), store=stores[1]))
    state = None if arguments.progress is None else ProgressFile(arguments.progress)
    seen = nullcontext() if state is None else watched(state.see)
    with seen, Watch(file=state) as watch:
        # What contradicts the vehicle comes before a search that may be long; the report holds it too.
        for doubt in check_vehicle(vehicle, known, fitted):
            watch.warn(str(doubt))
        files = file_hashes([*flight_files(flights), *options.given_paths(arguments.mapping)])
        setup = choose_method(settings.method, vehicle, flights, fitted, strategy)
        chosen = replace(settings, method=setup.options.method)
        problem = identity(vehicle, files, arguments.maneuver, arguments.validate, chosen, strategy)
        checkpoint = Checkpoint(arguments.output, problem, watch.warn)
        model, stopped = _identify(arguments, vehicle, flights, settings, checkpoint, watch)
        if assessments and not stopped:
            model = _assess(model, assessments, arguments, watch)
        if not (assessments and stopped):
            checkpoint.forget(model.result.status)
    _show_fit(model.result, model.forces, arguments.output, arguments.verbose)
    return INTERRUPTED if stopped else 0


def strategy_of(arguments: argparse.Namespace) -> Strategy:
    """Return the decisions that the switches leave; a StoopError says which of them contradict each other."""
    from stoop.errors import IdentificationError
    from stoop.strategy import Strategy

    strategy = Strategy.default()
    given = {
        "--textbook": arguments.textbook, "--only": arguments.only, "--without": arguments.without,
    }  # fmt: skip
    if len(used := [name for name, value in given.items() if value]) > 1:
        raise IdentificationError(
            f"{' and '.join(used)}: give one of them; each says which decisions are taken"
        )
    if arguments.extend and "extensions" in arguments.without:
        raise IdentificationError("--extend and --without extensions contradict each other; leave one out")
    if arguments.textbook:
        strategy = Strategy.textbook()
    elif arguments.only:
        strategy = Strategy.textbook().only(*arguments.only)
    elif arguments.without:
        strategy = strategy.without(*arguments.without)
    strategy = strategy.including("extensions") if arguments.extend else strategy
    return strategy.without_component(*arguments.without_component)


def _read(arguments: argparse.Namespace) -> tuple[Vehicle, list[Flight], Options]:
    """Return vehicle, flights and options; refuse a method, a name or an assessment before the search."""
    from stoop.assessment.assessment import Assessment, check_method
    from stoop.assessment.profile import check_names
    from stoop.estimate.fit import Options
    from stoop.estimate.methods import find
    from stoop.estimate.noise import read_covariance
    from stoop.flight.load import load_several
    from stoop.optimize import create
    from stoop.strategy.run import choose_method
    from stoop.vehicle.builtin import load_vehicle

    vehicle = options.with_free(load_vehicle(arguments.vehicle), arguments.free, arguments.fix)
    find(arguments.method)
    create(arguments.optimizer)
    given = read_covariance(arguments.noise, vehicle.outputs) if arguments.noise is not None else None
    settings = Options(
        arguments.optimizer, arguments.seed, arguments.generations, arguments.budget, arguments.target_cost, given,
        arguments.method,
    )  # fmt: skip
    flights = load_several(arguments.flight, arguments.mapping)
    if arguments.posterior or arguments.profile is not None:
        asked = {"posterior": arguments.posterior, "profile": arguments.profile is not None}
        chosen = choose_method(arguments.method, vehicle, flights, strategy=strategy_of(arguments))
        check_method(chosen.options.method, [n for n in asked if asked[n]])
        if arguments.posterior:
            hook("posterior", "--posterior", Assessment)()
        check_names([p.name for p in vehicle.parameters if p.free], arguments.profile or ())
    return vehicle, flights, settings


def _identify(
    arguments: argparse.Namespace,
    vehicle: Vehicle,
    flights: Sequence[Flight],
    settings: Options,
    checkpoint: Checkpoint,
    watch: Watch,
) -> tuple[FittedModel, bool]:
    """Return the fitted model, its results written, and whether Ctrl-C came."""
    from stoop.assessment.uncertainty import repeatability, with_repeatability
    from stoop.base.interrupts import deferred_interrupt
    from stoop.workflow.identification import finish, search
    from stoop.workflow.outputs import place_outputs

    state = checkpoint.load() if arguments.resume else None
    watch.count_from(0.0 if state is None else state.evaluations.trajectories, arguments.budget)

    def see(progress: Progress) -> None:
        checkpoint.keep(progress.state)
        watch.see(progress)

    others, command = options.given_paths(arguments.mapping, arguments.noise), options.command_line()
    common = vehicle, flights, arguments.maneuver, arguments.validate, settings
    done = search(*common, see, state, command, others, strategy_of(arguments), watch.turn_to)
    repeated = None
    if arguments.repeatability:
        checkpoint.keep_last(done.estimate.outcome)  # the search that was done is safe meanwhile
        repeated = repeatability(done.estimate, done.flights, done.options, watch.turn_to)
    with deferred_interrupt() as ctrl_c:
        checkpoint.keep_last(done.estimate.outcome)
        watch.turn_to("error bars, predictions and report")
        model = finish(done)
        watch.keep(model.traces)
        model = model.with_result(with_repeatability(model.result, repeated)) if repeated else model
        place_outputs(model, arguments.output, arguments.overwrite or arguments.resume)
    return model, ctrl_c.came or done.estimate.outcome.status == "interrupted"


def _assess(
    model: FittedModel, assessments: Sequence[Assessment], arguments: argparse.Namespace, watch: Watch
) -> FittedModel:
    """Return the model with the assessments that were asked for, written where its result lies.

    The result without them lies there already. What is done of them survives Ctrl-C: ``--resume`` goes on.
    """
    from stoop.parallel.store import forget
    from stoop.workflow.outputs import place_outputs

    stores = [arguments.output / name for name in STORES]
    for store in stores if not arguments.resume else ():
        forget(store)
    try:
        model = model.assess(*assessments, watch=watch.turn_to)
    except KeyboardInterrupt:
        watch.warn(f"the fit lies in {arguments.output}; --resume goes on with its uncertainty")
        raise
    place_outputs(model, arguments.output, overwrite=True)
    for store in stores:
        forget(store)
    return model


def _show_fit(result: Result, forces: Sequence[ForceFigures], folder: Path, verbose: bool) -> None:
    """Print verdict, estimates, windows held back and where the report is; all that the result holds with `verbose`."""
    out = page()
    _verdict(out, result, verbose)
    if verbose:
        _everything(out, result, forces)
    else:
        _estimates(out, result)
        _windows(out, result.maneuvers)
    out.bullets(decision_lines(result.decisions), "decisions")
    out.line()
    ended = f"{result.status}: {result.advice}" if result.advice else result.status
    out.line(f"{ended} ({result.trajectories:.0f} trajectories, {result.seconds:.1f} s)")
    out.line(f"report: {folder / 'report.html'}")


def _verdict(out: Page, result: Result, verbose: bool) -> None:
    reasons = grouped(result.verdict.reasons)
    out.line(f"verdict: {result.verdict.headline}")
    if verbose:
        out.bullets([*reasons, *result.verdict.advice])
        return
    out.bullets(map(shortened, reasons[:REASONS]))
    left = ((len(reasons) - REASONS, "more reason"), (len(result.warnings), "warning"))
    if known := [count(number, what) for number, what in left if number > 0]:
        out.line(f"  {', '.join(known)} and what would settle them: in the report, or by --verbose")


def _estimates(out: Page, result: Result) -> None:
    from stoop.workflow.summary import estimates_table

    known = text.determined(result.parameters)
    if len(known) > ROWS:
        out.heading("estimates +- standard errors (SI units, radians)")
        estimates = {name: (p.estimate, p.std_error) for name, p in known.items()}
        out.text("\n".join(text.estimate_blocks(estimates)))
    elif known:
        out.heading("estimates")
        out.text(estimates_table(known))
    for line in text.undetermined_lines(result.parameters):
        out.line(line)


def _windows(out: Page, maneuvers: Sequence[ManeuverResult]) -> None:
    held_back = [m for m in maneuvers if m.role == "validation"]
    out.heading("prediction of windows that were not fitted")
    out.bullets(map(text.window_line, held_back))
    if not held_back:
        out.bullets(["none was held back: --validate START:STOP holds one back"])
    out.line(f"fitted {text.matched_line([m for m in maneuvers if m.role == 'fit'])}")


def _everything(out: Page, result: Result, forces: Sequence[ForceFigures]) -> None:
    from stoop.workflow import summary

    out.heading("estimates")
    out.text(summary.estimates_table(result.parameters))
    if result.components.variances:
        out.heading("shares of the variance by component")
        out.text(str(result.components))
    if len(result.uncertainty) > len(summary.BASIC_METHODS):
        out.heading("standard errors by method")
        out.text(summary.methods_table(result))
        out.bullets(f"{name}: {note}" for name, m in result.uncertainty.items() for note in m.notes)
    out.bullets(result.trust, "which error bars to trust")
    advice = summary.advice_by_doubt(result.identifiability.parameters)
    if advice:
        out.heading("what would make the doubtful parameters identifiable")
    for doubt, advised in advice.items():
        out.line(f"{doubt}:")
        out.bullets(advised)
    out.heading("fit and prediction")
    out.text(summary.figures_table(result.maneuvers))
    if forces:
        out.heading("specific force below 5 Hz, from the measured motion: rms residual, m/s2")
        out.text(summary.forces_table(forces))
    repeated = summary.repeatability_lines(result.repeatability)
    out.bullets(repeated, "repeatability: each maneuver fitted alone")
    out.bullets((note for wind in result.wind for note in wind.notes), "wind and pitot")
    out.bullets(result.warnings, "warnings")
    out.bullets(result.basis, "what the figures rest on")
