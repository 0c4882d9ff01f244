"""What verbs that run a campaign share: where it runs, how far it is, how to go on after Ctrl-C."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stoop.cli.numbers import at_least_one
from stoop.cli.printable import printable

if TYPE_CHECKING:
    from stoop.parallel import Json, Plan, Pool, Tally

QUIET = 5.0  #: s between lines of a plain log
_INTERRUPTED = 130


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

    Parameters
    ----------
    arguments : Namespace
        With those of :func:`add_campaign_arguments`.
    plan : Plan
    store : Path

    Raises
    ------
    StoopError
        As :func:`stoop.parallel.execute`.
    """
    from stoop.parallel import execute

    display = Display(plan.name)
    with display.shown(), _leaving_politely(display, store):
        return execute(plan, store, pool(arguments), display.see)


@contextmanager
def _leaving_politely(display: Display, store: Path) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        display.close()
        print(printable(f"stoop: {_farewell(display.done, store)}"), file=sys.stderr)
        raise SystemExit(_INTERRUPTED) from None


def _farewell(done: int, store: Path) -> str:
    """Say what an interruption left, and what to do."""
    if not done:
        return "interrupted before any run was done; give the same command to begin again"
    runs = "1 run is" if done == 1 else f"{done} runs are"
    return f"interrupted; {runs} safe in {store}: give the same command to do the others"


class Display:
    """Shows how far a campaign is: a live line on a terminal, a plain line now and then elsewhere.

    Parameters
    ----------
    name : str
        Of the plan.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._said, self._note = -QUIET, ""
        self._status: Any = None
        self.done = 0  #: runs in the store

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Keep the live line open meanwhile, where there is a terminal."""
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.text import Text

            self._status = Console(stderr=True).status(Text(printable(self._name)))
            self._status.start()
        try:
            yield
        finally:
            self.close()

    def close(self) -> None:
        """Close the live line."""
        if self._status is not None:
            self._status.stop()
            self._status = None

    def see(self, tally: Tally) -> None:
        """Show a tally."""
        self.done = tally.done
        text = printable(f"{self._name}: {_words(tally)}")
        if self._status is not None:
            from rich.text import Text

            self._status.update(Text(text))
        elif self._worth_a_line(tally):
            print(text, file=sys.stderr, flush=True)

    def _worth_a_line(self, tally: Tally) -> bool:
        """Tell whether a log wants this: some time has passed, there is news, or all is done."""
        now = time.monotonic()
        news = tally.note not in ("", self._note) or (tally.done == tally.total and tally.seconds > QUIET)
        self._note = tally.note
        if not news and now - self._said < QUIET:
            return False
        self._said = now
        return True


def _words(tally: Tally) -> str:
    parts = [f"{tally.done} of {tally.total} runs"]
    if tally.restored:
        parts.append(f"{tally.restored} from before")
    if tally.note:
        parts.append(tally.note)
    elif tally.seconds_left is not None and tally.done < tally.total:
        parts.append(f"{clock(tally.seconds_left)} left")
    return ", ".join(parts)


def clock(seconds: float) -> str:
    """Return a duration as 0:07, 12:30 or 3:05:00."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
