"""The search vector: [free parameters in the unit box | nuisances in prior standard deviations].

Nuisances differ between maneuvers: initial states of each piece, sensor biases of each maneuver.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.vehicle import Parameter, Vehicle

#: of the mean of a prior by a factor; outside of the bounds no value counts as less
TINY: Final = 1e-6


@dataclass(frozen=True)
class Nuisance:
    """One nuisance: an initial state of a piece, or a sensor bias of a maneuver."""

    #: ``V`` ... ``psi`` (``u`` ... ``psi`` of a vehicle with rotors) or ``NAME.lag`` for an initial
    #: state, ``sensors.CHANNEL.bias`` for a bias
    name: str
    maneuver: int
    #: the piece whose initial state it is; None for a bias
    piece: int | None
    #: SI, where its entry is zero
    center: float
    #: SI, its prior standard deviation: value = center + scale * entry
    scale: float

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
    #: number D of free parameters
    dimension: int = field(init=False)
    #: number E of nuisances
    extra: int = field(init=False)
    #: lower bounds (D,), SI
    lower: FloatArray = field(init=False)
    #: width of the bounds (D,), SI
    width: FloatArray = field(init=False)
    #: kernel row of each free parameter
    rows: IntArray = field(init=False)
    #: SI size of one unit of each entry of the vector, (D + E,)
    scales: FloatArray = field(init=False)
    #: entries with a prior, its mean and its standard deviation, in units of the vector
    priors: tuple[IntArray, FloatArray, FloatArray] = field(init=False)
    #: places among them of priors by a factor
    by_factor: IntArray = field(init=False)

    @classmethod
    def of(cls, vehicle: Vehicle, nuisances: Sequence[Nuisance]) -> Layout:
        """Take the vehicle's free numbers as parameters, less sensor biases: those are nuisances."""
        return cls(vehicle, vehicle.free_parameters, tuple(nuisances))

    def __post_init__(self) -> None:
        lower = np.array([p.lower for p in self.parameters])
        width = np.array([p.upper - p.lower for p in self.parameters])
        index = np.array([i for i, p in enumerate(self.parameters) if p.prior is not None], dtype=np.intp)
        mean = np.array([self.parameters[i].prior_mean for i in index])
        sigma = np.array([self.parameters[i].prior or 1.0 for i in index])
        with np.errstate(divide="ignore", invalid="ignore"):  # without a width no parameter can be estimated
            priors = (index, (mean - lower[index]) / width[index], sigma / width[index])
        self.__dict__.update(
            dimension=len(self.parameters),
            extra=len(self.nuisances),
            lower=lower,
            width=width,
            rows=np.array([self.vehicle.rows[p.name] for p in self.parameters], dtype=np.intp),
            scales=np.concatenate([width, [n.scale for n in self.nuisances]]),
            priors=priors,
            by_factor=np.flatnonzero([self.parameters[i].by_factor for i in index]),
        )

    @property
    def start(self) -> FloatArray:
        """The vehicle's own values (D,) in the unit box."""
        return self.unit(np.array([p.value for p in self.parameters]))

    def physical(self, Z: FloatArray) -> FloatArray:
        """Return free parameters (B, D) in SI for vectors (B, D + E) or their first D entries."""
        return np.asarray(self.lower + Z[:, : self.dimension] * self.width)

    def values(self, z: FloatArray) -> dict[str, float]:
        """Return the free parameters, SI, by name for a vector (D + E,) or its first D entries."""
        found = self.physical(z[None, :])[0].tolist()
        return dict(zip((p.name for p in self.parameters), found, strict=True))

    def unit(self, values: FloatArray) -> FloatArray:
        """Return a point of the unit box for parameter values (D,) in SI."""
        return np.clip((values - self.lower) / self.width, 0.0, 1.0)

    def prior_residuals(self, Z: FloatArray) -> FloatArray:
        """Return the residuals of priors (B, n): parameters that have one, then every nuisance."""
        return np.concatenate([self._pulls(Z), Z[:, self.dimension :]], axis=1)

    def _pulls(self, Z: FloatArray) -> FloatArray:
        """Return the residuals of the parameters' priors (B, n); that of a factor is its logarithm."""
        index, mean, sigma = self.priors
        out, own = (Z[:, index] - mean) / sigma, self.by_factor
        if own.size:
            means, factors = self._factors(Z)
            out[:, own] = np.log(factors) * means / (self.width[index[own]] * sigma[own])
        return out

    def _factors(self, Z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the means (m,), SI, of priors by a factor, and the values (B, m) over them."""
        entries = self.priors[0][self.by_factor]
        lower, width = self.lower[entries], self.width[entries]
        means = lower + width * self.priors[1][self.by_factor]
        return means, np.maximum((lower + width * Z[:, entries]) / means, TINY)

    def prior_slopes(self, z: FloatArray) -> FloatArray:
        """Return the derivative (n,) of each parameter's prior residual by its entry, at a vector (D + E,) or its first D."""
        out, own = 1.0 / self.priors[2], self.by_factor
        if own.size:
            out[own] /= self._factors(z[None])[1][0]
        return out

    def prior_costs(self, X: FloatArray) -> FloatArray:
        """Return the cost of priors (B,) for parameters (B, D), nuisances at their start."""
        return np.asarray(np.sum(self._pulls(X) ** 2, axis=1))

    def prior_jacobian(self, z: FloatArray) -> FloatArray:
        """Return the derivative of :meth:`prior_residuals` at a vector (D + E,), (n, D + E)."""
        one = np.eye(self.dimension + self.extra)
        return np.concatenate([one[self.priors[0]] * self.prior_slopes(z)[:, None], one[self.dimension :]])
