"""The walks over binary logs, compiled: a flight of an hour holds twenty million messages, Python does half a million a second.

Compiled code is cached as that of kernels (`stoop.base.cache`): in a folder of its own with checksums, so that a damaged
file is compiled anew and never run. Bounds are checked in compiled code too: a mistake in a walk would be an IndexError,
not a read elsewhere.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Final

from stoop.base import cache
from stoop.kernels import environment
from stoop.kernels.generated import import_generated
from stoop.logs import blackbox_walk, dataflash_walk, ulog_walk

_BYTES, _READ, _WIDE, _NARROW = (
    "uint8[::1]", "Array(uint8, 1, 'C', readonly=True)", "int64[::1]", "int32[::1]",
)  # fmt: skip
_TOPICS: Final = f"{_NARROW}, {_NARROW}"
_ULOG: Final = {
    "walk": f"({_BYTES}, int64, int64, boolean, int64, {_BYTES}, {_TOPICS}, {_NARROW}, {_WIDE}, {_NARROW}, int64, {_WIDE})",
    "seek": f"({_BYTES}, int64, int64, int64, {_TOPICS})",
    "gather": f"({_BYTES}, {_WIDE}, {_NARROW}, int64, {_WIDE}, {_WIDE}, {_BYTES})",
}  #: entry -> its arguments
_DATAFLASH: Final = {
    "walk": f"(int64, int64, {_READ}, {_WIDE}, {_WIDE}, uint8[:, ::1], {_WIDE}, {_WIDE}, int64[:, ::1], {_WIDE}, {_WIDE}, "
    f"{_WIDE}, {_BYTES})"
}
_TABLE: Final = "int64[:, ::1]"
_BLACKBOX: Final = {
    "walk": f"(int64, {_READ}, int64[:, :, ::1], {_WIDE}, {_WIDE}, {_TABLE}, {_WIDE}, {_READ}, {_TABLE}, {_WIDE}, "
    "int64[:, :, ::1])"
}
_CALLED: Final = {
    "ulog": (
        "is_name", "is_time", "data_level", "sync_level", "key_level", "level", "is_chain", "seek", "classify", "count",
    ),
    "dataflash": ("is_mark", "find", "define", "add_gap"),
    "blackbox": (
        "extended", "unsigned", "signed_vb", "little", "wrapped", "three", "four", "skipped", "predicted", "read_group",
        "decode", "follows", "unrolled", "accept", "kind_of", "event", "skip", "keep",
    ),
}  #: functions that the entries call  # fmt: skip
_FOOT: Final = """

from numba import njit
from numba.extending import register_jitable

for _called in ({called},):
    register_jitable(_called)
compiled = {{f.__name__: njit(cache=True, nogil=True, boundscheck=True)(f) for f in ({entries},)}}
"""


@functools.cache
def ulog() -> Any:
    """Return what has `walk`, `seek` and `gather` of `stoop.logs.ulog_walk`, compiled."""
    return _compiled("ulog", ulog_walk, _ULOG)


@functools.cache
def dataflash() -> Any:
    """Return what has `walk` of `stoop.logs.dataflash_walk`, compiled."""
    return _compiled("dataflash", dataflash_walk, _DATAFLASH)


@functools.cache
def blackbox() -> Any:
    """Return what has `walk` of `stoop.logs.blackbox_walk`, compiled."""
    return _compiled("blackbox", blackbox_walk, _BLACKBOX)


def _compiled(name: str, plain: ModuleType, entries: Mapping[str, str]) -> Any:
    """Return the compiled functions: cached and sound, or built anew; the plain ones where nothing may be compiled or written."""
    from numba import config

    if config.DISABLE_JIT:
        return plain
    source = Path(str(plain.__file__)).read_text(encoding="utf-8")
    source += _FOOT.format(called=", ".join(_CALLED[name]), entries=", ".join(entries))
    key = hashlib.sha256("\n".join([source, *environment().values()]).encode()).hexdigest()[:32]

    def functions(folder: Path) -> dict[str, Any]:
        found: dict[str, Any] = import_generated(folder, key, name).compiled
        for entry, signature in entries.items():
            found[entry].compile(signature)
            found[entry].disable_compile()
        return found

    def make(folder: Path) -> None:
        (folder / f"{name}.py").write_text(source, encoding="utf-8")
        functions(folder)

    try:
        folder = cache.provide(cache.cache_folder() / f"{key}-{name}", make)
    except OSError:  # full disks
        return plain
    return SimpleNamespace(**functions(folder))
