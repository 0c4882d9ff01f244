"""Formats that are read through libraries in C are read in a child process, with limits on memory and time.

A damaged file may make such code crash, loop forever or allocate all memory; then the child dies, and the caller gets a
`LogError`. The result comes back as arrays in .npy files and one JSON file in a temporary folder: nothing is unpickled.

The child is a new interpreter: ``python -m stoop.logs.guard FORMAT FOLDER``; the folder holds its task.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.extras import install
from stoop.errors import LogError, StoopError
from stoop.logs.formats import FORMATS, HDF5
from stoop.logs.recording import Defect, Recording, Stream, increasing, log_size, reason, unreadable

MAX_RESULT: Final = 2**32  #: bytes of all arrays of a result
TASK, RESULT = "task.json", "result.json"


@dataclass(frozen=True)
class Limits:
    """Limits of a child process."""

    memory: int = 4 * 2**30  #: bytes of address space (where the system can limit it)
    seconds: int = 9  #: of processor time
    wall: int = 120  #: seconds of elapsed time

    @classmethod
    def of(cls, path: Path) -> Limits:
        """Return the limits for a log, by its size."""
        megabytes = log_size(path) >> 20
        return cls(seconds=cls.seconds + 3 * megabytes, wall=cls.wall + 8 * megabytes)


def is_hdf5(path: Path) -> bool:
    """Return whether a file is HDF5; MATLAB writes 512 bytes of its own before the mark.

    Raises
    ------
    LogError
        When it cannot be read, or is empty.
    """
    try:
        with path.open("rb") as file:
            head = file.read(512 + len(HDF5))
    except OSError as error:
        raise unreadable(path, error) from None
    if not head:
        raise LogError(f"{path}: the file is empty; export it again")
    return head.startswith(HDF5) or head[512:] == HDF5


def read_guarded(known: str, path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a log of a format that needs a library, once the library is known to be there; see `read_in_child`."""
    form = FORMATS[known]
    if (not form.hdf5_only or is_hdf5(path)) and importlib.util.find_spec(form.package) is None:
        raise LogError(f"{path}: this {form.name} needs the package {form.package}; {install(form.extra)}")
    return read_in_child(known, path, topics)


def read_in_child(
    known: str, path: Path, topics: frozenset[str] | None = None, limits: Limits | None = None
) -> Recording:
    """Read a log in a child process.

    Parameters
    ----------
    known : key of `stoop.logs.formats.FORMATS`
    path, topics : see `stoop.logs.read`
    limits : of the child; None means those for the size of the log

    Raises
    ------
    LogError
        What the reader raises, and when the child dies, exceeds its time or returns an invalid result.
    """
    try:
        bounds = limits or Limits.of(path)
        with tempfile.TemporaryDirectory(prefix="stoop-", ignore_cleanup_errors=True) as name:
            folder = Path(name)
            task = {"path": str(path.absolute()), "name": str(path), "limits": asdict(bounds),
                    "topics": None if topics is None else sorted(topics)}  # fmt: skip
            (folder / TASK).write_text(json.dumps(task))
            run_child(known, path, folder, bounds)
            return read_result(path, folder)
    except OSError as error:
        raise LogError(f"{path}: cannot be read in a child process ({error}); free some disk space") from None


def run_child(known: str, path: Path, folder: Path, limits: Limits) -> None:
    """Run the task in a folder in a child process: this package, one thread, no plugins of file formats."""
    paths = os.pathsep.join([str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])])
    single = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "ARROW_DEFAULT_MEMORY_POOL": "system"}
    environment = {**os.environ, **single, "PYTHONPATH": paths, "HDF5_PLUGIN_PATH": "::"}
    command = [sys.executable, "-P", "-m", "stoop.logs.guard", known, str(folder)]
    try:
        done = subprocess.run(  # noqa: S603  our own interpreter, our own module
            command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, timeout=limits.wall, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise LogError(
            f"{path}: reading took more than {limits.wall} s and was stopped; cut the log, or export it as CSV"
        ) from None
    if not (folder / RESULT).is_file():
        how = f"signal {-done.returncode}" if done.returncode < 0 else f"code {done.returncode}"
        raise LogError(
            f"{path}: the reading process died ({how}): the file is damaged, or needs more than "
            f"{limits.memory >> 30} GiB of memory or {limits.seconds} s; copy it again, or export the flight of "
            "interest as CSV"
        )


def read_result(path: Path, folder: Path) -> Recording:
    """Read and check what a child wrote: a process that died half way may have written anything."""
    try:
        result = json.loads((folder / RESULT).read_text())
        if result["error"]:
            raise LogError(str(result["error"]))
        if sum(file.stat().st_size for file in folder.iterdir()) > MAX_RESULT:
            raise LogError(f"{path}: more than {MAX_RESULT >> 30} GiB of numbers; cut the log")
        streams = {}
        for i, (name, columns) in enumerate(result["streams"]):
            block = np.load(folder / f"{i}.npy", allow_pickle=False)
            if block.dtype != np.float64 or block.ndim != 2 or len(block) != len(columns) + 1:
                raise ValueError(f"{i}.npy does not have the stated size")
            if increasing(block[0]).size != block.shape[1]:
                raise ValueError(f"the time in {i}.npy runs back")
            streams[str(name)] = Stream(block[0], {str(c): block[k + 1] for k, c in enumerate(columns)})
        defects = tuple(Defect(*map(str, defect)) for defect in result["defects"])
        parts = {key: dict(result[key]) for key in ("attributes", "parameters", "info", "units")}
        unread = {str(name): tuple(map(str, columns)) for name, columns in result["unread"].items()}
        return Recording(path, str(result["format"]), streams, defects, **parts, unread=unread)
    except (ValueError, TypeError, LookupError, AttributeError, OSError, EOFError, MemoryError) as error:
        raise LogError(
            f"{path}: the reading process returned an invalid result ({reason(error)}); copy the log again"
        ) from None


def write_result(folder: Path, recording: Recording) -> None:
    """Write a recording; the JSON file comes last."""
    streams = []
    for i, (name, stream) in enumerate(recording.streams.items()):
        columns = list(stream.columns)
        shape = (len(columns) + 1, stream.time.size)
        # not mapped: a full disk is then an error, and no signal
        with (folder / f"{i}.npy").open("wb") as file:
            header = {"descr": "<f8", "fortran_order": False, "shape": shape}
            np.lib.format.write_array_header_1_0(file, header)
            for values in (stream.time, *(stream.columns[column] for column in columns)):
                file.write(np.ascontiguousarray(values, "<f8").data)
        streams.append((name, columns))
    _write_json(folder, {
        "error": "", "format": recording.format, "streams": streams,
        "defects": [(d.kind, d.place, d.message) for d in recording.defects],
        "attributes": dict(recording.attributes), "parameters": dict(recording.parameters),
        "info": dict(recording.info), "units": {k: dict(v) for k, v in recording.units.items()},
        "unread": dict(recording.unread),
    })  # fmt: skip


def _write_json(folder: Path, result: dict[str, Any]) -> None:
    part = folder / f"{RESULT}.part"  # the name is there only when the file is whole
    part.write_text(json.dumps(result))
    part.replace(folder / RESULT)


def run_task(known: str, folder: Path) -> None:
    """Run the task in a folder and write its result, or the error, there."""
    task = json.loads((folder / TASK).read_text())
    topics = None if task["topics"] is None else frozenset(task["topics"])
    try:
        write_result(folder, parse(known, Path(task["path"]), topics))
    except StoopError as error:
        _write_json(folder, {"error": str(error).replace(task["path"], task["name"])})
    except Exception as error:
        _write_json(folder, {"error": f"{task['name']}: cannot be read ({reason(error)}); copy it again"})


def parse(known: str, path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a log by its library in this process; see `read_in_child`.

    Raises
    ------
    LogError
        When it is damaged: libraries report this by exceptions of many types.
    """
    if known not in FORMATS:
        raise LogError(f"{path}: {known} is no format")
    form = FORMATS[known]
    try:
        return form.function()(path, topics)
    except LogError:
        raise
    except MemoryError:
        raise LogError(
            f"{path}: does not fit into memory; if it is small it is damaged: copy it again"
        ) from None
    except Exception as error:
        raise LogError(
            f"{path}: damaged {form.name} ({reason(error)}); copy it again, or export it as CSV"
        ) from None


def main(known: str, where: str) -> None:
    """Limit this process, the child, as far as the system can, and run the task."""
    folder = Path(where)
    limits = Limits(**json.loads((folder / TASK).read_text())["limits"])
    with contextlib.suppress(ImportError):  # not a POSIX system: the elapsed time alone is limited
        import resource

        bounds = {
            resource.RLIMIT_AS: limits.memory,
            resource.RLIMIT_CPU: limits.seconds,
            resource.RLIMIT_FSIZE: MAX_RESULT,
            resource.RLIMIT_CORE: 0,
        }
        for what, most in bounds.items():
            with contextlib.suppress(ValueError, OSError):
                resource.setrlimit(what, (most, most))
    run_task(known, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
