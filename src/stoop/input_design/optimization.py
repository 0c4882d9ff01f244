"""D-optimal maneuvers by stoop's own optimizers, their robustness to the model, and a proposal of what to fly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import Notice, notice
from stoop.base.schema_errors import first_complaint
from stoop.base.text import Summarized
from stoop.errors import SimulationError
from stoop.input_design.information import Forecast, Setup
from stoop.input_design.inputs import COUNTED_SHAPES, LEAD, SHAPES, USUAL_SHAPES, Frame, Shape, StepInputs
from stoop.optimize.problem import ScalarProblem
from stoop.problem.evidence import invert
from stoop.simulation.maneuver import Maneuver

OUTSIDE: Final = 1e3  #: cost of leaving the envelope at all: every maneuver within it is better
MIN_STEP: Final = 0.1  #: s
MARGIN: Final = 0.02  #: of an envelope's width to its edge: forecasts of the search have a coarser step
DRAWS: Final = 20  #: models with which the robustness of the best maneuver is computed
SEARCH_RATE: Final = 50.0  #: Hz; a short period needs no more, and a search takes half as long


@dataclass(frozen=True)
class Plan:
    """What to design: duration, s; rate of the maneuver file and highest frequency of a multisine, Hz; and the search.

    ``evaluations`` is the number of maneuvers tried for one family of inputs. With a ``beat``, s, a pilot flies steps that are
    counted aloud.
    """

    duration: float = 20.0
    rate: float = 100.0
    band: float = 2.0
    optimizer: str = "ps-gde"
    evaluations: int = 2000
    seed: int = 0
    beat: float | None = None


@dataclass(frozen=True, eq=False)
class Design:
    """An optimized maneuver, its forecast at its own rate, and its gain (:meth:`stoop.input_design.Setup.gain`)."""

    shape: str
    maneuver: Maneuver
    forecast: Forecast
    gain: float
    evaluations: float


@dataclass(frozen=True, eq=False)
class InformationCost(ScalarProblem):
    """Cost of a point of a family of inputs: minus the gain of its maneuver; outside the envelope, how far."""

    setup: Setup
    shape: Shape
    plan: Plan

    @property
    def dimension(self) -> int:
        """Number of unknowns."""
        return self.shape.dimension

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return the costs (B,) of points (B, dimension)."""
        # an autopilot on rotors needs the whole rate
        rate = min(SEARCH_RATE, self.plan.rate) if self.setup.trim.on_wings else self.plan.rate
        forecasts = [self.setup.forecast(self.maneuver(x, rate), only_inside=True) for x in X]
        return np.array([OUTSIDE + f.excess if f.excess > 0.0 else -self.setup.gain(f) for f in forecasts])

    def maneuver(self, x: FloatArray, rate: float) -> Maneuver:
        """Return the maneuver of a point, from the trim of the setup."""
        start = self.setup.trim.start
        flight = {"duration": self.plan.duration, "airspeed": start.get("V"), "altitude": start["h"]}
        document = {**flight, "rate": rate, "input": self.shape.inputs(x)}
        try:
            return Maneuver.model_validate(document)
        except ValidationError as error:
            raise SimulationError(
                f"design: no maneuver can be made of this: {first_complaint(error, document, Maneuver)}"
            ) from None


@on_one_blas_thread
def design(
    setup: Setup,
    plan: Plan,
    shape: str = "multisine",
    callback: Callable[[optimize.Progress], None] | None = None,
) -> Design:
    """Return the D-optimal maneuver of a family of inputs, a name of :data:`stoop.input_design.SHAPES`.

    The callback gets an :class:`stoop.optimize.Progress` after each generation.

    Raises
    ------
    SimulationError
        No maneuver of the family stays within the envelope, or it cannot be flown.
    """
    if plan.beat is not None and shape not in COUNTED_SHAPES:
        raise SimulationError(
            f"design: a pilot cannot fly a {shape} by a beat; choose --shape from {', '.join(COUNTED_SHAPES)}"
        )
    margins = {c: MARGIN * (high - low) for c, (low, high) in setup.limits.envelope.items()}
    inner = {c: (a + margins[c], b - margins[c]) for c, (a, b) in setup.limits.envelope.items()}
    searched = replace(setup, limits=replace(setup.limits, envelope=inner))
    problem = InformationCost(searched, SHAPES[shape](_frame(setup, plan)), plan)
    stop = optimize.Stop(budget=float(plan.evaluations))
    optimizer = optimize.create(plan.optimizer, stop.budget)
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
    try:
        setup.limits.check_flyable(maneuver)
    except SimulationError as error:
        raise SimulationError(f"design: the {shape} cannot be flown: {error}") from None
    forecast = setup.forecast(maneuver)
    return Design(shape, maneuver, forecast, setup.gain(forecast), outcome.trajectories)


def textbook_maneuver(setup: Setup, plan: Plan) -> Maneuver:
    """Return the textbook maneuver: a 3-2-1-1 on one control after the other.

    Steps are as long as the time allows or half as long, whichever has more information. It is as large as a design may
    be, and smaller by common steps of 10 % only where it would leave the envelope.
    """
    rows = StepInputs(_frame(setup, plan), "3-2-1-1")
    problem = InformationCost(setup, rows, plan)
    inside = []
    for point in rows.starts:
        for share in np.arange(1.0, 0.15, -0.1):
            point[2::3] = 0.5 + 0.5 * share
            maneuver = problem.maneuver(point, plan.rate)
            if setup.forecast(maneuver, only_inside=True).excess == 0.0:
                inside.append(maneuver)
                break
    if not inside:
        raise SimulationError(
            f"design: even small 3-2-1-1 inputs leave the envelope within {plan.duration:g} s; "
            "lower --amplitude, widen --within, or design for a shorter time"
        )
    return max(inside, key=lambda maneuver: setup.gain(setup.forecast(maneuver)))


def _frame(setup: Setup, plan: Plan) -> Frame:
    limits = setup.limits
    if plan.duration <= 4.0 * LEAD:
        raise SimulationError(
            f"design: {plan.duration:g} s is too short; design for more than {4.0 * LEAD:g} s"
        )
    return Frame(
        limits.amplitude, limits.slew, plan.duration, plan.band, MIN_STEP, limits.min_amplitude, plan.beat
    )


@dataclass(frozen=True)
class Robustness:
    """A maneuver flown with models drawn from the distribution of the parameters.

    Attributes
    ----------
    untrimmed : models without a trim at this speed
    outside : flights that left the envelope or diverged
    largest_excess : of flights that did not diverge, in widths of the envelope
    ratios : mean standard error over that of the reference maneuver, for each model that stayed inside
    """

    draws: int
    untrimmed: int
    outside: int
    largest_excess: float
    ratios: tuple[float, ...]

    @property
    def notice(self) -> Notice:
        """Return how many of the models left the envelope, with advice if any did."""
        if not self.outside:
            return notice("design-stays-inside", draws=self.draws)
        left = self.outside
        return notice("design-leaves-envelope", outside=left, draws=self.draws, excess=self.largest_excess)


def robustness(setup: Setup, maneuver: Maneuver, reference: Maneuver, draws: int, seed: int) -> Robustness:
    """Fly a maneuver and its reference with models drawn from the distribution of the parameters.

    A direction without information is not drawn: the model keeps its file's values there.
    """
    layout = setup.layout
    factor = invert(setup.known).factor * layout.width[:, None]
    noise = np.random.default_rng(seed).standard_normal((draws, factor.shape[1]))
    untrimmed, excesses, ratios = 0, [], []
    for values in setup.values + noise @ factor.T:
        try:
            other = setup.with_values(np.clip(values, layout.lower, layout.lower + layout.width))
        except SimulationError:
            untrimmed += 1
            continue
        forecast = other.forecast(maneuver, only_inside=True)
        excesses.append(forecast.excess)
        if forecast.excess == 0.0:
            ratios.append(mean_ratio(other.std(forecast), other.std(other.forecast(reference))))
    finite = [e for e in excesses if np.isfinite(e)]
    outside = sum(e > 0.0 for e in excesses)
    return Robustness(draws, untrimmed, outside, max(finite, default=0.0), tuple(ratios))


def mean_ratio(std: FloatArray, reference: FloatArray) -> float:
    """Return the mean of the ratios of two sets of standard errors, over the parameters that both determine."""
    both = np.isfinite(std) & np.isfinite(reference) & (reference > 0.0)
    return float(np.mean(std[both] / reference[both])) if both.any() else float("nan")


@dataclass(frozen=True, eq=False, repr=False)
class Proposal(Summarized):
    """What to fly next: one design per family, the best first, beside the textbook's maneuver.

    Attributes
    ----------
    reference : a 3-2-1-1 on one control after the other, of the same duration and amplitude
    expected : forecast of the reference
    robustness : of the best design
    refused : families of which no maneuver can be flown, and why
    source : where the knowledge of the model comes from
    """

    setup: Setup
    plan: Plan
    designs: tuple[Design, ...]
    reference: Maneuver
    expected: Forecast
    robustness: Robustness
    source: str
    refused: tuple[tuple[str, str], ...] = ()

    @property
    def best(self) -> Design:
        """The design with the most information."""
        return self.designs[0]

    @property
    def now(self) -> FloatArray:
        """Standard errors (D,) before the flight; infinite where nothing is known."""
        return self.setup.std()

    def ratio(self, of: Design) -> float:
        """Return the mean of a design's standard errors over the reference's."""
        return mean_ratio(self.setup.std(of.forecast), self.setup.std(self.expected))


def propose(
    setup: Setup,
    plan: Plan,
    shapes: Sequence[str] = (),
    callback: Callable[[str, Any], None] | None = None,
    source: str = "",
) -> Proposal:
    """Design the best maneuver of every family, and compare it with the textbook's and for other models.

    The maneuver begins at the trim. Families are names of :data:`stoop.input_design.SHAPES`, the usual ones when none are given;
    the callback gets the name and an :class:`stoop.optimize.Progress` after each generation; `source` says where the knowledge of
    the model comes from. A family of which no maneuver can be
    flown is left out.

    Raises
    ------
    SimulationError
        No maneuver of any family stays within the limits.
    """
    reference = textbook_maneuver(setup, plan)
    found, refused = [], []
    for name in shapes or (USUAL_SHAPES if plan.beat is None else COUNTED_SHAPES):
        try:
            found.append(design(setup, plan, name, None if callback is None else partial(callback, name)))
        except SimulationError as error:
            refused.append((name, str(error)))
    if not found:
        raise SimulationError(refused[0][1])
    designs = tuple(sorted(found, key=lambda one: -one.gain))
    robust = robustness(setup, designs[0].maneuver, reference, DRAWS, plan.seed)
    expected = setup.forecast(reference)
    return Proposal(setup, plan, designs, reference, expected, robust, source, tuple(refused))
