"""Ctrl-C waits while a finished search is being written down."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

_WORDS = "\nstoop: the search is done; writing its result (Ctrl-C again throws it away)\n"


@dataclass
class Deferred:
    """Whether Ctrl-C came meanwhile."""

    came: bool = False

    def take(self, *_: Any) -> None:
        """Note the first Ctrl-C; the second really stops."""
        if self.came:
            raise KeyboardInterrupt
        self.came = True
        with contextlib.suppress(OSError, ValueError):
            # not print: this may come in the middle of another print
            os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, _WORDS.encode())


@contextmanager
def deferred_interrupt() -> Iterator[Deferred]:
    """Let Ctrl-C wait until the end of the block.

    Only the main thread can do so; elsewhere, and where the process ignores Ctrl-C, nothing is changed.
    """
    deferred = Deferred()
    ours = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGINT)
    if not ours or before in (signal.SIG_IGN, None):  # None: a handler that Python could not put back
        yield deferred
        return
    signal.signal(signal.SIGINT, deferred.take)
    try:
        yield deferred
    finally:
        signal.signal(signal.SIGINT, before)
