"""States on disk: arrays in an .npz, everything else in a JSON header beside them; no pickle, ever.

Only the classes named here are ever built from a file, and from their fields alone. A file is written to a
temporary name and renamed, so that a killed run leaves the previous state or the new one, never half of one.
"""

from __future__ import annotations

import json
import os
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.errors import IdentificationError, OutputError
from stoop.optimize.adaptation import ParameterMemory
from stoop.optimize.ladder import Optima
from stoop.optimize.ledger import Evaluations
from stoop.optimize.libraries import LibraryState
from stoop.optimize.population import Population
from stoop.optimize.ps_gde_lm import PsGdeLmState
from stoop.optimize.state import RandomStream, State

SCHEMA: Final = "stoop-state/1"
HEADER: Final = "header"
BROKEN: Final = (
    OSError,
    ValueError,
    LookupError,
    TypeError,
    EOFError,
    RuntimeError,
    AttributeError,
    OverflowError,
    struct.error,
    zlib.error,
    zipfile.BadZipFile,
)  #: what a damaged file may raise
CLASSES: Final[dict[str, type]] = {
    c.__name__: c
    for c in (PsGdeLmState, LibraryState, Evaluations, RandomStream, Optima, Population, ParameterMemory)
}  #: of the optimizers of this package
FORMER_CLASSES: Final[dict[str, type]] = {
    "PreyState": PsGdeLmState,
    "Books": Evaluations,
    "Stream": RandomStream,
    "Ends": Optima,
    "Herd": Population,
    "Memory": ParameterMemory,
}  #: names up to release 0.1: files that have them still load
FORMER_FIELDS: Final = {
    "books": "evaluations",
    "gone_on": "resumed",
    "shelved": "deferred",
    "seen": "least",
    "ends": "optima",
    "herd": "population",
    "herd_size": "population_size",
    "size": "population_size",
    "dived": "refined",
}  #: likewise, of the fields that a class no longer has
GROUP: Final = "stoop.optimizer_states"  #: entry points of other packages' state classes, by class name


def _state_class(name: str) -> type:
    """Return the class of a name, of this package or registered by another; no other is ever built."""
    if name not in CLASSES and name not in FORMER_CLASSES:
        for point in entry_points(group=GROUP):
            if point.name == name:
                CLASSES[name] = point.load()
    return FORMER_CLASSES[name] if name in FORMER_CLASSES else CLASSES[name]


def save_state(path: Path, state: State, tag: str = "") -> None:
    """Write a state, atomically.

    Parameters
    ----------
    path : Path
    state : State
    tag : str
        Kept in the same file: what the state belongs to.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    header = json.dumps({"schema": SCHEMA, "tag": tag, "state": _encode(state, arrays)})
    arrays[HEADER] = np.frombuffer(header.encode(), dtype=np.uint8)
    write: Callable[..., None] = np.savez
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as file:
                write(file, **arrays)
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(
            f"{path}: the state cannot be written ({error}); free the folder or choose another"
        ) from None


def load_state(path: Path) -> State:
    """Read a state; its tag is not looked at.

    Raises
    ------
    IdentificationError
        If the file is missing, damaged or of another version.
    """
    return load_tagged(path)[0]


def load_tagged(path: Path) -> tuple[State, str]:
    """Read a state and its tag.

    Raises
    ------
    IdentificationError
        If the file is missing, damaged or of another version.
    """
    try:
        state, tag = _read(path)
    except FileNotFoundError:
        raise IdentificationError(f"{path}: there is no saved state; start anew without resuming") from None
    except BROKEN as error:
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise IdentificationError(f"{path}: not a usable state ({what}); delete it and start anew") from None
    if not isinstance(state, State):
        raise IdentificationError(f"{path}: holds no state; delete it and start anew")
    return state, tag


def _read(path: Path) -> tuple[Any, str]:
    """Return what a file holds, and its tag."""
    # opened here: np.load leaves a damaged file open
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(arrays[HEADER].tobytes())
    if header["schema"] != SCHEMA:
        raise ValueError(f"schema {header['schema']}, not {SCHEMA}")
    return _decode(header["state"], arrays), str(header.get("tag", ""))


def _encode(value: Any, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    """Return what JSON can hold; arrays are put aside under a number."""
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        arrays[f"a{len(arrays)}"] = value
        return {"array": f"a{len(arrays) - 1}"}
    if is_dataclass(value):
        content = {f.name: _encode(getattr(value, f.name), arrays) for f in fields(value)}
        return {"class": type(value).__name__, "fields": content}
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"a state cannot hold {type(value).__name__}")


def _decode(value: Any, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    """Return what `_encode` was given."""
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[value["array"]]
    kind = _state_class(value["class"])
    known = {f.name for f in fields(kind)}
    content = {
        name if name in known else FORMER_FIELDS.get(name, name): _decode(item, arrays)
        for name, item in value["fields"].items()
    }
    return kind(**content)
