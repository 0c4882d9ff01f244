"""Aerodynamic terms: a line of text such as ``alpha^2`` or ``alpha*elevator``, never evaluated.

The text is parsed to Python's syntax tree and checked against a white list: numbers, known variables, ``+ - * /``,
whole powers from 0 to 6, and ``abs(...)``. The product of nested powers is at most 12, because powers of powers
multiply and a short text could otherwise fill the memory.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from stoop.errors import TermError

MAX_LENGTH, MAX_POWER, MAX_DEGREE = 200, 6, 12
STATE_VARIABLES = {
    "alpha": "angle of attack less its reference value, rad",
    "beta": "sideslip angle, rad",
    "p": "roll rate times span over twice the airspeed",
    "q": "pitch rate times chord over twice the airspeed",
    "r": "yaw rate times span over twice the airspeed",
    "V": "(airspeed - reference airspeed) / reference airspeed",
}  #: variables of a term, beside the controls
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


def parse(text: str, names: Iterable[str], where: str) -> ast.expr:
    """Parse a term and check it against the white list; a :class:`TermError` names `where`, file and key.

    `names` are the variables of the vehicle: :data:`STATE_VARIABLES` and its controls.
    """
    if len(text) > MAX_LENGTH:
        raise TermError(f"{where}: the term is longer than {MAX_LENGTH} characters; split it into several")
    try:
        tree = _tree(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise TermError(
            f"{where}: cannot read the term '{text}'; write it like alpha^2 or alpha*elevator"
        ) from None
    _check(tree, frozenset(names), where, text)
    # A value at some point, to find terms without one at any: 1e999, 1/0, 1/(alpha - alpha)
    try:
        value = float(convert(tree, {n: 0.37 + 0.11 * i for i, n in enumerate(sorted(variables(tree)))}))
    except ArithmeticError:
        value = math.nan
    if not math.isfinite(value):
        raise TermError(f"{where}: the term '{text}' has no finite value; look for a division by zero")
    return tree


def _tree(text: str) -> ast.expr:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Python's advice on odd literals is not for the user of a file
        return ast.parse(text.strip().replace("^", "**"), mode="eval").body


def written(text: str) -> str:
    """Return what terms that are written alike, but for blanks and the sign for powers, have in common."""
    return ast.dump(_tree(text))


def variables(tree: ast.expr) -> frozenset[str]:
    """Return the variables of a parsed term."""
    return frozenset(n.id for n in ast.walk(tree) if isinstance(n, ast.Name)) - {"abs"}


def _check(node: ast.expr, names: frozenset[str], where: str, text: str) -> None:
    match node:
        case ast.Constant(value=int() | float()) if not isinstance(node.value, bool):
            return
        case ast.Name(id=name):
            if name not in names:
                known = ", ".join(sorted(names))
                raise TermError(
                    f"{where}: unknown variable '{name}' in the term '{text}'; known are {known}, "
                    "and a control surface needs its table [controls.NAME]"
                )
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=operand):
            _check(operand, names, where, text)
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int(power))):
            if not 0 <= power <= MAX_POWER or isinstance(power, bool):
                raise TermError(
                    f"{where}: power {power} in '{text}'; whole powers from 0 to {MAX_POWER} are allowed"
                )
            _check(left, names, where, text)
            if power * _height(left) > MAX_DEGREE:
                raise TermError(f"{where}: powers in '{text}' multiply beyond {MAX_DEGREE}; lower them")
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div(), right=right):
            _check(left, names, where, text)
            _check(right, names, where, text)
        case ast.Call(func=ast.Name(id="abs"), args=[argument], keywords=[]):
            _check(argument, names, where, text)
        case _:
            raise TermError(
                f"{where}: the term '{text}' uses something that is not allowed; "
                "allowed are variables, numbers, + - * /, whole powers and abs()"
            )


def _height(node: ast.AST) -> int:
    """Return the largest product of nested powers."""
    inner = max((_height(child) for child in ast.iter_child_nodes(node)), default=1)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        return max(inner * int(node.right.value), 1)  # type: ignore[attr-defined]
    return inner


def convert(node: ast.expr, symbols: Mapping[str, Any]) -> Any:
    """Turn a checked syntax tree into an expression of the given symbols (SymPy's, or plain numbers)."""
    match node:
        case ast.Constant(value=value):
            return value
        case ast.Name(id=name):
            return symbols[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -convert(operand, symbols)
        case ast.UnaryOp(operand=operand):
            return convert(operand, symbols)
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=power)):
            return convert(left, symbols) ** power
        case ast.BinOp(left=left, op=op, right=right):
            return _BINARY[type(op)](convert(left, symbols), convert(right, symbols))
        case ast.Call(args=[argument]):
            return abs(convert(argument, symbols))
    raise AssertionError(f"unchecked node {node!r}")


def values(
    number: Callable[[str], Any], actual: bool, V: Any, alpha: Any, beta: Any, omega: Sequence[Any]
) -> dict[str, Any]:
    """Return the variables of terms, eq. (1), less the controls, as symbols or (n,) arrays.

    Parameters
    ----------
    number : callable
        Name of a number of the vehicle file -> value or symbol.
    actual : bool
        Rates are made dimensionless with the actual airspeed, not with the reference one.
    V, alpha, beta, omega : m/s, rad, rad/s
    """
    reference = number("reference.airspeed")
    speed = V if actual else reference
    span, chord = number("reference.span") / 2, number("reference.chord") / 2
    p, q, r = omega
    return {
        "alpha": alpha - number("reference.alpha"),
        "beta": beta,
        "p": (span / speed) * p,
        "q": (chord / speed) * q,
        "r": (span / speed) * r,
        "V": V / reference - 1,
    }


def parameter_name(coefficient: str, term: str, taken: Iterable[str] = ()) -> str:
    """Return the name of a term's parameter: ``CLalpha2`` for ``alpha^2``, ``Cmalphaelevator`` for a product."""
    base = (coefficient + re.sub(r"[^A-Za-z0-9]+", "", term.replace("^", "")))[:36]
    used, name, number = set(taken), base, 2
    while name in used:
        name, number = f"{base}_{number}", number + 1
    return name


def unit(text: str, controls: Iterable[str]) -> str:
    """Return the unit of a coefficient that multiplies this term: one over the angles in it."""
    tree = _tree(text)
    power = _angle_degree(tree, frozenset(controls) | {"alpha", "beta"})
    return "1" if power == 0 else "1/rad" if power == 1 else f"1/rad{power}"


def _angle_degree(node: ast.expr, angles: frozenset[str]) -> int:
    match node:
        case ast.Name(id=name):
            return int(name in angles)
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int(power))):
            return power * _angle_degree(left, angles)
        case ast.BinOp(left=left, op=ast.Mult() | ast.Div() as op, right=right):
            sign = 1 if isinstance(op, ast.Mult) else -1
            return _angle_degree(left, angles) + sign * _angle_degree(right, angles)
        case ast.BinOp(left=operand) | ast.UnaryOp(operand=operand) | ast.Call(args=[operand]):
            return _angle_degree(operand, angles)
    return 0
