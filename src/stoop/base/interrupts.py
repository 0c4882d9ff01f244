"""Ctrl-C and SIGTERM: other handlers for a while, and waiting for the end of a block."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

MESSAGE = "\nstoop: the search is done; writing its result (Ctrl-C again throws it away)\n"
Handler = Callable[[int, Any], Any]


@contextmanager
def handle_signals(replaced: Callable[[Handler], Handler]) -> Iterator[None]:
    """Handle Ctrl-C and SIGTERM otherwise until the end of the block: by what is made of the handler that each has.

    Only the main thread can do so; elsewhere, and where no function of Python's handles a signal, nothing is changed.
    """
    before: dict[signal.Signals, Handler] = {}
    if threading.current_thread() is threading.main_thread():
        handlers = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
        before = {one: handler for one, handler in handlers.items() if callable(handler)}
    try:
        for one, handler in before.items():
            signal.signal(one, replaced(handler))
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


@contextmanager
def reraise_interrupt() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end of a block in which an interrupt was caught: a partial search is no result."""
    came = False

    def noting(handler: Handler) -> Handler:
        def note(number: int, frame: Any) -> None:
            nonlocal came
            came = True
            handler(number, frame)

        return note

    with handle_signals(noting):
        yield
    if came:
        raise KeyboardInterrupt


@contextmanager
def delayed_interrupts() -> Iterator[None]:
    """Handle Ctrl-C and SIGTERM at the end of a block: raised amid locks that other threads need, they leave them locked."""
    came: list[Callable[[], Any]] = []
    with handle_signals(lambda handler: lambda number, frame: came.append(partial(handler, number, frame))):
        yield
    for handle in came:
        handle()


def unblock_interrupts() -> None:
    """Handle Ctrl-C from here on; one that has come meanwhile raises KeyboardInterrupt."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def restore_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt for an exception that one amid an import has caused: compiled modules make an ImportError of it."""
    try:
        yield
    except Exception as error:
        one: BaseException | None = error
        while one is not None:
            if isinstance(one, ImportError) and isinstance(one.__cause__, KeyboardInterrupt):
                raise KeyboardInterrupt from error
            one = one.__cause__ or one.__context__
        raise


@dataclass
class Deferred:
    """Whether Ctrl-C came meanwhile."""

    came: bool = False

    def take(self, *_: Any) -> None:
        """Note the first Ctrl-C; the second really stops."""
        if self.came:
            raise KeyboardInterrupt
        self.came = True
        with suppress(OSError, ValueError):
            # not print: this may come in the middle of another print
            os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, MESSAGE.encode())


@contextmanager
def deferred_interrupt() -> Iterator[Deferred]:
    """Let Ctrl-C and SIGTERM wait for the end of the block, where they can; see :func:`handle_signals`."""
    deferred = Deferred()
    with handle_signals(lambda _: deferred.take):
        yield deferred
