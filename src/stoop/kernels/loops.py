"""The time loop around the model's functions: time outside, lanes inside.

A block of candidates side by side, one a lane, takes each step together. What a block needs between steps lies in rows of
scratch memory on the stack. The second to fourth stage of a Runge-Kutta step are one loop, so the machine code of a step holds
the derivatives twice and not four times. Blocks are always full: a lane without a candidate repeats the last one. Every lane
does the same operations in the same order, so a candidate's result depends neither on its place nor on the width of a block.

Axes: b = candidate, k = sample, i = state, input or output.

What would move to another machine, such as a GPU: the model's functions are straight-line scalar code on tuples, without
arrays, loops, branches or state; all they call is ``sqrt``, ``fabs`` and ``atan2``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import FunctionType, ModuleType
from typing import Any

from stoop.kernels.elementary import FUNCTIONS, wrap
from stoop.kernels.instructions import Function, Rows, Term, double
from stoop.kernels.symbolic import Sizes

Terms = Sequence[Any]  #: terms, or numbers that are the same in every lane


@dataclass(frozen=True)
class Model:
    """The functions of a model, which take and return tuples of terms."""

    sizes: Sizes
    module: ModuleType  #: the same functions, of arrays

    def __getattr__(self, name: str) -> Callable[..., Terms]:
        return FunctionType(getattr(self.module, name).__code__, dict(FUNCTIONS))


@dataclass(frozen=True)
class Entry:
    """A function that is compiled for every model."""

    arguments: str  #: as LLVM writes them
    body: Callable[[Function, Model], None]

    def text(self, model: Model, lanes: int) -> str:
        """Return LLVM's text of its module."""
        code = Function(self.arguments, lanes)
        self.body(code, model)
        return code.text()


class Block:
    """The memory of a block of candidates and what is done with it.

    Parameters
    ----------
    code : Function
    model : Model
    moving : sequence of int, optional
        The states that are integrated; all by default. Others keep their initial values.
    """

    def __init__(self, code: Function, model: Model, moving: Sequence[int] | None = None) -> None:
        sizes = model.sizes
        self.code, self.model, self.sizes = code, model, sizes
        self.moving = range(sizes.states) if moving is None else moving
        self.state, self.slope, self.total = (code.rows(sizes.states) for _ in range(3))
        self.constants = code.rows(sizes.constants)
        self.forcing = code.rows(3 * sizes.forcings)  #: at a sample, in the middle of its step, at the end
        self.half = code.value(f"fmul double %dt, {double(0.5)}")
        self.sixth = code.value(f"fdiv double %dt, {double(6.0)}")

    def begin(self, first: str, inputs: Terms) -> None:
        """Write the constants, initial states and first forcing terms of the candidates from the first on."""
        gather(self.code, "%X0", self.state, first)
        prepare(self.code, self.model, self.constants, first)
        self.forcing.fill(self.forced(inputs))

    def forced(self, inputs: Terms) -> Terms:
        """Write the forcing terms of inputs."""
        return self.model.forcing(inputs, list(self.constants))

    def observe(self) -> tuple[Terms, Terms]:
        """Write derivatives and outputs at the current state."""
        found = self.model.observe(list(self.state), list(self.forcing), list(self.constants))
        return found[: self.sizes.states], found[self.sizes.states :]

    def derive(self) -> Terms:
        """Write derivatives at the current state."""
        return self.model.derive(list(self.state), list(self.forcing), list(self.constants))

    def follow(self, now: Terms, end: Terms) -> None:
        """Write the forcing terms of a step along which inputs are linear, from `now` to `end`.

        Those at its beginning are the last ones of the step before; they are computed again only where inputs are held.
        """
        sizes, count = self.sizes, self.sizes.forcings
        if sizes.held:
            self.forcing.fill(self.forced(now))
        there = self.forced(end)
        between = self.forced([0.5 * (a + b) for a, b in zip(now, end, strict=True)])
        for i in range(count):
            mean = 0.5 * (self.forcing[i] + there[i]) if i in sizes.affine else between[i]
            self.forcing[count + i], self.forcing[2 * count + i] = mean, there[i]

    def advance(self, derivatives: Terms) -> None:
        """Write a step of the Runge-Kutta method of order four from the derivatives at the current state."""
        code, count = self.code, self.sizes.forcings
        for i in self.moving:
            self.slope[i] = self.total[i] = derivatives[i]
        with code.loop(0, 3) as stage:
            last = code.value(f"icmp eq i64 {stage}, 2")
            ahead = code.spread(code.value(f"select i1 {last}, double %dt, double {self.half}"))
            weight = code.spread(code.value(f"select i1 {last}, double {double(1.0)}, double {double(2.0)}"))
            first = code.integer("mul", code.integer("add", code.integer("lshr", stage, 1), 1), count)
            forcing = [self.forcing[code.integer("add", first, i)] for i in range(count)]
            state = list(self.state)
            for i in self.moving:
                state[i] = state[i] + ahead * self.slope[i]
            slopes = self.model.derive(state, forcing, list(self.constants))
            for i in self.moving:
                self.slope[i] = slopes[i]
                self.total[i] = self.total[i] + weight * slopes[i]
        sixth = code.spread(self.sixth)
        for i in self.moving:
            self.state[i] = self.state[i] + sixth * self.total[i]
        for i in range(count):
            self.forcing[i] = self.forcing[2 * count + i]

    def shared_inputs(self, k: str) -> tuple[Terms, Terms]:
        """Write the inputs that all candidates share, at a sample and at the next."""
        code, count = self.code, self.sizes.inputs
        now = code.integer("mul", k, count)
        then = code.integer("mul", following(code, k, "%rows"), count)
        return self._pair(lambda i: code.spread(code.load("%U", code.integer("add", now, i))),
                          lambda i: code.spread(code.load("%U", code.integer("add", then, i))))  # fmt: skip

    def own_inputs(self, k: str, first: str) -> tuple[Terms, Terms]:
        """Write the inputs of each candidate, [block, sample, input, lane], at a sample and at the next."""
        code, lanes = self.code, self.code.lanes
        block = code.integer("mul", code.value(f"sdiv i64 {first}, {lanes}"), "%rows")
        now, then = (
            code.integer("mul", code.integer("add", block, row), self.sizes.inputs * lanes)
            for row in (k, following(code, k, "%rows"))
        )
        return self._pair(lambda i: code.vector_at("%U", code.integer("add", now, i * lanes)),
                          lambda i: code.vector_at("%U", code.integer("add", then, i * lanes)))  # fmt: skip

    def _pair(self, now: Callable[[int], Term], then: Callable[[int], Term]) -> tuple[Terms, Terms]:
        """Return inputs at a sample and at the end of its step; those that the model holds are the same there."""
        here = [now(i) for i in range(self.sizes.inputs)]
        return here, [here[i] if i in self.sizes.held else then(i) for i in range(self.sizes.inputs)]


def following(code: Function, k: str, end: str) -> str:
    """Write the row after k, or the last one."""
    return code.least(code.integer("add", k, 1), code.integer("sub", end, 1))


def candidate(code: Function, first: str, lane: str) -> str:
    """Write the candidate of a lane; the last one fills a block."""
    return code.least(code.integer("add", first, lane), code.integer("sub", "%count", 1))


def gather(code: Function, matrix: str, rows: Rows, first: str) -> None:
    """Write the copy of a matrix, a column a candidate, to rows of a block."""
    with code.loop(0, code.lanes) as lane:
        b = candidate(code, first, lane)
        with code.loop(0, rows.count) as i:
            number = code.load(matrix, code.integer("add", code.integer("mul", i, "%count"), b))
            code.store(number, rows.name, rows.place(i, lane))


def scatter(code: Function, rows: Rows, matrix: str, first: str) -> None:
    """Write the copy of rows of a block to a matrix, a column a candidate."""
    with code.loop(0, code.lanes) as lane:
        b = candidate(code, first, lane)
        with code.loop(0, rows.count) as i:
            number = code.load(rows.name, rows.place(i, lane))
            code.store(number, matrix, code.integer("add", code.integer("mul", i, "%count"), b))


def keep_sample(code: Function, rows: Rows, record: str, first: str, k: str) -> None:
    """Write the copy of rows to sample k of a record [candidate, sample, row]; lanes without a candidate are left out."""
    with code.loop(0, code.least(code.lanes, code.integer("sub", "%last", first))) as lane:
        sample = code.integer("mul", code.integer("add", first, lane), "%samples")
        place = code.integer("mul", code.integer("add", sample, k), rows.count)
        with code.loop(0, rows.count) as i:
            code.store(code.load(rows.name, rows.place(i, lane)), record, code.integer("add", place, i))


def prepare(code: Function, model: Model, constants: Rows, first: str) -> None:
    """Write what depends on the parameters alone."""
    parameters = code.rows(model.sizes.parameters)
    gather(code, "%P", parameters, first)
    constants.fill(model.prepare(list(parameters)))


def sample_of(code: Function, record: str, k: str, count: int) -> list[Term]:
    """Write the load of a row of a record that all candidates share."""
    first = code.integer("mul", k, count)
    return [code.spread(code.load(record, code.integer("add", first, i))) for i in range(count)]


def _inputs(block: Block, per_lane: bool, k: str, first: str) -> tuple[Terms, Terms]:
    return block.own_inputs(k, first) if per_lane else block.shared_inputs(k)


def _sum(term: Callable[[Term, Term], Term], per_lane: bool) -> Callable[[Function, Model], None]:
    """Return the body of a function that adds up a term of each error of the readings and its weight."""

    def body(code: Function, model: Model) -> None:
        block, total, sizes = Block(code, model, model.sizes.seen), code.rows(1), model.sizes
        with code.loop("%first", "%last", code.lanes) as first:
            block.begin(first, _inputs(block, per_lane, "0", first)[0])
            total[0] = 0.0
            with code.loop(0, "%samples") as k:
                block.follow(*_inputs(block, per_lane, k, first))
                derivatives, outputs = block.observe()
                measured, weights = (sample_of(code, r, k, sizes.outputs) for r in ("%Z", "%W"))
                errors = [y - z for y, z in zip(outputs, measured, strict=True)]
                errors = [wrap(e) if w else e for e, w in zip(errors, sizes.wrapped, strict=True)]
                terms = [term(e, w) for e, w in zip(errors, weights, strict=True)]
                total[0] = total[0] + sum(terms[1:], start=terms[0])
                block.advance(derivatives)
            with code.loop(0, code.least(code.lanes, code.integer("sub", "%last", first))) as lane:
                code.store(code.load(total.name, lane), "%J", code.integer("add", first, lane))

    return body


def _square(error: Term, weight: Term) -> Term:
    return weight * (error * error)


def _product(error: Term, weight: Term) -> Term:
    return weight * error


def _outputs(per_lane: bool) -> Callable[[Function, Model], None]:
    def body(code: Function, model: Model) -> None:
        block, kept = Block(code, model, model.sizes.seen), code.rows(model.sizes.outputs)
        with code.loop("%first", "%last", code.lanes) as first:
            block.begin(first, _inputs(block, per_lane, "0", first)[0])
            with code.loop(0, "%samples") as k:
                block.follow(*_inputs(block, per_lane, k, first))
                derivatives, outputs = block.observe()
                kept.fill(outputs)
                block.advance(derivatives)
                keep_sample(code, kept, "%Y", first, k)

    return body


def _evaluate(code: Function, model: Model) -> None:
    sizes = model.sizes
    counts = (sizes.states, sizes.inputs, sizes.constants, sizes.states + sizes.outputs)
    state, inputs, constants, found = map(code.rows, counts)
    with code.loop(0, "%count", code.lanes) as first:
        prepare(code, model, constants, first)
        gather(code, "%X", state, first)
        gather(code, "%U", inputs, first)
        forcing = model.forcing(list(inputs), list(constants))
        found.fill(model.observe(list(state), forcing, list(constants)))
        scatter(code, found, "%D", first)


def pointers(names: str) -> str:
    """Return arguments that are arrays, none of which overlaps another."""
    return ", ".join(f"ptr noalias %{name}" for name in names.split())


BLOCKS = "i64 %first, i64 %last, i64 %count"  #: the candidates of a call, and how many there are in all
_START = f"{pointers('P X0 U')}, i64 %rows"
_COST = f"{_START}, {pointers('Z W')}, double %dt, i64 %samples, {pointers('J')}, {BLOCKS}"
_OUTPUTS = f"{_START}, double %dt, i64 %samples, {pointers('Y')}, {BLOCKS}"

ENTRIES = {
    "cost": Entry(_COST, _sum(_square, per_lane=False)),
    "cost_per_lane": Entry(_COST, _sum(_square, per_lane=True)),
    "products": Entry(_COST, _sum(_product, per_lane=False)),
    "outputs": Entry(_OUTPUTS, _outputs(per_lane=False)),
    "outputs_per_lane": Entry(_OUTPUTS, _outputs(per_lane=True)),
    "evaluate": Entry(f"{pointers('P X U D')}, i64 %count", _evaluate),
}
