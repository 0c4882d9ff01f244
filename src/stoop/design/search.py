"""D-optimal inputs: the search for the maneuver that tells most, by stoop's own optimizers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from threadpoolctl import threadpool_limits

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.design.setup import Forecast, Setup
from stoop.design.shapes import LEAD, SHAPES, Frame, Shape
from stoop.errors import SimulationError
from stoop.optimize.problem import ScalarProblem
from stoop.simulate import Maneuver

OUTSIDE: Final = 1e3  #: cost of leaving the envelope at all: every maneuver within it is better
SHORTEST_STEP: Final = 0.1  #: s
MARGIN: Final = (
    0.02  #: of an envelope's width that a design keeps away from its edge: forecasts have a coarser step
)
SEARCH_RATE: Final = 50.0  #: Hz; a short period needs no more, and a search takes half as long


@dataclass(frozen=True)
class Plan:
    """What to design.

    Attributes
    ----------
    duration : float, s
    rate : float, Hz
        Of the maneuver file.
    band : float, Hz
        Highest frequency of a multisine.
    optimizer : str
    evaluations : int
        Maneuvers tried for one family of inputs.
    seed : int
    """

    duration: float = 20.0
    rate: float = 100.0
    band: float = 2.0
    optimizer: str = "ps-gde"
    evaluations: int = 2000
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Design:
    """A maneuver and what it is expected to tell.

    Attributes
    ----------
    shape : str
    maneuver : Maneuver
    forecast : Forecast
        At the maneuver's own rate.
    gain : float
        See :meth:`stoop.design.Setup.gain`.
    evaluations : float
    """

    shape: str
    maneuver: Maneuver
    forecast: Forecast
    gain: float
    evaluations: float


@dataclass(frozen=True, eq=False)
class Uninformed(ScalarProblem):
    """Cost of a point of a family of inputs: minus what its maneuver tells; outside the envelope, how far."""

    setup: Setup
    shape: Shape
    plan: Plan

    @property
    def dimension(self) -> int:
        """Number of unknowns."""
        return self.shape.dimension

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return the costs (B,) of points (B, dimension)."""
        return np.array([self._cost(x) for x in X])

    def maneuver(self, x: FloatArray, rate: float) -> Maneuver:
        """Return the maneuver of a point, from the trim of the setup."""
        start = self.setup.trim.start
        said = {"duration": self.plan.duration, "rate": rate, "airspeed": start["V"], "altitude": start["h"]}
        return Maneuver.model_validate({**said, "input": self.shape.inputs(x)})

    def _cost(self, x: FloatArray) -> float:
        told = self.setup.forecast(self.maneuver(x, min(SEARCH_RATE, self.plan.rate)), only_inside=True)
        return OUTSIDE + told.excess if told.excess > 0.0 else -self.setup.gain(told)


def design(
    setup: Setup,
    plan: Plan,
    shape: str = "multisine",
    callback: Callable[[optimize.Progress], None] | None = None,
) -> Design:
    """Return the maneuver of a family that tells most about the parameters.

    Parameters
    ----------
    setup : Setup
    plan : Plan
    shape : str
        A name of :data:`stoop.design.SHAPES`.
    callback : callable, optional
        Sees an :class:`stoop.optimize.Progress` after each generation.

    Raises
    ------
    SimulationError
        No maneuver of the family stays within the envelope.
    """
    problem = Uninformed(_narrowed(setup), SHAPES[shape](_frame(setup, plan)), plan)
    stop = optimize.Stop(budget=float(plan.evaluations))
    optimizer = optimize.create(plan.optimizer, stop.budget)
    with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
        outcome = optimize.minimize(
            optimizer, problem, seed=plan.seed, starts=problem.shape.starts, stop=stop, callback=callback
        )
    if outcome.status == "interrupted":
        raise KeyboardInterrupt  # half a search is no design, and the families after it are not wanted either
    if not outcome.cost < OUTSIDE:
        raise SimulationError(
            f"design: no {shape} of these amplitudes stays within the envelope for {plan.duration:g} s; "
            "lower --amplitude, widen --within, or design for a shorter time"
        )
    maneuver = problem.maneuver(outcome.z, plan.rate)
    told = setup.forecast(maneuver)
    return Design(shape, maneuver, told, setup.gain(told), outcome.trajectories)


def one_after_another(setup: Setup, plan: Plan) -> Maneuver:
    """Return the textbook maneuver: a 3-2-1-1 on one control after the other.

    With steps as long as the time allows or half as long, whichever tells more. As large as a design may be, and
    smaller by common steps of 10 % only where it would leave the envelope.
    """
    rows = SHAPES["3-2-1-1"](_frame(setup, plan))
    problem = Uninformed(setup, rows, plan)
    inside = [found for start in rows.starts if (found := _largest(problem, start)) is not None]
    if not inside:
        raise SimulationError(
            f"design: even small 3-2-1-1 inputs leave the envelope within {plan.duration:g} s; "
            "lower --amplitude, widen --within, or design for a shorter time"
        )
    return max(inside, key=lambda maneuver: setup.gain(setup.forecast(maneuver)))


def _largest(problem: Uninformed, point: FloatArray) -> Maneuver | None:
    """Return the largest of a 3-2-1-1 that stays inside, if there is one."""
    for share in np.arange(1.0, 0.15, -0.1):
        sized = point.copy()
        sized[2::3] = 0.5 + 0.5 * share
        maneuver = problem.maneuver(sized, problem.plan.rate)
        if problem.setup.forecast(maneuver, only_inside=True).excess == 0.0:
            return maneuver
    return None


def _frame(setup: Setup, plan: Plan) -> Frame:
    limits = setup.limits
    if plan.duration <= 4.0 * LEAD:
        raise SimulationError(
            f"design: {plan.duration:g} s is too short; design for more than {4.0 * LEAD:g} s"
        )
    return Frame(dict(limits.amplitude), limits.slew, plan.duration, plan.band, SHORTEST_STEP)


def _narrowed(setup: Setup) -> Setup:
    """Return the setup with a margin kept from every edge of its envelope."""
    inner = {
        c: (low + MARGIN * (high - low), high - MARGIN * (high - low))
        for c, (low, high) in setup.limits.envelope.items()
    }
    return replace(setup, limits=replace(setup.limits, envelope=inner))
