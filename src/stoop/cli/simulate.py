"""`stoop simulate`: fly a maneuver from trim and write what the instruments would record."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.base.files import check_target
from stoop.cli.arguments import COMPILING, VEHICLE_HELP, add_file
from stoop.cli.numbers import count
from stoop.cli.page import busy, page
from stoop.errors import ManeuverError, VehicleError

if TYPE_CHECKING:
    from stoop.flight import Flight
    from stoop.simulation.maneuver import Maneuver
    from stoop.vehicle import Vehicle


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add("vehicle", metavar="VEHICLE", help=VEHICLE_HELP)
    add("--maneuver", metavar="M.toml", type=Path, required=True, help="what the pilot does (TOML)")
    add_file(parser, "FLIGHT", "the flight file to write: .nc, or a log", required=True)
    add("--no-noise", action="store_true", help="perfect sensors")
    add("--seed", metavar="N", type=count, default=0, help="of sensor noise and gusts (default: 0)")


def run(arguments: argparse.Namespace) -> int:
    """Fly, write, and print what to do next."""
    target: Path = arguments.output
    _check_target(target, arguments.overwrite)
    from stoop.exporters.flight_file import save_flight_as
    from stoop.simulation import load_maneuver, numbers_set, simulate_flight
    from stoop.simulation.fly import flown_trim
    from stoop.vehicle.builtin import resolve_vehicle

    vehicle = resolve_vehicle(arguments.vehicle)
    _check_channels(vehicle)
    maneuver = load_maneuver(arguments.maneuver)
    with _naming(arguments.maneuver), busy(COMPILING):
        flight = simulate_flight(vehicle, maneuver, arguments.seed, not arguments.no_noise, target.stem)
        flown = numbers_set(vehicle, flown_trim(vehicle, maneuver))
    mapping = save_flight_as(flight, target)
    noise = "no sensor noise" if arguments.no_noise else f"sensor noise of seed {arguments.seed}"
    _print(flight, target, noise, mapping)
    _print_next(target, arguments, vehicle, maneuver, flown)
    return 0


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Name the maneuver file in what only the flight finds wrong with it."""
    try:
        yield
    except ManeuverError as error:
        raise ManeuverError(f"{path}: {error}") from None


def _check_target(target: Path, overwrite: bool) -> None:
    """Refuse a name by which the file could not be read again, and one that is taken, its mapping's too."""
    from stoop.exporters.flight_file import OWN, check_ending
    from stoop.logs.csv_tables import mapping_beside

    check_ending(target)
    check_target(target, overwrite)
    if target.suffix.lower() != OWN:
        check_target(mapping_beside(target), overwrite)


def _check_channels(vehicle: Vehicle) -> None:
    """Refuse an input that a flight file has no place for: it would be lost on reading."""
    from stoop.base.text import nearest
    from stoop.base.variables import VARIABLES

    for channel in vehicle.recorded:
        if channel not in VARIABLES:
            advice = nearest(channel, VARIABLES)
            raise VehicleError(f"{vehicle.where}: the input '{channel}' is no variable of stoop; {advice}")


def _print(flight: Flight, target: Path, noise: str, mapping: Path | None) -> None:
    start, stop = float(flight.time[0]), float(flight.time[-1])
    size = f"{stop - start:g} s at {flight.rate:g} Hz, {len(flight.data.data_vars)} channels"
    out = page()
    out.line(f"wrote {target}: {size}, {noise}")
    if mapping is not None:
        out.line(f"wrote {mapping}: the mapping of what the autopilot has no place for, or calls otherwise")
    out.bullets(str(found) for found in flight.notices if found.code != "simulated")


def _print_next(
    target: Path,
    arguments: argparse.Namespace,
    vehicle: Vehicle,
    maneuver: Maneuver,
    flown: Mapping[str, float],
) -> None:
    """Print the fit of this flight, and what must go before it."""
    from stoop.input_design.maneuver_windows import maneuver_windows
    from stoop.problem.observation import observation_model

    windows, out = maneuver_windows(maneuver, not observation_model(vehicle).open_loop), page()
    if not windows.fit:
        out.line(f"no input moves the vehicle: to identify it, add [[input]] tables to {arguments.maneuver}")
        out.command("next: ", ["stoop", "info", str(target)])
        return
    firsts, free = _set_by_trim(vehicle, flown)
    for first in firsts:
        out.line(first)
    validate = ["--validate", *windows.validate] if windows.validate else []
    out.command(
        "next: ",
        [
            "stoop", "identify", str(target), "--vehicle", arguments.vehicle, "--maneuver", *windows.fit, *validate,
            *(word for name in free for word in ("--free", name)), "-o", f"{target.stem}-result",
        ],
    )  # fmt: skip


def _set_by_trim(vehicle: Vehicle, flown: Mapping[str, float]) -> tuple[list[str], list[str]]:
    """Return what to write into the file, and names to free: with the file's own number it would find another drag."""
    firsts, free = [], []
    for name, value in flown.items():
        own = vehicle.parameters[vehicle.rows[name]]
        if own.free:
            continue
        if own.lower < own.upper and own.lower <= value <= own.upper:
            free.append(name)
        else:
            firsts.append(
                f"first: write {name.rpartition('.')[2]} = {value:.7g} into [{name.partition('.')[0]}] of the vehicle "
                "file; with its own number the fit puts the difference into the drag"
            )
    return firsts, free
