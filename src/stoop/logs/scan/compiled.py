"""The walk, compiled: the one place beside the kernels that imports Numba.

A flight of an hour holds twenty million messages; Python looks at half a million a second. Bounds are checked
in compiled code too: a mistake in the walk would be an IndexError, not a read elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit
from numba.extending import register_jitable

from stoop.logs.scan import walk as plain


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    try:
        return njit(cache=True, nogil=True, boundscheck=True)(function)
    except RuntimeError:  # no folder where compiled code could be kept
        return njit(nogil=True, boundscheck=True)(function)


for _part in (
    plain.named, plain.timely, plain.data_level, plain.sync_level, plain.key_level, plain.text_level, plain.short_level,
    plain.level, plain.chained, plain.seek, plain.follows, plain.invented, plain.judge, plain.note, plain.remark,
):  # fmt: skip
    register_jitable(_part)

walk = _compiled(plain.walk)
seek = _compiled(plain.seek)
gather = _compiled(plain.gather)
