"""Header of every generated module: the one JIT gateway and branch-free elementary functions.

The text of this file is copied to the head of each generated module, so that one flat file holds all that
is compiled (Numba's cache does not follow imports). Nothing here may branch: a branch would keep LLVM from
vectorizing across lanes.

The reciprocal of zero is infinity and 0 * inf is NaN: fastmath leaves NaN and infinity honest (neither
``nnan`` nor ``ninf``), so a diverging lane becomes NaN and no other lane notices.
"""

import math
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numba as nb
import numpy as np
from llvmlite import ir
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.lib.mixins import NDArrayOperatorsMixin

WIDEST = '"prefer-vector-width"="512"'
FASTMATH = {"contract", "nsz", "arcp", "afn", "reassoc"}
# Nothing but the entry points is called from Python: without wrappers Numba takes a third less time.
inline = nb.njit(
    fastmath=FASTMATH, forceinline=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True
)
compiled = nb.njit(fastmath=FASTMATH, error_model="numpy", nogil=True, cache=True, no_cfunc_wrapper=True)


@intrinsic(prefer_literal=True)
def scratch(_: Any, size: Any) -> Any:
    """Reserve so many doubles (a literal) on the caller's stack, on a cache line.

    The compiler then puts the whole stack frame on a cache line, also the hundred registers a time step spills
    there. Else each of those crosses two lines, unless the caller's depth happens to be a lucky one.

    The caller is compiled for registers of 512 bits where the processor has them: by itself LLVM takes half of them on
    several processors of Intel, for programs that use vectors now and then.
    """
    count = size.literal_value

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        set.add(builder.function.attributes, WIDEST)  # llvmlite lists only attributes that have no value
        with builder.goto_entry_block():
            place = builder.alloca(ir.ArrayType(ir.DoubleType(), count))
        place.align = 64
        return builder.bitcast(place, ir.DoubleType().as_pointer())

    return nb.types.CPointer(nb.float64)(size), generate


# Rows of the scratch array and of matrices are loaded and stored as whole tuples: written out as Python, hundreds of
# single loads would cost Numba's type inference as much time as the equations.


def _doubles(count: int) -> Any:
    return nb.types.Tuple((nb.float64,) * count)


def _place(context: Any, builder: Any, array_type: Any, array: Any, indices: list[Any]) -> Any:
    array = context.make_array(array_type)(context, builder, array)
    return cgutils.get_item_pointer(context, builder, array_type, array, indices)


def _literal(i: int) -> Any:
    return ir.IntType(64)(i)


@intrinsic(prefer_literal=True)
def load_rows(_: Any, S: Any, first: Any, apart: Any, count: Any, j: Any) -> Any:
    """Load S[first + i apart + j] for i below count; first, apart and count are literals."""
    indices = [first.literal_value + i * apart.literal_value for i in range(count.literal_value)]

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        places = (builder.add(arguments[4], _literal(i)) for i in indices)
        values = [builder.load(_place(context, builder, S, arguments[0], [p])) for p in places]
        return context.make_tuple(builder, signature.return_type, values)

    return _doubles(len(indices))(S, first, apart, count, nb.int64), generate


@intrinsic(prefer_literal=True)
def store_rows(_: Any, S: Any, first: Any, apart: Any, values: Any, j: Any) -> Any:
    """Store values[i] in S[first + i apart + j]; first and apart are literals."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        for i, value in enumerate(cgutils.unpack_tuple(builder, arguments[3], len(values))):
            place = builder.add(arguments[4], _literal(first.literal_value + i * apart.literal_value))
            builder.store(value, _place(context, builder, S, arguments[0], [place]))
        return context.get_dummy_value()

    return nb.types.void(S, first, apart, _doubles(len(values)), nb.int64), generate


@intrinsic(prefer_literal=True)
def load_column(_: Any, A: Any, count: Any, b: Any) -> Any:
    """Load A[i, b] for i below count, a literal."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        indices = ([_literal(i), arguments[2]] for i in range(count.literal_value))
        values = [builder.load(_place(context, builder, A, arguments[0], i)) for i in indices]
        return context.make_tuple(builder, signature.return_type, values)

    return _doubles(count.literal_value)(A, count, nb.int64), generate


@intrinsic(prefer_literal=True)
def load_row(_: Any, A: Any, count: Any, k: Any) -> Any:
    """Load A[k, i] for i below count, a literal."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        indices = ([arguments[2], _literal(i)] for i in range(count.literal_value))
        values = [builder.load(_place(context, builder, A, arguments[0], i)) for i in indices]
        return context.make_tuple(builder, signature.return_type, values)

    return _doubles(count.literal_value)(A, count, nb.int64), generate


@intrinsic
def store_column(_: Any, A: Any, values: Any, b: Any) -> Any:
    """Store values[i] in A[i, b]."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        for i, value in enumerate(cgutils.unpack_tuple(builder, arguments[1], len(values))):
            builder.store(value, _place(context, builder, A, arguments[0], [_literal(i), arguments[2]]))
        return context.get_dummy_value()

    return nb.types.void(A, _doubles(len(values)), nb.int64), generate


@inline
def sqrt(a: float) -> float:
    """Take the square root."""
    return math.sqrt(a)


@inline
def fabs(a: float) -> float:
    """Take the magnitude."""
    return abs(a)


@inline
def select(c: bool, a: float, b: float) -> float:
    """Choose without a branch."""
    return a if c else b


@inline
def wrap(a: float) -> float:
    """Take an angle difference from (-3 pi, 3 pi) to [-pi, pi]."""
    a = select(a > 3.141592653589793, a - 6.283185307179586, a)
    return select(a < -3.141592653589793, a + 6.283185307179586, a)


@inline
def atan2(y: float, x: float) -> float:
    """Arc tangent of y / x over the whole circle, within 4e-16 relative.

    Reduction to [0, tan(pi/8)] and a minimax polynomial of the odd series, in Estrin's order: a time step
    waits for four of these one after the other, and Horner's chain is twice as long. Where the arc begins and
    which way it goes is known long before the polynomial is, so nothing is left to do after it but one
    multiply-add.
    """
    ax = fabs(x)
    ay = fabs(y)
    swap = ay > ax
    large = select(swap, ay, ax)
    small = select(swap, ax, ay)
    upper = small > 0.41421356237309503 * large
    t = select(upper, small - large, small) / (select(upper, small + large, large) + 1e-300)
    left = x < 0.0
    below = y < 0.0
    begin = select(upper, 0.7853981633974483, 0.0)
    begin = select(swap, 1.5707963267948966 - begin, begin)
    begin = select(left, 3.141592653589793 - begin, begin)
    begin = select(below, -begin, begin)
    v = select((swap != left) != below, -t, t)
    z = t * t
    z2 = z * z
    z4 = z2 * z2
    a = -0.3333333333332844 + z * 0.199999999988551
    b = -0.1428571418097571 + z * 0.11111106180425145
    c = -0.09090773074092884 + z * 0.07689953486227682
    d = -0.06640233842869744 + z * 0.056883487686028446
    e = -0.04348050891958043 + z * 0.02113535694575133
    s = (a + z2 * b) + z4 * ((c + z2 * d) + z4 * e)
    return (begin + v) + (v * z) * s


# The equations are hundreds of operations without a branch. They are written by running their function on terms, each
# operation of which writes its instruction. Numba, which would infer the type of each, takes a quarter less for a model.


_INSTRUCTIONS = {np.add: "fadd", np.subtract: "fsub", np.multiply: "fmul", np.true_divide: "fdiv"}


class _Term(NDArrayOperatorsMixin):
    """A double of the code that is being written."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    def __array_ufunc__(self, operation: Any, method: str, *terms: Any) -> Any:
        if operation is np.negative:
            return -0.0 - self
        write = getattr(self.builder, _INSTRUCTIONS[operation])
        return _Term(self.builder, write(*map(_value, terms)))


def _value(term: Any) -> Any:
    return term.value if isinstance(term, _Term) else ir.DoubleType()(float(term))


def _calls(context: Any, builder: Any) -> dict[str, Any]:
    """Return what writes calls of the elementary functions, by name."""

    def writer(function: Any) -> Callable[..., Any]:
        def call(*terms: Any) -> Any:
            kind = nb.typeof(function)
            signature = kind.get_call_type(context.typing_context, (nb.float64,) * len(terms), {})
            compiled = context.get_function(kind, signature)
            context.add_linking_libs(getattr(compiled, "libs", ()))
            return _Term(builder, compiled(builder, [_value(term) for term in terms]))

        return call

    return {function.__name__: writer(function) for function in (sqrt, fabs, wrap, atan2)}


def straight_line(count: int) -> Callable[[Any], Any]:
    """Return the decorator of a function of doubles, and of tuples of them, that returns `count` doubles and has no branch."""

    def decorate(function: Any) -> Any:
        @intrinsic
        def write(_: Any, given: Any) -> Any:
            def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
                def terms(kind: Any, value: Any) -> Any:
                    if not isinstance(kind, nb.types.BaseTuple):
                        return _Term(builder, value)
                    parts = cgutils.unpack_tuple(builder, value, len(kind))
                    return [terms(one, part) for one, part in zip(kind, parts, strict=True)]

                written = FunctionType(function.__code__, _calls(context, builder))
                values = [_value(term) for term in written(*terms(given, arguments[0]))]
                return context.make_tuple(builder, signature.return_type, values)

            return _doubles(count)(given), generate

        @inline
        def call(*given: Any) -> Any:
            return write(given)

        return call

    return decorate
