"""What assessments of a finished fit look at, and what they give back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from stoop.assess.estimate import Uncertainty
from stoop.assess.optimum import Optimum, linearize
from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.estimate.fit import Fit
from stoop.estimate.methods import DEFAULT
from stoop.problem import Misfit
from stoop.results.uncertainty import Interval, MethodIntervals
from stoop.workflow.errorbars import ErrorBars, error_bars

Watch = Callable[[str], None]  #: told how far an assessment is


@dataclass(frozen=True, eq=False)
class Case:
    """A finished output-error fit, ready to be assessed.

    Attributes
    ----------
    fit : Fit
    seed : int
        Of everything random.
    """

    fit: Fit
    seed: int

    @cached_property
    def bars(self) -> ErrorBars:
        """Error bars, for the noise behind the residuals and for what the data can tell."""
        with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
            return error_bars(self.fit, 1.0)

    @property
    def found(self) -> Uncertainty:
        """Covariances of the entries that no bound holds."""
        if self.bars.found is None:
            raise IdentificationError("the fit has no sensitivities to assess")
        return self.bars.found

    @property
    def free(self) -> NDArray[np.intp]:
        """Entries that no bound holds."""
        return np.flatnonzero(~self.bars.held)

    @cached_property
    def optimum(self) -> Optimum:
        """The fit's optimum, those at a bound held."""
        return linearize(self.fit.problem, self.fit.z, self.free)

    @property
    def names(self) -> list[str]:
        """Of the free parameters, in the order of the vector."""
        return [p.name for p in self.fit.problem.layout.parameters]

    @property
    def told(self) -> list[bool]:
        """Which parameters the data can tell; one at a bound is not told."""
        return [
            not held and self.bars.judged[name].identifiable
            for name, held in zip(self.names, self.bars.held, strict=False)
        ]


def case_of(fit: Fit, method: str, seed: int) -> Case:
    """Return what assessments look at.

    Raises
    ------
    IdentificationError
        The fit is of another method.
    """
    check_method(method)
    if not isinstance(fit.problem, Misfit) or fit.covariance is not None:
        raise IdentificationError("the fit is no simulation against measurements; assess an output-error fit")
    return Case(fit, seed)


def check_method(method: str) -> None:
    """Refuse a method whose fits cannot be assessed.

    Raises
    ------
    IdentificationError
        It is not output error.
    """
    if method not in ("", DEFAULT):
        raise IdentificationError(
            f"bootstrap, posterior and profile are of --method {DEFAULT}, not of {method}; leave them out, or name "
            f"--method {DEFAULT} for a vehicle that can be flown open loop"
        )


@dataclass(frozen=True)
class Finding:
    """What an assessment found.

    Attributes
    ----------
    spread : MethodIntervals
    files : mapping of str to bytes
        By name, to lie beside the result.
    """

    spread: MethodIntervals
    files: Mapping[str, bytes] = field(default_factory=dict)


class Assessment(Protocol):
    """One more way to state the uncertainty of a fit."""

    @property
    def name(self) -> str:
        """Key in ``result.uncertainty``."""

    def __call__(self, case: Case, watch: Watch) -> Finding:
        """Assess."""


def spreads(case: Case, std: FloatArray, lower: FloatArray, upper: FloatArray) -> dict[str, Interval]:
    """Return the spreads by name; a parameter that the data cannot tell gets no confident number.

    Parameters
    ----------
    case : Case
    std, lower, upper : (D,), SI
    """
    return {
        name: Interval(float(s), float(a), float(b)) if told else Interval()
        for name, told, s, a, b in zip(case.names, case.told, std, lower, upper, strict=True)
    }
