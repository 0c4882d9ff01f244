"""The walk over a DataFlash log, compiled; bounds are checked there too."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit
from numba.extending import register_jitable

from stoop.logs.scan import dataflash as plain

for _part in (plain.mark, plain.find, plain.define, plain.gap):
    register_jitable(_part)


def _compile() -> Callable[..., Any]:
    try:
        return njit(cache=True, nogil=True, boundscheck=True)(plain.walk)
    except RuntimeError:  # no folder where compiled code could be kept
        return njit(nogil=True, boundscheck=True)(plain.walk)


walk = _compile()
