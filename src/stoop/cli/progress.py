"""Progress of a search: a live line on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Any

from stoop.cli.printable import printable

if TYPE_CHECKING:
    from types import TracebackType

    from stoop.optimize import Progress

QUIET = 5.0  #: s between lines of a plain log


class Watch:
    """Shows generation, cost and speed."""

    def __init__(self, first: str = "estimating the weights") -> None:
        self._first = first
        self._before = 0.0
        self._began = time.perf_counter()
        self._said = 0.0
        self._status: Any = None

    def __enter__(self) -> Watch:
        """Open the live line where there is a terminal."""
        if sys.stderr.isatty():
            from rich.console import Console

            self._status = Console(stderr=True).status(self._first)
            self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the live line."""
        if self._status is not None:
            self._status.stop()

    def count_from(self, trajectories: float) -> None:
        """Leave out of the speed what an earlier run has spent."""
        self._before = trajectories

    def see(self, progress: Progress) -> None:
        """Show one generation."""
        now = time.perf_counter()
        text = self._text(progress, now - self._began)
        if self._status is not None:
            self._status.update(text)
        elif now - self._said > QUIET:
            self._said = now
            print(text, file=sys.stderr)

    def turn_to(self, work: str) -> None:
        """Show what is done after the search."""
        if self._status is not None:
            self._status.update(work)

    def warn(self, text: str) -> None:
        """Print a line that stays."""
        if self._status is not None:
            self._status.console.print(
                f"stoop: {printable(text)}", markup=False, highlight=False, soft_wrap=True
            )
        else:
            print(f"stoop: {printable(text)}", file=sys.stderr)

    def _text(self, progress: Progress, seconds: float) -> str:
        speed = (progress.trajectories - self._before) / max(seconds, 1e-9)
        return (
            f"generation {progress.state.generation}  {progress.event.kind}  cost {progress.cost:.6g}  "
            f"{progress.trajectories:.0f} trajectories  {speed:.0f}/s"
        )
