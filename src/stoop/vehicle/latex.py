"""The coefficient equations as LaTeX, for the report."""

from __future__ import annotations

import ast
import re

from stoop.vehicle.latex_rotors import rotor_equations, rotor_symbols
from stoop.vehicle.vehicle import Vehicle

_GREEK = ("alpha", "beta", "phi", "theta", "psi")
_SURFACE = {"elevator": r"\delta_e", "aileron": r"\delta_a", "rudder": r"\delta_r"}
_FACTOR = {
    "alpha": r"\Delta\alpha",
    "beta": r"\beta",
    "p": r"\frac{p b}{2V}",
    "q": r"\frac{q \bar c}{2V}",
    "r": r"\frac{r b}{2V}",
    "V": r"\frac{V-V_*}{V_*}",
}


def coefficient_symbol(coefficient: str) -> str:
    """Return e.g. ``C_{L}`` or ``C_{l}``."""
    return f"C_{{{coefficient[1:]}}}"


def parameter_symbol(name: str, coefficient: str | None = None) -> str:
    r"""Return the LaTeX of a parameter's name, e.g. ``C_{L\alpha}`` for CLalpha."""
    if coefficient is None or not name.startswith(coefficient):
        return r"\mathrm{" + _plain(name) + "}"
    tail = "".join(_tail(part) for part in _parts(name[len(coefficient) :]))
    return f"C_{{{coefficient[1:]}{tail}}}"


def _parts(tail: str) -> list[str]:
    known = "|".join((*_GREEK, *_SURFACE))
    return [part for part in re.split(f"({known}|[0-9]+)", tail) if part]


def _tail(part: str) -> str:
    if part in _SURFACE:
        return " " + _SURFACE[part]
    if part in _GREEK:
        return f" \\{part}"
    if part.isdigit():
        return part if part == "0" else f"^{{{part}}}"
    return f" {_plain(part)}"


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9.]", " ", text)


def _term(node: ast.expr, starred: bool) -> str:
    """Return the LaTeX of a checked term."""
    match node:
        case ast.Constant(value=int() | float() as value):
            return f"{value:g}"
        case ast.Name(id=name):
            factor = _FACTOR.get(name) or _SURFACE.get(name) or r"\delta_{\mathrm{" + _plain(name) + "}}"
            return factor.replace("{2V}", "{2V_*}") if starred else factor
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return f"-{_term(operand, starred)}"
        case ast.UnaryOp(operand=operand):
            return _term(operand, starred)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return f"\\left({_term(left, starred)}\\right)^{{{_term(right, starred)}}}"
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return f"\\frac{{{_term(left, starred)}}}{{{_term(right, starred)}}}"
        case ast.BinOp(left=left, op=op, right=right):
            sign = {ast.Add: "+", ast.Sub: "-"}.get(type(op), r"\,")
            return f"{_term(left, starred)}{sign}{_term(right, starred)}"
        case ast.Call(args=[argument]):
            return f"\\left|{_term(argument, starred)}\\right|"
    raise AssertionError(f"unchecked node {node!r}")


def _product(name: str, coefficient: str, text: str, starred: bool) -> str:
    symbol = parameter_symbol(name, coefficient)
    tree = ast.parse(text.replace("^", "**"), mode="eval").body
    if isinstance(tree, ast.Constant) and tree.value == 1:
        return symbol
    body = _term(tree, starred)
    if isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Add | ast.Sub):
        body = f"\\left({body}\\right)"
    return f"{symbol}\\,{body}"


def equations(vehicle: Vehicle) -> tuple[str, ...]:
    """Return one equation per coefficient that the vehicle's kept equations contain, then those of its rotors."""
    starred = not vehicle.actual_rates
    out = []
    for coefficient, group in vehicle.terms.items() if vehicle.file.reference is not None else ():
        terms = " + ".join(_product(name, coefficient, text, starred) for name, text in group.items())
        out.append(f"{coefficient_symbol(coefficient)} = {terms or '0'}")
    return (*out, *rotor_equations(vehicle))


def symbols(vehicle: Vehicle) -> dict[str, str]:
    """Return the LaTeX symbol of every aerodynamic parameter, and of the numbers of rotors."""
    own = {name: parameter_symbol(name, c) for c, group in vehicle.terms.items() for name in group}
    return own | rotor_symbols(vehicle)
