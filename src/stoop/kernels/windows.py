"""The time loop of windows: every lane is a trajectory from a sample of its own, in a record that all lanes share.

The hundreds of short windows of multiple shooting, with dozens of candidates each, fill the lanes of one call. Inputs
are read at the lane's own row of the record, so that no window needs a copy of them.

Axes: b = lane (candidate and window), k = sample of the window, i = state, input or output.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.kernels.arrays import fits, matrix
from stoop.kernels.instructions import Function, Rows
from stoop.kernels.loops import BLOCKS, Block, Entry, Model, candidate, following, keep_sample, pointers

if TYPE_CHECKING:
    from stoop.kernels.kernel import Kernel

IntArray = NDArray[np.int64]


def windows(
    kernel: Kernel,
    parameters: FloatArray,
    initial: FloatArray,
    record: FloatArray,
    first: IntArray,
    end: IntArray,
    steps: IntArray,
    dt: float,
) -> tuple[FloatArray, FloatArray]:
    """Return readings (B, n, n_y) along each window, n = the most steps + 1, and states (n_x, B) after its steps.

    Parameters
    ----------
    parameters, initial : (n_p, B), (n_x, B)
    record : (rows, n_u) array
        Inputs, linear between rows (those that the model holds are steps); several records may stand one below the other.
    first, end : (B,) array of int
        The row at which a window begins, and the one behind its record; the last row holds from there on.
    steps : (B,) array of int
        After how many steps the state is wanted.
    dt : float, s
    """
    nx, nu, np_, ny = kernel.sizes
    count = parameters.shape[1]
    fits("parameters", parameters, (np_, count))
    fits("initial", initial, (nx, count))
    fits("record", record, (len(record), nu))
    begin, behind, many = (_whole(n, a, count) for n, a in (("first", first), ("end", end), ("steps", steps)))
    if count and not (begin.min() >= 0 and (begin < behind).all() and behind.max() <= len(record)):
        raise ValueError("first, end: rows that the record does not have")
    samples = 1 + max(0, int(many.max(initial=0)))
    p, x, u = matrix(parameters), matrix(initial), matrix(record)
    out, last = np.empty((count, samples, ny)), np.full((nx, count), np.nan)
    march = kernel.entry("windows", count)

    def run(a: int, b: int) -> None:
        march(p, x, u, begin, behind, many, float(dt), samples, out, last, a, b, count)

    kernel.share(run, count, None)
    return out, last


def _whole(name: str, values: IntArray, count: int) -> IntArray:
    if values.shape != (count,):
        raise ValueError(f"{name}: shape {values.shape} instead of {(count,)}")
    return np.require(values, dtype=np.int64, requirements=["C", "W"])


def _windows(code: Function, model: Model) -> None:
    sizes = model.sizes
    block, now, end = Block(code, model), code.rows(sizes.inputs), code.rows(sizes.inputs)
    kept = code.rows(sizes.outputs)
    with code.loop("%first", "%last", code.lanes) as first:
        _load_inputs(code, now, end, sizes.held, first, "0")
        block.begin(first, list(now))
        with code.loop(0, "%samples") as k:
            _load_inputs(code, now, end, sizes.held, first, k)
            block.follow(list(now), list(end))
            _keep_last(code, block.state, first, k)
            derivatives, outputs = block.observe()
            kept.fill(outputs)
            block.advance(derivatives)
            keep_sample(code, kept, "%Y", first, k)


def _load_inputs(code: Function, now: Rows, end: Rows, held: tuple[int, ...], first: str, k: str) -> None:
    """Write the load of each lane's inputs at a sample and at the end of its step."""
    with code.loop(0, code.lanes) as lane:
        b = candidate(code, first, lane)
        behind = code.load("%behind", b, "i64")
        here = code.integer("add", code.load("%begin", b, "i64"), k)
        row = code.least(here, code.integer("sub", behind, 1))
        then = following(code, row, behind)
        for i in range(now.count):
            for rows, at in ((now, row), (end, row if i in held else then)):
                place = code.integer("add", code.integer("mul", at, now.count), i)
                code.store(code.load("%U", place), rows.name, rows.place(i, lane))


def _keep_last(code: Function, state: Rows, first: str, k: str) -> None:
    """Write the copy of the states of those lanes that have taken their steps."""
    with code.loop(0, code.least(code.lanes, code.integer("sub", "%last", first))) as lane:
        b = code.integer("add", first, lane)
        with code.when("eq", code.load("%steps", b, "i64"), k), code.loop(0, state.count) as i:
            place = code.integer("add", code.integer("mul", i, "%count"), b)
            code.store(code.load(state.name, state.place(i, lane)), "%X", place)


_RECORDS = f"{pointers('P X0 U begin behind steps')}, double %dt, i64 %samples, {pointers('Y X')}, {BLOCKS}"
ENTRIES = {"windows": Entry(_RECORDS, _windows)}
