"""The time loop around the model's functions: time outside, lanes inside.

A block is ``LANES`` candidates side by side. All that a block needs lies in one flat scratch array whose
rows are ``LANES`` apart (a compile-time constant), so that LLVM sees the distances and turns the loop over
lanes into vector instructions. Blocks are always full: a remainder loop would round differently.

Axes: b = candidate, k = sample, i = state, input or output, j = lane.

What would move to another machine, such as a GPU: ``prepare``, ``derive`` and ``observe`` are straight-line
scalar code on tuples, without arrays, loops, branches or state; all they call is ``sqrt``, ``fabs`` and ``atan2``
of the runtime header. What follows here would not: blocks, scratch on the stack and the loop over lanes are made
for the vector registers of a CPU. A GPU would have one thread per candidate and its own loop over time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # a warm start needs the signatures below, but no SymPy
    from stoop.kernels.emit import Emitted

LANES = 8  #: one AVX-512 register of doubles


def _tuple(pattern: str, count: int) -> str:
    """Write a tuple of ``count`` entries; ``{i}`` is the index."""
    return "(" + "".join(pattern.format(i=i) + ", " for i in range(count)) + ")"


def _rows(first: int, count: int) -> str:
    return "(" + "".join(f"S[{(first + i) * LANES} + j], " for i in range(count)) + ")"


def _axpy(count: int, k: str) -> str:
    return "(" + "".join(f"x[{i}] + a * {k}[{i}], " for i in range(count)) + ")"


def _residual(i: int, wrapped: bool, nx: int) -> str:
    difference = f"y[{nx + i}] - z[{i}]"
    return f"wrap({difference})" if wrapped else difference


def _helpers(e: Emitted) -> str:
    """Write the steps: Runge-Kutta of order four, the cost of one sample, loads and stores."""
    nx, combined = e.states, "x[{i}] + h6 * (k1[{i}] + 2.0 * (k2[{i}] + k3[{i}]) + k4[{i}])"
    terms = " + ".join(f"w[{i}] * (e{i} * e{i})" for i in range(e.outputs))
    errors = "\n".join(f"    e{i} = {_residual(i, w, nx)}" for i, w in enumerate(e.wrapped))
    return f"""
@inline
def axpy(x, a, k):
    return {_axpy(nx, "k")}


@inline
def advance(x, k1, c, um, ub, hh, h, h6):
    k2 = derive(axpy(x, hh, k1), um, c)
    k3 = derive(axpy(x, hh, k2), um, c)
    k4 = derive(axpy(x, h, k3), ub, c)
    return {_tuple(combined, nx)}


@inline
def penalty(y, z, w):
{errors}
    return {terms}


@inline
def load_state(S, j):
    return {_rows(0, nx)}


@inline
def load_constants(S, j):
    return {_rows(nx, e.constants)}


@inline
def store_state(S, j, x):
{chr(10).join(f"    S[{i * LANES} + j] = x[{i}]" for i in range(nx))}


@inline
def middle(a, b):
    return {_tuple("0.5 * (a[{i}] + b[{i}])", e.inputs)}


@inline
def load_parameters(P, b):
    return {_tuple("P[{i}, b]", e.parameters)}


@inline
def fill(S, P, X0, b0):
    for j in range(LANES):
        b = min(b0 + j, P.shape[1] - 1)
        c = prepare(load_parameters(P, b))
{chr(10).join(f"        S[{i * LANES} + j] = X0[{i}, b]" for i in range(nx))}
{chr(10).join(f"        S[{(nx + i) * LANES} + j] = c[{i}]" for i in range(e.constants))}
"""


def _scratch(e: Emitted) -> tuple[int, int, int]:
    """Return where the results and a lane's own inputs begin in the scratch array, and its size, in rows.

    All that the lane loop touches lies in this one array: with two, LLVM could not rule out that they
    overlap, and would not vectorize.
    """
    results = e.states + e.constants
    inputs = results + e.outputs
    return results, inputs, inputs + 2 * e.inputs


def _inputs(e: Emitted, per_lane: bool) -> tuple[str, str]:
    """Return the source that reads a sample's inputs: before the lane loop and inside it."""
    if not per_lane:
        lines = [
            "k1 = min(k + 1, rows - 1)",
            f"ua = {_tuple('U[k, {i}]', e.inputs)}",
            f"ub = {_tuple('U[k1, {i}]', e.inputs)}",
            "um = middle(ua, ub)",
        ]
        return _indent(lines, 12), ""
    width, first = e.inputs * LANES, _scratch(e)[1]
    before = [
        f"ia = ((b0 // LANES) * rows + k) * {width}",
        f"ib = ((b0 // LANES) * rows + min(k + 1, rows - 1)) * {width}",
        f"for i in range({width}):",
        f"    S[{first * LANES} + i] = U[ia + i]",
        f"    S[{first * LANES + width} + i] = U[ib + i]",
    ]
    inside = [
        f"ua = {_rows(first, e.inputs)}",
        f"ub = {_rows(first + e.inputs, e.inputs)}",
        "um = middle(ua, ub)",
    ]
    return _indent(before, 12), _indent(inside, 16)


def _indent(lines: list[str], depth: int) -> str:
    return "".join(" " * depth + line + "\n" for line in lines)


def _loops(e: Emitted, per_lane: bool) -> str:
    nx, (results, _, size) = e.states, _scratch(e)
    before, inside = _inputs(e, per_lane)
    total = f"S[{results * LANES} + j]"
    step = inside + _indent(
        [
            "x = load_state(S, j)",
            "c = load_constants(S, j)",
            "y = observe(x, ua, c)",
            "store_state(S, j, advance(x, y, c, um, ub, hh, dt, h6))",
        ],
        16,
    )
    keep = _indent([f"S[{(results + i) * LANES} + j] = y[{nx + i}]" for i in range(e.outputs)], 16)
    return f"""
@compiled
def run_cost(P, X0, U, rows, Z, W, dt, samples, J, first, last):
    S = nb.carray(scratch({size * LANES}), {size * LANES})
    hh = 0.5 * dt
    h6 = dt / 6.0
    for b0 in range(first, last, LANES):
        fill(S, P, X0, b0)
        for j in range(LANES):
            {total} = 0.0
        for k in range(samples):
{before}            z = {_tuple("Z[k, {i}]", e.outputs)}
            w = {_tuple("W[k, {i}]", e.outputs)}
            for j in range(LANES):
{step}                {total} += penalty(y, z, w)
        for j in range(min(LANES, last - b0)):
            J[b0 + j] = {total}


@compiled
def run_outputs(P, X0, U, rows, dt, samples, Y, first, last):
    S = nb.carray(scratch({size * LANES}), {size * LANES})
    hh = 0.5 * dt
    h6 = dt / 6.0
    for b0 in range(first, last, LANES):
        fill(S, P, X0, b0)
        for k in range(samples):
{before}            for j in range(LANES):
{step}{keep}            for j in range(min(LANES, last - b0)):
                for i in range({e.outputs}):
                    Y[b0 + j, k, i] = S[({results} + i) * LANES + j]
"""


def _evaluate(e: Emitted) -> str:
    nx, ny = e.states, e.outputs
    return f"""
@compiled
def run_evaluate(P, X, U, D):
    for b in range(P.shape[1]):
        c = prepare(load_parameters(P, b))
        y = observe({_tuple("X[{i}, b]", nx)}, {_tuple("U[{i}, b]", e.inputs)}, c)
{chr(10).join(f"        D[{i}, b] = y[{i}]" for i in range(nx + ny))}
"""


SIGNATURES = {
    "run_cost": "void(f8[:,::1], f8[:,::1], {U}, i8, f8[:,::1], f8[:,::1], f8, i8, f8[::1], i8, i8)",
    "run_outputs": "void(f8[:,::1], f8[:,::1], {U}, i8, f8, i8, f8[:,:,::1], i8, i8)",
    "run_evaluate": "void(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1])",
}


def loop_source(e: Emitted, per_lane: bool) -> str:
    """Write all that follows the model's functions in the generated module."""
    return f"LANES = {LANES}\n" + _helpers(e) + _loops(e, per_lane) + _evaluate(e)


def signatures(per_lane: bool) -> dict[str, str]:
    """Return the Numba signature of each entry point."""
    return {name: s.format(U="f8[::1]" if per_lane else "f8[:,::1]") for name, s in SIGNATURES.items()}
