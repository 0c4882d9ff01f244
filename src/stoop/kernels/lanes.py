"""The time loop around the model's functions: time outside, lanes inside.

A block is ``LANES`` candidates side by side, in one or two groups of ``WIDTH``. All that a block needs lies in
one flat scratch array whose rows are ``LANES`` apart (a compile-time constant), so that LLVM sees the distances
and turns the loop over the lanes of a group into vector instructions. Where one group would wait for its own
results (:mod:`stoop.kernels.balance`), two take each stage of a step in turn. Blocks are always full, in both
groups: other code for a remainder would round differently. For the same reason LLVM may not reorder the sums of
two groups: it chooses an order for each group by itself, and a candidate's cost would depend on its place.

Axes: b = candidate, k = sample, i = state, input or output, j = lane, g = group.

What would move to another machine, such as a GPU: ``prepare``, ``derive`` and ``observe`` are straight-line
scalar code on tuples, without arrays, loops, branches or state; all they call is ``sqrt``, ``fabs`` and ``atan2``
of the runtime header. What follows here would not: blocks, scratch on the stack and the loop over lanes are made
for the vector registers of a CPU. A GPU would have one thread per candidate and its own loop over time.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # a warm start needs the signatures below, but no SymPy
    from stoop.kernels.emit import Emitted

WIDTH = 8  #: of a group: one AVX-512 register of doubles
_REORDER = ', "reassoc"'  #: among the flags in the runtime header
ARRAYS = """\
from numpy import absolute as fabs, arctan2 as atan2, sqrt


def inline(function):
    return function


def straight_line(count):
    return inline


"""  #: header of the model's functions where they take arrays
LOOPS = "# Loops over time.\n"  #: between the functions that the modules of a model share and those of each module


def lanes(e: Emitted) -> int:
    """Return how many candidates a block of this model holds."""
    return WIDTH * e.groups


def header(e: Emitted) -> str:
    """Return the head of the generated module: the runtime header, whose sums stay in order for two groups."""
    text = Path(__file__).with_name("runtime.py").read_text()
    return text.replace(_REORDER, "") if e.groups > 1 else text


def tuple_of(pattern: str, count: int) -> str:
    """Write a tuple of ``count`` entries; ``{i}`` is the index."""
    return "(" + "".join(pattern.format(i=i) + ", " for i in range(count)) + ")"


def straight_line(name: str, arguments: str, lines: Sequence[str], results: Sequence[str]) -> str:
    """Write one inlined function that returns the tuple of the results."""
    body = "".join(f"    {line}\n" for line in (*lines, f"return ({''.join(f'{one}, ' for one in results)})"))
    return f"@straight_line({len(results)})\ndef {name}({arguments}):\n{body}"


def next_inputs(e: Emitted, here: str, there: str) -> list[str]:
    """Write each input at the end of a step: its value there, or here where it is held; ``{i}`` is the index."""
    return [(here if i in e.held else there).format(i=i) for i in range(e.inputs)]


def _rows(e: Emitted, first: int, count: int) -> str:
    return f"load_rows(S, {first * lanes(e)}, {lanes(e)}, {count}, j)"


def _stages(e: Emitted) -> str:
    """Write a step of Runge-Kutta of order four; each stage is taken by all groups before the next begins."""
    states = range(e.states)
    ahead = [f"x[{i}] + a * k[{i}]" for i in states]
    combined = [f"x[{i}] + h6 * (k1[{i}] + 2.0 * (k2[{i}] + k3[{i}]) + k4[{i}])" for i in states]
    stage = "derive(axpy(x[{{i}}], {h}, {k}[{{i}}]), {u}[{{i}}], c[{{i}}])"
    return f"""
{straight_line("axpy", "x, a, k", (), ahead)}

{straight_line("combine", "x, k1, k2, k3, k4, h6", (), combined)}

@inline
def advance(x, k1, c, um, ub, hh, h, h6):
    k2 = {tuple_of(stage.format(h="hh", k="k1", u="um"), e.groups)}
    k3 = {tuple_of(stage.format(h="hh", k="k2", u="um"), e.groups)}
    k4 = {tuple_of(stage.format(h="h", k="k3", u="ub"), e.groups)}
    return {tuple_of("combine(x[{i}], k1[{i}], k2[{i}], k3[{i}], k4[{i}], h6)", e.groups)}
"""


def _helpers(e: Emitted) -> str:
    """Write the cost of one sample, loads and stores of one group."""
    nx, apart = e.states, lanes(e)
    terms = " + ".join(f"w[{i}] * (e{i} * e{i})" for i in range(e.outputs))
    difference = [f"y[{nx + i}] - z[{i}]" for i in range(e.outputs)]
    residuals = [f"wrap({d})" if w else d for d, w in zip(difference, e.wrapped, strict=True)]
    errors = "\n".join(f"    e{i} = {residual}" for i, residual in enumerate(residuals))
    return f"""
@inline
def penalty(y, z, w):
{errors}
    return {terms}


@inline
def load_state(S, j):
    return {_rows(e, 0, nx)}


@inline
def load_constants(S, j):
    return {_rows(e, nx, e.constants)}


@inline
def store_state(S, j, x):
    store_rows(S, 0, {apart}, x, j)


@inline
def middle(a, b):
    return {tuple_of("0.5 * (a[{i}] + b[{i}])", e.inputs)}


@inline
def load_parameters(P, b):
    return load_column(P, {e.parameters}, b)


@inline
def fill(S, P, X0, b0):
    for j in range(LANES):
        b = min(b0 + j, P.shape[1] - 1)
        store_rows(S, 0, {apart}, load_column(X0, {nx}, b), j)
        store_rows(S, {nx * apart}, {apart}, prepare(load_parameters(P, b)), j)
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
    """Return the source that reads a sample's inputs: before the lane loop and inside it.

    There ``ua``, ``um`` and ``ub`` have one entry per group: at the sample, in the middle, at the next.
    """
    if not per_lane:
        lines = [
            "k1 = min(k + 1, rows - 1)",
            f"a = load_row(U, {e.inputs}, k)",
            f"b = ({''.join(f'{one}, ' for one in next_inputs(e, 'U[k, {i}]', 'U[k1, {i}]'))})",
            "m = middle(a, b)",
            *(f"u{name} = {tuple_of(name, e.groups)}" for name in "amb"),
        ]
        return indent(lines, 12), ""
    width, first = e.inputs * lanes(e), _scratch(e)[1]
    before = [
        f"ia = ((b0 // LANES) * rows + k) * {width}",
        f"ib = ((b0 // LANES) * rows + min(k + 1, rows - 1)) * {width}",
        f"for i in range({width}):",
        f"    S[{first * lanes(e)} + i] = U[ia + i]",
        f"    S[{first * lanes(e) + width} + i] = U[ib + i]",
    ]
    inside = [
        f"ua = {_groups(e, 'load_inputs(S, {j})')}",
        f"ub = {_groups(e, 'load_next_inputs(S, {j})')}",
        f"um = {tuple_of('middle(ua[{i}], ub[{i}])', e.groups)}",
    ]
    return indent(before, 12), indent(inside, 16)


def _input_loads(e: Emitted) -> str:
    first, apart = _scratch(e)[1], lanes(e)
    following = [(first + i + (0 if i in e.held else e.inputs)) * apart for i in range(e.inputs)]
    return f"""
@inline
def load_inputs(S, j):
    return {_rows(e, first, e.inputs)}


@inline
def load_next_inputs(S, j):
    return ({"".join(f"S[{row} + j], " for row in following)})
"""


def _groups(e: Emitted, pattern: str) -> str:
    """Write a tuple with an entry per group; ``{j}`` is the lane."""
    return "(" + "".join(pattern.format(j=f"j + {WIDTH * g}") + ", " for g in range(e.groups)) + ")"


def indent(lines: list[str], depth: int) -> str:
    """Write lines at a depth."""
    return "".join(" " * depth + line + "\n" for line in lines)


def _step(e: Emitted, per_lane: bool) -> tuple[str, str]:
    """Write what a sample begins with, before the lane loop, and a step of all groups in it."""
    before, inside = _inputs(e, per_lane)
    lines = [
        f"x = {_groups(e, 'load_state(S, {j})')}",
        f"c = {_groups(e, 'load_constants(S, {j})')}",
        f"y = {tuple_of('observe(x[{i}], ua[{i}], c[{i}])', e.groups)}",
        "after = advance(x, y, c, um, ub, hh, dt, h6)",
        *(f"store_state(S, j + {WIDTH * g}, after[{g}])" for g in range(e.groups)),
    ]
    return before, inside + indent(lines, 16)


def _costs(e: Emitted, per_lane: bool) -> str:
    (results, _, size), apart = _scratch(e), lanes(e)
    before, step = _step(e, per_lane)
    total = f"S[{results * apart} + j]"
    add = [f"S[{results * apart + WIDTH * g} + j] += penalty(y[{g}], z, w)" for g in range(e.groups)]
    return f"""
@compiled
def run_cost(P, X0, U, rows, Z, W, dt, samples, J, first, last):
    S = nb.carray(scratch({size * apart}), {size * apart})
    hh = 0.5 * dt
    h6 = dt / 6.0
    for b0 in range(first, last, LANES):
        fill(S, P, X0, b0)
        for j in range(LANES):
            {total} = 0.0
        for k in range(samples):
{before}            z = load_row(Z, {e.outputs}, k)
            w = load_row(W, {e.outputs}, k)
            for j in range({WIDTH}):
{step}{indent(add, 16)}        for j in range(min(LANES, last - b0)):
            J[b0 + j] = {total}
"""


def _outputs(e: Emitted, per_lane: bool) -> str:
    (results, _, size), apart = _scratch(e), lanes(e)
    before, step = _step(e, per_lane)
    keep = [
        f"store_rows(S, {results * apart + WIDTH * g}, {apart}, y[{g}][{e.states}:], j)"
        for g in range(e.groups)
    ]
    return f"""
@compiled
def run_outputs(P, X0, U, rows, dt, samples, Y, first, last):
    S = nb.carray(scratch({size * apart}), {size * apart})
    hh = 0.5 * dt
    h6 = dt / 6.0
    for b0 in range(first, last, LANES):
        fill(S, P, X0, b0)
        for k in range(samples):
{before}            for j in range({WIDTH}):
{step}{indent(keep, 16)}            for j in range(min(LANES, last - b0)):
                for i in range({e.outputs}):
                    Y[b0 + j, k, i] = S[({results} + i) * LANES + j]
"""


def _evaluate(e: Emitted) -> str:
    return f"""
@compiled
def run_evaluate(P, X, U, D):
    for b in range(P.shape[1]):
        c = prepare(load_parameters(P, b))
        store_column(D, observe(load_column(X, {e.states}, b), load_column(U, {e.inputs}, b), c), b)
"""


_COST = "void(f8[:,::1], f8[:,::1], {U}, i8, f8[:,::1], f8[:,::1], f8, i8, f8[::1], i8, i8)"
_OUTPUTS = "void(f8[:,::1], f8[:,::1], {U}, i8, f8, i8, f8[:,:,::1], i8, i8)"
_SHARED, _PER_LANE = "f8[:,::1]", "f8[::1]"  #: inputs
SIGNATURES = {
    "shared": {
        "run_outputs": _OUTPUTS.format(U=_SHARED),
        "run_evaluate": "void(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1])",
    },
    "per_lane": {"run_outputs": _OUTPUTS.format(U=_PER_LANE)},
    "costs": {"run_cost": _COST.format(U=_SHARED)},
    "costs_per_lane": {"run_cost": _COST.format(U=_PER_LANE)},
}  #: module -> entry points


def model_source(e: Emitted) -> str:
    """Write what all modules of a model begin with: header, its functions, a step in time, loads and stores of a group.

    A process compiles these functions once, whichever of the modules it compiles (:data:`LOOPS`).
    """
    parts = [header(e), e.source, e.correction, f"LANES = {lanes(e)}\n{_stages(e)}{_helpers(e)}"]
    return "\n\n".join(parts) + f"\n\n{LOOPS}"


def input_tuples(e: Emitted) -> str:
    """Write the lines that read a sample's inputs, shared by all candidates."""
    return _inputs(e, per_lane=False)[0]


def loop_source(e: Emitted, name: str) -> str:
    """Write a module of costs or trajectories, one of `SIGNATURES`."""
    per_lane = name.endswith("per_lane")
    loops = _costs(e, per_lane) if "run_cost" in SIGNATURES[name] else _outputs(e, per_lane)
    return (
        model_source(e)
        + (_input_loads(e) if per_lane else "")
        + loops
        + (_evaluate(e) if name == "shared" else "")
    )
