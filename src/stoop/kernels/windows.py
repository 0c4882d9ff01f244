"""The time loop of windows: every lane is a trajectory from a sample of its own, in a record that all lanes share.

The hundreds of short windows of multiple shooting, with dozens of candidates each, fill the lanes of one call. Inputs
are read at the lane's own row of the record, so that no window needs a copy of them.

Axes: b = lane (candidate and window), k = sample of the window, i = state, input or output.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.kernels.arrays import fits, matrix
from stoop.kernels.lanes import indent, model_source, next_inputs

if TYPE_CHECKING:
    from stoop.kernels.emit import Emitted
    from stoop.kernels.kernel import Kernel

IntArray = NDArray[np.int64]
WIDTH = 8

SIGNATURES = {
    "run_windows": (
        "void(f8[:,::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1], i8[::1], f8, i8, f8[:,:,::1], f8[:,::1], i8, i8)"
    ),
}


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
    module = kernel.module("windows")

    def run(a: int, b: int) -> None:
        module.run_windows(p, x, u, begin, behind, many, float(dt), samples, out, last, a, b)

    kernel.share(run, count, None, WIDTH)
    return out, last


def _whole(name: str, values: IntArray, count: int) -> IntArray:
    if values.shape != (count,):
        raise ValueError(f"{name}: shape {values.shape} instead of {(count,)}")
    return np.require(values, dtype=np.int64, requirements=["C", "W"])


def windows_source(emitted: Emitted) -> str:
    """Write a whole module: the model's functions, the loop."""
    e = replace(emitted, groups=1)
    return model_source(e) + _loop(e)


def _loads(e: Emitted, first: int) -> str:
    return f"load_rows(S, {first * WIDTH}, {WIDTH}, {e.inputs}, j)"


def _loop(e: Emitted) -> str:
    results = e.states + e.constants
    now = results + e.outputs
    after, size = now + e.inputs, now + 2 * e.inputs
    gather = [f"store_rows(S, {now * WIDTH}, {WIDTH}, load_row(U, {e.inputs}, row), j)"]
    ahead = next_inputs(e, "U[row, {i}]", "U[next, {i}]")
    gather += [f"S[{(after + i) * WIDTH} + j] = {one}" for i, one in enumerate(ahead)]
    keep = [f"store_rows(S, {results * WIDTH}, {WIDTH}, y[{e.states}:], j)"]
    return f"""
@compiled
def run_windows(P, X0, U, first_row, end_row, steps, dt, samples, Y, X, first, last):
    S = nb.carray(scratch({size * WIDTH}), {size * WIDTH})
    hh = 0.5 * dt
    h6 = dt / 6.0
    for b0 in range(first, last, LANES):
        fill(S, P, X0, b0)
        for k in range(samples):
            for j in range(LANES):
                b = min(b0 + j, P.shape[1] - 1)
                row = min(first_row[b] + k, end_row[b] - 1)
                next = min(row + 1, end_row[b] - 1)
{indent(gather, 16)}            for j in range(min(LANES, last - b0)):
                if steps[b0 + j] == k:
                    for i in range({e.states}):
                        X[i, b0 + j] = S[i * LANES + j]
            for j in range({WIDTH}):
                x = load_state(S, j)
                c = load_constants(S, j)
                a = {_loads(e, now)}
                n = {_loads(e, after)}
                y = observe(x, a, c)
                moved = advance((x,), (y,), (c,), (middle(a, n),), (n,), hh, dt, h6)
                store_state(S, j, moved[0])
{indent(keep, 16)}            for j in range(min(LANES, last - b0)):
                for i in range({e.outputs}):
                    Y[b0 + j, k, i] = S[({results} + i) * LANES + j]
"""
