"""One at a time: what changes something that the whole process shares, such as the number of BLAS threads.

Two threads that each limit it and put back what they found would otherwise leave the limit of the one to the other.
"""

from __future__ import annotations

import importlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Final

from threadpoolctl import ThreadpoolController

ALONE: Final = threading.RLock()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let SciPy and NumPy reckon with one thread: on tiny matrices more only wait, and round differently."""
    with ALONE, _threads().limit(limits=1, user_api="blas"):
        yield


@cache
def _threads() -> ThreadpoolController:
    """Return the handle of the BLAS libraries; finding them takes a millisecond, and they must be loaded."""
    importlib.import_module("scipy.optimize")
    return ThreadpoolController()
