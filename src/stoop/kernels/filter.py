"""The time loop of a filter: at every sample the state is corrected by a gain times the innovation.

A candidate has its own gain. The model defines how the error state corrects the state, :attr:`SymbolicModel.moved`: a
quaternion by a rotation, anything else by addition.

Axes: b = candidate, k = sample, i = innovation, e = component of the error state, g = gain, r = point of linearization.
"""

from __future__ import annotations

from stoop.kernels import loops
from stoop.kernels.elementary import wrap
from stoop.kernels.instructions import Function, Rows


def _filter(code: Function, model: loops.Model) -> None:
    sizes = model.sizes
    block = loops.Block(code, model)
    gains, kept = code.rows(sizes.moves * sizes.outputs), code.rows(sizes.outputs)
    with code.loop("%first", "%last", code.lanes) as first:
        block.begin(first, block.shared_inputs("0")[0])
        with code.loop(0, "%samples") as k:
            shown, start = code.load("%G", k, "i64"), code.value(f"icmp eq i64 {k}, 0")
            back = code.integer("sub", k, code.value(f"select i1 {start}, i64 0, i64 1"))
            before = code.value(f"select i1 {start}, i64 -1, i64 {code.load('%G', back, 'i64')}")
            with code.when("ne", shown, before):
                _load_gains(code, gains, shown, first)
            block.follow(*block.shared_inputs(k))
            measured, seen = (loops.sample_of(code, r, k, sizes.outputs) for r in ("%Z", "%M"))
            with code.when("ne", "%states", 0):
                loops.keep_sample(code, block.state, "%X", first, k)
            _, outputs = block.observe()
            ahead = [z - y for z, y in zip(measured, outputs, strict=True)]
            ahead = [wrap(a) if w else a for a, w in zip(ahead, sizes.wrapped, strict=True)]
            kept.fill([m * a for m, a in zip(seen, ahead, strict=True)])
            _correct(block, gains, kept)
            block.advance(block.derive())
            loops.keep_sample(code, kept, "%V", first, k)


def _load_gains(code: Function, gains: Rows, shown: str, first: str) -> None:
    with code.loop(0, code.lanes) as lane:
        b = loops.candidate(code, first, lane)
        begin = code.integer("mul", shown, gains.count)
        with code.loop(0, gains.count) as i:
            place = code.integer("mul", code.integer("add", begin, i), "%count")
            code.store(code.load("%K", code.integer("add", place, b)), gains.name, gains.place(i, lane))


def _correct(block: loops.Block, gains: Rows, innovations: Rows) -> None:
    """Write the correction of the state by gains times innovations."""
    values, count = list(innovations), innovations.count
    error = []
    for row in range(0, gains.count, count):
        products = [gains[row + i] * v for i, v in enumerate(values)]
        error.append(sum(products[1:], start=products[0]))
    block.state.fill(block.model.correct(list(block.state), error, ()))


def _step(code: Function, model: loops.Model) -> None:
    sizes = model.sizes
    block, now, end = loops.Block(code, model), code.rows(sizes.inputs), code.rows(sizes.inputs)
    kept = code.rows(sizes.states + sizes.outputs)
    with code.loop(0, "%count", code.lanes) as first:
        loops.gather(code, "%U", now, first)
        loops.gather(code, "%N", end, first)
        block.begin(first, list(now))
        block.follow(list(now), [now[i] if i in sizes.held else end[i] for i in range(sizes.inputs)])
        derivatives, outputs = block.observe()
        for i, output in enumerate(outputs):
            kept[sizes.states + i] = output
        block.advance(derivatives)
        for i, state in enumerate(block.state):
            kept[i] = state
        loops.scatter(code, kept, "%D", first)


def _move(code: Function, model: loops.Model) -> None:
    state, error = code.rows(model.sizes.states), code.rows(model.sizes.moves)
    with code.loop(0, "%count", code.lanes) as first:
        loops.gather(code, "%X", state, first)
        loops.gather(code, "%E", error, first)
        state.fill(model.correct(list(state), list(error), ()))
        loops.scatter(code, state, "%D", first)


_FILTER = (
    f"{loops.pointers('P X0 K G U')}, i64 %rows, {loops.pointers('Z M')}, double %dt, i64 %samples, {loops.pointers('V X')}, "
    f"i64 %states, {loops.BLOCKS}"
)
_STEP = f"{loops.pointers('P X0 U N')}, double %dt, {loops.pointers('D')}, i64 %count"
ENTRIES = {
    "filter": loops.Entry(_FILTER, _filter),
    "step": loops.Entry(_STEP, _step),
    "move": loops.Entry(f"{loops.pointers('X E D')}, i64 %count", _move),
}
