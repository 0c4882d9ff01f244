"""Equations of a model, as the compiler takes them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class SymbolicModel:
    """Equations of motion and of observation as SymPy expressions of plain symbols."""

    states: tuple[Any, ...]  #: symbols of which the expressions are made
    inputs: tuple[Any, ...]  #: symbols
    parameters: tuple[Any, ...]  #: symbols, constant along a trajectory
    derivatives: tuple[Any, ...]  #: time derivative of each state, SI
    outputs: tuple[Any, ...]  #: readings of the instruments
    output_names: tuple[str, ...]  #: registry names
    wrapped: tuple[bool, ...]  #: true for an angle on the whole circle: its residual is taken to (-pi, pi]
    held: tuple[int, ...] = ()  #: inputs that are constant from a sample to the next; all others are linear
    moves: tuple[Any, ...] = ()  #: symbols of a filter's error state; none for a model that no filter takes
    moved: tuple[Any, ...] = ()  #: each state after its correction by the error state
    latex: tuple[str, ...] = ()  #: the equations, kept beside the compiled code: a page then needs no SymPy
