"""Branch-free elementary functions of the lanes of a vector.

The reciprocal of zero is infinity and 0 * inf is NaN, so a candidate that diverges becomes NaN.
"""

from __future__ import annotations

import math
from typing import Any

from stoop.kernels.instructions import Condition, Term


def sqrt(a: Any) -> Any:
    """Write the square root; that of a number is one."""
    return a.unary("sqrt") if isinstance(a, Term) else math.sqrt(a)


def fabs(a: Any) -> Any:
    """Write the magnitude; that of a number is one."""
    return a.unary("fabs") if isinstance(a, Term) else abs(a)


def select(condition: Condition, a: Any, b: Any) -> Term:
    """Write a choice without a branch."""
    return condition.choose(a, b)


def wrap(a: Term) -> Term:
    """Take an angle difference from (-3 pi, 3 pi) to [-pi, pi]."""
    a = select(a > 3.141592653589793, a - 6.283185307179586, a)
    return select(a < -3.141592653589793, a + 6.283185307179586, a)


def atan2(y: Any, x: Any) -> Any:
    """Write the arc tangent of y / x over the whole circle, within 4e-16 relative.

    Reduction to [0, tan(pi/8)] and a minimax polynomial of the odd series, in Estrin's order: a time step waits for four of
    these one after the other, and Horner's chain is twice as long. Where the arc begins and which way it goes is known long
    before the polynomial is, so nothing is left to do after it but one multiply-add.
    """
    given = [a for a in (y, x) if isinstance(a, Term)]
    if not given:
        return math.atan2(y, x)
    code = given[0].code
    y, x = (a if isinstance(a, Term) else Term(code, code.literal(a)) for a in (y, x))
    ax = x if x.magnitude else fabs(x)
    ay = fabs(y)
    swap = ay > ax
    large = select(swap, ay, ax)
    small = select(swap, ax, ay)
    upper = small > 0.41421356237309503 * large
    t = select(upper, small - large, small) / (select(upper, small + large, large) + 1e-300)
    below = y < 0.0
    begin = select(upper, 0.7853981633974483, select(swap, 1.5707963267948966, 0.0))
    turned = swap.differs(below)
    if not x.magnitude:
        left = x < 0.0
        begin, turned = select(left, 3.141592653589793 - begin, begin), turned.differs(left)
    begin = select(below, -begin, begin)
    v = select(turned, -t, t)
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


FUNCTIONS = {f.__name__: f for f in (sqrt, fabs, wrap, atan2)}  #: that a model's functions call
