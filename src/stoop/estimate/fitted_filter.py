"""The filter of a fit over other windows: its innovations there, and what gusts do to a prediction without it.

Gusts move an aircraft away from any prediction of more than a second, however right its model is. What judges a model in gusts
are its predictions from sample to sample: with the right parameters and noise, innovations over their expected standard
deviations are white, of unit variance (R. K. Mehra and J. Peschon, "An innovations approach to fault detection and diagnosis in
dynamic systems", *Automatica* 7(5), 1971, pp. 637-640). Parameters and noise are those of the fit; only what belongs to a
window itself (initial state, gusts at its beginning, sensor biases) is at its most likely values there.

A prediction without the filter differs from the record by what the disturbances do meanwhile, of covariance

    P_k+1 = F P_k F' + Q,  readings H P_k H',

with F, H of the vehicle linearized about the mean of the window, Q of the fit, and the gusts' own variance at the beginning.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.estimate.filter_gains import GAINS, Gain, Noise
from stoop.estimate.filter_likelihood import FrozenFilter, Likelihood
from stoop.estimate.linearization import linearized, measured_points, undelayed
from stoop.problem import Layout, Misfit, Nuisance, Piece
from stoop.results.result import NoiseCovariance, ProcessNoise
from stoop.vehicle import Vehicle
from stoop.vehicle.channels import GUST_STATES

#: of the intensity in each gust state
GUST_SHARES: Final = {"u": (1.0,), "v": (0.5**0.5, 0.5), "w": (0.5**0.5, 0.5)}
#: of the gains: at what was measured, then along the states that the filter finds
LINEARIZATIONS: Final = 2


def gust_deviations(vehicle: Vehicle) -> dict[str, float]:
    """Return the standard deviation of each gust state, m/s."""
    out = dict[str, float]()
    for axis in vehicle.gusts:
        intensity = vehicle.value(f"turbulence.{axis}.intensity")
        out |= {n: x * intensity for n, x in zip(GUST_STATES[axis], GUST_SHARES[axis], strict=True)}
    return out


def with_gusts(problem: Misfit) -> Misfit:
    """Return the problem with the gusts at the beginning of each piece among the nuisances."""
    vehicle = problem.layout.vehicle
    gusts, deviations = list[Nuisance](), gust_deviations(vehicle).items()
    for i, piece in enumerate(problem.pieces):
        gusts += [Nuisance(name, piece.maneuver, i, 0.0, deviation) for name, deviation in deviations]
    own = problem.layout.nuisances
    states, biases = [n for n in own if not n.is_bias], [n for n in own if n.is_bias]
    return replace(problem, layout=Layout(vehicle, problem.layout.parameters, (*states, *gusts, *biases)))


@dataclass(frozen=True, eq=False)
class FittedFilter:
    """Gain and noise of a fit; `tail` (t,) are the logarithms of its intensities, as `noise` has them."""

    gain: Gain
    noise: Noise
    tail: FloatArray

    @classmethod
    def of_result(
        cls, vehicle: Vehicle, noise: NoiseCovariance, process: ProcessNoise
    ) -> FittedFilter | None:
        """Return the filter of a result, with its vehicle at the estimates; None where the result names none."""
        variances = np.diag(noise.of(vehicle.outputs))
        known = Noise(vehicle, np.sqrt(variances), variances, process.share or None)
        if not process.filtered or process.states != known.disturbed:
            return None
        return cls(GAINS[process.gain], known, np.log(np.array(process.intensities, dtype=np.float64)))

    def _known(self, vehicle: Vehicle) -> tuple[Noise, FloatArray]:
        """Return the noise with its variances given, for a vehicle at its estimates, and what is left of the tail."""
        given = replace(self.noise, vehicle=vehicle, given=self.noise.variances(self.tail[None, :])[0])
        return given, self.tail[: len(self.noise.disturbed)]

    def innovations(self, problem: Misfit) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Return innovations (n, n_y) of each piece over their expected standard deviations, and these.

        Innovations are NaN where nothing was measured. `problem` has no free parameter; its nuisances are estimated with the
        gains fixed.
        """
        noise, tail = self._known(problem.layout.vehicle)
        unknown = ~np.isfinite(noise.first)
        blank = [replace(p, measured=np.where(unknown, np.nan, p.measured)) for p in problem.pieces]
        problem = undelayed(with_gusts(replace(problem, pieces=tuple(blank))))
        z = np.concatenate([np.zeros(problem.extra), tail])
        likelihood = Likelihood.of(problem, noise, self.gain, z)
        for _ in range(LINEARIZATIONS):
            frozen = FrozenFilter.of(likelihood, z)
            z = np.concatenate([optimize.refine(frozen, z[: problem.extra], 0).z, tail])
            likelihood = likelihood.along(z)
        return FrozenFilter.of(likelihood, z).standardized(z[: problem.extra])

    def disturbance(self, vehicle: Vehicle, piece: Piece) -> FloatArray:
        """Return the variance (n, n_y) of readings by gusts and other process noise since the beginning of a piece."""
        noise, tail = self._known(vehicle)
        at = measured_points(vehicle, piece, np.zeros(len(piece.time), dtype=np.int64))
        rows = vehicle.parameter_rows(piece.changes)
        linear = linearized(vehicle, rows, at.states[:, :, None], at.inputs, piece.dt)
        F, H = linear.transition[0, 0], linear.readings[0, 0]
        Q = noise.process(tail[None, :], linear.drive, piece.dt)[0, 0]
        gusts = gust_deviations(vehicle)
        P, out = np.diag([gusts.get(name, 0.0) ** 2 for name in vehicle.moves]), []
        for _ in piece.time:
            out.append(np.einsum("ie,ef,if->i", H, P, H))
            P = F @ P @ F.T + Q
        return np.array(out)
