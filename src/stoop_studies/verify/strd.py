"""Files of NIST's Statistical Reference Datasets, nonlinear regression: data, starts, certified values, and the model.

A file states its model as text (``y = b1*(1-exp[-b2*x])  +  e``). It is parsed to Python's syntax tree, checked against a
white list and turned into SymPy; it is never run as code.

References
----------
National Institute of Standards and Technology, Statistical Reference Datasets, https://www.itl.nist.gov/div898/strd/
"""

from __future__ import annotations

import ast
import operator
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import sympy as sp

from stoop.base.arrays import FloatArray
from stoop.errors import StoopError

PARAMETER_ROW: Final = re.compile(r"^\s*b(\d+) =\s+(\S+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.MULTILINE)
SUM_OF_SQUARES: Final = re.compile(r"^Residual Sum of Squares:\s+(\S+)\s*$", re.MULTILINE)
LEVEL: Final = re.compile(r"^\s*(Lower|Average|Higher) Level of Difficulty", re.MULTILINE)
MODEL: Final = re.compile(r"^Model:(.*?)^\s*Starting", re.MULTILINE | re.DOTALL)
EQUATION: Final = re.compile(r"^\s*((?:y|log\s*[\[(]\s*y\s*[\])])\s*=.*)\+\s*e\s*$", re.MULTILINE | re.DOTALL)
MAX_LENGTH, MAX_POWER = 1000, 12
LARGEST: Final = sp.Integer(10) ** 100
FUNCTIONS: Final[Mapping[str, Callable[[Any], Any]]] = {
    "exp": sp.exp,
    "log": sp.log,
    "sin": sp.sin,
    "cos": sp.cos,
    "arctan": sp.atan,
    "sqrt": sp.sqrt,
}
_BINARY: Final[Mapping[type[ast.operator], Callable[[Any, Any], Any]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}


class Model(NamedTuple):
    """A regression ``response = mean + e``."""

    mean: sp.Expr
    response: sp.Expr  #: of the measured `y`
    parameters: tuple[sp.Symbol, ...]  #: `b1`, `b2`, ...
    predictors: tuple[sp.Symbol, ...]  #: in the order of the columns; `x`, or `x1`, `x2`, ...


@dataclass(frozen=True, eq=False)
class Certified:
    """A problem as its file states it: two starts (2, p), certified values and standard deviations (p,), data.

    ``least`` is the certified residual sum of squares, ``y`` (n,) the response, ``x`` (m, n) the predictors.
    """

    name: str
    level: str
    model: Model
    starts: FloatArray
    values: FloatArray
    deviations: FloatArray
    least: float
    y: FloatArray
    x: FloatArray


def read_certified(path: Path) -> Certified:
    """Read a file; one that is not of this format is a StoopError."""
    try:
        text = path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise StoopError(f"{path}: cannot be read ({error}); fetch it again from NIST") from None
    try:
        found = PARAMETER_ROW.findall(text)
        rows = np.array([row[1:] for row in found], dtype=np.float64)
        (least,), (level,) = SUM_OF_SQUARES.findall(text)[:1], LEVEL.findall(text)[:1]
        lines = text[text.rindex("\nData:") :].splitlines()[2:]
        table = np.array([line.split() for line in lines if line.strip()], dtype=np.float64)
        starts, values, deviations = rows[:, :2].T, rows[:, 2], rows[:, 3]
        y, x = table[:, 0], table[:, 1:].T
        sound = np.isfinite(rows).all() and np.isfinite(table).all() and np.isfinite(float(least))
        if not sound or [row[0] for row in found] != [str(i + 1) for i in range(len(rows))]:
            raise ValueError
    except (ValueError, TypeError, IndexError):
        raise StoopError(
            f"{path}: is no nonlinear regression of NIST StRD; fetch it again from NIST, or take it out of the folder"
        ) from None
    if not len(rows) < len(y) or not len(x):
        raise StoopError(
            f"{path}: {len(y)} observations of {len(x)} predictors cannot determine {len(rows)} parameters; "
            "fetch it again from NIST"
        )
    model = _model(text, len(rows), len(x), path)
    return Certified(path.stem, level.lower(), model, starts, values, deviations, float(least), y, x)


def _model(text: str, parameters: int, predictors: int, path: Path) -> Model:
    """Return the model that a file states, of so many parameters and predictors."""
    block = MODEL.search(text)
    equation = EQUATION.search(block[1]) if block else None
    if equation is None:
        raise StoopError(
            f"{path}: states no model that can be read; it is written like y = b1*(1-exp[-b2*x])  +  e"
        )
    y = sp.Symbol("y", real=True)
    b = tuple(sp.Symbol(f"b{i + 1}", real=True) for i in range(parameters))
    x = tuple(sp.Symbol("x" if predictors == 1 else f"x{i + 1}", real=True) for i in range(predictors))
    left, _, right = " ".join(equation[1].split()).partition("=")
    try:
        response, mean = parse_formula(left, {"y": y}), parse_formula(right, {s.name: s for s in (*b, *x)})
        unused = [s.name for s in b if s not in mean.free_symbols]
        if unused:
            raise ValueError(f"it does not depend on {unused[0]}")
    except ValueError as error:
        raise StoopError(
            f"{path}: the model '{right.strip()[:80]}' cannot be used: {error}; fetch it again from NIST"
        ) from None
    return Model(mean, response, b, x)


def parse_formula(text: str, symbols: Mapping[str, sp.Symbol]) -> sp.Expr:
    """Return a formula of a file; brackets are round or square, and `pi` is known.

    Raises
    ------
    ValueError
        It is too long, cannot be read, or has something else than numbers, `symbols`, ``+ - * / **`` and `FUNCTIONS`.
    """
    if len(text) > MAX_LENGTH:
        raise ValueError(f"it is longer than {MAX_LENGTH} characters")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's advice on odd literals is not for the user of a file
            tree = ast.parse(text.strip().translate(str.maketrans("[]", "()")), mode="eval").body
        formula = _convert(tree, {**symbols, "pi": sp.pi})
    except (SyntaxError, TypeError, RecursionError, MemoryError):
        raise ValueError("it is no formula") from None
    if formula.has(sp.zoo, sp.nan, sp.oo, sp.I) or any(abs(n) > LARGEST for n in formula.atoms(sp.Number)):
        raise ValueError("it has no finite value")
    return formula


def _convert(node: ast.expr, symbols: Mapping[str, sp.Expr]) -> sp.Expr:
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return sp.Rational(str(value)) if abs(value) <= LARGEST else sp.oo
        case ast.Name(id=name) if name in symbols:
            return symbols[name]
        case ast.Name(id=name):
            raise ValueError(f"it names {name}, which is none of {', '.join(symbols)}")
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_convert(operand, symbols)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _convert(operand, symbols)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            base, other = _convert(left, symbols), _convert(right, symbols)
            if isinstance(op, ast.Pow):
                # what could be worked out at once could fill the memory
                if not (base.free_symbols or other.free_symbols):
                    raise ValueError("it has a power of numbers alone")
                if not other.free_symbols and not abs(float(other)) <= MAX_POWER:
                    raise ValueError(f"it has a power beyond {MAX_POWER}")
            return _BINARY[type(op)](base, other)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
            inner = _convert(argument, symbols)
            if not inner.free_symbols:
                raise ValueError(f"it has {name} of a number")
            return FUNCTIONS[name](inner)
    raise ValueError(f"it has something else than numbers, names, + - * / ** and {', '.join(FUNCTIONS)}")
