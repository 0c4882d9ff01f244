"""Progress of a search or a campaign: a live line on a terminal, a plain line now and then elsewhere; where runs are done."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from stoop.base.text import duration, printable, show

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.text import Text

    from stoop.cli.progress_file import ProgressFile
    from stoop.optimize import Progress
    from stoop.parallel import Json, Plan, Pool, Tally
    from stoop.results.result import ManeuverTrace

QUIET = 5.0  #: s between lines of a plain log
INTERRUPTED = 130  #: exit code


@dataclass(frozen=True)
class Timed:
    """A text beside the time since `began` (`time.perf_counter`), which goes on as the line is drawn."""

    text: str
    began: float

    def __rich__(self) -> Text:
        """Return the line as it is now."""
        from rich.text import Text

        return Text(f"{printable(self.text)}  [{duration(time.perf_counter() - self.began)}]")


class LiveLine:
    """A line on stderr that says on a terminal that work goes on, and how far it is."""

    def __init__(self, first: str) -> None:
        self._first = first
        self._began, self._printed = time.perf_counter(), -QUIET
        self._status: Any = None

    def __enter__(self) -> Self:
        """Open the live line where there is a terminal."""
        if sys.stderr.isatty() and os.environ.get("TERM") != "dumb":
            from rich.console import Console

            self._status = Console(stderr=True).status(Timed(self._first, self._began))
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Close the live line."""
        if self._status is not None:
            self._status.stop()
            self._status = None

    def turn_to(self, work: str) -> None:
        """Show what is done now, on a terminal only."""
        self._update(work)

    def _update(self, work: str) -> None:
        if self._status is not None:
            self._status.update(Timed(work, self._began))

    def show(self, text: str, now: float, news: bool = False) -> None:
        """Show how far it is; in a log a line where there is news, or none was printed for some seconds."""
        self._update(text)
        if self._status is None and (news or now - self._printed > QUIET):
            self._printed = now
            show(printable(text), sys.stderr)

    def warn(self, text: str) -> None:
        """Print a line that stays."""
        line = f"stoop: {printable(text)}"
        if self._status is not None:
            self._status.console.print(line, markup=False, highlight=False, soft_wrap=True)
        else:
            show(line, sys.stderr)


class Watch(LiveLine):
    """Shows generation, cost and speed of a search."""

    def __init__(self, first: str = "estimating the weights", file: ProgressFile | None = None) -> None:
        super().__init__(first)
        self._before, self._budget, self._file = 0.0, math.inf, file
        if file is not None:
            file.turn_to(first)

    def turn_to(self, work: str) -> None:
        """Show what is done now, in the file too."""
        super().turn_to(work)
        if self._file is not None:
            self._file.turn_to(work)

    def keep(self, traces: Sequence[ManeuverTrace]) -> None:
        """Keep the curves of a result in the file."""
        if self._file is not None:
            self._file.keep(traces)

    def _update(self, work: str) -> None:
        super()._update(work)
        if self._file is not None:
            self._file.note(work)

    def count_from(self, trajectories: float, budget: float = math.inf) -> None:
        """Leave out of the speed what an earlier run has spent; the search may spend a `budget` in all."""
        self._before, self._budget = trajectories, budget

    def see(self, progress: Progress) -> None:
        """Show one generation."""
        now = time.perf_counter()
        speed = (progress.trajectories - self._before) / max(now - self._began, 1e-9)
        text = (
            f"generation {progress.state.generation}  {progress.event.kind}  cost {progress.cost:.6g}  "
            f"{progress.trajectories:.0f} trajectories  {speed:.0f}/s"
        )
        left = (self._budget - progress.trajectories) / speed if speed > 0.0 else math.inf
        if self._status is not None and math.isfinite(left):
            text += f"  at most {duration(max(left, 0.0))} left"
        self.show(text, now)


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
            parts.append(f"{duration(tally.seconds_left)} left")
        news = tally.note not in ("", self._note) or (tally.done == tally.total and tally.seconds > QUIET)
        self._note = tally.note
        self.show(f"{self._first}: {', '.join(parts)}", time.perf_counter(), news)


def pool(arguments: argparse.Namespace) -> Pool:
    """Return where the runs are done."""
    from stoop.parallel import Dask, LocalProcesses

    if arguments.scheduler is not None:
        return Dask(arguments.scheduler)
    return LocalProcesses() if arguments.workers is None else LocalProcesses(arguments.workers)


def run_campaign(arguments: argparse.Namespace, plan: Plan, store: Path) -> dict[str, Json]:
    """Run a plan to its end with progress on stderr; Ctrl-C leaves with a line that says how to go on.

    Raises `StoopError`: as :func:`stoop.parallel.execute`.
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
