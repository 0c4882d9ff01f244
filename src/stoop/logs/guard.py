"""Readers that end in other people's C code run in a process of their own, with limits on memory and time.

A damaged file may make such code crash, go round in circles or ask for all memory; then a child dies, and the caller gets a
`LogError`. The result comes back as arrays in .npy files and one JSON file in a temporary folder: nothing is unpickled.

The child is a fresh interpreter: ``python -m stoop.logs.guard MODULE:FUNCTION FOLDER``; what it shall do stands in the folder.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.errors import LogError, StoopError
from stoop.logs.recording import Defect, Recording, Stream, bytes_of, increasing

ROOM: Final = "stoop.logs."  #: readers are called from here only
MAX_RESULT: Final = 2**32  #: bytes of all arrays that are taken back
TASK, _RESULT = "task.json", "result.json"


@dataclass(frozen=True)
class Limits:
    """What a child may take.

    Attributes
    ----------
    memory : bytes of address space (where the system can limit it)
    seconds : of processor time
    wall : seconds on the clock on the wall
    """

    memory: int = 4 * 2**30
    seconds: int = 30
    wall: int = 120

    @classmethod
    def of(cls, path: Path) -> Limits:
        """Return limits for a log: a short one that takes long goes round in circles."""
        megabytes = bytes_of(path) >> 20
        return cls(seconds=30 + 2 * megabytes, wall=120 + 8 * megabytes)


def need(path: Path, package: str, extra: str, what: str) -> None:
    """Say what to install where the package that reads a format is missing.

    Raises
    ------
    LogError
        When it is.
    """
    if importlib.util.find_spec(package) is None:
        raise LogError(
            f"{path}: {what} need the package {package}; install it with pip install 'stoop[{extra}]'"
        )


def guarded(
    reader: str, path: Path, topics: frozenset[str] | None = None, limits: Limits | None = None
) -> Recording:
    """Read a log in a child process.

    Parameters
    ----------
    reader : "module:function" of this package; called with path and topics, it returns a Recording
    path, topics : see `stoop.logs.read`
    limits : of the child; None means those for the size of the log

    Raises
    ------
    LogError
        What the reader raises, and when the child dies, runs too long or hands back nonsense.
    """
    try:
        bounds = limits or Limits.of(path)
        with tempfile.TemporaryDirectory(prefix="stoop-", ignore_cleanup_errors=True) as name:
            folder = Path(name)
            task = {"path": str(path.absolute()), "shown": str(path), "limits": asdict(bounds),
                    "topics": None if topics is None else sorted(topics)}  # fmt: skip
            (folder / TASK).write_text(json.dumps(task))
            launch(reader, path, folder, bounds)
            return _taken(path, folder)
    except OSError as error:
        raise LogError(f"{path}: cannot be read in a process of its own ({error}); free some space") from None


def launch(reader: str, path: Path, folder: Path, limits: Limits) -> None:
    """Let a child do the task in a folder."""
    command = [sys.executable, "-P", "-m", "stoop.logs.guard", reader, str(folder)]
    try:
        done = subprocess.run(  # noqa: S603  our own interpreter, our own module
            command, env=_environment(), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, timeout=limits.wall, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise LogError(
            f"{path}: reading took more than {limits.wall} s and was ended; cut the log, or export it as CSV"
        ) from None
    if not (folder / _RESULT).is_file():
        how = f"signal {-done.returncode}" if done.returncode < 0 else f"code {done.returncode}"
        raise LogError(
            f"{path}: its reader died ({how}): damaged, or too large for {limits.memory >> 30} GiB of memory and "
            f"{limits.seconds} s; copy it again, or export the flight of interest as CSV"
        )


def _environment() -> dict[str, str]:
    """Return the child's environment: this very package, one thread, no plugins of file formats."""
    here = str(Path(__file__).parents[2])
    paths = os.pathsep.join([here, *filter(None, [os.environ.get("PYTHONPATH")])])
    alone = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "ARROW_DEFAULT_MEMORY_POOL": "system"}
    return {**os.environ, **alone, "PYTHONPATH": paths, "HDF5_PLUGIN_PATH": "::"}


def _taken(path: Path, folder: Path) -> Recording:
    """Take back what a child left, and check it: what crashed half may have written anything."""
    try:
        result = json.loads((folder / _RESULT).read_text())
        if result["error"]:
            raise LogError(str(result["error"]))
        if sum(file.stat().st_size for file in folder.iterdir()) > MAX_RESULT:
            raise LogError(f"{path}: more than {MAX_RESULT >> 30} GiB of numbers; cut the log")
        streams = {
            str(name): _stream(folder / f"{i}.npy", columns)
            for i, (name, columns) in enumerate(result["streams"])
        }
        defects = tuple(Defect(*map(str, defect)) for defect in result["defects"])
        parts = {key: dict(result[key]) for key in ("attributes", "parameters", "info", "units")}
        unread = {str(name): tuple(map(str, columns)) for name, columns in result["unread"].items()}
        return Recording(path, str(result["format"]), streams, defects, **parts, unread=unread)
    except (ValueError, TypeError, LookupError, AttributeError, OSError, EOFError, MemoryError) as error:
        what = " ".join(str(error).split())[:120] or type(error).__name__
        raise LogError(f"{path}: its reader left nonsense ({what}); copy the log again") from None


def _stream(file: Path, columns: list[str]) -> Stream:
    block = np.load(file, allow_pickle=False)
    if block.dtype != np.float64 or block.ndim != 2 or len(block) != len(columns) + 1:
        raise ValueError(f"{file.name} is not of the size that was told")
    if increasing(block[0]).size != block.shape[1]:
        raise ValueError(f"the time in {file.name} runs back")
    return Stream(block[0], {str(name): block[i + 1] for i, name in enumerate(columns)})


def _limit(limits: Limits) -> None:
    """Limit this process; a system that cannot is left with the clock on the wall."""
    try:
        import resource
    except ImportError:  # not a POSIX system
        return
    bounds = {
        resource.RLIMIT_AS: limits.memory,
        resource.RLIMIT_CPU: limits.seconds,
        resource.RLIMIT_FSIZE: MAX_RESULT,
        resource.RLIMIT_CORE: 0,
    }
    for what, most in bounds.items():
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(what, (most, most))


def _leave(folder: Path, recording: Recording) -> None:
    """Write a recording; the JSON file comes last, under its name only when it is whole."""
    streams = []
    for i, (name, stream) in enumerate(recording.streams.items()):
        columns = list(stream.columns)
        shape = (len(columns) + 1, stream.time.size)
        block = np.lib.format.open_memmap(folder / f"{i}.npy", mode="w+", dtype=np.float64, shape=shape)
        block[0] = stream.time
        for k, column in enumerate(columns):
            block[k + 1] = stream.columns[column]
        block.flush()
        streams.append((name, columns))
    _write(folder, {
        "error": "", "format": recording.format, "streams": streams,
        "defects": [(d.kind, d.place, d.message) for d in recording.defects],
        "attributes": dict(recording.attributes), "parameters": dict(recording.parameters),
        "info": dict(recording.info), "units": {k: dict(v) for k, v in recording.units.items()},
        "unread": dict(recording.unread),
    })  # fmt: skip


def _write(folder: Path, result: dict[str, Any]) -> None:
    whole = folder / f"{_RESULT}.part"
    whole.write_text(json.dumps(result))
    whole.replace(folder / _RESULT)


def main(reader: str, where: str) -> None:
    """Read, in the child."""
    folder = Path(where)
    _limit(Limits(**json.loads((folder / TASK).read_text())["limits"]))
    answer(reader, folder)


def answer(reader: str, folder: Path) -> None:
    """Do the task in a folder; whatever comes of it is written there."""
    task = json.loads((folder / TASK).read_text())
    limits, shown = Limits(**task["limits"]), task["shown"]
    try:
        module, function = reader.split(":")
        if not module.startswith(ROOM):
            raise LogError(f"{shown}: {reader} is no reader")
        read: Callable[..., Recording] = getattr(importlib.import_module(module), function)
        topics = None if task["topics"] is None else frozenset(task["topics"])
        _leave(folder, read(Path(task["path"]), topics))
    except StoopError as error:
        _write(folder, {"error": str(error).replace(task["path"], shown)})
    except MemoryError:
        _write(
            folder, {"error": f"{shown}: needs more than {limits.memory >> 30} GiB of memory; cut the log"}
        )
    except Exception as error:
        what = " ".join(str(error).split())[:120] or type(error).__name__
        _write(folder, {"error": f"{shown}: damaged ({what}); copy it again, or export it as CSV"})


if __name__ == "__main__":
    main(*sys.argv[1:])
