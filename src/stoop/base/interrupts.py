"""Ctrl-C and SIGTERM: who answers them for a while."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Handler = Callable[[int, Any], Any]


@contextmanager
def answered(answer: Callable[[Handler], Handler]) -> Iterator[None]:
    """Answer Ctrl-C and SIGTERM otherwise until the end of the block, from the handler that each has.

    Only the main thread can do so; elsewhere, and where no function of Python's handles a signal, nothing is changed.
    """
    before: dict[signal.Signals, Handler] = {}
    if threading.current_thread() is threading.main_thread():
        handlers = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
        before = {one: handler for one, handler in handlers.items() if callable(handler)}
    try:
        for one, handler in before.items():
            signal.signal(one, answer(handler))
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


@contextmanager
def undivided() -> Iterator[None]:
    """Let a block that was interrupted end so, also where what is in it has an answer of its own: half a search is no result."""
    came = False

    def noting(handler: Handler) -> Handler:
        def note(number: int, frame: Any) -> None:
            nonlocal came
            came = True
            handler(number, frame)

        return note

    with answered(noting):
        yield
    if came:
        raise KeyboardInterrupt
