"""Progress of a search: a live line on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from types import TracebackType

    from stoop.optimize import Progress

QUIET = 5.0  #: s between lines of a plain log


class Watch:
    """Shows generation, cost and speed; passes every state on to be kept.

    Parameters
    ----------
    keep : callable
        Takes the optimizer's state after each generation.
    """

    def __init__(self, keep: Callable[[Any], None] | None = None) -> None:
        self._keep = keep
        self._began = time.perf_counter()
        self._said = 0.0
        self._status: Any = None

    def __enter__(self) -> Watch:
        """Open the live line where there is a terminal."""
        if sys.stderr.isatty():
            from rich.console import Console

            self._status = Console(stderr=True).status("settling the weights")
            self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the live line."""
        if self._status is not None:
            self._status.stop()

    def see(self, progress: Progress) -> None:
        """Show one generation."""
        if self._keep is not None:
            self._keep(progress.state)
        now = time.perf_counter()
        text = self._text(progress, now - self._began)
        if self._status is not None:
            self._status.update(text)
        elif now - self._said > QUIET:
            self._said = now
            print(text, file=sys.stderr)

    def _text(self, progress: Progress, seconds: float) -> str:
        speed = progress.trajectories / max(seconds, 1e-9)
        return (
            f"generation {progress.state.generation}  {progress.event.kind}  cost {progress.cost:.6g}  "
            f"{progress.trajectories:.0f} trajectories  {speed:.0f}/s"
        )
