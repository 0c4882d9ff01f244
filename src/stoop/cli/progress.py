"""Progress of a search: a live line on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Any, Self

from stoop.base.text import printable

if TYPE_CHECKING:
    from stoop.optimize import Progress

QUIET = 5.0  #: s between lines of a plain log
INTERRUPTED = 130  #: exit code


class LiveLine:
    """A line on stderr that says how far the work is."""

    def __init__(self, first: str) -> None:
        self._first = first
        self._began, self._printed = time.perf_counter(), -QUIET
        self._status: Any = None

    def __enter__(self) -> Self:
        """Open the live line where there is a terminal."""
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.text import Text

            self._status = Console(stderr=True).status(Text(printable(self._first)))
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Close the live line."""
        if self._status is not None:
            self._status.stop()
            self._status = None

    def turn_to(self, work: str) -> None:
        """Show what is done now, on a terminal only."""
        if self._status is not None:
            from rich.text import Text

            self._status.update(Text(printable(work)))

    def show(self, text: str, now: float, news: bool = False) -> None:
        """Show how far it is; in a log a line where there is news, or none was printed for some seconds."""
        self.turn_to(text)
        if self._status is None and (news or now - self._printed > QUIET):
            self._printed = now
            print(printable(text), file=sys.stderr, flush=True)

    def warn(self, text: str) -> None:
        """Print a line that stays."""
        line = f"stoop: {printable(text)}"
        if self._status is not None:
            self._status.console.print(line, markup=False, highlight=False, soft_wrap=True)
        else:
            print(line, file=sys.stderr)


class Watch(LiveLine):
    """Shows generation, cost and speed of a search."""

    def __init__(self, first: str = "estimating the weights") -> None:
        super().__init__(first)
        self._before = 0.0

    def count_from(self, trajectories: float) -> None:
        """Leave out of the speed what an earlier run has spent."""
        self._before = trajectories

    def see(self, progress: Progress) -> None:
        """Show one generation."""
        now = time.perf_counter()
        speed = (progress.trajectories - self._before) / max(now - self._began, 1e-9)
        text = (
            f"generation {progress.state.generation}  {progress.event.kind}  cost {progress.cost:.6g}  "
            f"{progress.trajectories:.0f} trajectories  {speed:.0f}/s"
        )
        self.show(text, now)
