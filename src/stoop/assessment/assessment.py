"""Assessments of a finished fit: further estimates of its uncertainty, by refits of the same problem.

An assessment is called with an `AssessedFit` and returns a `Finding`. The fit may be of any method whose residuals are those
of a simulation: of output error, of a filter (its innovations), or of windows. `pack` writes its problem as one text, which
is what a worker needs to refit it, wherever it runs.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np

from stoop.assessment.agreement import method_agreement
from stoop.assessment.error_bars import ErrorBars, Uncertainty, error_bars
from stoop.base.arrays import FloatArray, IntArray
from stoop.errors import IdentificationError
from stoop.estimate import methods
from stoop.estimate.filter_likelihood import FrozenFilter
from stoop.estimate.fit import Fit
from stoop.estimate.multiple_shooting import FollowingWindows
from stoop.problem import Layout, Misfit, Nuisance, Piece, Weights
from stoop.results.result import Result
from stoop.results.uncertainty import Interval, MethodIntervals
from stoop.vehicle import Parameter, Vehicle
from stoop.vehicle.schema import VehicleFile

Watch = Callable[[str], None]  #: receives the progress of an assessment
Refittable = Misfit | FrozenFilter | FollowingWindows
PIECE_ARRAYS: Final = ("time", "inputs", "measured")


@dataclass(frozen=True, eq=False)
class AssessedFit:
    """A finished fit, ready to be assessed.

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
        """Error bars, for the noise behind the residuals and for identifiability."""
        return error_bars(self.fit)

    @property
    def uncertainty(self) -> Uncertainty:
        """Covariances of the estimated unknowns that are at no bound.

        Raises
        ------
        IdentificationError
            The fit is a regression.
        """
        if self.bars.uncertainty is None:
            raise IdentificationError("the fit has no sensitivities to assess; it is a regression")
        return self.bars.uncertainty

    @cached_property
    def problem(self) -> Refittable:
        """The least-squares problem that refits solve."""
        found: Refittable = self.fit.problem if self.fit.local_problem is None else self.fit.local_problem()
        return found

    @property
    def free(self) -> IntArray:
        """Entries of the search vector that no bound holds."""
        return self.bars.free[self.bars.free < len(self.fit.z)]

    @property
    def names(self) -> list[str]:
        """Of the free parameters, in the order of the vector."""
        return [p.name for p in self.fit.problem.layout.parameters]

    def intervals(self, std: FloatArray, lower: FloatArray, upper: FloatArray) -> dict[str, Interval]:
        """Return the intervals by name from (D,) each, SI; none for a parameter at a bound or not identifiable."""
        judged, at_bound = self.bars.identifiability, self.bars.at_bound
        return {
            name: Interval(float(s), float(a), float(b))
            if not held and judged[name].identifiable
            else Interval()
            for name, held, s, a, b in zip(self.names, at_bound, std, lower, upper, strict=False)
        }

    def packed(self, more: Mapping[str, Any]) -> str:
        """Return the problem, its optimum and further arrays as text."""
        return pack(self.problem, {"z": self.fit.z, "free": self.free, **more})


def check_method(method: str) -> None:
    """Refuse a method whose fits cannot be assessed.

    Raises
    ------
    IdentificationError
        It is a regression.
    """
    if not methods.find(method).simulates:
        raise IdentificationError(
            f"bootstrap, posterior and profile refit a simulation, and --method {method} is a regression without one; "
            f"leave them out, or name --method {methods.DEFAULT}"
        )


@dataclass(frozen=True)
class Finding:
    """What an assessment found.

    Attributes
    ----------
    intervals : MethodIntervals
    files : mapping of str to bytes
        By name, to lie beside the result.
    """

    intervals: MethodIntervals
    files: Mapping[str, bytes] = field(default_factory=dict)


class Assessment(Protocol):
    """One more estimate of the uncertainty of a fit."""

    @property
    def name(self) -> str:
        """Key in ``result.uncertainty``."""

    def __call__(self, fit: AssessedFit, watch: Watch) -> Finding:
        """Assess."""


def assess(
    result: Result, fit: Fit, assessments: Sequence[Assessment], watch: Watch
) -> tuple[Result, dict[str, bytes]]:
    """Return the result with what the assessments found and which methods agree, and the files that they give.

    Raises
    ------
    IdentificationError
        The fit is of a method that cannot be assessed, or an extra is not installed.
    """
    check_method(result.method)
    assessed = AssessedFit(fit, result.seed)
    uncertainty, files = dict(result.uncertainty), dict[str, bytes]()
    for assessment in assessments:
        found = assessment(assessed, watch)
        uncertainty[assessment.name] = found.intervals
        files |= found.files
    agreement = method_agreement(result.parameters, uncertainty)
    return replace(result, uncertainty=uncertainty, trust=agreement), files


def simulated(problem: Refittable) -> Misfit:
    """Return layout, pieces and weights of a problem."""
    return problem if isinstance(problem, Misfit) else problem.problem


def pack(problem: Refittable, more: Mapping[str, Any]) -> str:
    """Return a problem, and arrays that belong to it, as text; the same problem gives the same text."""
    base = simulated(problem)
    arrays: dict[str, Any] = {
        f"{name}.{i}": getattr(piece, name) for i, piece in enumerate(base.pieces) for name in PIECE_ARRAYS
    }
    arrays |= {"covariance": base.weights.covariance, "root": base.weights.root, **more}
    kind = ""
    if not isinstance(problem, Misfit):
        arrays, kind = arrays | problem.arrays, problem.kind
    arrays["head"] = np.frombuffer(json.dumps(_head(base, kind)).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return base64.b64encode(buffer.getvalue()).decode()


def unpack(text: str) -> tuple[Refittable, dict[str, Any]]:
    """Return the problem that was packed, and all arrays."""
    with np.load(io.BytesIO(base64.b64decode(text)), allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    head = json.loads(arrays.pop("head").tobytes())
    vehicle = Vehicle(VehicleFile.model_validate(head["vehicle"]), "", head["where"])
    parameters = tuple(Parameter(**p) for p in head["parameters"])
    layout = Layout(vehicle, parameters, tuple(Nuisance(**n) for n in head["nuisances"]))
    weights = Weights(arrays["covariance"], arrays["root"])
    pieces = tuple(
        Piece(
            p["maneuver"],
            arrays[f"time.{i}"],
            arrays[f"inputs.{i}"],
            arrays[f"measured.{i}"],
            p["start"],
            p["changes"],
        )
        for i, p in enumerate(head["pieces"])
    )
    misfit = Misfit(layout, pieces, weights, tuple(tuple(rung) for rung in head["ladder"]))
    if head["kind"] == "filter":
        return FrozenFilter.restored(misfit, arrays), arrays
    return (FollowingWindows.restored(misfit, arrays) if head["kind"] == "windows" else misfit), arrays


def _head(problem: Misfit, kind: str) -> dict[str, Any]:
    """Return what is no array; the vehicle without bounds: the layout has them, and a set value may lie outside."""
    layout = problem.layout
    unbounded = layout.vehicle.with_numbers({p.name: {"bounds": None} for p in layout.vehicle.parameters})
    return {
        "vehicle": unbounded.file.model_dump(mode="json", exclude_unset=True),
        "where": layout.vehicle.where,
        "parameters": [asdict(p) for p in layout.parameters],
        "nuisances": [asdict(n) for n in layout.nuisances],
        "pieces": [
            {"maneuver": p.maneuver, "start": dict(p.start), "changes": dict(p.changes)}
            for p in problem.pieces
        ],
        "ladder": problem.ladder,
        "kind": kind,
    }
