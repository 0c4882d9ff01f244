"""Which candidates stand on which: a product or a power has a meaning only beside the variables that it is made of.

`alpha^3` without `alpha` is a model that another reference angle would turn into one with both, so what is chosen
would hang on where angles are counted from. J. A. Nelder, "A reformulation of linear models", Journal of the
Royal Statistical Society A 140(1), 1977 (marginality).
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Mapping, Sequence


def parents(trees: Sequence[ast.expr]) -> tuple[tuple[int, ...], ...]:
    """Return for each candidate the places of the plain variables that it is a product or power of.

    Variables that are no candidates are not asked for, so an even function stays possible: `beta^2` in lift.
    What is no product, such as `abs(beta)`, stands on nothing.
    """
    plain = {tree.id: i for i, tree in enumerate(trees) if isinstance(tree, ast.Name)}
    return tuple(_stands_on(_factors(tree), plain) for tree in trees)


def _stands_on(factors: Counter[str] | None, plain: Mapping[str, int]) -> tuple[int, ...]:
    if factors is None or factors.total() < 2:
        return ()
    return tuple(sorted(plain[name] for name in factors if name in plain))


def _factors(tree: ast.expr) -> Counter[str] | None:
    """Return the exponents of a monomial; None for anything else."""
    match tree:
        case ast.Name(id=name):
            return Counter({name: 1})
        case ast.Constant():
            return Counter()
        case ast.UnaryOp(operand=inner):
            return _factors(inner)
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return _product(_factors(left), _factors(right))
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int(power))) if power > 0:
            base = _factors(left)
            return None if base is None else Counter({n: e * power for n, e in base.items()})
    return None


def _product(a: Counter[str] | None, b: Counter[str] | None) -> Counter[str] | None:
    return None if a is None or b is None else a + b
