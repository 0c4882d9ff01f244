"""What verbs that run a campaign share: where it runs, how far it is, how to go on after Ctrl-C."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli.options import at_least_one
from stoop.cli.progress import INTERRUPTED, QUIET, LiveLine

if TYPE_CHECKING:
    from stoop.parallel import Json, Plan, Pool, Tally


class Display(LiveLine):
    """Shows how far a campaign of this name is."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._note = ""
        self.done = 0  #: runs in the store

    def see(self, tally: Tally) -> None:
        """Show a tally; news are a new note, and that all is done."""
        self.done = tally.done
        parts = [f"{tally.done} of {tally.total} runs"]
        parts += [f"{tally.restored} from before"] if tally.restored else []
        if tally.note:
            parts.append(tally.note)
        elif tally.seconds_left is not None and tally.done < tally.total:
            parts.append(f"{clock(tally.seconds_left)} left")
        news = tally.note not in ("", self._note) or (tally.done == tally.total and tally.seconds > QUIET)
        self._note = tally.note
        self.show(f"{self._first}: {', '.join(parts)}", time.perf_counter(), news)


def clock(seconds: float) -> str:
    """Return a duration as 0:07, 12:30 or 3:05:00."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def add_campaign_arguments(parser: argparse.ArgumentParser) -> None:
    """Add where the runs are done."""
    where = parser.add_mutually_exclusive_group()
    workers = "worker processes on this machine (default: its processors)"
    where.add_argument("--workers", metavar="N", type=at_least_one, help=workers)
    scheduler = "run on an existing Dask cluster, tcp://HOST:PORT"
    where.add_argument("--scheduler", metavar="ADDRESS", help=scheduler)


def pool(arguments: argparse.Namespace) -> Pool:
    """Return where the runs are done."""
    from stoop.parallel import Dask, LocalProcesses

    if arguments.scheduler is not None:
        return Dask(arguments.scheduler)
    return LocalProcesses() if arguments.workers is None else LocalProcesses(arguments.workers)


def run_campaign(arguments: argparse.Namespace, plan: Plan, store: Path) -> dict[str, Json]:
    """Run a plan to its end with progress on stderr; Ctrl-C leaves with a line that says how to go on.

    Raises
    ------
    StoopError
        As :func:`stoop.parallel.execute`.
    """
    from stoop.parallel import execute

    display = Display(plan.name)
    try:
        with display:
            return execute(plan, store, pool(arguments), display.see)
    except KeyboardInterrupt:
        runs = "1 run is" if display.done == 1 else f"{display.done} runs are"
        left = f"interrupted; {runs} safe in {store}: give the same command to do the others"
        if not display.done:
            left = "interrupted before any run was done; give the same command to begin again"
        display.warn(left)
        raise SystemExit(INTERRUPTED) from None
