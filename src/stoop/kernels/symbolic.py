"""The neutral description that a vehicle hands to the compiler."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class SymbolicModel:
    """Equations of motion and of observation as SymPy expressions of plain symbols.

    Attributes
    ----------
    states, inputs, parameters : tuple of sympy.Symbol
        What the expressions are made of; a parameter is constant along a trajectory.
    derivatives : tuple of sympy.Expr
        Time derivative of each state, SI.
    outputs : tuple of sympy.Expr
        What the instruments would read.
    output_names : tuple of str
        Registry name of each output.
    wrapped : tuple of bool
        True for an output that is an angle on the whole circle; its residual is taken to (-pi, pi].
    held : tuple of int
        Inputs that keep a sample's value until the next one; all others go in straight lines.
    moves : tuple of sympy.Symbol
        Numbers of a small move of the state, as a filter makes it; none for a model that no filter takes.
    moved : tuple of sympy.Expr
        Each state after the move.
    latex : tuple of str
        The equations as LaTeX, kept beside the compiled code: a page then needs no SymPy.
    """

    states: tuple[Any, ...]
    inputs: tuple[Any, ...]
    parameters: tuple[Any, ...]
    derivatives: tuple[Any, ...]
    outputs: tuple[Any, ...]
    output_names: tuple[str, ...]
    wrapped: tuple[bool, ...]
    held: tuple[int, ...] = ()
    moves: tuple[Any, ...] = ()
    moved: tuple[Any, ...] = ()
    latex: tuple[str, ...] = ()
