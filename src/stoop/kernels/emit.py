"""SymPy expressions -> Python source of small functions on scalars.

What depends on parameters alone is a constant, which is computed once per candidate (``prepare``); what depends on inputs
besides is a forcing term, which is computed once per sample (``forcing``). Sums and products of the rest are rewritten for
few operations (:mod:`stoop.kernels.algebra`, :mod:`stoop.kernels.rewriting`) and written out without repetition
(:mod:`stoop.kernels.listing`). Names in the source are made here (``x0``, ``u1``, ``h7``): no text of a user's file reaches it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from stoop.kernels.algebra import ONE, Algebra, Product
from stoop.kernels.listing import Listing
from stoop.kernels.rewriting import Rewriter
from stoop.kernels.symbolic import Sizes, SymbolicModel

HEADER = "from numpy import absolute as fabs, arctan2 as atan2, sqrt"  #: where the functions take arrays


class _Printer(PythonCodePrinter):  # type: ignore[misc]
    """Prints only what the runtime header provides."""

    def _print_Pow(self, expr: Any) -> str:
        base, exponent = expr.args
        twice = 2 * exponent
        if not twice.is_Integer:
            raise NotImplementedError(f"power {exponent} has no vector form")
        factors = [self.parenthesize(base, 1000)] * (abs(int(twice)) // 2)
        if int(twice) % 2:
            factors.append(f"sqrt({self._print(base)})")
        magnitude = "(" + "*".join(factors) + ")"
        return f"(1.0/{magnitude})" if twice < 0 else magnitude

    def _print_atan2(self, expr: Any) -> str:
        return f"atan2({self._print(expr.args[0])}, {self._print(expr.args[1])})"

    def _print_atan(self, expr: Any) -> str:
        # SymPy turns atan2 into this one where it knows that x is positive.
        return f"atan2({self._print(expr.args[0])}, 1.0)"

    def _print_Abs(self, expr: Any) -> str:
        return f"fabs({self._print(expr.args[0])})"

    def _print_Float(self, expr: Any) -> str:
        return repr(float(expr))

    def _print_Integer(self, expr: Any) -> str:
        return repr(float(expr))

    def _print_Rational(self, expr: Any) -> str:
        return repr(float(expr))


_PRINTER = _Printer({"fully_qualified_modules": False})


def scalar_text(expr: Any) -> str:
    """Return an expression as Python, which is C as well: arithmetic, ``sqrt``, ``fabs`` and ``atan2`` of doubles."""
    text: str = _PRINTER.doprint(expr)
    return text


@dataclass(frozen=True)
class Emitted:
    """Source of the model's functions, importable where they take arrays, and sizes of the model."""

    source: str
    sizes: Sizes
    latex: tuple[str, ...] = ()


_KNOWN = (sp.Symbol, sp.Float, sp.Rational, sp.Add, sp.Mul, sp.Pow, sp.atan2, sp.atan, sp.Abs)


def _renamed(
    expressions: Sequence[Any], **symbols: Sequence[Any]
) -> tuple[list[Any], dict[str, Sequence[Any]]]:
    """Return expressions of symbols named by a letter and a number, and those symbols.

    What the runtime header has no function for is refused here, rather than deep inside the compiler.
    """
    new = {p: [sp.Symbol(f"{p}{i}", real=True) for i in range(len(old))] for p, old in symbols.items()}
    done = {old: s for p, many in symbols.items() for old, s in zip(many, new[p], strict=True)}

    def rename(expr: Any) -> Any:
        if expr not in done:  # once each: written out as trees, expressions have many times as many nodes
            if not isinstance(expr, _KNOWN):
                raise NotImplementedError(f"{type(expr).__name__} has no vector form")
            done[expr] = expr.func(*map(rename, expr.args)) if expr.args else expr
        return done[expr]

    renamed = [rename(sp.sympify(e)) for e in expressions]
    return renamed, dict(new)


class _Constants:
    """The coefficients that functions take, in the order of their first use."""

    def __init__(self, algebra: Algebra) -> None:
        self.defined = {symbol: expr for expr, symbol in algebra.constants.items()}
        self.names: dict[Any, str] = {}  #: of a coefficient
        self._same: dict[Any, Any] = {}  #: coefficient of parameters alone -> the first that was asked for

    def name(self, coefficient: Any) -> str:
        """Return the name of a coefficient."""
        first = self._same.setdefault(coefficient.xreplace(self.defined), coefficient)
        own = str(first) if first.is_Symbol else f"k{len(self.names)}"
        return self.names.setdefault(first, own)

    def source(self, parameters: Sequence[Any]) -> str:
        """Write the function of the parameters that computes them."""
        needed: dict[Any, None] = {}
        for coefficient in self.names:
            needed |= dict.fromkeys(s for s in self.defined if s in coefficient.free_symbols)
        steps, results = sp.cse([self.defined[s] for s in needed], sp.numbered_symbols("t"), order="none")
        read = (*(self.defined[s] for s in needed), *self.names)
        used = set().union(*(expr.free_symbols for expr in read))
        steps += list(zip(needed, results, strict=True))
        lines = [f"{s} = p[{i}]" for i, s in enumerate(parameters) if s in used]
        lines += [f"{symbol} = {scalar_text(expr)}" for symbol, expr in steps]
        lines.append(f"return ({''.join(f'{scalar_text(c)}, ' for c in self.names)})")
        return _function("prepare(p)", lines)


def _function(head: str, lines: Iterable[str]) -> str:
    return f"def {head}:\n" + "".join(f"    {line}\n" for line in lines)


@dataclass(frozen=True)
class _TimeLoop:
    """The functions of the time loop, which share nodes and constants."""

    algebra: Algebra
    constants: _Constants

    def function(self, name: str, roots: Sequence[Product], **arguments: Sequence[int]) -> str:
        """Write a function of tuples of nodes, and of the constants, that returns the tuple of some products."""
        places = {n: (f"{a}{i}", f"{a}[{i}]") for a, nodes in arguments.items() for i, n in enumerate(nodes)}
        listing = Listing(self.algebra, {n: own for n, (own, _) in places.items()}, self.constants.name)
        lines = listing.source(roots)
        entries = dict(places.values())
        entries |= {own: f"c[{i}]" for i, own in enumerate(self.constants.names.values())}
        lines[:0] = [f"{own} = {entry}" for own, entry in entries.items() if own in listing.used]
        return _function(f"{name}({', '.join([*arguments, 'c'])})", lines)


def emit(model: SymbolicModel) -> Emitted:
    """Write ``prepare`` (once per candidate), ``forcing`` (once per sample), ``derive``, ``observe`` and ``correct``."""
    equations = (*model.derivatives, *model.outputs)
    expressions, named = _renamed(equations, x=model.states, u=model.inputs, p=model.parameters)
    x, u, p = named["x"], named["u"], named["p"]
    algebra = Algebra(p)
    rewriter = Rewriter(algebra, [algebra.product(e) for e in expressions])
    rewriter.run()
    forced = rewriter.separate(u)
    roots, states, inputs = rewriter.products(rewriter.root), *(list(map(algebra.node, s)) for s in (x, u))
    loop = _TimeLoop(algebra, _Constants(algebra))
    functions = [
        loop.function("forcing", [(ONE, ((node, 2),)) for node in forced], u=inputs),
        loop.function("derive", roots[: len(x)], x=states, w=forced),
        loop.function("observe", roots, x=states, w=forced),
    ]
    sizes = Sizes(
        states=len(x),
        inputs=len(u),
        parameters=len(p),
        constants=len(loop.constants.names),
        outputs=len(model.outputs),
        moves=len(model.moves),
        forcings=len(forced),
        held=model.held,
        wrapped=tuple(map(int, model.wrapped)),
        affine=tuple(i for i, node in enumerate(forced) if rewriter.affine(node, inputs)),
        seen=rewriter.seen(states),
    )
    functions += [_correct(model)] if model.moves else []
    return Emitted("\n\n".join([HEADER, loop.constants.source(p), *functions]), sizes, model.latex)


def _correct(model: SymbolicModel) -> str:
    """Write the correction of the states by the error state, which has numbers but no constants."""
    after, named = _renamed(model.moved, x=model.states, d=model.moves)
    algebra = Algebra(())
    moved = Rewriter(algebra, [algebra.product(e) for e in after]).run()
    nodes = {letter: list(map(algebra.node, symbols)) for letter, symbols in named.items()}
    return _TimeLoop(algebra, _Constants(algebra)).function("correct", moved, **nodes)
