"""The compiled model: costs and trajectories of many candidates at once."""

from __future__ import annotations

import atexit
import functools
import hashlib
import os
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.machinery import SourceFileLoader
from itertools import pairwise
from pathlib import Path
from types import CodeType, ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from stoop.base import cache
from stoop.base.arrays import FloatArray
from stoop.errors import KernelError
from stoop.kernels.arrays import fits, matrix
from stoop.kernels.fingerprint import environment
from stoop.kernels.lanes import LOOPS
from stoop.kernels.symbolic import SymbolicModel

if TYPE_CHECKING:
    from stoop.kernels.emit import Emitted


def thread_count() -> int:
    """Return how many threads share the blocks: ``STOOP_THREADS``, else the cores this process may use."""
    wanted = os.environ.get("STOOP_THREADS")
    if wanted and wanted.isdigit() and int(wanted) > 0:
        return int(wanted)
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    pool = ThreadPoolExecutor(threads, thread_name_prefix="stoop-lanes")
    atexit.register(pool.shutdown)
    return pool


if hasattr(
    os, "register_at_fork"
):  # the child of a fork has the pool, but not its threads, and would wait for ever
    os.register_at_fork(after_in_child=_pool.cache_clear)


@dataclass(frozen=True)
class Kernel:
    """One vehicle structure, compiled.

    Axes: b = candidate, k = sample, i = state, input or output, in the order of the model.
    Every candidate (lane) has its own parameters and initial state. A candidate that diverges costs
    infinity and leaves the others bit-identical. Results do not depend on the number of threads.
    """

    folder: Path
    lanes: int
    sizes: tuple[int, int, int, int]  #: states, inputs, parameters, outputs
    shared: ModuleType
    modules: Mapping[str, Callable[[], ModuleType]]  #: all others, compiled when needed
    moves: int = 0  #: components of the error state; zero where no filter takes the model
    latex: tuple[str, ...] = ()  #: the equations, one a line

    def cost(
        self,
        parameters: FloatArray,
        initial: FloatArray,
        inputs: FloatArray,
        measured: FloatArray,
        weights: FloatArray,
        dt: float,
        samples: int | None = None,
        threads: int | None = None,
    ) -> FloatArray:
        """Return the weighted sum of squared residuals of each candidate, eq. (3) with diagonal Q.

        Parameters
        ----------
        parameters : (n_p, B) array, SI
        initial : (n_x, B) array, SI
        inputs : (n, n_u) array, shared by all candidates, or (n, n_u, B) array
            Linear between samples; those that the model holds are steps.
        measured, weights : (n, n_y) arrays
            A weight of zero hides a sample; a NaN measurement must come with weight zero.
        dt : float, s
        samples : int, optional
            Only the first so many samples.
        threads : int, optional

        Returns
        -------
        (B,) array
            Infinite where the trajectory diverged.
        """
        p, x, u, rows = self.arguments(parameters, initial, inputs)
        n = min(len(measured) if samples is None else samples, len(measured))
        fits("measured", measured, (len(measured), self.sizes[3]))
        fits("weights", weights, measured.shape)
        fits("inputs", inputs, (max(n, rows), *inputs.shape[1:]))
        seen = weights > 0.0
        if not seen.all():  # else no copies, which take as long as several trajectories
            measured, weights = np.where(seen, measured, 0.0), np.where(seen, weights, 0.0)
        z, w = matrix(measured), matrix(weights)
        out = np.empty(p.shape[1])
        module = self.module("costs" if inputs.ndim == 2 else "costs_per_lane")
        self.share(
            lambda a, b: module.run_cost(p, x, u, rows, z, w, float(dt), n, out, a, b), p.shape[1], threads
        )
        return np.where(np.isfinite(out), out, np.inf)

    def trajectories(
        self,
        parameters: FloatArray,
        initial: FloatArray,
        inputs: FloatArray,
        dt: float,
        samples: int | None = None,
        threads: int | None = None,
    ) -> FloatArray:
        """Return the outputs (B, n, n_y) of each candidate; NaN or infinite once diverged.

        Parameters as in :meth:`cost`.
        """
        p, x, u, rows = self.arguments(parameters, initial, inputs)
        n = rows if samples is None else min(samples, rows)
        out = np.empty((p.shape[1], n, self.sizes[3]))
        module = self.shared if inputs.ndim == 2 else self.module("per_lane")
        self.share(
            lambda a, b: module.run_outputs(p, x, u, rows, float(dt), n, out, a, b), p.shape[1], threads
        )
        return out

    def evaluate(
        self, parameters: FloatArray, states: FloatArray, inputs: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return state derivatives (n_x, B) and outputs (n_y, B) at single points.

        Parameters, states and inputs are (n_p, B), (n_x, B) and (n_u, B).
        """
        nx, nu, np_, ny = self.sizes
        count = parameters.shape[1]
        fits("parameters", parameters, (np_, count))
        fits("states", states, (nx, count))
        fits("inputs", inputs, (nu, count))
        out = np.empty((nx + ny, count))
        self.shared.run_evaluate(matrix(parameters), matrix(states), matrix(inputs), out)
        return out[:nx], out[nx:]

    def module(self, name: str) -> ModuleType:
        """Return a further compiled module: one of `modules`."""
        if name in ("filtering", "steps") and not self.moves:
            raise ValueError("this model has no error state, so no filter takes it")
        return self.modules[name]()

    def assembly(self, entry: str = "run_cost", per_lane: bool = False) -> str:
        """Return the machine code of a time loop as text, to be searched for vector instructions.

        It is compiled once more, because Numba keeps no text of cached code. `entry` is run_cost or run_outputs; with
        `per_lane` each candidate has its own inputs.
        """
        import numba

        from stoop.kernels.lanes import SIGNATURES

        end = "per_lane" if per_lane else "shared"
        name = {"run_outputs": end, "run_cost": "costs_per_lane" if per_lane else "costs"}[entry]
        module = self.shared if name == "shared" else self.module(name)
        options = {"fastmath": module.FASTMATH, "error_model": "numpy", "nogil": True}
        again: Any = numba.njit(**options)(getattr(module, entry).py_func)
        again.compile(SIGNATURES[name][entry])
        return "\n".join(again.inspect_asm().values())

    def arguments(
        self, parameters: FloatArray, initial: FloatArray, inputs: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        """Return checked parameters, states and inputs as compiled code takes them, and rows of inputs."""
        nx, nu, np_, _ = self.sizes
        count = parameters.shape[-1]
        fits("parameters", parameters, (np_, count))
        fits("initial", initial, (nx, count))
        fits("inputs", inputs, (max(len(inputs), 1), nu, count)[: max(inputs.ndim, 2)])
        p, x = matrix(parameters), matrix(initial)
        if inputs.ndim == 2:
            return p, x, matrix(inputs), len(inputs)
        # One flat array [block, sample, input, lane]; the last block is padded.
        n, lanes = len(inputs), self.lanes
        blocks = -(-count // lanes)
        padding = np.repeat(inputs[..., -1:], blocks * lanes - count, axis=2)
        padded = np.concatenate([inputs, padding], axis=2).reshape(n, nu, blocks, lanes)
        return p, x, np.ascontiguousarray(padded.transpose(2, 0, 1, 3)).ravel(), n

    def share(
        self, run: Callable[[int, int], None], count: int, threads: int | None, lanes: int | None = None
    ) -> None:
        """Share whole blocks among threads, the caller's among them."""
        lanes = lanes or self.lanes
        blocks = -(-count // lanes)
        workers = max(1, min(threads or thread_count(), blocks))
        edges = [lanes * (blocks * i // workers) for i in range(workers)] + [count]
        others = [_pool(workers - 1).submit(run, *ends) for ends in pairwise(edges[1:])]
        run(0, edges[1])
        for other in others:
            other.result()


class _SourceLoader(SourceFileLoader):
    """Runs a source and leaves no byte code beside its file: the sealed folder must not change."""

    def __init__(self, name: str, path: str, source: str) -> None:
        super().__init__(name, path)
        self.source = source

    def get_code(self, fullname: str) -> CodeType:
        code: CodeType = self.source_to_code(self.source.encode(), self.get_filename(fullname))
        return code


def _model_functions(source: str, path: Path) -> dict[str, Any]:
    """Return the functions of a model, run once a process as a module of their own.

    Numba's files name the module in which an inlined function was defined, so it depends on the source alone.
    """
    name = f"_stoop_model_{hashlib.sha256(source.encode()).hexdigest()[:32]}"
    if name not in sys.modules:
        module = sys.modules[name] = ModuleType(name)
        _SourceLoader(name, str(path), source).exec_module(module)
    return {n: f for n, f in vars(sys.modules[name]).items() if not n.startswith("__")}


def import_generated(folder: Path, key: str, name: str) -> ModuleType:
    """Return the module ``name.py`` of a folder, imported under a name of its own, with Numba's files beside it.

    They lie beside the source even where the user sends them to another folder: no checksum would guard them there, and
    a damaged one ends the process. Modules of one model share its functions, so that Numba compiles these once.
    """
    from numba import config

    unique = f"_stoop_kernel_{key}_{name}"  # Numba's files hold this name: it may not depend on the folder
    path = folder / f"{name}.py"
    module = ModuleType(unique)
    module.__file__ = str(path)
    sys.modules[unique] = module
    source = path.read_text(encoding="utf-8")
    model, mark, loops = source.partition(LOOPS)
    wanted, config.CACHE_DIR = config.CACHE_DIR, ""
    try:
        if mark:
            vars(module).update(_model_functions(model, path))
            source = "\n" * (model + mark).count("\n") + loops  # Numba's files are named by lines
        _SourceLoader(unique, str(path), source).exec_module(module)
    finally:
        config.CACHE_DIR = wanted
    return module


def _open(folder: Path, key: str, name: str) -> ModuleType:
    """Import a generated module and compile its entry points, or take them from Numba's files beside it."""
    from stoop.kernels import filter as filters
    from stoop.kernels import windows
    from stoop.kernels.lanes import SIGNATURES

    entries = {
        **SIGNATURES, "filtering": filters.SIGNATURES, "steps": filters.STEP_SIGNATURES,
        "riccati": filters.RICCATI_SIGNATURES, "windows": windows.SIGNATURES, "arrays": {},
    }  # fmt: skip
    module = import_generated(folder, key, name)
    for entry, signature in entries[name].items():
        dispatcher = getattr(module, entry)
        dispatcher.compile(signature)
        dispatcher.disable_compile()
    return module


#: by key: the compiled modules and those that take arrays have the same functions
_emitted: dict[str, Emitted] = {}


def _emit(key: str, model: Callable[[], SymbolicModel]) -> Emitted:
    from stoop.kernels.emit import emit

    if key not in _emitted:
        _emitted[key] = emit(model())
    return _emitted[key]


def _write_sources(folder: Path, emitted: Emitted) -> None:
    from stoop.kernels.filter import filter_source, step_source
    from stoop.kernels.lanes import SIGNATURES, lanes, loop_source
    from stoop.kernels.windows import windows_source

    for name in SIGNATURES:
        (folder / f"{name}.py").write_text(loop_source(emitted, name))
    for name, source in (("filtering", filter_source), ("steps", step_source)):
        (folder / f"{name}.py").write_text(source(emitted) if emitted.moves else "# no filter\n")
    (folder / "windows.py").write_text(windows_source(emitted))
    sizes = (
        emitted.states, emitted.inputs, emitted.parameters, emitted.outputs, lanes(emitted), emitted.moves,
    )  # fmt: skip
    (folder / "sizes.txt").write_text(" ".join(map(str, sizes)))
    (folder / "equations.tex").write_text("\n".join(emitted.latex))


def _build(final: Path, key: str, name: str, write: Callable[[Path], None]) -> Path:
    """Make the sealed folder of one module unless it is there; return where it lies."""

    def make(building: Path) -> None:
        write(building)
        _open(building, key, name)

    try:
        return cache.provide(final, make)
    except OSError as error:
        raise KernelError(
            f"kernel cache: no room to keep compiled equations ({error.strerror or error}); "
            "free disk space, or set STOOP_CACHE_DIR or TMPDIR to a folder on another disk"
        ) from error


def load_kernel(structure: str, model: Callable[[], SymbolicModel]) -> Kernel:
    """Return the compiled kernel of a model structure, from the cache where it is there.

    Parameters
    ----------
    structure : str
        Everything that decides the equations, and no parameter value: the same text, the same kernel.
    model : callable
        Builds the equations; called only when the cache has no sound copy.

    Raises
    ------
    KernelError
        Numba is told not to compile, or no disk has room for what it compiles.
    """
    return _load(_key(structure), model)


def _key(structure: str) -> str:
    """Return the name of what is compiled from a structure on this machine; refuse where nothing is."""
    from numba import config

    if config.DISABLE_JIT:
        raise KernelError(
            "NUMBA_DISABLE_JIT: set, so the equations cannot be compiled, and uncompiled they do not run; "
            "unset it (or take disable_jit out of .numba_config.yaml)"
        )
    return hashlib.sha256("\n".join([structure, *environment().values()]).encode()).hexdigest()[:32]


@functools.cache
def riccati_module() -> ModuleType:
    """Return the compiled covariance recursion of a filter; one serves every model."""
    from stoop.kernels.filter import riccati_source

    key = _key("riccati")

    def write(folder: Path) -> None:
        (folder / "riccati.py").write_text(riccati_source())

    return _open(_build(cache.cache_folder() / f"{key}-riccati", key, "riccati", write), key, "riccati")


_arrays: dict[str, ModuleType] = {}


def array_functions(structure: str, model: Callable[[], SymbolicModel]) -> ModuleType:
    """Return `prepare` and `observe` of a model structure, which take arrays and are not compiled, as :func:`load_kernel`."""
    from stoop.kernels.lanes import ARRAYS

    key = _key(structure)
    if key in _arrays:
        return _arrays[key]

    def write(folder: Path) -> None:
        (folder / "arrays.py").write_text(ARRAYS + _emit(key, model).source)

    folder = _build(cache.cache_folder() / f"{key}-arrays", key, "arrays", write)
    _arrays[key] = _open(folder, key, "arrays")
    return _arrays[key]


_loaded: dict[str, Kernel] = {}


def _later(folder: Path, final: Path, key: str, name: str) -> Callable[[], ModuleType]:
    """Return what compiles a module of the folder when it is needed; the folder may be gone by then."""
    source = (folder / f"{name}.py").read_text()

    def write(target: Path) -> None:
        (target / f"{name}.py").write_text(source)

    return functools.cache(lambda: _open(_build(final, key, name, write), key, name))


def _load(key: str, model: Callable[[], SymbolicModel]) -> Kernel:
    if key in _loaded:
        return _loaded[key]
    root = cache.cache_folder()
    folder = _build(root / key, key, "shared", lambda f: _write_sources(f, _emit(key, model)))
    nx, nu, np_, ny, lanes, moves = (int(v) for v in (folder / "sizes.txt").read_text().split())
    suffixes = {
        "per_lane": "lanes", "costs": "costs", "costs_per_lane": "lane-costs", "filtering": "filter", "steps": "steps",
        "windows": "windows",
    }  # fmt: skip
    later = {name: _later(folder, root / f"{key}-{end}", key, name) for name, end in suffixes.items()}
    shared = _open(folder, key, "shared")
    latex = tuple((folder / "equations.tex").read_text().splitlines())
    _loaded[key] = Kernel(folder, lanes, (nx, nu, np_, ny), shared, later, moves, latex)
    return _loaded[key]
