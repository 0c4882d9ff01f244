"""SymPy expressions -> JSBSim functions: trees of ``product``, ``sum``, ``quotient``, ``pow`` and ``abs``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import sympy as sp


def number(value: float) -> str:
    """Return a number as text that reads back as the same double."""
    return repr(float(value))


def leaf(tag: str, text: str) -> Element:
    """Return an element that holds text."""
    out = Element(tag)
    out.text = text
    return out


def value(x: float) -> Element:
    """Return a constant."""
    return leaf("value", number(x))


def prop(name: str) -> Element:
    """Return the value of a property."""
    return leaf("property", name)


def node(tag: str, *children: Element) -> Element:
    """Return an operation on its arguments; a sum or product of one is that one."""
    if tag in ("sum", "product") and len(children) == 1:
        return children[0]
    out = Element(tag)
    out.extend(children)
    return out


def function(name: str, body: Element, description: str = "") -> Element:
    """Return a named function: its value is the property of that name."""
    out = Element("function", {"name": name})
    if description:
        SubElement(out, "description").text = description
    out.append(body)
    return out


def convert(expr: Any, names: Mapping[Any, str]) -> Element:
    """Turn an expression into the element that computes it.

    Parameters
    ----------
    expr : SymPy expression of symbols, numbers, sums, products, whole or half powers and ``Abs``
    names : mapping of symbol to property

    Raises
    ------
    NotImplementedError
        A function that vehicle files cannot express.
    """
    expr = sp.sympify(expr)
    if expr.is_Symbol:
        return prop(names[expr])
    if expr.is_Number:
        return value(float(expr))
    if expr.is_Add:
        return node("sum", *(convert(a, names) for a in expr.args))
    if expr.is_Mul:
        return _product(expr, names)
    if expr.is_Pow:
        return _power(expr, names)
    if isinstance(expr, sp.Abs):
        return node("abs", convert(expr.args[0], names))
    raise NotImplementedError(f"{type(expr).__name__} has no form in JSBSim")


def _product(expr: Any, names: Mapping[Any, str]) -> Element:
    """Write what is below the line as a quotient, so that no reciprocal is rounded."""
    above, below = sp.fraction(expr)
    if below == 1:
        return node("product", *(convert(a, names) for a in expr.args))
    return node("quotient", convert(above, names), convert(below, names))


def _power(expr: Any, names: Mapping[Any, str]) -> Element:
    base, exponent = expr.args
    if exponent.is_negative:
        return node("quotient", value(1.0), convert(base**-exponent, names))
    return node("pow", convert(base, names), value(float(exponent)))
