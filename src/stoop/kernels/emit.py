"""SymPy expressions -> Python source of small functions on scalars.

What depends on parameters alone is taken out of the time loop: :func:`hoist` replaces every such
sub-expression, also a group of factors or summands, by a constant that is computed once per candidate.
Names in the source are made here (``x0``, ``u1``, ``c7``): no text of a user's file reaches it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

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
class Hoisted:
    """Expressions whose parameter-only parts have been named."""

    constants: tuple[tuple[Any, Any], ...]  #: (symbol, expression of the parameters alone)
    expressions: tuple[Any, ...]


class _Hoister:
    def __init__(self, parameters: Iterable[Any]) -> None:
        self.parameters = frozenset(parameters)
        self.names: dict[Any, Any] = {}
        self.memo: dict[Any, Any] = {}
        self.fixed: dict[Any, bool] = {}

    def constant(self, expr: Any) -> bool:
        if expr not in self.fixed:
            own = expr in self.parameters if expr.is_Symbol else all(map(self.constant, expr.args))
            self.fixed[expr] = own
        return self.fixed[expr]

    def name(self, expr: Any) -> Any:
        """Give a parameter-only expression a name, unless it is as cheap as one."""
        if expr.is_Number or expr.is_Symbol or (expr.is_Mul and -expr in self.parameters):
            return expr
        if expr not in self.names:
            self.names[expr] = sp.Symbol(f"h{len(self.names)}", real=True)
        return self.names[expr]

    def visit(self, expr: Any) -> Any:
        if expr in self.memo:
            return self.memo[expr]
        if self.constant(expr):
            out = self.name(expr)
        elif not (expr.is_Mul or expr.is_Add):
            out = expr.func(*map(self.visit, expr.args)) if expr.args else expr
        else:
            fixed = [a for a in expr.args if self.constant(a)]
            varying = [self.visit(a) for a in expr.args if not self.constant(a)]
            out = expr.func(*([self.name(expr.func(*fixed))] if fixed else []), *varying)
        self.memo[expr] = out
        return out


def hoist(expressions: Sequence[Any], parameters: Iterable[Any]) -> Hoisted:
    """Take what depends on the parameters alone out of the expressions."""
    hoister = _Hoister(parameters)
    moved = tuple(hoister.visit(sp.sympify(e)) for e in expressions)
    return Hoisted(tuple((symbol, expr) for expr, symbol in hoister.names.items()), moved)


def function_source(name: str, arguments: dict[str, Sequence[Any]], expressions: Sequence[Any]) -> str:
    """Write one inlined function of tuples that returns the tuple of the expressions."""
    lines = []
    used = set().union(*(e.free_symbols for e in expressions)) if expressions else set()
    for argument, symbols in arguments.items():
        lines += [f"{s} = {argument}[{i}]" for i, s in enumerate(symbols) if s in used]
    steps, results = sp.cse(list(expressions), sp.numbered_symbols("t"), order="none")
    lines += [f"{symbol} = {_PRINTER.doprint(expr)}" for symbol, expr in steps]
    lines.append(f"return ({''.join(f'{_PRINTER.doprint(e)}, ' for e in results)})")
    return f"def {name}({', '.join(arguments)}):\n" + "".join(f"    {line}\n" for line in lines)


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


def emit(model: SymbolicModel) -> Emitted:
    """Write ``prepare`` (once per candidate), ``derive`` and ``observe`` (in the time loop), and ``correct``."""
    equations = (*model.derivatives, *model.outputs)
    expressions, named = _renamed(equations, x=model.states, u=model.inputs, p=model.parameters)
    x, u, p = named["x"], named["u"], named["p"]
    hoisted = hoist(expressions, p)
    used = set().union(*(e.free_symbols for e in hoisted.expressions))
    direct = [(s, s) for s in p if s in used]
    constants = direct + [(s, e) for s, e in hoisted.constants if s in used]
    names = [s for s, _ in constants]
    arguments: dict[str, Sequence[Any]] = {"x": x, "u": u, "c": names}
    nx = len(x)
    functions = [
        HEADER,
        function_source("prepare", {"p": p}, [e for _, e in constants]),
        function_source("derive", arguments, hoisted.expressions[:nx]),
        function_source("observe", arguments, hoisted.expressions),
    ]
    if model.moves:
        after, arguments = _renamed(model.moved, x=model.states, d=model.moves)
        functions.append(function_source("correct", arguments, after))
    wrapped = tuple(map(int, model.wrapped))
    sizes = Sizes(nx, len(u), len(p), len(names), len(model.outputs), len(model.moves), model.held, wrapped)
    return Emitted("\n\n".join(functions), sizes, model.latex)
