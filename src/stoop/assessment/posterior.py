"""The posterior of the parameters, by an ensemble of walkers on the batched likelihood.

Sampled are the parameters alone. Initial states and biases enter the readings almost linearly, so they are marginalized in
closed form (Laplace): at each point they stand where a linear model puts them, one projection takes off what is left, and
`Target.error` measures what this neglects.

The fit weighs colored residuals as so many times fewer independent ones, one factor for all. That makes the likelihood
about right in size but not in shape, so it is stretched about its maximum (curvature adjustment) until its curvature is the
inverse of the covariance corrected for color. A linear model then has exactly the corrected covariance as its posterior;
whitening the residuals instead would move the maximum away from the estimate, and onto the high frequencies.

References
----------
M. Ribatet, D. Cooley and A. C. Davison, "Bayesian inference from composite likelihoods, with an application to spatial
extremes", *Statistica Sinica* 22, 2012, pp. 813-845, section 2 (curvature adjustment).
S. L. Cotter, G. O. Roberts, A. M. Stuart and D. White, "MCMC methods for functions: modifying old algorithms to make them
faster", *Statistical Science* 28(3), 2013, pp. 424-446 (the preconditioned Crank-Nicolson proposal).
D. Foreman-Mackey, D. W. Hogg, D. Lang and J. Goodman, "emcee: the MCMC hammer", *Publications of the Astronomical Society of
the Pacific* 125, 2013, pp. 306-312.
A. Vehtari, A. Gelman, D. Simpson, B. Carpenter and P.-C. Buerkner, "Rank-normalization, folding, and localization: an
improved R-hat for assessing convergence of MCMC", *Bayesian Analysis* 16(2), 2021, pp. 667-718.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from threadpoolctl import threadpool_limits

from stoop.assessment.assessment import AssessedFit, Finding, Optimum, Watch, linearize, stationary
from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.problem import Misfit
from stoop.results.uncertainty import Interval, MethodIntervals


@dataclass(frozen=True)
class SamplerSettings:
    """Settings of the sampler and of its checks."""

    box_std: float = 0.29  #: of a value thrown blindly into a box of width 1
    blend: float = 0.05  #: of the spread of a reference that stays when it is fitted to draws
    min_eigenvalue: float = 1e-12  #: of the greatest eigenvalue; what is below is taken as that
    steps_per_round: int = 250  #: steps between looks at convergence
    max_steps: int = 8000
    max_rhat: float = 1.01  #: of every parameter
    #: independent draws' worth, in the middle and in the tails of every parameter
    min_sample_size: float = 1000.0
    min_walkers: int = 32
    file_draws: int = 250  #: draws of each walker in the file, at most
    checked_draws: int = 16  #: at which the marginalization is checked
    max_density_error: float = 0.5  #: of the log density, by which it may be off


SAMPLER: Final = SamplerSettings()

STEP_LENGTHS: Final = (1.0, 0.7, 0.4, 0.2, 0.1)  #: of a proposal; 1 forgets where it came from
WARM_UP: Final = (150, 300)  #: steps thrown away; after each the proposals are fitted to its second half
MISSING: Final = "the posterior needs emcee and arviz; install them with pip install 'stoop[posterior]'"
FILE: Final = "posterior.nc"


@dataclass(frozen=True, eq=False)
class Target:
    """Logarithm of the posterior density of the parameters in the unit box, up to a constant."""

    optimum: Optimum  #: with all entries free
    stretch: FloatArray  #: (k, k), from a step of the posterior to one of the likelihood, :func:`stretch`

    @property
    def size(self) -> int:
        """Number k of parameters."""
        return self.optimum.shared

    @property
    def center(self) -> FloatArray:
        """The estimate (k,)."""
        return self.optimum.z[: self.size]

    def __call__(self, X: FloatArray) -> FloatArray:
        """Return the log density (W,) of points (W, k); minus infinity outside of the box."""
        inside = ((X >= 0.0) & (X <= 1.0)).all(axis=1)
        out = np.full(len(X), -np.inf)
        if inside.any():
            out[inside] = self._densities((X[inside] - self.center) @ self.stretch.T)
        return out

    def _densities(self, steps: FloatArray) -> FloatArray:
        k, information = self.size, self.optimum.information
        with np.errstate(invalid="ignore", over="ignore"):
            residuals = self.optimum.problem.residuals(self._followed(steps), self.optimum.rung)
            gradient = residuals @ self.optimum.jacobian[:, k:]
            # by how much the nuisances lower the cost from where they stand; their priors make the matrix definite
            gain = np.sum(gradient * np.linalg.solve(information[k:, k:], gradient.T).T, axis=1)
            density = -0.5 * (np.sum(residuals**2, axis=1) - gain)
        return np.where(np.isfinite(density), density, -np.inf)

    def _followed(self, steps: FloatArray) -> FloatArray:
        """Return vectors (W, D + E) with the nuisances where the linear model puts them."""
        return self.optimum.z + np.hstack([steps, steps @ self._follow.T])

    @cached_property
    def _follow(self) -> FloatArray:
        """How the nuisances follow the parameters, (E, k)."""
        k, information = self.size, self.optimum.information
        return np.asarray(-np.linalg.solve(information[k:, k:], information[k:, :k]))

    @cached_property
    def information(self) -> FloatArray:
        """Of the parameters with the nuisances unknown, as the weights have it, (k, k)."""
        whole, k = self.optimum.information, self.size
        return np.asarray(whole[:k, :k] + whole[:k, k:] @ self._follow)

    def error(self, X: FloatArray) -> FloatArray:
        """Return the error of the log density (W,) at points (W, k): nuisances by one projection, or Gauss-Newton steps."""
        problem, rung, k = self.optimum.problem, self.optimum.rung, self.size
        steps = (X - self.center) @ self.stretch.T
        found = []
        for z in self._followed(steps):
            for _ in range(4 if k < len(z) else 0):
                r = problem.residuals(z[None, :], rung)[0]
                jacobian = problem.jacobian(z, rung, r)[0][:, k:]
                z[k:] -= np.linalg.lstsq(jacobian, r, rcond=None)[0]
            r = problem.residuals(z[None, :], rung)[0]
            found.append(-0.5 * float(r @ r))
        return np.array(found) - self._densities(steps)


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
    values = np.sqrt(np.maximum(values, SAMPLER.min_eigenvalue * values[-1]))
    return (vectors * values) @ vectors.T, (vectors / values) @ vectors.T


@dataclass(frozen=True, eq=False)
class Reference:
    """The normal distribution that the posterior would be if the model were linear and the box wide."""

    center: FloatArray  #: (k,)
    factor: FloatArray  #: (k, k); its product with its own transpose is the covariance

    def draw(self, count: int, random: np.random.RandomState) -> FloatArray:
        """Return points (count, k) of the box."""
        points = self.center + random.standard_normal((count, len(self.center))) @ self.factor.T
        return np.asarray(np.abs(points) - 2.0 * np.maximum(np.abs(points) - 1.0, 0.0)).clip(0.0, 1.0)

    def propose(self, X: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """Return new points (W, k) and what the acceptance owes to the proposal (W,): emcee's `MHMove`.

        The preconditioned Crank-Nicolson step leaves this distribution as it is, whatever its length; lengths are mixed.
        """
        reach = random.choice(STEP_LENGTHS, size=(len(X), 1))
        before = np.linalg.solve(self.factor, (X - self.center).T).T
        after = np.sqrt(1.0 - reach**2) * before + reach * random.standard_normal(X.shape)
        owed = 0.5 * (np.sum(after**2, axis=1) - np.sum(before**2, axis=1))
        return self.center + after @ self.factor.T, owed

    def fitted(self, draws: FloatArray) -> Reference:
        """Return the reference with center and spread of draws (m, k), kept definite by a little of this one."""
        own = np.cov(draws.T).reshape(draws.shape[1], -1)
        spread = (1.0 - SAMPLER.blend) * own + SAMPLER.blend * self.factor @ self.factor.T
        return Reference(np.asarray(draws.mean(axis=0)), np.asarray(np.linalg.cholesky(spread)))


def reference(target: Target) -> Reference:
    """Return the normal distribution beside a target; what the data do not see is as wide as the box."""
    information = target.stretch.T @ target.information @ target.stretch
    information = 0.5 * (information + information.T) + np.eye(target.size) / SAMPLER.box_std**2
    values, vectors = np.linalg.eigh(information)
    return Reference(target.center, vectors / np.sqrt(values))


@dataclass(frozen=True, eq=False)
class Chains:
    """Draws of a posterior."""

    draws: FloatArray  #: (walkers, steps, k); in the unit box, warm-up left out
    density: FloatArray  #: (walkers, steps); logarithm, up to a constant
    #: convergence: ``rhat`` (greatest), ``ess_bulk``, ``ess_tail`` (least), ``autocorrelation_time`` (longest,
    #: steps), ``acceptance`` (mean), ``walkers``, ``steps``
    figures: dict[str, float]

    @property
    def sample_size(self) -> float:
        """Independent draws' worth, of the worst parameter."""
        return min(self.figures["ess_bulk"], self.figures["ess_tail"])

    @property
    def converged(self) -> bool:
        """Whether all walkers tell the same, often enough."""
        return self.figures["rhat"] <= SAMPLER.max_rhat and self.sample_size >= SAMPLER.min_sample_size


def sample(
    target: Callable[[FloatArray], FloatArray],
    reference: Reference,
    seed: int,
    watch: Callable[[int], None] | None = None,
) -> Chains:
    """Walk until R-hat and the effective sample size are good, at most `SAMPLER.max_steps` steps.

    `target` gives the log density (W,) of points (W, k), all walkers at once; `reference` is where walkers start and what
    most of their proposals come from; `watch` receives the number of steps so far. Errors are those of :func:`libraries`.
    """
    emcee, arviz = libraries()
    walkers = max(SAMPLER.min_walkers, 2 * len(reference.center) + 2)
    random = np.random.RandomState(seed)
    # walkers start where the density is above zero; one that is lost begins beside one that is not
    points = reference.draw(walkers, random)
    lost = ~np.isfinite(target(points))
    if lost.all():
        points = reference.center + 1e-3 * (points - reference.center)
        lost = ~np.isfinite(target(points))
    if lost.any() and not lost.all():
        found = points[~lost]
        chosen = found[random.randint(len(found), size=int(lost.sum()))]
        points[lost] = chosen + 1e-3 * (reference.center - chosen)

    # most proposals from the reference, the others from the differences of walkers
    shares, size = (0.6, 0.3, 0.1), len(reference.center)
    differences = (emcee.moves.DEMove(), emcee.moves.DESnookerMove())
    state = emcee.State(points, random_state=random.get_state())
    for steps in (*WARM_UP, 0):
        moves = list(zip((emcee.moves.MHMove(reference.propose), *differences), shares, strict=True))
        walk = emcee.EnsembleSampler(walkers, size, target, vectorize=True, moves=moves)
        if steps:
            state = walk.run_mcmc(state, steps, skip_initial_state_check=True)
            reference = reference.fitted(walk.get_chain(discard=steps // 2, flat=True))
    while walk.iteration < SAMPLER.max_steps:
        state = walk.run_mcmc(state, SAMPLER.steps_per_round, skip_initial_state_check=True)
        draws = np.swapaxes(walk.get_chain(), 0, 1)
        data = arviz.convert_to_dataset({"x": draws})
        with np.errstate(all="ignore"):
            figures = {
                "rhat": float(np.max(np.asarray(arviz.rhat(data)["x"]))),
                "ess_bulk": float(np.min(np.asarray(arviz.ess(data, method="bulk")["x"]))),
                "ess_tail": float(np.min(np.asarray(arviz.ess(data, method="tail")["x"]))),
                "autocorrelation_time": float(np.max(walk.get_autocorr_time(tol=0, quiet=True))),
                "acceptance": float(np.mean(walk.acceptance_fraction)),
                "walkers": float(draws.shape[0]),
                "steps": float(draws.shape[1]),
            }
        chains = Chains(draws, walk.get_log_prob().T, figures)
        if watch is not None:
            watch(walk.iteration)
        if chains.converged:
            break
    return chains


def libraries() -> tuple[Any, Any]:
    """Return emcee and arviz; an IdentificationError says that one of them is not installed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # arviz announces its next version
            import arviz
            import emcee
    except ImportError:
        raise IdentificationError(MISSING) from None
    return emcee, arviz


@dataclass(frozen=True)
class Posterior:
    """Sample the posterior of the parameters; initial states and biases are marginalized."""

    name: str = field(default="posterior", init=False)

    def __call__(self, fit: AssessedFit, watch: Watch) -> Finding:
        """Return standard deviations and equal-tailed intervals, and the draws as ``posterior.nc``."""
        libraries()
        with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
            target = posterior_target(fit)
            chains = sample(
                target, reference(target), fit.seed, lambda n: watch(f"posterior: {n} steps of every walker")
            )
            every = chains.draws.reshape(-1, target.size)
            checked = every[np.linspace(0, len(every) - 1, SAMPLER.checked_draws).astype(int)]
            error = float(np.max(np.abs(target.error(checked))))
        chains = replace(chains, figures={**chains.figures, "marginalization_error": error})
        layout, figures = fit.fit.problem.layout, chains.figures
        values = layout.physical(every)
        ends = np.quantile(values, [0.025, 0.975], axis=0)
        rows = zip(fit.names, values.std(axis=0).tolist(), *ends.tolist(), strict=True)
        parameters = {name: Interval(*numbers) for name, *numbers in rows}
        notices = []
        if not chains.converged:
            limits: dict[str, Any] = {"max_rhat": SAMPLER.max_rhat, "needed": SAMPLER.min_sample_size}
            size, rhat = chains.sample_size, figures["rhat"]
            notices.append(notice("posterior-not-converged", rhat=rhat, sample_size=size, **limits))
        if error > SAMPLER.max_density_error:
            notices.append(notice("posterior-nuisances-nonlinear", error=error))
        intervals = MethodIntervals(parameters, figures, tuple(notices))
        return Finding(intervals, {FILE: _file(fit, chains)})


def posterior_target(fit: AssessedFit) -> Target:
    """Return the posterior; its likelihood is stretched to the covariance corrected for color.

    It is not where something is not determined. Parameters at a bound keep the variance that the weights give them.
    """
    z = fit.fit.z
    optimum = linearize(fit.problem, z, np.arange(len(z)))
    if not isinstance(fit.problem, Misfit):
        optimum = stationary(optimum)
    plain = Target(optimum, np.eye(optimum.shared))
    k, width = plain.size, fit.fit.problem.layout.width
    free = fit.free[fit.free < k]
    corrected = fit.bars.covariance[np.ix_(free, free)] / np.outer(width[free], width[free])
    if not (np.isfinite(corrected).all() and np.all(np.linalg.eigvalsh(plain.information) > 0.0)):
        return plain
    held = np.setdiff1d(np.arange(k), free)
    covariance = np.zeros((k, k))
    covariance[np.ix_(free, free)] = corrected
    covariance[np.ix_(held, held)] = np.linalg.inv(plain.information)[np.ix_(held, held)]
    return Target(optimum, stretch(plain.information, covariance))


def _file(fit: AssessedFit, chains: Chains) -> bytes:
    """Return an ArviZ InferenceData as NetCDF, SI units, thinned."""
    _, arviz = libraries()
    layout = fit.fit.problem.layout
    thin = max(1, chains.draws.shape[1] // SAMPLER.file_draws)
    values = layout.lower + chains.draws[:, ::thin] * layout.width
    data = arviz.from_dict(
        posterior={p.name: values[:, :, i] for i, p in enumerate(layout.parameters)},
        sample_stats={"lp": chains.density[:, ::thin]},
        attrs={"inference_library": "emcee", "seed": fit.seed, **chains.figures, "thin": thin},
    )
    for p in layout.parameters:
        data.posterior[p.name].attrs["units"] = p.unit
    with tempfile.TemporaryDirectory(prefix="stoop-") as folder:
        path = Path(folder) / FILE
        data.to_netcdf(str(path), engine="h5netcdf")
        return path.read_bytes()
