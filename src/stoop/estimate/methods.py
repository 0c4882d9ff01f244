"""Methods of identification by name.

``fit(vehicle, flights, windows, options, callback, state) -> Estimate``
    Turns windows of flights into an estimate; `stoop.estimate.fit.estimation_problem` gives the problem.

    `callback` receives the state after each step, and a search resumes from `state`; regressions ignore both.

To add a method, write its function and its :class:`stoop.estimate.estimate.Estimate`, and add one row of ``estimators`` to
``data/verbs.toml``; packages have theirs in ``stoop.toml`` (`stoop.base.packages`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from stoop.base.packages import guarded, made, resolved
from stoop.base.text import nearest
from stoop.errors import IdentificationError, StoopError

if TYPE_CHECKING:
    from stoop.estimate.estimate import Estimate
    from stoop.estimate.refit_problem import RefitProblem

DEFAULT: Final = "output-error"


@dataclass(frozen=True)
class Method:
    """One method; its function is imported when it is first used."""

    #: ``"module:function"``; see the head of this module
    fit: str
    #: ``"module:class"``, the :class:`stoop.estimate.estimate.Estimate` that it returns
    estimate: str = "stoop.estimate.fit:OutputErrorEstimate"
    #: purpose, in a few words
    purpose: str = ""
    #: whether residuals are those of a simulation, whose likelihood posterior and profile show
    simulates: bool = True

    def fitter(self) -> Callable[..., Any]:
        """Return the function that fits."""
        from stoop.estimate.estimate import Estimate

        return guarded(self.fit, Estimate)

    def estimates(self) -> type[Estimate]:
        """Return the class of its estimates."""
        return resolved(self.estimate)  # type: ignore[no-any-return]


@cache
def _methods() -> Mapping[str, Method]:
    """Return the methods of stoop and those of packages."""
    return made("estimators", Method)


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
    found = _methods().get(str(name or DEFAULT))
    if found is None:
        raise IdentificationError(f"method '{name}': not known; {nearest(str(name), _methods())}")
    return found
