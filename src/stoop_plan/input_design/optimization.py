"""D-optimal maneuvers by stoop's own optimizers, their robustness to the model, and a proposal of what to fly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from stoop import Notice
from stoop.extend.arrays import FloatArray, on_one_blas_thread
from stoop.extend.errors import SimulationError
from stoop.extend.files import first_complaint
from stoop.extend.fits import invert, optimize
from stoop.extend.motion import Maneuver
from stoop.extend.notices import notice
from stoop.extend.text import Summarized
from stoop_plan.input_design.information import Forecast, Setup, forecasts
from stoop_plan.input_design.inputs import (
    COUNTED_SHAPES,
    LEAD,
    SHAPES,
    STEADY,
    USUAL_SHAPES,
    CountedSteps,
    Frame,
    Shape,
    StepInputs,
)

TEXTBOOK: Final = "textbook"  #: in place of a family, where the textbook's maneuver is proposed
OUTSIDE: Final = 1e3  #: cost of leaving the envelope at all: every maneuver within it is better
MIN_STEP: Final = 0.1  #: s
MARGIN: Final = 0.02  #: of an envelope's width to its edge: forecasts of the search have a coarser step
OPTIMIZERS: Final = ("ps-gde", "scipy-de")  #: of which the first that is installed is the default
DRAWS: Final = 20  #: models with which the robustness of the best maneuver is computed
SEARCH_RATE: Final = 50.0  #: Hz; a short period needs no more, and a search takes half as long


@dataclass(frozen=True)
class Plan:
    """What to design: duration, s; rate of the maneuver file and highest frequency of a multisine, Hz; and the search.

    ``evaluations`` is the number of maneuvers tried for one family of inputs. With a ``beat``, s, a pilot flies steps that are
    counted aloud, trimmed again before each row of them. ``textbook``: the textbook's maneuver may be what is proposed.
    """

    duration: float = 20.0
    rate: float = 100.0
    band: float = 2.0
    optimizer: str = field(default_factory=lambda: next(n for n in OPTIMIZERS if n in optimize.names()))
    evaluations: int = 2000
    seed: int = 0
    beat: float | None = None
    textbook: bool = True

    def __post_init__(self) -> None:
        """Refuse an optimizer that there is none of, or that needs residuals."""
        if optimize.needs_residuals(self.optimizer):
            raise SimulationError(
                f"design: {self.optimizer} needs residuals; choose --optimizer {' or '.join(OPTIMIZERS)}"
            )


@dataclass(frozen=True, eq=False)
class Design:
    """An optimized maneuver, its forecast at its own rate, and its gain (`information.Setup.gain`)."""

    shape: str
    maneuver: Maneuver
    forecast: Forecast
    gain: float
    evaluations: float


@dataclass(frozen=True, eq=False)
class InformationCost(optimize.ScalarProblem):
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
        found = forecasts([(self.setup, self.maneuver(x, rate)) for x in X], only_inside=True)
        return np.array([OUTSIDE + f.excess if f.excess > 0.0 else -self.setup.gain(f) for f in found])

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
    """Return the D-optimal maneuver of a family of inputs, a name of `inputs.SHAPES`.

    The callback gets an :class:`stoop.optimize.Progress` after each generation.

    Raises
    ------
    SimulationError
        No maneuver of the family stays within the envelope, or it cannot be flown.
    """
    _check_beat(plan, [shape])
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


def _check_beat(plan: Plan, shapes: Sequence[str]) -> None:
    """Refuse families of which a pilot can fly none by a beat."""
    if plan.beat is not None and not set(shapes) & set(COUNTED_SHAPES):
        raise SimulationError(
            f"design: a pilot cannot fly a {shapes[0]} by a beat; choose --shape from {', '.join(COUNTED_SHAPES)}"
        )


def textbook_maneuver(setup: Setup, plan: Plan) -> Maneuver:
    """Return the textbook maneuver: a 3-2-1-1 on one control after the other.

    Steps are as long as the time allows or half as long, whichever has more information; by a beat they are counted, and those of
    a shorter pattern where the time holds no 3-2-1-1. It is as large as a design may be, and smaller by common steps of 10 %
    only where it would leave the envelope.
    """
    rows = _textbook_rows(_frame(setup, plan))
    problem, each = InformationCost(setup, rows, plan), rows.dimension // len(setup.limits.amplitude)
    inside = []
    for point in rows.starts:
        for share in np.arange(1.0, 0.15, -0.1):
            point[each - 1 :: each] = 0.5 + 0.5 * share
            maneuver = problem.maneuver(point, plan.rate)
            forecast = setup.forecast(maneuver, only_inside=True)
            if forecast.excess == 0.0:
                inside.append((setup.gain(forecast), maneuver))
                break
    if not inside:
        raise SimulationError(
            f"design: even small 3-2-1-1 inputs leave the envelope within {plan.duration:g} s; "
            "lower --amplitude, widen --within, or design for a shorter time"
        )
    return max(inside, key=lambda one: one[0])[1]


def _textbook_rows(frame: Frame) -> StepInputs | CountedSteps:
    """Return the family of the textbook maneuver; by a beat the first that the time holds."""
    if frame.beat is None:
        return StepInputs(frame, "3-2-1-1")
    refused = []
    for pattern in COUNTED_SHAPES:
        rows = CountedSteps(frame, pattern, frame.beat)
        try:
            rows.inputs(rows.starts[0])
            return rows
        except SimulationError as error:
            refused.append(error)
    raise refused[0]


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
    ratios : size of the uncertainty over that of the reference maneuver, for each model that stayed inside
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

    A direction without information is not drawn: the model keeps its file's values there; without any, there are no draws.
    """
    layout = setup.layout
    factor = invert(setup.known).factor * layout.width[:, None]
    draws = draws if factor.any() else 0  # where nothing is known, nothing is drawn
    noise = np.random.default_rng(seed).standard_normal((draws, factor.shape[1]))
    models = []
    for values in setup.values + noise @ factor.T:
        with suppress(SimulationError):  # without a trim
            models.append(setup.with_values(np.clip(values, layout.lower, layout.lower + layout.width)))
    designed = forecasts([(model, maneuver) for model in models], only_inside=True)
    excesses = [one.excess for one in designed]
    inside = [(m, f) for m, f in zip(models, designed, strict=True) if f.excess == 0.0]
    compared = forecasts([(model, reference) for model, _ in inside])
    ratios = tuple(
        uncertainty_ratio(model, one, other) for (model, one), other in zip(inside, compared, strict=True)
    )
    finite = [e for e in excesses if np.isfinite(e)]
    outside = sum(e > 0.0 for e in excesses)
    return Robustness(draws, draws - len(models), outside, max(finite, default=0.0), ratios)


def uncertainty_ratio(setup: Setup, one: Forecast, other: Forecast) -> float:
    """Return the size of the uncertainty ellipsoid of a forecast over another's, per parameter: the criterion of a design."""
    return float(np.exp(setup.gain(other) - setup.gain(one)))


@dataclass(frozen=True, eq=False, repr=False)
class Proposal(Summarized):
    """What to fly next: one design per family, the best first, beside the textbook's maneuver.

    Designs with more information (`information.Setup.gain`) go first. Where none has more than the textbook's
    maneuver, that is the first, as the family :data:`TEXTBOOK`, unless it cannot be flown.

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
        """What is proposed."""
        return self.designs[0]

    @property
    def now(self) -> FloatArray:
        """Standard errors (D,) before the flight; infinite where nothing is known."""
        return self.setup.std()

    def ratio(self, of: Design) -> float:
        """Return the size of a design's uncertainty ellipsoid over the reference's, per parameter."""
        return uncertainty_ratio(self.setup, of.forecast, self.expected)

    @property
    def is_textbook(self) -> bool:
        """Whether the textbook's maneuver itself is proposed."""
        return self.best.shape == TEXTBOOK

    @property
    def is_improvement(self) -> bool:
        """Whether a design has more information than the textbook's maneuver."""
        return self.ratio(self.best) < 1.0


def propose(
    setup: Setup,
    plan: Plan,
    shapes: Sequence[str] = (),
    callback: Callable[[str, Any], None] | None = None,
    source: str = "",
) -> Proposal:
    """Design the best maneuver of every family, and compare it with the textbook's and for other models.

    The maneuver begins at the trim. Families are names of `inputs.SHAPES`, by default the usual ones;
    the callback gets the name and an :class:`stoop.optimize.Progress` after each generation, None in its place where a family,
    "textbook" or "robustness" begins; `source` says where the knowledge of the model comes from. A family of which no maneuver
    can be flown is left out.

    Raises
    ------
    SimulationError
        No maneuver of any family stays within the limits.
    """
    families = shapes or (USUAL_SHAPES if plan.beat is None else COUNTED_SHAPES)
    _check_beat(plan, families)
    if plan.beat is not None:
        setup = replace(setup, retrim=STEADY)
    told = callback or (lambda *_: None)
    told(TEXTBOOK, None)
    reference = textbook_maneuver(setup, plan)
    found, refused = list[Design](), []
    for name in families:
        told(name, None)
        try:
            found.append(design(setup, plan, name, partial(told, name)))
        except SimulationError as error:
            refused.append((name, str(error)))
    if not found:
        raise SimulationError(refused[0][1])
    expected = setup.forecast(reference)
    designs, base = sorted(found, key=lambda one: -one.gain), setup.gain(expected)
    if designs[0].gain <= base and plan.textbook:
        with suppress(SimulationError):
            setup.limits.check_flyable(reference)
            designs.insert(0, Design(TEXTBOOK, reference, expected, base, 0.0))
    told("robustness", None)
    robust = robustness(setup, designs[0].maneuver, reference, DRAWS, plan.seed)
    return Proposal(setup, plan, tuple(designs), reference, expected, robust, source, tuple(refused))
