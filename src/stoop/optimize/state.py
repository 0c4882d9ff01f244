"""The state that every optimizer shares, its random numbers, what a step reports, and states on disk.

In a file arrays lie in an .npz, everything else in a JSON header beside them; no pickle. Only classes of states that are
registered are ever built from a file, and from their fields alone.
"""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Final, Literal, Protocol, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.files import write_file
from stoop.base.npz import read_arrays
from stoop.base.packages import resolved
from stoop.base.toml import is_of_type, parse_json
from stoop.errors import IdentificationError
from stoop.optimize.ledger import Evaluations
from stoop.optimize.problem import Problem


@dataclass(frozen=True)
class RandomStream:
    """State of a stream of random numbers as a value (the fields of NumPy's PCG64)."""

    state: int
    inc: int
    has_uint32: int
    uinteger: int

    @classmethod
    def of(cls, generator: np.random.Generator) -> RandomStream:
        """Return the state of a generator."""
        state = generator.bit_generator.state
        return cls(state["state"]["state"], state["state"]["inc"], state["has_uint32"], state["uinteger"])

    @classmethod
    def from_seed(cls, seed: int) -> RandomStream:
        """Return the start of the stream of a seed."""
        return cls.of(np.random.Generator(np.random.PCG64(seed)))

    def generator(self) -> np.random.Generator:
        """Return a generator that continues from here; this value does not change."""
        bits = np.random.PCG64(0)
        bits.state = {
            "bit_generator": "PCG64",
            "state": {"state": self.state, "inc": self.inc},
            "has_uint32": self.has_uint32,
            "uinteger": self.uinteger,
        }
        return np.random.Generator(bits)


@dataclass(frozen=True, kw_only=True)
class State:
    """Everything a run needs to continue bit-identically; optimizers add their own fields."""

    optimizer: str  #: registered name
    generation: int  #: steps taken
    stream: RandomStream
    evaluations: Evaluations
    #: an optimum was found and confirmed (see the optimizer's docstring for what confirms it)
    converged: bool = False


@dataclass(frozen=True)
class Event:
    """What one step did, for the progress display; nothing depends on it."""

    kind: Literal["evolution", "scouts", "refinement"]
    cost: float  #: best of this step, on the rung it worked on
    rung: int
    text: str = ""


S = TypeVar("S", bound=State)


class Optimizer(Protocol[S]):
    """A search: its initial state, and one step."""

    @property
    def name(self) -> str:
        """Registered name."""

    def init(self, problem: Problem, seed: int, starts: FloatArray) -> S:
        """Return the state before the first step.

        Starts are the user's own guesses, (k, D), or (k, D + E) with nuisances; k may be 0. Optimizers that keep the
        nuisances at zero ignore those of the guesses.
        """

    def step(self, state: S, problem: Problem) -> tuple[S, Event]:
        """Do one generation (evolution, scouting round or local refinement); the same state gives the same result."""


SCHEMA: Final = "stoop-state/1"
HEADER: Final = "header"
MAX_BYTES: Final = 2**28  #: to which a saved state may unfold
CLASSES: Final = {
    "PsGdeLmState": "stoop.optimize.ps_gde_lm",
    "LibraryState": "stoop.optimize.libraries",
    "Evaluations": "stoop.optimize.ledger",
    "RandomStream": "stoop.optimize.state",
    "Optima": "stoop.optimize.ladder",
    "Population": "stoop.optimize.population",
    "ParameterMemory": "stoop.optimize.population",
    "StagesState": "stoop.optimize.levenberg_marquardt",
}  #: class -> module, of the optimizers of this package; `registry.Entry` names those of others
FORMER_CLASSES: Final = {
    "PreyState": "PsGdeLmState",
    "Books": "Evaluations",
    "Stream": "RandomStream",
    "Ends": "Optima",
    "Herd": "Population",
    "Memory": "ParameterMemory",
    "HerdState": "OrderedShadeState",
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


def save_state(path: Path, state: State, tag: str = "") -> None:
    """Write a state, atomically: a killed run leaves the previous state or the new one.

    The tag is kept in the same file: what the state belongs to.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    header = json.dumps({"schema": SCHEMA, "tag": tag, "state": _encode(state, arrays)})
    arrays[HEADER] = np.frombuffer(header.encode(), dtype=np.uint8)
    write: Callable[..., None] = np.savez
    write(content := io.BytesIO(), **arrays)
    write_file(path, content.getvalue())


def load_tagged(path: Path) -> tuple[State, str]:
    """Read a state and its tag.

    Raises
    ------
    IdentificationError
        If the file is missing, damaged or of another version.
    """
    try:
        with path.open("rb") as file:
            arrays = read_arrays(file, MAX_BYTES)
        header = parse_json(arrays[HEADER].tobytes())
        if header["schema"] != SCHEMA:
            raise ValueError(f"schema {header['schema']}, not {SCHEMA}")
        state, tag = _decode(header["state"], arrays), str(header.get("tag", ""))
    except FileNotFoundError:
        raise IdentificationError(f"{path}: there is no saved state; start anew without resuming") from None
    except (
        OSError, ValueError, LookupError, TypeError, EOFError, RuntimeError, AttributeError, OverflowError,
        struct.error, zlib.error, zipfile.BadZipFile,
    ) as error:  # what a damaged file may raise  # fmt: skip
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise IdentificationError(f"{path}: not a usable state ({what}); delete it and start anew") from None
    if not isinstance(state, State):
        raise IdentificationError(f"{path}: holds no state; delete it and start anew")
    return state, tag


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
    """Return what `_encode` was given, of this release or an earlier one."""
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[value["array"]]
    name: str = value["class"]
    name = FORMER_CLASSES.get(name, name)
    module = CLASSES.get(name)
    if module is None:
        from stoop.optimize.registry import state_classes

        module = state_classes()[name]
    kind = resolved(f"{module}:{name}")
    names = {old: new for old, new in FORMER_FIELDS.items() if old not in {f.name for f in fields(kind)}}
    content = {names.get(old, old): _decode(item, arrays) for old, item in value["fields"].items()}
    hints = get_type_hints(kind)
    return kind(**{field: _checked(hints[field], item, f"{name}.{field}") for field, item in content.items()})


def _checked(kind: Any, value: Any, place: str) -> Any:
    """Return the value of a field; raise TypeError where it is not what the class says: the file may come from anywhere."""
    for one in get_args(kind) if isinstance(kind, UnionType) else (kind,):
        if one is Any:
            return value
        if get_origin(one) is np.ndarray:
            if isinstance(value, np.ndarray) and value.dtype.type in get_args(get_args(one)[-1]):
                return value
        elif is_of_type(value, one):
            return float(value) if one is float else value
    raise TypeError(f"{place} is no {getattr(kind, '__name__', kind)}")
