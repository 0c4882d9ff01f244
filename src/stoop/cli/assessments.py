"""The options of `stoop identify` that ask for further statements of uncertainty."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli.numbers import at_least_one

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stoop.assess.assessment import Assessment
    from stoop.cli.progress import Watch
    from stoop.flight import Flight
    from stoop.vehicle import Vehicle
    from stoop.workflow import Job

STORES = ("bootstrap.sqlite", "profile.sqlite")  #: in the output folder while the work goes on


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add = parser.add_argument
    refits = "block bootstrap with N replicates (default: 1000)"
    lines = "profile likelihood of these parameters (default: the doubtful ones)"
    add("--bootstrap", metavar="N", nargs="?", const=1000, type=at_least_one, help=refits)
    add("--posterior", action="store_true", help="sample the posterior; writes posterior.nc")
    add("--profile", metavar="NAME", nargs="*", help=lines)


def files(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return the names of the files that the assessments add to the output folder."""
    return ("posterior.nc",) if arguments.posterior else ()


def wanted(arguments: argparse.Namespace) -> bool:
    """Whether any assessment was asked for."""
    return bool(arguments.bootstrap or arguments.posterior or arguments.profile is not None)


def check(arguments: argparse.Namespace, vehicle: Vehicle, flights: Sequence[Flight]) -> None:
    """Refuse what cannot be done, before the search.

    Raises
    ------
    IdentificationError
        The method's fits cannot be assessed, an extra is not installed, or a name is not free.
    """
    if not wanted(arguments):
        return
    from stoop.assess.assessment import check_method
    from stoop.assess.posterior import libraries
    from stoop.assess.profile import check_names
    from stoop.estimate.methods import choose_method

    check_method(choose_method(arguments.method, vehicle, flights).name)
    if arguments.posterior:
        libraries()
    check_names([p.name for p in vehicle.parameters if p.free], arguments.profile or ())


def asked(arguments: argparse.Namespace) -> list[Assessment]:
    """Return the assessments that were asked for."""
    from stoop.assess.profile import DOUBTFUL
    from stoop.workflow import Bootstrap, Posterior, Profile

    folder = arguments.output
    out: list[Assessment] = []
    if arguments.bootstrap:
        out.append(Bootstrap(arguments.bootstrap, store=folder / STORES[0]))
    if arguments.posterior:
        out.append(Posterior())
    if arguments.profile is not None:
        out.append(Profile(tuple(arguments.profile) or (DOUBTFUL,), store=folder / STORES[1]))
    return out


def assess(job: Job, arguments: argparse.Namespace, watch: Watch) -> Job:
    """Return the job with the assessments that were asked for, written where its result lies.

    The result without them lies there already. What is done of them survives Ctrl-C: ``--resume`` goes on.
    """
    from stoop.parallel.store import forget
    from stoop.workflow.outputs import place_outputs

    stores = [Path(arguments.output) / name for name in STORES]
    if not arguments.resume:
        for store in stores:
            forget(store)
    try:
        job = job.assess(*asked(arguments), watch=watch.turn_to)
    except KeyboardInterrupt:
        watch.warn(f"the fit lies in {arguments.output}; --resume goes on with its uncertainty")
        raise
    place_outputs(job, arguments.output, overwrite=True)
    for store in stores:
        forget(store)
    return job
