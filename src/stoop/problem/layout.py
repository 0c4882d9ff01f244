"""The search vector: [free parameters in the unit box | nuisances in prior standard deviations].

Nuisances differ between maneuvers: initial states of each piece, sensor biases of each maneuver.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.vehicle import Parameter, Vehicle
from stoop.vehicle.schema import CHANNELS, WIND


@dataclass(frozen=True)
class Nuisance:
    """One nuisance: an initial state of a piece, or a sensor bias of a maneuver."""

    #: ``V`` ... ``psi`` (``u`` ... ``psi`` of a vehicle with rotors) or ``NAME.lag`` for an initial
    #: state, ``sensors.CHANNEL.bias`` for a bias
    name: str
    maneuver: int
    piece: int | None  #: the piece whose initial state it is; None for a bias
    center: float  #: SI, where its entry is zero
    scale: float  #: SI, its prior standard deviation: value = center + scale * entry

    @property
    def is_bias(self) -> bool:
        """Whether it adds to a reading."""
        return self.piece is None


@dataclass(frozen=True, eq=False)
class Layout:
    """The search vector of a vehicle and its maneuvers; D parameters, E nuisances."""

    vehicle: Vehicle
    parameters: tuple[Parameter, ...]
    nuisances: tuple[Nuisance, ...]

    @classmethod
    def of(cls, vehicle: Vehicle, nuisances: Sequence[Nuisance]) -> Layout:
        """Take the vehicle's free numbers as parameters, less sensor biases: those are nuisances."""
        biases = {f"sensors.{c}.bias" for c in (*WIND, *CHANNELS)}
        free = tuple(p for p in vehicle.parameters if p.free and p.name not in biases)
        return cls(vehicle, free, tuple(nuisances))

    @cached_property
    def dimension(self) -> int:
        """Number D of free parameters."""
        return len(self.parameters)

    @cached_property
    def extra(self) -> int:
        """Number E of nuisances."""
        return len(self.nuisances)

    @cached_property
    def lower(self) -> FloatArray:
        """Lower bounds (D,), SI."""
        return np.array([p.lower for p in self.parameters])

    @cached_property
    def width(self) -> FloatArray:
        """Width of the bounds (D,), SI."""
        return np.array([p.upper - p.lower for p in self.parameters])

    @cached_property
    def rows(self) -> NDArray[np.intp]:
        """Kernel row of each free parameter."""
        return np.array([self.vehicle.rows[p.name] for p in self.parameters], dtype=np.intp)

    @cached_property
    def scales(self) -> FloatArray:
        """SI size of one unit of each entry of the vector, (D + E,)."""
        return np.concatenate([self.width, [n.scale for n in self.nuisances]])

    def physical(self, Z: FloatArray) -> FloatArray:
        """Return free parameters (B, D) in SI for vectors (B, D + E) or their first D entries."""
        return np.asarray(self.lower + Z[:, : self.dimension] * self.width)

    def unit(self, values: FloatArray) -> FloatArray:
        """Return a point of the unit box for parameter values (D,) in SI."""
        return np.clip((values - self.lower) / self.width, 0.0, 1.0)

    @cached_property
    def priors(self) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
        """Entries with a prior, its mean and its standard deviation, in units of the vector."""
        some = [(i, p) for i, p in enumerate(self.parameters) if p.prior is not None]
        index = np.array([i for i, _ in some], dtype=np.intp)
        mean = np.array([(p.value - p.lower) / (p.upper - p.lower) for _, p in some])
        sigma = np.array([(p.prior or 1.0) / (p.upper - p.lower) for _, p in some])
        return index, mean, sigma

    def prior_residuals(self, Z: FloatArray) -> FloatArray:
        """Return the residuals of priors (B, n): parameters that have one, then every nuisance."""
        index, mean, sigma = self.priors
        return np.concatenate([(Z[:, index] - mean) / sigma, Z[:, self.dimension :]], axis=1)

    def prior_costs(self, X: FloatArray) -> FloatArray:
        """Return the cost of priors (B,) for parameters (B, D), nuisances at their start."""
        index, mean, sigma = self.priors
        return np.asarray(np.sum(((X[:, index] - mean) / sigma) ** 2, axis=1))

    def prior_jacobian(self) -> FloatArray:
        """Return the derivative of :meth:`prior_residuals`, (n, D + E)."""
        index, _, sigma = self.priors
        one = np.eye(self.dimension + self.extra)
        return np.concatenate([one[index] / sigma[:, None], one[self.dimension :]])
