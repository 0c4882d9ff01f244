"""The estimate of a vehicle's free numbers, one interface for every estimator.

An estimator adds one class: it says which least-squares problem it solved near the estimate and which residuals,
sensitivities and information belong to it. Error bars, checks of the residuals, refits and predictions follow from these.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.estimate.fitted_filter import FittedFilter
from stoop.estimate.noise import noise_covariance, noise_variance
from stoop.estimate.refit_problem import RefitProblem
from stoop.estimate.response import Responses
from stoop.problem import Misfit, on_circle
from stoop.problem.archive import problem_arrays, problem_document, restored_problem
from stoop.problem.evidence import Evidence, Unknown, unknowns_of
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.results.decisions import DecisionRecord
from stoop.results.result import ProcessNoise
from stoop.vehicle import Vehicle

#: fields of an outcome that are no arrays
OUTCOME: Final = ("cost", "trajectories", "generation", "status", "advice", "optimizer")


@dataclass(frozen=True, eq=False)
class Estimate(ABC):
    """Estimates of the free numbers of a vehicle from windows of flights.

    A child adds the results of its estimator as fields, and derives everything else from them.
    ``numpy.savez(file, **estimate.state())`` saves an estimate and `stoop.estimate.methods.restore` restores it: error bars,
    bootstrap, profile and predictions of both have the same bits.
    """

    #: class of `refit_problem`
    refits: ClassVar[type[RefitProblem]]
    #: with which the fitted windows are simulated open loop
    problem: Misfit
    prepared: Prepared
    #: (D + E,), the optimum
    z: FloatArray
    #: of the search
    outcome: optimize.Outcome
    #: twice the negative logarithm of the posterior at the optimum, less its constant terms
    cost: float
    #: whole-trajectory equivalents, refinement included
    trajectories: float
    #: of the method, and of doubtful estimates, beside those of `prepared`
    notices: tuple[Notice, ...]
    #: of the noise, beside those of `prepared`
    decisions: tuple[DecisionRecord, ...] = field(default=(), kw_only=True)

    @property
    @abstractmethod
    def evidence(self) -> Evidence:
        """Residuals, sensitivities and prior information, for error bars."""

    @property
    @abstractmethod
    def refit_problem(self) -> RefitProblem:
        """The least-squares problem near the estimate."""

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The numbers that the estimator solved for, noise intensities last."""
        return unknowns_of(self.problem.layout, self.z)

    @property
    def estimates(self) -> dict[str, float]:
        """Free parameters, SI."""
        return self.problem.layout.values(self.z)

    @property
    def weighted_problem(self) -> Misfit:
        """The problem with its final weights and the noise of each maneuver."""
        return self.problem

    @property
    def white(self) -> FloatArray:
        """Unknowns (D + E,) by the weights of white noise, which are those of a search."""
        return self.z

    @property
    def start(self) -> dict[str, float]:
        """Values of the free parameters, SI, from which another search begins."""
        return self.problem.layout.values(self.white)

    @property
    def identified_vehicle(self) -> Vehicle:
        """The vehicle with its free numbers at their estimates; priors keep their means."""
        layout = self.problem.layout
        means = {p.name: {"mean": p.prior_mean} for p in layout.parameters if p.prior is not None}
        changes = {name: {"value": value, **means.get(name, {})} for name, value in self.estimates.items()}
        return layout.vehicle.with_numbers(changes)

    def state(self) -> dict[str, Any]:
        """Return arrays from which :meth:`restored` builds the same estimate, with the same bits, without the flights.

        They hold plain numbers, so that :func:`numpy.savez` and :func:`stoop.base.npz.read_arrays` keep them; the
        entry ``head`` is a JSON document in UTF-8. The state of the search, with which a search goes on, is not among them.
        """
        vehicle, outcome = self.problem.layout.vehicle, self.outcome
        numbers = vehicle.quantities
        limits = {p.name: numbers[p.name].bounds for p in vehicle.parameters}
        head = {
            "problem": problem_document(self.problem),
            "text": vehicle.text,
            "bounds": {name: pair for name, pair in limits.items() if pair is not None},
            "windows": [asdict(window) for window in self.prepared.windows],
            "prepared": [one.to_dict() for one in self.prepared.notices],
            "notices": [one.to_dict() for one in self.notices],
            "decisions": [(d.name, d.found, d.done) for d in (*self.prepared.decisions, *self.decisions)],
            "outcome": {n: getattr(outcome, n) for n in OUTCOME},
            "cost": self.cost,
            "trajectories": self.trajectories,
        }
        series = {f"recorded.{i}": p.measured for i, p in enumerate(self.prepared.pieces)}
        found = {"z": self.z, "outcome.z": outcome.z, "outcome.history": outcome.history}
        text = np.frombuffer(json.dumps(head).encode(), dtype=np.uint8)
        return {**problem_arrays(self.problem), **series, **found, **self.own_state(), "head": text}

    @classmethod
    def restored(cls, arrays: Mapping[str, Any]) -> Estimate:
        """Return the estimate of a :meth:`state`; evidence, refit problem, readings and predictor have the same bits.

        Raises
        ------
        KeyError, TypeError, ValueError
            The arrays are not those of such an estimate.
        """
        head = json.loads(arrays["head"].tobytes())
        problem, z = restored_problem(head["problem"], arrays), arrays["z"]
        limits = {name: {"bounds": tuple(pair)} for name, pair in head["bounds"].items()}
        vehicle = replace(problem.layout.vehicle, text=head["text"]).with_numbers(limits)
        problem = replace(problem, layout=replace(problem.layout, vehicle=vehicle))
        _check_sizes(problem, arrays)
        plain: dict[str, Any] = {"moved": (), "relative_noise": (), "interpolated": None}
        recorded = ((p, arrays[f"recorded.{i}"]) for i, p in enumerate(problem.pieces))
        pieces = tuple(replace(piece, measured=measured, **plain) for piece, measured in recorded)
        windows = tuple(Window(**one) for one in head["windows"])
        prepared = Prepared(windows, pieces, tuple(map(Notice.from_dict, head["prepared"])))
        history = arrays["outcome.history"]
        outcome = optimize.Outcome(z=arrays["outcome.z"], history=history, state=None, **head["outcome"])
        common = (problem, prepared, z, outcome, head["cost"], head["trajectories"])
        notices = tuple(map(Notice.from_dict, head["notices"]))
        records = head.get("decisions", ())
        taken = tuple(DecisionRecord(n, "applied", found, done) for n, found, done in records)
        own = cls.own_fields(problem, z, arrays)
        return cls.suited(problem)(*common, notices, **own, decisions=taken)

    def own_state(self) -> dict[str, Any]:
        """Return the arrays from which :meth:`own_fields` restores the fields of a child."""
        return {}

    @classmethod
    def own_fields(cls, problem: Misfit, z: FloatArray, arrays: Mapping[str, Any]) -> dict[str, Any]:
        """Return the fields that a child adds."""
        return {}

    @classmethod
    def suited(cls, problem: Misfit) -> type[Estimate]:
        """Return the class for a kind of vehicle."""
        return cls

    def observed_information(self, factor: FloatArray) -> FloatArray | None:
        """Return the Hessian (r, r) of half the cost along the columns of `factor` (f, r), changes of the free unknowns.

        None where only Gauss and Newton's is known.
        """
        return None

    def responses(self) -> Responses:
        """Return the first-order responses of the residuals to extensions of the vehicle."""
        return self.refit_problem.responses(self.z)

    @cached_property
    def readings(self) -> tuple[FloatArray, ...]:
        """Readings (n, n_y) of the model in each piece."""
        return simulated(self.problem, self.z)

    @property
    def residuals(self) -> list[FloatArray]:
        """Measured minus modeled readings (n, n_y) of each piece."""
        outputs = self.problem.layout.vehicle.outputs
        pairs = zip(self.problem.pieces, self.readings, strict=True)
        return [on_circle(piece.measured - y, outputs) for piece, y in pairs]

    @cached_property
    def measurement_noise(self) -> FloatArray:
        """Covariance (n_y, n_y) of the measurement noise; NaN for a channel that was never measured."""
        return noise_covariance(self.problem, self.residuals)

    @property
    def inflation(self) -> float:
        """Factor by which the variance in the weights exceeds that of the residuals, for their correlation."""
        return 1.0

    @property
    def correlation_time(self) -> float:
        """Residuals that say as much as one independent one, the median of the channels."""
        return self.inflation

    @property
    def white_evidence(self) -> Evidence:
        """The evidence by the weights of white noise, in which what a model leaves unexplained keeps its size."""
        return self.evidence

    @property
    def disagreement(self) -> FloatArray:
        """By how much estimates by other weights differ, per SI unit of the unknowns (k,); zero where only these are known."""
        return np.zeros(len(self.evidence.unknowns))

    @property
    def process_noise(self) -> ProcessNoise:
        """Process noise and gain of the filter, if there is one."""
        return ProcessNoise()

    @property
    def innovation_correlation(self) -> float:
        """Correlation of the innovations of neighboring samples; NaN without a filter."""
        return np.nan

    @property
    def predictor(self) -> FittedFilter | None:
        """The filter with which other windows are predicted from sample to sample; None without process noise."""
        return None

    def reading_slopes(self, index: int) -> FloatArray | None:
        """Return the derivatives (n, n_y, k) of the readings of a piece by the unknowns, per SI unit; None if unknown."""
        return np.asarray(self.problem.slopes(self.z, index)[1] / self.problem.layout.scales)

    def deviations(self, covariance: FloatArray) -> tuple[FloatArray, ...] | None:
        """Return standard deviations (n, n_y) of the fitted readings of each piece, measurement noise included.

        The `covariance` (k, k) of the unknowns, SI, is propagated linearly. NaN where a reading is not known; None where the
        derivatives of the readings are not.
        """
        k, found = len(covariance), []
        noise = np.nan_to_num(np.diag(self.measurement_noise))
        for i, piece in enumerate(self.problem.pieces):
            slopes = self.reading_slopes(i)
            if slopes is None:
                return None
            own = slopes[:, :, :k]
            with np.errstate(invalid="ignore", over="ignore"):
                variance = np.einsum("nyj,jk,nyk->ny", own, covariance, own, optimize=True)
                measured = noise * np.square(piece.relative_noise or 1.0)
                found.append(np.sqrt(np.maximum(variance, 0.0) + measured))
        return tuple(found)


def _check_sizes(problem: Misfit, arrays: Mapping[str, Any]) -> None:
    """Raise `ValueError` if arrays of a state do not have the sizes and the type that its problem gives them."""
    vehicle, weights, pieces = problem.layout.vehicle, problem.weights, problem.pieces
    channels, unknowns = len(vehicle.outputs), (problem.layout.dimension + problem.layout.extra,)
    expected = [(arrays["z"], unknowns), (arrays["outcome.z"], arrays["outcome.z"].shape[:1])]
    expected += [(matrix, (channels, channels)) for matrix in (weights.covariance, weights.root)]
    for i, p in enumerate(pieces):
        n = p.time.size
        sizes = ((p.time, (n,)), (p.inputs, (n, len(vehicle.inputs))))
        measured = ((x, (n, channels)) for x in (p.measured, p.whole, arrays[f"recorded.{i}"]))
        expected += [*sizes, *measured]
    ladder = [len(rung) == len(pieces) for rung in problem.ladder]
    steps = (0 < a <= p.time.size for rung in problem.ladder for a, p in zip(rung, pieces, strict=False))
    if not (
        pieces
        and ladder
        and all((*ladder, *steps))
        and all(p.time.size > 1 for p in pieces)
        and set(vehicle.measured) <= set(vehicle.held_channels)
        and all(x.shape == shape and x.dtype == np.float64 for x, shape in expected)
    ):
        raise ValueError("arrays of other sizes than its problem")


def simulated(problem: Misfit, z: FloatArray) -> tuple[FloatArray, ...]:
    """Return the readings (n, n_y) of each piece, simulated from its start."""
    return tuple(problem.outputs(z, i) for i in range(len(problem.pieces)))


def simulation_inflation(estimate: Estimate) -> float:
    """Return the median ratio of the variances in the weights to those of the residuals of the simulation."""
    problem = estimate.problem
    variance = noise_variance(problem, estimate.residuals)
    return float(np.median(np.diag(problem.weights.covariance) / variance))
