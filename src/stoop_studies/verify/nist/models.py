"""The models of NIST StRD, each written once; derivatives follow from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import sympy as sp

b1, b2, b3, b4, b5, b6, b7, b8, b9 = B = sp.symbols("b1:10", real=True)
x, x1, x2, y = sp.symbols("x x1 x2 y", real=True)

_EXPONENTIALS: Final = b1 * sp.exp(-b2 * x) + b3 * sp.exp(-b4 * x) + b5 * sp.exp(-b6 * x)
_GAUSSIANS: Final = (
    b1 * sp.exp(-b2 * x) + b3 * sp.exp(-((x - b4) ** 2) / b5**2) + b6 * sp.exp(-((x - b7) ** 2) / b8**2)
)
_CHWIRUT: Final = sp.exp(-b1 * x) / (b2 + b3 * x)


def _wave(period: sp.Expr, cosine: sp.Expr, sine: sp.Expr) -> sp.Expr:
    phase = 2 * sp.pi * x / period
    return cosine * sp.cos(phase) + sine * sp.sin(phase)


@dataclass(frozen=True)
class Model:
    """A regression: ``response = mean + e``.

    Attributes
    ----------
    mean : Expr
        Of `b1` to `b9` and the predictors.
    response : Expr
        Of what was measured, `y`.
    predictors : tuple of Symbol
        In the order of the columns.
    """

    mean: sp.Expr
    response: sp.Expr = y
    predictors: tuple[sp.Symbol, ...] = (x,)

    @property
    def parameters(self) -> tuple[sp.Symbol, ...]:
        """`b1` and so on."""
        return tuple(b for b in B if b in self.mean.free_symbols)


MODELS: Final[Mapping[str, Model]] = {
    "Chwirut1": Model(_CHWIRUT),
    "Chwirut2": Model(_CHWIRUT),
    "DanWood": Model(b1 * x**b2),
    "ENSO": Model(b1 + _wave(sp.Integer(12), b2, b3) + _wave(b4, b5, b6) + _wave(b7, b8, b9)),
    "Gauss1": Model(_GAUSSIANS),
    "Gauss2": Model(_GAUSSIANS),
    "Gauss3": Model(_GAUSSIANS),
    "Kirby2": Model((b1 + b2 * x + b3 * x**2) / (1 + b4 * x + b5 * x**2)),
    "Lanczos2": Model(_EXPONENTIALS),
    "Lanczos3": Model(_EXPONENTIALS),
    "MGH10": Model(b1 * sp.exp(b2 / (x + b3))),
    "MGH17": Model(b1 + b2 * sp.exp(-x * b4) + b3 * sp.exp(-x * b5)),
    "Misra1a": Model(b1 * (1 - sp.exp(-b2 * x))),
    "Misra1b": Model(b1 * (1 - (1 + b2 * x / 2) ** -2)),
    "Misra1c": Model(b1 * (1 - 1 / sp.sqrt(1 + 2 * b2 * x))),
    "Misra1d": Model(b1 * b2 * x / (1 + b2 * x)),
    "Nelson": Model(b1 - b2 * x1 * sp.exp(-b3 * x2), sp.log(y), (x1, x2)),
    "Rat42": Model(b1 / (1 + sp.exp(b2 - b3 * x))),
    "Roszman1": Model(b1 - b2 * x - sp.atan(b3 / (x - b4)) / sp.pi),
}  #: by the name of the file


@dataclass(frozen=True)
class Compiled:
    """Residuals and their exact derivatives as functions of (parameters, y, predictors)."""

    residual: Callable[..., Any]
    derivatives: tuple[Callable[..., Any], ...]


@cache
def compiled(name: str) -> Compiled:
    """Return the functions of a model."""
    model = MODELS[name]
    arguments = (model.parameters, y, *model.predictors)
    residual = model.mean - model.response
    derivatives = (sp.diff(residual, b) for b in model.parameters)
    return Compiled(
        sp.lambdify(arguments, residual, "numpy"),
        tuple(sp.lambdify(arguments, d, "numpy") for d in derivatives),
    )
