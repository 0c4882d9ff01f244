"""Equations of a model, as the compiler takes them."""

from __future__ import annotations

from dataclasses import dataclass, fields
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


@dataclass(frozen=True)
class Sizes:
    """Sizes of a model, and what a time loop has to know of its inputs and outputs."""

    states: int
    inputs: int
    parameters: int
    constants: int  #: that depend on the parameters alone
    outputs: int
    moves: int  #: components of the error state; zero where no filter takes the model
    forcings: int  #: forcing terms, which depend on inputs and parameters alone
    held: tuple[int, ...]  #: inputs that keep a sample's value until the next
    wrapped: tuple[int, ...]  #: 1 for an output that is an angle on the whole circle
    affine: tuple[int, ...]  #: forcing terms that are linear along a step, as inputs are
    seen: tuple[int, ...]  #: states that outputs depend on

    def text(self) -> str:
        """Return one line a field."""
        rows = (getattr(self, f.name) for f in fields(self))
        return "\n".join(" ".join(map(str, row if isinstance(row, tuple) else [row])) for row in rows)

    @classmethod
    def read(cls, text: str) -> Sizes:
        """Return the sizes of a text that :meth:`text` wrote."""
        rows = [tuple(int(word) for word in line.split()) for line in text.split("\n")]
        states, inputs, parameters, constants, outputs, moves, forcings = (number for (number,) in rows[:7])
        return cls(states, inputs, parameters, constants, outputs, moves, forcings, *rows[7:])
