"""Verbs that write a file to go on with: `stoop vehicle` and `stoop simulate`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.base.files import check_target, write_text_atomic
from stoop.base.text import show
from stoop.cli import options
from stoop.cli.page import page, words
from stoop.cli.progress import LiveLine
from stoop.errors import FlightError, ManeuverError, VehicleError

if TYPE_CHECKING:
    from stoop.vehicle import Vehicle


def vehicle(arguments: argparse.Namespace) -> int:
    """List the built-in vehicles, print the file of one, or write it."""
    from stoop.vehicle.builtin import BUILT_IN, builtin_text, builtin_title

    name, output, out = arguments.name, arguments.output, page()
    if arguments.equations:
        if name is None or output is not None:
            arguments.complain("--equations needs the name of a vehicle or its file, and no -o")
        from stoop.vehicle.builtin import resolve_vehicle
        from stoop.vehicle.symbolic import build_model

        with LiveLine(options.COMPILING):
            lines = build_model(resolve_vehicle(name)).latex
        for line in lines:
            show(line)
    elif name is None:
        if output is not None:
            arguments.complain("-o needs the name of a vehicle")
        out.table(words("name", BUILT_IN), words("what it is", map(builtin_title, BUILT_IN), wraps=True))
        out.command("a draft of your own, by its log: ", ["stoop", "vehicle", "new", "LOG", "-o", "my.toml"])
        out.command("a copy to edit: ", ["stoop", "vehicle", "quad-x", "-o", "my.toml"])
    elif output is None:
        show(builtin_text(name).removesuffix("\n"))
    else:
        text = builtin_text(name)
        write_text_atomic(output, text)
        out.line(f"{output}: the built-in vehicle {name}, with its comments; edit its numbers")
        out.command("next: ", ["stoop", "trim", str(output)])
    return 0


def simulate(arguments: argparse.Namespace) -> int:
    """Fly from trim, write what the instruments would record, and print what to do next."""
    from stoop.base.text import nearest
    from stoop.base.variables import VARIABLES
    from stoop.input_design.windows import find_windows
    from stoop.logs.csv_tables import mapping_beside
    from stoop.simulation.fly import flown_trim, numbers_set, simulate_flight
    from stoop.simulation.maneuver import load_maneuver
    from stoop.vehicle.builtin import resolve_vehicle
    from stoop.workflow.flying import simulate_under_law
    from stoop_plan.flight_logs import OWN, check_ending, save_flight_as

    if arguments.maneuver is None:
        arguments.complain("name a maneuver by --maneuver")
    target: Path = arguments.output
    check_target(target, arguments.overwrite)
    check_ending(target)
    if target.suffix.lower() != OWN:
        check_target(mapping_beside(target), arguments.overwrite)
    vehicle = resolve_vehicle(arguments.vehicle)
    lost = next((channel for channel in vehicle.recorded if channel not in VARIABLES), None)
    if lost is not None:  # a flight file has no place for it
        advice = nearest(lost, VARIABLES)
        raise VehicleError(f"{vehicle.where}: the input '{lost}' is no variable of stoop; {advice}")
    maneuver = load_maneuver(arguments.maneuver)
    try:
        with LiveLine(options.COMPILING):
            asked = (arguments.seed, not arguments.no_noise, target.stem)
            if arguments.autopilot:
                flight = simulate_under_law(vehicle, maneuver, arguments.autopilot, *asked)
            else:
                flight = simulate_flight(vehicle, maneuver, *asked)
            flown = numbers_set(vehicle, flown_trim(vehicle, maneuver))
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
