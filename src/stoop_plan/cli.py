"""`stoop maneuvers`, `design` and `simulate`: windows to fit and to predict, what to fly next, and simulated flights."""

from __future__ import annotations

import argparse
import math
import shlex
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from stoop.extend.errors import FlightError, ManeuverError, SimulationError, VehicleError
from stoop.extend.files import check_targets
from stoop.extend.fits import estimate_blocks
from stoop.extend.motion import Maneuver
from stoop.extend.text import count, enumerated, remaining
from stoop.extend.variables import FAMILIES
from stoop.extend.verbs import LiveLine, Page, column, options, page
from stoop_plan.injection_targets import MANUAL_THROTTLE

if TYPE_CHECKING:
    from stoop import Vehicle
    from stoop_plan.input_design.windows import Expected, FoundWindows

IN_DEGREES: Final = (
    "alpha",
    "beta",
    *FAMILIES["euler"],
    *FAMILIES["rates"],
)  #: channels that are given in degrees


def maneuvers(arguments: argparse.Namespace) -> int:
    """Find windows, write them, and print what was found."""
    from stoop import load_vehicle
    from stoop.extend.files import by_name
    from stoop.extend.flights import load_several
    from stoop.extend.vehicles import with_assumptions
    from stoop_plan.design import WINDOW_FILES, write_windows
    from stoop_plan.input_design.windows import doubts, find_windows
    from stoop_plan.input_design.windows_file import NAME

    given, free, fix = arguments.vehicle, arguments.free, arguments.fix
    check_targets(arguments.output, WINDOW_FILES, arguments.overwrite)
    if (free or fix) and not given:
        raise VehicleError("--free and --fix choose numbers of a vehicle file; name it with --vehicle")
    vehicle = options.with_free(load_vehicle(given), free, fix) if given else None
    with LiveLine("reading the log"):
        read = [one.without_faults() for one in load_several(arguments.flight, arguments.mapping)]
        flights = by_name(read, "maneuvers")
    if vehicle is not None:
        vehicle, _ = with_assumptions(vehicle, 1.0 / read[0].rate)
    with LiveLine(options.COMPILING if vehicle is not None else "looking for maneuvers") as watch:
        warned = doubts(flights, vehicle) if vehicle is not None else []
        for doubt in warned:
            watch.warn(str(doubt))
        found = find_windows(flights, vehicle, watch.turn_to)
    folder = arguments.output
    following = options.identify_command(arguments, "result", maneuver=[folder / NAME])
    every = replace(found, notices=(*warned, *found.notices))
    name = "" if vehicle is None else vehicle.name
    write_windows(every, flights, name, folder, options.command_line(), following)

    _show_windows(found, folder, following, arguments.verbose)
    return 0


def _show_windows(found: FoundWindows, folder: Path, following: Sequence[str], verbose: bool) -> None:
    """Print how many windows are proposed, the windows, the next command, and what may be expected of them."""
    from stoop_plan.input_design.windows_file import NAME
    from stoop_plan.report import span_of

    out, proposed = page(), found.windows
    uses = [w.purpose for w in proposed]
    fit, ahead = uses.count("fit"), uses.count("predict")
    out.line(f"{count(len(proposed), 'window')} found: {fit} to fit, {ahead} to predict")
    out.command("next: ", following)
    out.line()
    out.table(
        column("", range(1, len(proposed) + 1), 0),
        column("window s", [span_of(w, found) for w in proposed]),
        column("use", uses),
        column("axis", [w.axis for w in proposed]),
        column("information", [w.information for w in proposed], 2),
        column("gain", [w.gain or math.nan for w in proposed], 2),
        column("why", [str(w.why) for w in proposed], wraps=True),
    )
    _show_expected(out, found.expected, verbose)
    out.bullets(found.notices, "notes")
    out.line()
    out.line(f"edit: {folder / NAME}")
    out.line(f"page: {folder / 'windows.html'}")


def _show_expected(out: Page, expected: Sequence[Expected], verbose: bool) -> None:
    """Print the quick fit with the standard errors that are expected of the windows: by groups, or a line each."""
    from stoop_plan.report import QUICK_FIT, percent

    if not expected:
        return
    if not verbose:
        out.heading("quick fit +- expected standard errors (SI units, radians)")
        inside = {e.name: (e.value, e.std_error) for e in expected if math.isfinite(e.std_error)}
        out.text("\n".join(estimate_blocks(inside)))
        if bound := [e.name for e in expected if e.name not in inside]:
            out.line(f"at a bound: {enumerated(bound)}")
        return
    out.heading("expected of the windows to be fitted")
    out.line(QUICK_FIT)
    errors = [e.std_error if math.isfinite(e.std_error) else math.nan for e in expected]
    out.table(
        column("", [e.name for e in expected]),
        column("quick fit", [e.value for e in expected]),
        column("std error", errors),
        replace(column("of its size", [percent(e.relative) for e in expected]), right=True),
    )


def design(arguments: argparse.Namespace) -> int:
    """Design a maneuver, write it, and print the expected standard errors."""
    import numpy as np

    from stoop import trim
    from stoop.extend.fits import model_or_vehicle
    from stoop_plan.design import (
        DESIGN_FILES,
        flight_files,
        known_before,
        maneuver_files,
        min_amplitudes,
        usual_plan,
        write_proposal,
    )  # fmt: skip
    from stoop_plan.input_design.information import Limits, Setup, usual_amplitudes
    from stoop_plan.input_design.optimization import propose
    from stoop_plan.report import NO_IMPROVEMENT
    from stoop_plan.targets import flown_by

    folder, target = arguments.output, arguments.target
    check_targets(folder, (*DESIGN_FILES, *(flown_by(target).names if target else ())), arguments.overwrite)
    vehicle, knowledge, noise, source = known_before(model_or_vehicle(arguments.vehicle))
    vehicle = options.with_free(vehicle, arguments.free, arguments.fix)
    with LiveLine(options.COMPILING):
        steady = trim(vehicle, arguments.airspeed, arguments.altitude)
    controls = tuple(usual_amplitudes(vehicle, steady))
    throws = _sizes(arguments.throw, "--throw", controls)
    envelope: dict[str, tuple[float, float]] = {}
    for text in arguments.within:  # alpha=-5:10
        channel, _, span = text.partition("=")
        factor = math.radians(1.0) if channel in IN_DEGREES else 1.0
        edges = [factor * _number(edge, "--within", text, "CHANNEL=LOW:HIGH") for edge in span.split(":")]
        if len(edges) != 2 or not edges[0] < edges[1]:
            form = "write CHANNEL=LOW:HIGH with LOW below HIGH, for example alpha=-5:10"
            raise SimulationError(f"--within {text}: {form}")
        envelope[channel] = (edges[0], edges[1])
    limits = Limits.about(
        vehicle, steady, _sizes(arguments.amplitude, "--amplitude", controls), math.radians(arguments.slew), envelope,
        min_amplitudes(vehicle.controls, target, _sizes(arguments.min_amplitude, "--min-amplitude", controls)),
    )  # fmt: skip
    if target:
        flown_by(target).check(target, vehicle, steady, limits.amplitude, throws)
    plan, shapes = usual_plan(
        steady, target, arguments.shape, arguments.duration, arguments.beat, arguments.evaluations,
        band=arguments.band, optimizer=arguments.optimizer, seed=arguments.seed,
    )  # fmt: skip
    began = 0.0

    def see(stage: str, progress: Any) -> None:
        nonlocal began
        now, far = time.perf_counter(), ""
        if progress is None:
            began = now
        else:
            left = remaining(now - began, progress.trajectories, plan.evaluations)
            far = f", {progress.trajectories:.0f} of {plan.evaluations} maneuvers{left}"
        live.show(f"designing: {stage}{far}", now, news=progress is None)

    setup = Setup(vehicle, steady, limits, knowledge, noise)
    with LiveLine("designing") as live:
        proposal = propose(setup, plan, shapes, see, source)
    flight = flight_files(proposal, target, throws) if target else {}
    write_proposal(proposal, folder, _command(arguments), arguments.overwrite, flight)

    out = page()
    out.heading("Standard errors")
    now = [value if np.isfinite(value) else math.nan for value in proposal.now]
    columns = {"textbook": proposal.expected, "designed": proposal.best.forecast}
    errors = [column(head, list(setup.std(one))) for head, one in columns.items()]
    out.table(column("", setup.names), column("now", now), *errors)
    out.line()
    ratios = [(one.shape, proposal.ratio(one)) for one in proposal.designs]
    out.bullets(
        f"{shape}: error bars together (D-optimality) {r:.2f} of the textbook's" for shape, r in ratios
    )
    out.bullets(why for _, why in proposal.refused)
    if not proposal.is_improvement:
        out.bullets([NO_IMPROVEMENT[proposal.is_textbook]])
    if target == "pilot" and not throws:
        out.bullets(["the card has no percentages of the stick: give the throws by --throw CONTROL=DEG"])
    if any(name.startswith("sid_") for name in flight):
        out.bullets([MANUAL_THROTTLE])
    if np.any(setup.known):
        out.bullets([proposal.robustness.notice])
    maneuvers = [*maneuver_files("maneuver", proposal.best.maneuver, proposal.setup.retrim, "")]
    for name in maneuvers:
        out.line(f"maneuver: {folder / name}")
    out.line(f"page: {folder / 'design.html'}")
    for name in flight:
        out.line(f"to fly: {folder / name}")
    given = Path(arguments.vehicle)
    model_file = given / "vehicle.toml" if given.is_dir() else given
    command = ["stoop", "simulate", str(model_file), "--maneuver", str(folder / maneuvers[0])]
    out.command("next: ", [*command, "-o", "designed.nc"])
    return 0


def _sizes(texts: Sequence[str], option: str, controls: Sequence[str]) -> dict[str, float]:
    """Return sizes by control, SI: 3 is of all controls, rudder=5 of one."""
    out: dict[str, float] = {}
    for text in texts:
        control, equals, value = text.rpartition("=")
        size = _number(value, option, text, "DEG or CONTROL=DEG")
        named = (control,) if equals else controls
        for name in named:
            angle = Maneuver.unit_of(name) == "rad"
            if not 0.0 <= size < (90.0 if angle else math.inf):
                raise SimulationError(
                    f"{option} {text}: {value} is {'not between 0 and 90 degrees' if angle else 'negative'}"
                )
            out[name] = math.radians(size) if angle else size
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
    parts += ["--for", arguments.target] if arguments.target else []
    for option in ("duration", "airspeed", "altitude", "slew", "band", "beat"):
        value = getattr(arguments, option)
        parts += [f"--{option}", f"{value:g}"] if value is not None else []
    for option in ("amplitude", "min_amplitude", "throw", "within", "shape", "free", "fix"):
        given = getattr(arguments, option)
        parts += [f"--{option}", *given] if given else []
    parts += ["--optimizer", arguments.optimizer] if arguments.optimizer else []
    parts += ["--evaluations", str(arguments.evaluations)] if arguments.evaluations else []
    return shlex.join([*parts, "--seed", str(arguments.seed), "-o", str(arguments.output)])


def simulate(arguments: argparse.Namespace) -> int:
    """Fly from trim, write what the instruments would record, and print what to do next."""
    from stoop import load_maneuver, load_vehicle
    from stoop import simulate as simulated
    from stoop.extend.recordings import mapping_beside
    from stoop.extend.text import nearest
    from stoop.extend.variables import VARIABLES
    from stoop_plan.flight_logs import OWN, check_ending, save_flight_as
    from stoop_plan.input_design.windows import find_windows

    if arguments.maneuver is None:
        arguments.complain("name a maneuver by --maneuver")
    target: Path = arguments.output
    options.check_target(target, arguments.overwrite)
    check_ending(target)
    if target.suffix.lower() != OWN:
        options.check_target(mapping_beside(target), arguments.overwrite)
    vehicle = load_vehicle(arguments.vehicle)
    lost = next((channel for channel in vehicle.recorded if channel not in VARIABLES), None)
    if lost is not None:  # a flight file has no place for it
        advice = nearest(lost, VARIABLES)
        raise VehicleError(f"{vehicle.where}: the input '{lost}' is no variable of stoop; {advice}")
    maneuver = load_maneuver(arguments.maneuver)
    try:
        with LiveLine(options.COMPILING):
            flight = simulated(
                vehicle, maneuver, seed=arguments.seed, noise=not arguments.no_noise, name=target.stem,
                autopilot=arguments.autopilot or None,
            )  # fmt: skip
            flown = maneuver.trim(vehicle).numbers_set(vehicle)
    except ManeuverError as error:
        raise ManeuverError(f"{arguments.maneuver}: {error}") from None
    mapping = save_flight_as(flight, target)

    out, duration = page(), float(flight.time[-1]) - float(flight.time[0])
    noise = "no sensor noise" if arguments.no_noise else f"sensor noise of seed {arguments.seed}"
    size = f"{duration:g} s at {flight.rate:g} Hz, {len(flight.channels)} channels"
    out.line(f"wrote {target}: {size}, {noise}")
    if mapping is not None:
        out.line(f"wrote {mapping}: the mapping of what the autopilot has no place for, or calls otherwise")
    out.bullets(found for found in flight.notices if found.code != "simulated")
    try:
        found = find_windows({flight.name: flight})
    except FlightError as error:
        if not maneuver.input:
            out.line(
                f"no input moves the vehicle: to identify it, add [[input]] tables to {arguments.maneuver}"
            )
        else:
            out.line(str(error))
        out.command("next: ", ["stoop", "info", str(target)])
        return 0
    free = _freed(vehicle, flown)
    chosen = {"flight": target, "free": free} | options.windows_of(found)
    out.command("next: ", options.identify_command(arguments, f"{target.stem}-result", **chosen))
    return 0


def _freed(vehicle: Vehicle, flown: dict[str, float]) -> list[str]:
    """Return numbers to free, those that trim has set: with the file's own the fit would find another drag.

    Those that have no bounds around that value must be written into the file first; this is printed.
    """
    found: list[str] = []
    for name, value in flown.items():
        own = vehicle.parameters[vehicle.rows[name]]
        if own.free:
            continue
        if own.lower < own.upper and own.lower <= value <= own.upper:
            found.append(name)
        else:
            page().line(
                f"first: write {name.rpartition('.')[2]} = {value:.7g} into [{name.partition('.')[0]}] of the vehicle "
                "file; with its own number the fit puts the difference into the drag"
            )
    return found
