"""Standard streams that the caller closed, or that nobody reads any more."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import TextIO


def open_missing_streams() -> None:
    """Open the null device for the standard streams that the caller closed.

    Otherwise the next file that is opened gets the number of the stream, and what child processes print.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            handle = os.open(os.devnull, os.O_RDWR)  # the lowest free number
            os.set_inheritable(handle, handle == number)
            stream = os.fdopen(handle, mode, encoding="utf-8")
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)


def flush_or_discard(stream: TextIO) -> None:
    """Write what a stream still holds, or lead it to the null device: the interpreter flushes it once more at its end.

    See the Python manual on SIGPIPE.
    """
    try:
        stream.flush()
    except OSError:
        with contextlib.suppress(OSError):  # a stream without a file descriptor
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, stream.fileno())
            os.close(null)
