"""Methods of identification by name.

``fit(vehicle, flights, windows, options, callback, state) -> Estimate``
    Turns windows of flights into an estimate; `stoop.estimate.fit.estimation_problem` gives the problem.

    `callback` receives the state after each step, and a search resumes from `state`; regressions ignore both.

To add a method, write its function and its :class:`stoop.estimate.estimate.Estimate`, and add one row to `_METHODS`; packages
add theirs as rows of ``estimators`` (`stoop.base.packages`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from stoop.base.packages import PREFIX, made, resolved
from stoop.base.text import nearest
from stoop.errors import IdentificationError, StoopError

if TYPE_CHECKING:
    from stoop.estimate.estimate import Estimate
    from stoop.estimate.refit_problem import RefitProblem

DEFAULT: Final = "output-error"


@dataclass(frozen=True)
class Method:
    """One method; its function is imported when it is first used."""

    #: ``"module:function"`` of this room, or of a package; see the head of this module
    fit: str
    #: ``"module:class"``, the :class:`stoop.estimate.estimate.Estimate` that it returns
    estimate: str = "fit:OutputErrorEstimate"
    #: purpose, in a few words
    purpose: str = ""
    #: whether residuals are those of a simulation, whose likelihood posterior and profile show
    simulates: bool = True

    def fitter(self) -> Callable[..., Any]:
        """Return the function that fits."""
        found: Callable[..., Any] = _imported(self.fit)
        return found

    def estimates(self) -> type[Estimate]:
        """Return the class of its estimates."""
        found: type[Estimate] = _imported(self.estimate)
        return found


def _imported(place: str) -> Any:
    return resolved(place if place.startswith(PREFIX) else f"stoop.estimate.{place}")


FILTER: Final = "filter_error:FilterEstimate"
REGRESSION: Final = "regression.method:RegressionEstimate"
_METHODS: Final[dict[str, Method]] = {
    DEFAULT: Method("fit:fit", "fit:OutputErrorEstimate", "flights in calm air"),
    "filter-error": Method("filter_error:steady", FILTER, "flights in turbulence"),
    "filter-error-ekf": Method(
        "filter_error:varying", FILTER, "likewise, with a gain that follows large maneuvers"
    ),
    "stabilized-output-error": Method(
        "filter_error:stabilized",
        FILTER,
        "unstable vehicles in calm air: measurements keep the simulation near the record",
    ),
    "multiple-shooting": Method(
        "multiple_shooting:fit",
        "multiple_shooting:ShootingEstimate",
        "vehicles that are unstable or fly on rotors: short windows",
    ),
    "equation-error": Method(
        "regression.method:equation_error",
        REGRESSION,
        "a first look without a simulation: smoothed samples",
        False,
    ),
    "frequency-domain": Method(
        "regression.method:frequency_domain",
        REGRESSION,
        "likewise, on the Fourier coefficients of a band",
        False,
    ),
    "two-stage": Method(
        "two_stage:two_stage",
        REGRESSION,
        "aircraft: flight path first, then forces and moments along it",
        False,
    ),
}


@cache
def _methods() -> Mapping[str, Method]:
    """Return the methods of stoop and those of packages."""
    return _METHODS | made("estimators", "estimator", Method, _METHODS)


#: errors of arrays that are not those of an estimate
UNREADABLE: Final = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError)


def restore(name: str, arrays: Mapping[str, Any], where: str) -> Estimate:
    """Return the estimate of a method from its :meth:`stoop.estimate.estimate.Estimate.state`; `where` names its file.

    Raises
    ------
    IdentificationError
        The arrays are not those of an estimate of the method.
    """
    try:
        return find(name).estimates().restored(arrays)
    except (*UNREADABLE, StoopError) as error:
        raise IdentificationError(
            f"{where}: holds no estimate of {name or DEFAULT} that this version reads ({error}); fit again"
        ) from error


def refit_problem(kind: str) -> type[RefitProblem]:
    """Return the class of least-squares problems that has a name in packed problems."""
    problems = (method.estimates().refits for method in _methods().values())
    return next(one for one in problems if one.kind == kind)


def names() -> tuple[str, ...]:
    """Return the names of all methods."""
    return tuple(_methods())


def find(name: str) -> Method:
    """Return a method by its name, output error where none is named; an IdentificationError says that there is none."""
    found = _METHODS.get(str(name or DEFAULT)) or _methods().get(str(name))
    if found is None:
        raise IdentificationError(f"method '{name}': not known; {nearest(str(name), _methods())}")
    return found
