"""A proposal of what to fly: the best maneuver of each family, beside the textbook's, and its robustness."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from stoop.base.arrays import FloatArray
from stoop.input_design.information import Forecast, Knowledge, Setup
from stoop.input_design.inputs import SHAPES
from stoop.input_design.limits import Limits
from stoop.input_design.optimization import (
    Design,
    Plan,
    Robustness,
    design,
    mean_ratio,
    robustness,
    textbook_maneuver,
)
from stoop.simulation import Maneuver, Trim
from stoop.vehicle import Vehicle

DRAWS: Final = 20  #: models with which the robustness of the best maneuver is computed


@dataclass(frozen=True, eq=False)
class PriorModel:
    """A model and what is known of it before the flight.

    Attributes
    ----------
    vehicle : Vehicle
    knowledge : Knowledge
    noise : (n_y, n_y)
    source : str
        What they come from.
    """

    vehicle: Vehicle
    knowledge: Knowledge
    noise: FloatArray
    source: str


@dataclass(frozen=True, eq=False)
class Proposal:
    """What to fly next.

    Attributes
    ----------
    setup : Setup
    plan : Plan
    designs : tuple of Design
        One per family, the best first.
    reference : Maneuver
        The textbook's: a 3-2-1-1 on one control after the other, of the same duration and amplitude.
    expected : Forecast
        Of the reference.
    robustness : Robustness
        Of the best.
    source : str
        What is known of the model comes from there.
    """

    setup: Setup
    plan: Plan
    designs: tuple[Design, ...]
    reference: Maneuver
    expected: Forecast
    robustness: Robustness
    source: str

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
    model: PriorModel,
    trim: Trim,
    limits: Limits,
    plan: Plan,
    shapes: Sequence[str] = tuple(SHAPES),
    callback: Callable[[str, Any], None] | None = None,
) -> Proposal:
    """Design the best maneuver of every family, and compare it with the textbook's and for other models.

    Parameters
    ----------
    model : PriorModel
    trim : Trim
        Where it begins.
    limits : Limits
    plan : Plan
    shapes : sequence of str
        Names of :data:`stoop.input_design.SHAPES`.
    callback : callable, optional
        Called with the family's name and an :class:`stoop.optimize.Progress` after each generation.

    Raises
    ------
    SimulationError
        No maneuver stays within the limits.
    """
    setup = Setup(model.vehicle, trim, limits, model.knowledge, model.noise)
    reference = textbook_maneuver(setup, plan)
    watch = callback or (lambda name, progress: None)
    found = [design(setup, plan, name, lambda progress, name=name: watch(name, progress)) for name in shapes]  # type: ignore[misc]
    designs = tuple(sorted(found, key=lambda one: -one.gain))
    robust = robustness(setup, designs[0].maneuver, reference, DRAWS, plan.seed)
    return Proposal(setup, plan, designs, reference, setup.forecast(reference), robust, model.source)
