"""`stoop compare`: optimizers on the same problems, counted the same way."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli.page import page
from stoop.cli.progress import run_campaign
from stoop.errors import IdentificationError

if TYPE_CHECKING:
    from stoop_studies.compare.field import Field


def run(arguments: argparse.Namespace) -> int:
    """Run what is left of the comparison, write it, and say who is ahead."""
    from stoop.cli import page as tables
    from stoop_studies.compare.page import PAGE, STORE, beaten_text, conclude, ends_text, prepare

    field = _field(arguments)
    plan = field.plan()
    prepare(arguments.output, arguments.overwrite)
    results = run_campaign(arguments, plan, arguments.output / STORE)
    scores = conclude(field, results, arguments.output, _command(arguments))
    out = page()
    for problem in dict.fromkeys(s.problem for s in scores):
        found = [s for s in scores if s.problem == problem]
        out.heading(problem)
        out.table(
            tables.words("optimizer", [s.optimizer for s in found]),
            tables.points("successes", [s.rate_text for s in found]),
            tables.points("ERT", [s.ert_text for s in found]),
            tables.points("ratio", [s.ratio_text for s in found]),
            tables.words("95 %", [s.ratio.interval for s in found]),
        )
        out.line(beaten_text(found))
    out.line()
    for line in ends_text(scores):
        out.line(line)
    out.line(f"Tables and page: {arguments.output / PAGE}")
    return 0


def _field(arguments: argparse.Namespace) -> Field:
    from stoop.errors import FlightError
    from stoop.workflow.outputs import file_hashes
    from stoop_studies.compare import field

    given = {"--flight": arguments.flight, "--vehicle": arguments.vehicle, "--maneuver": arguments.maneuver}
    missing = [name for name, value in given.items() if not value]
    flight: dict[str, str | list[str]] = {}
    if not missing:
        flight = {"flight": arguments.flight, "vehicle": arguments.vehicle, "maneuvers": arguments.maneuver}
    elif len(missing) < len(given):
        raise IdentificationError(
            f"problem flight: {' and '.join(missing)} missing; give all of {', '.join(given)}"
        )
    optimizers, absent = arguments.optimizers, dict[str, str]()
    if optimizers is None:
        optimizers, absent = field.installed()
    field.check_optimizers(optimizers)
    problems = arguments.problems or (*field.PROBLEMS, *([field.FLIGHT] if flight else []))
    if flight and field.FLIGHT not in problems:
        raise IdentificationError("--flight: the problem 'flight' is not among --problems; add it there")
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    field.check_problems(problems, bool(flight), arguments.first_seed)
    # a store is continued on the same files only
    paths = [Path(path) for path in (*arguments.flight, arguments.vehicle)] if flight else []
    for path in paths[:-1]:
        if not path.exists():
            raise FlightError(f"{path}: no such file or folder; check the name")
    digests = file_hashes([path for path in paths if path.exists()])
    return field.Field(optimizers, problems, seeds, arguments.budget, flight, digests, absent)


def _command(arguments: argparse.Namespace) -> str:
    """Return the command that makes the page; where it runs and into what folder do not change it."""
    given = {
        "--optimizers": [",".join(arguments.optimizers or ())],
        "--problems": [",".join(arguments.problems or ())],
        "--flight": arguments.flight or [],
        "--vehicle": [arguments.vehicle or ""],
        "--maneuver": arguments.maneuver,
        "--seeds": [str(arguments.seeds)],
        "--first-seed": [str(arguments.first_seed)],
        "--budget": [repr(arguments.budget).removesuffix(".0")],
    }
    options = [word for name, values in given.items() if any(values) for word in (name, *values)]
    return shlex.join(["stoop", "compare", *options])
