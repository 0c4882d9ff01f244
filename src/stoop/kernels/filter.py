"""The time loop of a filter: at every sample the state is corrected by a gain times the innovation.

As in :mod:`stoop.kernels.lanes`, candidates lie side by side in lanes and all that the lane loop touches lies in one
scratch array; a candidate has its own gain. There is one group of lanes. The model defines how the error state corrects
the state, :attr:`SymbolicModel.moved`: a quaternion by a rotation, anything else by addition.

Axes: b = candidate, k = sample, i = innovation, e = component of the error state, g = gain, r = point of linearization.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.kernels.lanes import input_tuples, model_source, next_inputs, straight_line

if TYPE_CHECKING:
    from stoop.kernels.emit import Emitted

WIDTH = 8

SIGNATURES = {
    "run_filter": (
        "void(f8[:,::1], f8[:,::1], f8[:,:,::1], i8[::1], f8[:,::1], i8, f8[:,::1], f8[:,::1], f8, i8, "
        "f8[:,:,::1], f8[:,:,::1], i8, i8, i8)"
    ),
}
STEP_SIGNATURES = {
    "run_step": "void(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8, f8[:,::1])",
    "run_move": "void(f8[:,::1], f8[:,::1], f8[:,::1])",
}
RICCATI_SIGNATURES = {
    "run_riccati": (
        "void(f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[::1], f8[:,::1], i8[::1], f8[:,::1], "
        "f8[:,:,::1], f8[:,:,::1])"
    ),
}


def filter_source(emitted: Emitted) -> str:
    """Write the module of the time loop: the model's functions, the loop."""
    e = replace(emitted, groups=1)
    return model_source(e) + _helpers(e) + _loop(e)


def step_source(emitted: Emitted) -> str:
    """Write the module of single steps and moves of a state, for which no lanes are needed."""
    e = replace(emitted, groups=1)
    return model_source(e) + _steps(e)


def riccati_source() -> str:
    """Write the module of the covariance recursion, which is the same for every model."""
    here = Path(__file__).parent
    recursion = (here / "recursion.py").read_text().split("# Copied from here.\n")[1]
    return "\n\n".join([(here / "runtime.py").read_text(), recursion])


def _rows(e: Emitted) -> tuple[int, int, int]:
    """Return where innovations and gains begin in the scratch array, and its size, in rows."""
    first = e.states + e.constants
    return first, first + e.outputs, first + e.outputs + e.moves * e.outputs


def _helpers(e: Emitted) -> str:
    """Write innovations and moves of one lane."""
    _, gains, _ = _rows(e)
    ahead = [f"z[{i}] - y[{e.states + i}]" for i in range(e.outputs)]
    innovations = [
        f"m[{i}] * {f'wrap({a})' if w else f'({a})'}"
        for i, (a, w) in enumerate(zip(ahead, e.wrapped, strict=True))
    ]
    moves = [" + ".join(f"g[{m * e.outputs + i}] * v[{i}]" for i in range(e.outputs)) for m in range(e.moves)]
    return f"""
{straight_line("innovate", "y, z, m", (), innovations)}

{straight_line("weigh", "g, v", (), moves)}

@inline
def gained(S, j, v):
    return weigh(load_rows(S, {gains * WIDTH}, {WIDTH}, {e.moves * e.outputs}, j), v)
"""


def _loop(e: Emitted) -> str:
    innovations, gains, size = _rows(e)
    many = e.moves * e.outputs
    inputs = input_tuples(e)
    return f"""
@compiled
def run_filter(P, X0, K, G, U, rows, Z, M, dt, samples, V, X, states, first, last):
    S = nb.carray(scratch({size * WIDTH}), {size * WIDTH})
    hh = 0.5 * dt
    h6 = dt / 6.0
    for b0 in range(first, last, LANES):
        fill(S, P, X0, b0)
        shown = -1
        for k in range(samples):
            if G[k] != shown:
                shown = G[k]
                for i in range({many}):
                    for j in range(LANES):
                        S[({gains} + i) * LANES + j] = K[shown, i, min(b0 + j, P.shape[1] - 1)]
{inputs}            z = load_row(Z, {e.outputs}, k)
            m = load_row(M, {e.outputs}, k)
            if states:
                for j in range(min(LANES, last - b0)):
                    for i in range({e.states}):
                        X[b0 + j, k, i] = S[i * LANES + j]
            for j in range({WIDTH}):
                x = load_state(S, j)
                c = load_constants(S, j)
                v = innovate(observe(x, ua[0], c), z, m)
                store_rows(S, {innovations * WIDTH}, {WIDTH}, v, j)
                x = correct(x, gained(S, j, v))
                after = advance((x,), (derive(x, ua[0], c),), (c,), um, ub, hh, dt, h6)
                store_state(S, j, after[0])
            for j in range(min(LANES, last - b0)):
                for i in range({e.outputs}):
                    V[b0 + j, k, i] = S[({innovations} + i) * LANES + j]
"""


def _steps(e: Emitted) -> str:
    return f"""
@compiled
def run_step(P, X, U, N, dt, D):
    for b in range(P.shape[1]):
        c = prepare(load_parameters(P, b))
        x = load_column(X, {e.states}, b)
        a = load_column(U, {e.inputs}, b)
        n = ({"".join(f"{one}, " for one in next_inputs(e, "U[{i}, b]", "N[{i}, b]"))})
        y = observe(x, a, c)
        after = advance((x,), (y,), (c,), (middle(a, n),), (n,), 0.5 * dt, dt, dt / 6.0)[0]
        store_column(D, after + y[{e.states}:], b)


@compiled
def run_move(X, E, D):
    for b in range(X.shape[1]):
        store_column(D, correct(load_column(X, {e.states}, b), load_column(E, {e.moves}, b)), b)
"""
