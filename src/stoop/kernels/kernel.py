"""The compiled model: costs and trajectories of many candidates at once."""

from __future__ import annotations

import atexit
import functools
import hashlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np

from stoop.base import cache
from stoop.base.arrays import FloatArray
from stoop.kernels import compiler, loops, windows
from stoop.kernels import filter as filters
from stoop.kernels.arrays import fits, matrix
from stoop.kernels.fingerprint import equations_environment
from stoop.kernels.generated import build, import_source
from stoop.kernels.loops import Model
from stoop.kernels.symbolic import Sizes, SymbolicModel

#: functions that are compiled for every model
ENTRIES = {**loops.ENTRIES, **filters.ENTRIES, **windows.ENTRIES}
_OBJECT = "code.o"


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


# the child of a fork has the pool, but not its threads, and would wait for ever
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)


@dataclass(frozen=True)
class Kernel:
    """One vehicle structure, compiled.

    Axes: b = candidate, k = sample, i = state, input or output, in the order of the model.
    Every candidate (lane) has its own parameters and initial state. A candidate that diverges costs
    infinity and leaves the others bit-identical. Results do not depend on the number of threads.
    """

    folder: Path
    lanes: int  #: candidates of a block; a call with no more than half of them takes blocks of half the width
    sizes: tuple[int, int, int, int]  #: states, inputs, parameters, outputs
    model: Model
    #: of a name and a number of lanes; compiled when needed
    entries: Callable[[str, int], Callable[..., None]]
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
        out = self._summed("cost", parameters, initial, inputs, measured, weights, dt, samples, threads)
        return np.where(np.isfinite(out), out, np.inf)

    def products(
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
        """Return the sum (B,) of residuals times weights of each candidate; not finite where the trajectory diverged.

        A weight may have any sign. Parameters as in :meth:`cost`, inputs (n, n_u) that all candidates share. With the derivative
        of a sum of squares by the residuals as weights, finite differences of this sum are its gradient by the parameters.
        """
        fits("inputs", inputs, (*inputs.shape[:1], self.sizes[1]))
        return self._summed("products", parameters, initial, inputs, measured, weights, dt, samples, threads)

    def _summed(
        self,
        name: str,
        parameters: FloatArray,
        initial: FloatArray,
        inputs: FloatArray,
        measured: FloatArray,
        weights: FloatArray,
        dt: float,
        samples: int | None,
        threads: int | None,
    ) -> FloatArray:
        """Return the sum (B,) that an entry adds up along the trajectory of each candidate."""
        p, x, u, rows = self.arguments(parameters, initial, inputs)
        n = min(len(measured) if samples is None else samples, len(measured))
        fits("measured", measured, (len(measured), self.sizes[3]))
        fits("weights", weights, measured.shape)
        fits("inputs", inputs, (max(n, rows), *inputs.shape[1:]))
        seen = np.abs(weights) > 0.0
        if not seen.all():  # else no copies, which take as long as several trajectories
            measured, weights = np.where(seen, measured, 0.0), np.where(seen, weights, 0.0)
        z, w = matrix(measured), matrix(weights)
        out = np.empty(p.shape[1])
        count = p.shape[1]
        march = self.entry(name if inputs.ndim == 2 else f"{name}_per_lane", count)
        self.share(lambda a, b: march(p, x, u, rows, z, w, float(dt), n, out, a, b, count), count, threads)
        return out

    def trajectories(
        self,
        parameters: FloatArray,
        initial: FloatArray,
        inputs: FloatArray,
        dt: float,
        samples: int | None = None,
        threads: int | None = None,
        out: FloatArray | None = None,
    ) -> FloatArray:
        """Return the outputs (B, n, n_y) of each candidate; NaN or infinite once diverged.

        Parameters as in :meth:`cost`; `out` (B, n, n_y), contiguous, takes the result.
        """
        p, x, u, rows = self.arguments(parameters, initial, inputs)
        n = rows if samples is None else min(samples, rows)
        if out is None:
            out = np.empty((p.shape[1], n, self.sizes[3]))
        fits("out", out, (p.shape[1], n, self.sizes[3]))
        count = p.shape[1]
        march = self.entry("outputs" if inputs.ndim == 2 else "outputs_per_lane", count)
        self.share(lambda a, b: march(p, x, u, rows, float(dt), n, out, a, b, count), count, threads)
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
        self.entry("evaluate", count)(matrix(parameters), matrix(states), matrix(inputs), out, count)
        return out[:nx], out[nx:]

    def entry(self, name: str, count: int) -> Callable[..., None]:
        """Return a compiled function, one of `ENTRIES`, for so many candidates."""
        if name in filters.ENTRIES and not self.moves:
            raise ValueError("this model has no error state, so no filter takes it")
        return self.entries(name, self.width(count))

    def width(self, count: int) -> int:
        """Return how many lanes a block has in a call with so many candidates: results do not depend on it."""
        return self.lanes if 2 * count > self.lanes else self.lanes // 2

    def assembly(self, name: str = "cost", target: compiler.Target | None = None) -> str:
        """Return the machine code of an entry as text, to be searched for vector instructions.

        `target` is another processor than this one.
        """
        made_for = target or compiler.native()
        return made_for.assembly(ENTRIES[name].text(self.model, 2 * made_for.doubles()))

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
        n, lanes = len(inputs), self.width(count)
        blocks = -(-count // lanes)
        padding = np.repeat(inputs[..., -1:], blocks * lanes - count, axis=2)
        padded = np.concatenate([inputs, padding], axis=2).reshape(n, nu, blocks, lanes)
        return p, x, np.ascontiguousarray(padded.transpose(2, 0, 1, 3)).ravel(), n

    def share(self, run: Callable[[int, int], None], count: int, threads: int | None) -> None:
        """Share whole blocks among threads, the caller's among them."""
        lanes = self.width(count)
        blocks = -(-count // lanes)
        workers = max(1, min(threads or thread_count(), blocks))
        edges = [lanes * (blocks * i // workers) for i in range(workers)] + [count]
        others = [_pool(workers - 1).submit(run, *ends) for ends in pairwise(edges[1:])]
        run(0, edges[1])
        for other in others:
            other.result()

    def step(
        self, parameters: FloatArray, states: FloatArray, inputs: FloatArray, following: FloatArray, dt: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return states (n_x, B) one sample later, and outputs (n_y, B) now.

        Parameters, states and inputs are those of :meth:`Kernel.evaluate`; `following` (n_u, B) are inputs one sample, `dt`
        in s, later.
        """
        nx, nu, np_, ny = self.sizes
        count = parameters.shape[1]
        fits("parameters", parameters, (np_, count))
        fits("states", states, (nx, count))
        fits("inputs", inputs, (nu, count))
        fits("following", following, (nu, count))
        out = np.empty((nx + ny, count))
        arrays = [matrix(a) for a in (parameters, states, inputs, following)]
        self.entry("step", count)(*arrays, float(dt), out, count)
        return out[:nx], out[nx:]


@dataclass(frozen=True)
class _Loaded:
    """A model from the cache: its functions of arrays, its sizes and its equations."""

    folder: Path
    model: Model
    latex: tuple[str, ...]


_models: dict[str, _Loaded] = {}
_loaded: dict[str, Kernel] = {}


def _key(structure: str) -> str:
    """Return the name of what is compiled from a structure on this machine."""
    facts = [structure, *equations_environment().values()]
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()[:32]


def _model(key: str, model: Callable[[], SymbolicModel]) -> _Loaded:
    """Return the model of a key; SymPy is imported only where it is not in the cache."""
    if key in _models:
        return _models[key]

    def write(folder: Path) -> None:
        from stoop.kernels.emit import emit

        emitted = emit(model())
        (folder / "model.py").write_text(emitted.source)
        (folder / "sizes.txt").write_text(emitted.sizes.text())
        (folder / "equations.tex").write_text("\n".join(emitted.latex))

    folder = build(cache.cache_folder() / key, write)
    module = import_source(folder / "model.py", f"_stoop_model_{key}")
    latex = tuple((folder / "equations.tex").read_text().splitlines())
    _models[key] = _Loaded(folder, Model(Sizes.read((folder / "sizes.txt").read_text()), module), latex)
    return _models[key]


def array_functions(structure: str, model: Callable[[], SymbolicModel]) -> ModuleType:
    """Return `prepare` and `observe` of a model structure, which take arrays and are not compiled, as :func:`load_kernel`."""
    return _model(_key(structure), model).model.module


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
        No disk has room for what is compiled.
    """
    return _load(_key(structure), model)


def _load(key: str, model: Callable[[], SymbolicModel]) -> Kernel:
    if key not in _loaded:
        found, root, lanes = _model(key, model), cache.cache_folder(), compiler.lanes()
        sizes = found.model.sizes

        @functools.cache
        def entries(name: str, lanes: int) -> Callable[..., None]:
            return _entry(root / f"{key}-{name}-{lanes}", name, found.model, lanes)

        shape = sizes.states, sizes.inputs, sizes.parameters, sizes.outputs
        _loaded[key] = Kernel(found.folder, lanes, shape, found.model, entries, sizes.moves, found.latex)
    return _loaded[key]


def _entry(final: Path, name: str, model: Model, lanes: int) -> Callable[..., None]:
    """Return a compiled function of a model, from the cache where it is there."""
    entry = ENTRIES[name]

    def write(folder: Path) -> None:
        text = entry.text(model, lanes)
        (folder / _OBJECT).write_bytes(compiler.native().object_file(text))

    folder = build(final, write)
    return compiler.load((folder / _OBJECT).read_bytes(), entry.arguments)
