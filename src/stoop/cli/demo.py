"""`stoop demo`: the whole job without a file."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli.numbers import count
from stoop.cli.page import page
from stoop.workflow.demo_problem import MANEUVER, TABLE_1

if TYPE_CHECKING:
    from stoop.vehicle import Vehicle
    from stoop.workflow import Job

HERE = Path("stoop-demo")
NAME = "demo"  #: of the flight


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    folder, seed = "folder for the results", "of sensor noise, wrong start values and search"
    add("-o", "--output", metavar="DIR", type=Path, default=HERE, help=f"{folder} (default: {HERE})")
    add("--seed", metavar="N", type=count, default=0, help=f"{seed} (default: 0)")
    add("--overwrite", action="store_true", help="replace files in DIR that are of no earlier demo")


def run(arguments: argparse.Namespace) -> int:
    """Simulate, identify from wrong values, print truth beside estimate, write the report."""
    from stoop.workflow.outputs import check_folder

    overwrite = arguments.overwrite or _holds_demo(arguments.output)
    check_folder(arguments.output, [NAME], overwrite)
    job, truth = identify_demo(arguments.seed)
    from stoop.workflow.summary import estimates_table

    out = page()
    out.line(
        "The paper's twin-boom aircraft (mass and area reconstructed) flies a 3-2-1-1; its sensors are noisy."
    )
    out.line("Ten coefficients are identified, starting from values up to 60 % wrong:")
    out.line()
    result = job.identification.result
    out.text(estimates_table(result, truth))
    out.line()
    out.line(
        f"{result.status} ({result.trajectories:.0f} trajectories, {result.seconds:.2f} s); writing the report ..."
    )
    folder = job.save(arguments.output, overwrite)
    out.line(f"report: {folder / 'report.html'}")
    return 0


def _holds_demo(folder: Path) -> bool:
    """Tell whether a folder holds the result of an earlier demo, which nobody will miss."""
    from stoop.errors import StoopError
    from stoop.results.result import read_result
    from stoop.workflow.outputs import RESULT

    try:
        return {m.flight for m in read_result(folder / RESULT).maneuvers} == {NAME}
    except StoopError:
        return False


def identify_demo(seed: int) -> tuple[Job, dict[str, float]]:
    """Return the finished job and the truth."""
    from stoop.estimate.fit import Options
    from stoop.simulation import parse_maneuver, simulate_flight
    from stoop.vehicle.builtin import resolve_vehicle
    from stoop.workflow import identify

    vehicle = resolve_vehicle("twin-boom").reduced("longitudinal")
    flight = simulate_flight(vehicle, parse_maneuver(MANEUVER, NAME), seed, name=NAME)
    truth = {k: v for k, v in json.loads(flight.data.attrs["truth"]).items() if k in TABLE_1}
    job = identify(misled(vehicle, seed), flight, ["0:30"], options=Options(seed=seed), command="stoop demo")
    return job, truth


def misled(vehicle: Vehicle, seed: int) -> Vehicle:
    """Return the vehicle with wrong starting values and only Table 1's ten coefficients free."""
    import numpy as np

    factors = np.random.default_rng(seed).uniform(0.4, 1.6, len(TABLE_1))
    wrong = {n: {"value": vehicle.value(n) * f} for n, f in zip(TABLE_1, factors, strict=True)}
    others = [
        p.name
        for p in vehicle.parameters
        if p.free and p.name not in TABLE_1 and not p.name.startswith("sensors.")
    ]
    return vehicle.with_numbers({**wrong, **{name: {"free": False} for name in others}})
