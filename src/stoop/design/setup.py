"""What a maneuver will tell before it is flown: its readings, and the information in them.

The information is Fisher's for the readings of a flight from trim with the sensors' noise, the initial state and
the biases unknown; what is known already adds to it.

References
----------
V. Klein, E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., 2016, chapter 9
(experiment design). V. V. Fedorov, *Theory of Optimal Experiments*, Academic Press, 1972 (D-optimality).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stoop.assess.covariance import invert, marked, standard_errors
from stoop.base.arrays import FloatArray
from stoop.design.knowledge import Knowledge
from stoop.design.limits import Limits
from stoop.errors import IdentificationError
from stoop.problem import Layout, Misfit, Piece, Weights
from stoop.problem.prepare import Prepared, nuisances
from stoop.problem.windows import Window
from stoop.simulate import Maneuver, Trim
from stoop.simulate.fly import flown_inputs
from stoop.vehicle import Vehicle

BOX = 12.0  #: information of a number that is only known to lie in the unit box: one over its variance


@dataclass(frozen=True, eq=False)
class Forecast:
    """What a maneuver would show.

    Attributes
    ----------
    readings : (n, n_y)
        Without noise; not finite where the flight diverges.
    excess : float
        By how much they leave the envelope, in its widths; infinite for a flight that diverges.
    information : (D, D)
        About the parameters in the unit box, everything else unknown; without what is known already.
    """

    readings: FloatArray
    excess: float
    information: FloatArray


@dataclass(frozen=True, eq=False)
class Setup:
    """A vehicle in steady flight, what may be done with it, and what is known of it.

    Attributes
    ----------
    vehicle : Vehicle
        Its free numbers are the parameters; their values are those that the design believes.
    trim : Trim
    limits : Limits
    knowledge : Knowledge
    noise : (n_y, n_y)
        Covariance of the measurement noise.
    """

    vehicle: Vehicle
    trim: Trim
    limits: Limits
    knowledge: Knowledge
    noise: FloatArray

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the parameters."""
        return tuple(p.name for p in self._layout.parameters)

    @cached_property
    def width(self) -> FloatArray:
        """Return the widths (D,) of their boxes, SI."""
        return self._layout.width

    @cached_property
    def lower(self) -> FloatArray:
        """Return the lower ends (D,) of their boxes, SI."""
        return self._layout.lower

    @cached_property
    def values(self) -> FloatArray:
        """Return what the design believes them to be (D,), SI."""
        return np.array([p.value for p in self._layout.parameters])

    @cached_property
    def known(self) -> FloatArray:
        """Information (D, D) that there is before the flight, in the unit box."""
        return self.knowledge.among(self.names) * np.outer(self.width, self.width)

    def forecast(self, maneuver: Maneuver, only_inside: bool = False) -> Forecast:
        """Return what a maneuver would show.

        Parameters
        ----------
        maneuver : Maneuver
        only_inside : bool
            Do without the information where the flight leaves the envelope: nobody will fly it.
        """
        problem = self._problem(maneuver)
        z = np.concatenate([self._layout.unit(self.values), np.zeros(problem.extra)])
        with np.errstate(invalid="ignore", over="ignore"):
            readings = problem.outputs(z, 0)
        if not np.isfinite(readings).all():
            return Forecast(readings, np.inf, self._nothing)
        excess = self.limits.excess(readings, self.vehicle.outputs)
        if only_inside and excess > 0.0:
            return Forecast(readings, excess, self._nothing)
        return Forecast(readings, excess, _parameters_information(problem, z))

    def std(self, *forecasts: Forecast) -> FloatArray:
        """Return the standard errors (D,), SI, that flights with these forecasts leave, with what is known."""
        inverse = invert(self.known + sum((f.information for f in forecasts), self._nothing))
        return standard_errors(marked(inverse.matrix, inverse.determined)) * self.width

    def gain(self, forecast: Forecast) -> float:
        """Return the mean logarithm of how much smaller a flight makes the parameters' uncertainty ellipsoid.

        D-optimality: log det of the information, per parameter; the box counts as weak knowledge, so that a
        parameter that is not excited costs much, but not infinitely much.
        """
        whole = self.known + BOX * np.eye(len(self.names))
        after = np.linalg.slogdet(whole + forecast.information)[1] - np.linalg.slogdet(whole)[1]
        return 0.5 * float(after) / len(self.names)

    def believing(self, values: FloatArray) -> Setup:
        """Return the setup with other values (D,) of the parameters, trimmed at the same speed."""
        from stoop.simulate import trim

        vehicle = self.vehicle.with_numbers(
            {n: {"value": float(v)} for n, v in zip(self.names, values, strict=True)}
        )
        return replace(self, vehicle=vehicle, trim=trim(vehicle, self.trim.start["V"], self.trim.start["h"]))

    @cached_property
    def _layout(self) -> Layout:
        """Parameters without priors: what is known stands in `knowledge` alone."""
        layout = Layout.of(self.vehicle, ())
        if not layout.parameters:
            raise IdentificationError(
                f"{self.vehicle.where}: no number is free; set free = true or use --free NAME"
            )
        return replace(layout, parameters=tuple(replace(p, prior=None) for p in layout.parameters))

    @cached_property
    def _nothing(self) -> FloatArray:
        return np.zeros((len(self.names), len(self.names)))

    def _problem(self, maneuver: Maneuver) -> Misfit:
        vehicle, t = self.vehicle, maneuver.time
        inputs = flown_inputs(vehicle, maneuver, self.trim)
        blank = np.zeros((len(t), len(vehicle.outputs)))
        piece = Piece(0, t, inputs, blank, self.trim.start, self.trim.changes)
        prepared = Prepared((Window("design", 0.0, float(t[-1])),), (piece,), ())
        layout = replace(self._layout, nuisances=nuisances(vehicle, prepared))
        return Misfit(layout, (piece,), Weights.of(self.noise), ((len(t),),))


def _parameters_information(problem: Misfit, z: FloatArray) -> FloatArray:
    """Return the information (D, D) about the parameters when the nuisances are estimated too."""
    r = problem.residuals(z[None, :], 0)[0]
    J, _ = problem.jacobian(z, 0, r)
    return marginal(J, problem.dimension)


def marginal(J: FloatArray, d: int) -> FloatArray:
    """Return the information (d, d) about the first d unknowns when the others are estimated too.

    A reading with a sensitivity that is not finite tells nothing: neither of the parameter, nor, as if that were
    known, of the others. Others that the readings cannot tell take nothing away but what they share.

    Parameters
    ----------
    J : (n, k)
        Whitened sensitivities of the readings.
    d : int
    """
    J = J[np.isfinite(J).all(axis=1)]
    whole = J.T @ J
    shared = invert(whole[d:, d:]).factor.T @ whole[d:, :d]
    out: FloatArray = whole[:d, :d] - shared.T @ shared
    return 0.5 * (out + out.T)


def sensor_noise(vehicle: Vehicle) -> FloatArray:
    """Return the noise covariance (n_y, n_y) that the vehicle file states."""
    return np.diag([getattr(vehicle.file.sensors, c).sigma ** 2 for c in vehicle.outputs])
