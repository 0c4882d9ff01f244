"""What a report reads of a fitted model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from stoop.base.arrays import FloatArray
from stoop.results.result import AirDataTrace, ManeuverTrace, Quantity, Result


class Named(Protocol):
    """A vehicle as its name."""

    @property
    def name(self) -> str:
        """Name of the vehicle."""


class Model(Protocol):
    """A fitted model: `stoop.workflow.fitted_model.FittedModel`."""

    @property
    def vehicle(self) -> Named:
        """The vehicle."""

    @property
    def result(self) -> Result:
        """The numbers."""

    @property
    def traces(self) -> tuple[ManeuverTrace, ...]:
        """Measured and simulated readings of each of ``result.maneuvers``."""

    @property
    def equations(self) -> tuple[str, ...]:
        """Equations of the model as LaTeX."""

    @property
    def convergence(self) -> FloatArray:
        """Trajectories spent, and the best cost so far, (k, 2)."""

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of each channel and input; rad and rad/s are drawn in degrees."""

    @property
    def symbols(self) -> Mapping[str, str]:
        """LaTeX symbol of each number; the plain name is used where there is none."""

    @property
    def air_data(self) -> tuple[AirDataTrace, ...]:
        """Air data of each flight that they were reconstructed for."""

    @property
    def command(self) -> str:
        """Command line that fitted the model."""

    @property
    def body(self) -> Mapping[str, Quantity]:
        """Mass, inertia and reference values."""
