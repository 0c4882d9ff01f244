"""Memory of the process: freed arrays are kept for the next ones."""

from __future__ import annotations

import ctypes
import sys
from typing import Final

_TRIM_THRESHOLD: Final = (-1, 2**28)  #: parameter of mallopt, bytes
_MMAP_THRESHOLD: Final = (-3, 2**25)  #: the largest that glibc takes


def keep_freed_memory() -> None:
    """Let glibc keep what is freed, up to 256 MB, instead of returning it to the system.

    Fresh pages are cleared and mapped when they are first touched. For arrays of a few megabytes, made and freed again and
    again, that takes as long as what is done with them (`python -m benchmarks joint`). It is a matter of the whole process: the
    command line and its workers ask for it, `import stoop` does not. Other C libraries are left alone.
    """
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "mallopt"):
        libc.mallopt(*_TRIM_THRESHOLD)
        libc.mallopt(*_MMAP_THRESHOLD)
