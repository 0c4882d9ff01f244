"""The posterior of the parameters: its density with derivatives, drawn from by :mod:`stoop_analysis.sampling`.

Sampled are the parameters alone. Initial states and biases enter the readings almost linearly, so they are marginalized in
closed form (Laplace): at each point they stand where a linear model puts them, one projection takes off what is left, and
`Target.error` measures what this neglects.

What the weights leave of the color of residuals, the fit takes for so many times fewer independent ones, one factor for all.
That makes the likelihood about right in size but not in shape, so it is stretched about its maximum (curvature adjustment)
until its curvature is the inverse of the covariance corrected for color. A linear model then has exactly the corrected
covariance as its posterior.

References
----------
M. Ribatet, D. Cooley and A. C. Davison, "Bayesian inference from composite likelihoods, with an application to spatial
extremes", *Statistica Sinica* 22, 2012, pp. 813-845, section 2 (curvature adjustment).
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from stoop.extend import fits
from stoop.extend.arrays import FloatArray, on_one_blas_thread
from stoop.extend.notices import notice
from stoop_analysis.sampling import SAMPLER, Chains, Coordinates, check_libraries, library, sample

FILE: Final = "posterior.nc"
STEP: Final = 1e-6  #: of a forward difference, in standard deviations
BEND_STEP: Final = 0.1  #: of the central differences of the derivatives, in standard deviations
CHECKED_DRAWS: Final = 16  #: at which the marginalization is checked
MAX_DENSITY_ERROR: Final = 0.5  #: of the log density, by which the marginalization may be off
MIN_EIGENVALUE: Final = 1e-12  #: of the greatest eigenvalue; what is below is taken as that


@dataclass(frozen=True, eq=False)
class Target:
    """Logarithm of the posterior density of the parameters in the unit box, up to a constant."""

    optimum: fits.Optimum  #: with all entries free
    stretch: FloatArray  #: (k, k), from a step of the posterior to one of the likelihood, :func:`stretch`

    @property
    def size(self) -> int:
        """Number k of parameters."""
        return self.optimum.shared

    @property
    def center(self) -> FloatArray:
        """The estimate (k,)."""
        return self.optimum.z[: self.size]

    def slopes(self, x: FloatArray, directions: FloatArray) -> tuple[float, FloatArray]:
        """Return the log density at a point (k,), of the box or beside it, and its derivatives (m,) along (k, m)."""
        here, ahead = self._followed(x[None, :]), self._followed(x + STEP * directions.T)
        with np.errstate(invalid="ignore", over="ignore"):
            r = self.optimum.problem.residuals(here, self.optimum.rung)[0]
            density, taken = self._marginal(r[None, :])
            left = r - self.optimum.nuisances.apply(taken[0])
            if not np.isfinite(density[0]):
                return -np.inf, np.zeros(len(ahead))
            ends = self.optimum.problem.products(ahead, self.optimum.rung, left)
            return float(density[0]), (np.einsum("i,i->", left, r) - ends) / STEP

    def residuals_along(self, x: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals (n_r,) at a point, and (m, n_r) one step ahead along each of directions (k, m)."""
        R = self._residuals(np.vstack([x, x + STEP * directions.T]))
        return np.asarray(R[0]), np.asarray(R[1:])

    def _residuals(self, X: FloatArray) -> FloatArray:
        with np.errstate(invalid="ignore", over="ignore"):
            return self.optimum.problem.residuals(self._followed(X), self.optimum.rung)

    def _marginal(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the log density (W,) of residuals (W, n_r), and how far the nuisances go from where they stand, (W, E)."""
        with np.errstate(invalid="ignore", over="ignore"):
            gradient = np.array([self.optimum.nuisances.project(r) for r in residuals])
            taken = cho_solve(self._factor, gradient.T, check_finite=False).T
            density = -0.5 * (np.sum(residuals**2, axis=1) - np.sum(gradient * taken, axis=1))
        return np.where(np.isfinite(density), density, -np.inf), np.asarray(taken)

    def remaining(self, residuals: FloatArray) -> FloatArray:
        """Return what the nuisances leave of residuals (W, n_r)."""
        taken = self._marginal(residuals)[1]
        return np.array([r - self.optimum.nuisances.apply(t) for r, t in zip(residuals, taken, strict=True)])

    def _followed(self, X: FloatArray) -> FloatArray:
        """Return vectors (W, D + E) of points (W, k), with the nuisances where the linear model puts them."""
        steps = (X - self.center) @ self.stretch.T
        return self.optimum.z + np.hstack([steps, steps @ self._follow.T])

    @cached_property
    def _factor(self) -> tuple[FloatArray, bool]:
        """Cholesky factor (E, E) of the nuisances' information, which their priors make definite, as `cho_solve` takes it."""
        k = self.size
        factor, lower = cho_factor(self.optimum.information[k:, k:])
        return factor, lower

    @cached_property
    def _follow(self) -> FloatArray:
        """How the nuisances follow the parameters, (E, k)."""
        k, information = self.size, self.optimum.information
        return np.asarray(-cho_solve(self._factor, information[k:, :k]))

    @cached_property
    def information(self) -> FloatArray:
        """Of the parameters with the nuisances unknown, as the weights have it, (k, k)."""
        whole, k = self.optimum.information, self.size
        return np.asarray(whole[:k, :k] + whole[:k, k:] @ self._follow)

    def error(self, X: FloatArray) -> FloatArray:
        """Return the error of the log density (W,) at points (W, k): nuisances by one projection, or Gauss-Newton steps."""
        problem, rung, k = self.optimum.problem, self.optimum.rung, self.size
        found = []
        for z in self._followed(X):
            for _ in range(4 if k < len(z) else 0):
                r = problem.residuals(z[None, :], rung)[0]
                J = problem.jacobian(z, rung, r)[0]
                z[k:] -= np.linalg.lstsq(
                    (J if isinstance(J, np.ndarray) else J.dense())[:, k:], r, rcond=None
                )[0]
            r = problem.residuals(z[None, :], rung)[0]
            found.append(-0.5 * float(r @ r))
        return np.array(found) - self._marginal(self._residuals(X))[0]


def coordinates(target: Target) -> Coordinates:
    """Return the coordinates in which the residuals are nearly linear; what the data do not see is as wide as the box.

    Along T, the derivatives of the residuals where the estimate is, their second derivatives are the curvature that
    coordinates cause (parameter-effects curvature: D. M. Bates and D. G. Watts, *Nonlinear Regression Analysis and Its
    Applications*, Wiley, 1988, section 7.1). It is taken off where a coordinate is bent by weaker ones: those move far.
    """
    information = target.stretch.T @ target.information @ target.stretch
    values, vectors = np.linalg.eigh(
        0.5 * (information + information.T) + np.eye(target.size) / SAMPLER.box_std**2
    )
    straight = Coordinates.straight(target.center, vectors / np.sqrt(values))

    def derivatives(w: FloatArray) -> FloatArray:
        x, directions = straight.tangent(w)
        r, ends = target.residuals_along(x, directions)
        return (ends - r) / STEP

    origin = np.zeros(target.size)
    T = target.remaining(derivatives(origin))
    bends = [
        T @ (derivatives(origin + step) - derivatives(origin - step)).T / (2.0 * BEND_STEP)
        for step in BEND_STEP * np.eye(target.size)
    ]
    return straight.bent(np.nan_to_num(np.stack(bends, axis=2)))


def stretch(information: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the matrix M (k, k) with M' `information` M the inverse of `covariance`.

    Among all such it is the symmetric one where the information has a unit diagonal: the optimal transport.
    """
    scale = np.sqrt(np.diag(information))
    root, inverse = _roots(information / np.outer(scale, scale))
    _, half = _roots(covariance * np.outer(scale, scale))
    middle, _ = _roots(root @ (half @ half) @ root)
    return np.asarray((inverse @ middle @ inverse) / scale[:, None] * scale[None, :])


def _roots(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the symmetric square root of a positive matrix, and its inverse."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    values = np.sqrt(np.maximum(values, MIN_EIGENVALUE * values[-1]))
    return (vectors * values) @ vectors.T, (vectors / values) @ vectors.T


@dataclass(frozen=True)
class Posterior:
    """Sample the posterior of the parameters; initial states and biases are marginalized."""

    name: str = field(default="posterior", init=False)

    @on_one_blas_thread
    def __call__(
        self, fit: fits.Estimate, bars: fits.ErrorBars, seed: int, watch: Callable[[str], None]
    ) -> fits.Finding:
        """Return standard deviations and equal-tailed intervals, and the draws as ``posterior.nc``."""
        check_libraries()
        target = posterior_target(fit, bars)
        chains = sample(target, coordinates(target), seed, watch)
        every = chains.draws.reshape(-1, target.size)
        checked = every[np.linspace(0, len(every) - 1, CHECKED_DRAWS).astype(int)]
        error = float(np.max(np.abs(target.error(checked))))
        chains = replace(chains, figures={**chains.figures, "marginalization_error": error})
        layout, figures = fit.problem.layout, chains.figures
        values = layout.physical(every)
        ends = np.quantile(values, [0.025, 0.975], axis=0)
        rows = zip(fit.estimates, values.std(axis=0).tolist(), *ends.tolist(), strict=True)
        parameters = {name: fits.Interval(*numbers) for name, *numbers in rows}
        notices = []
        if not chains.converged:
            found = notice(
                "posterior-not-converged", rhat=figures["rhat"], max_rhat=fits.MethodIntervals.MAX_RHAT,
                sample_size=chains.sample_size, needed=SAMPLER.min_sample_size,
                std_error=figures["std_error"], max_std_error=SAMPLER.max_std_error,
            )  # fmt: skip
            notices.append(found)
        if error > MAX_DENSITY_ERROR:
            notices.append(notice("posterior-nuisances-nonlinear", error=error))
        intervals = fits.MethodIntervals(parameters, figures, tuple(notices))
        return fits.Finding(intervals, {FILE: _file(fit, seed, chains)})


def posterior() -> Posterior:
    """Return the assessment of ``stoop identify --posterior``; an IdentificationError says which library is missing."""
    check_libraries()
    return Posterior()


def posterior_target(fit: fits.Estimate, bars: fits.ErrorBars) -> Target:
    """Return the posterior; its likelihood is stretched to the covariance corrected for color.

    It is not where something is not determined. Parameters at a bound keep the variance that the weights give them.
    """
    optimum = fits.Optimum.of_likelihood(fit)
    plain = Target(optimum, np.eye(optimum.shared))
    k, width = plain.size, fit.problem.layout.width
    free = bars.free[bars.free < k]
    corrected = bars.covariance[np.ix_(free, free)] / np.outer(width[free], width[free])
    if not (np.isfinite(corrected).all() and np.all(np.linalg.eigvalsh(plain.information) > 0.0)):
        return plain
    held = np.setdiff1d(np.arange(k), free)
    covariance = np.zeros((k, k))
    covariance[np.ix_(free, free)] = corrected
    covariance[np.ix_(held, held)] = np.linalg.inv(plain.information)[np.ix_(held, held)]
    return Target(optimum, stretch(plain.information, covariance))


def _file(fit: fits.Estimate, seed: int, chains: Chains) -> bytes:
    """Return an ArviZ InferenceData as NetCDF, SI units, thinned."""
    arviz = library("arviz")
    layout = fit.problem.layout
    thin = math.ceil(chains.density.size / SAMPLER.file_draws)
    values = layout.lower + chains.draws[:, ::thin] * layout.width
    data = arviz.from_dict(
        posterior={p.name: values[:, :, i] for i, p in enumerate(layout.parameters)},
        sample_stats={"lp": chains.density[:, ::thin]},
        attrs={"inference_library": "nutpie", "seed": seed, **chains.figures, "thin": thin},
    )
    for p in layout.parameters:
        data.posterior[p.name].attrs["units"] = p.unit
    with tempfile.TemporaryDirectory(prefix="stoop-") as folder:
        path = Path(folder) / FILE
        data.to_netcdf(str(path), engine="h5netcdf")
        return path.read_bytes()
