"""A joint fit as a problem for any tool: equations in symbols, data, weights, unknowns; nothing of stoop is needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp

from stoop.base.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Case:
    """What is fitted: w maneuvers of n samples, each with n_q numbers, some of them common to all.

    Attributes
    ----------
    rates, readings, beginning : tuples of expressions
        Derivatives (n_x) and readings (n_y) of states ``x``, inputs ``u`` and numbers ``q``; the initial state (n_x) of ``q``.
    index : (w, n_q) array
        The unknown that each number of a maneuver depends on.
    center, scale : (w, n_q) arrays
        The numbers are ``center + scale * z[index]``, SI.
    inputs, measured : (w, n, n_u) and (w, n, n_y) arrays, SI
        Inputs are linear between samples.
    sigma : (n_y,) array
        Standard deviation of the noise.
    dt : float, s
        Sample period and step of the classical Runge-Kutta method.
    start : (D + E,) array
        Unknowns to start from.
    coefficients : int
        D: the others have a prior of mean zero and unit variance.
    """

    rates: tuple[sp.Expr, ...]
    readings: tuple[sp.Expr, ...]
    beginning: tuple[sp.Expr, ...]
    index: IntArray
    center: FloatArray
    scale: FloatArray
    inputs: FloatArray
    measured: FloatArray
    sigma: FloatArray
    dt: float
    start: FloatArray
    coefficients: int

    @staticmethod
    def printed(expressions: tuple[sp.Expr, ...], library: Any) -> Callable[..., Any]:
        """Return a function of indexable x, u, q in terms of a library, common sub-expressions taken out."""
        arguments = [sp.DeferredVector(name) for name in "xuq"]
        function: Callable[..., Any] = sp.lambdify(arguments, expressions, modules=library, cse=True)
        return function

    def numbers(self, z: FloatArray) -> FloatArray:
        """Return the numbers (w, n_q) of all maneuvers, SI, for unknowns (D + E,)."""
        return np.asarray(self.center + self.scale * z[self.index])


@dataclass(frozen=True)
class Found:
    """The end of a fit: unknowns (D + E,), iterations, and simulations of all maneuvers (tangents are not counted)."""

    z: FloatArray
    iterations: int
    simulations: int


@dataclass(frozen=True)
class Solver:
    """A tool made ready: the readings (w, n, n_y) that it simulates for unknowns, and the fit from the start."""

    simulate: Callable[[FloatArray], FloatArray]
    fit: Callable[[], Found]
