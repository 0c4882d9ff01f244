"""The posterior of the parameters, by an ensemble of walkers on the batched likelihood.

Sampled are the parameters alone. Initial states and biases enter the readings almost linearly, so they are marginalized in
closed form (Laplace): at each point they stand where a linear model puts them, one projection takes off what is left, and
`Target.error` measures what this neglects.

The fit weighs colored residuals as so many times fewer independent ones, one factor for all. That makes the likelihood
about right in size but not in shape: some parameters live where the noise is strong, others where it is not. So the
likelihood is stretched about its maximum (curvature adjustment) until its curvature is the inverse of the covariance
corrected for color. A linear model then has exactly the corrected covariance as its posterior, and what the posterior shows
beyond that is the model's own: skewness, bounds, ridges. Whitening the residuals by an autoregression instead would move the
maximum away from the estimate, and onto the high frequencies, where a flight-dynamics model knows least.

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
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from threadpoolctl import threadpool_limits

from stoop.assess.assessment import AssessedFit, Finding, Watch
from stoop.assess.refit import Optimum, linearize, stationary
from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.problem import Misfit
from stoop.results.uncertainty import Interval, MethodIntervals

BOX_STD: Final = 0.29  #: of a value thrown blindly into a box of width 1
BLEND: Final = 0.05  #: of the spread of a reference that stays when it is fitted to draws
MIN_EIGENVALUE: Final = 1e-12  #: of the greatest eigenvalue; what is below is taken as that
REACHES: Final = (1.0, 0.7, 0.4, 0.2, 0.1)  #: of a proposal; 1 forgets where it came from
WARM_UP: Final = (150, 300)  #: steps thrown away; after each the proposals are fitted to its second half
STEPS_PER_ROUND: Final = 250  #: steps between looks at convergence
MAX_STEPS: Final = 8000  #: steps at most
MAX_RHAT: Final = 1.01  #: of every parameter, at most
MIN_SAMPLE_SIZE: Final = (
    1000.0  #: independent draws' worth, in the middle and in the tails of every parameter, at least
)
MIN_WALKERS: Final = 32
MISSING: Final = "the posterior needs emcee and arviz; install them with pip install 'stoop[posterior]'"
FILE: Final = "posterior.nc"
FILE_DRAWS: Final = 250  #: draws of each walker in the file, at most
CHECKED_DRAWS: Final = 16  #: draws at which the marginalization is checked
MAX_DENSITY_ERROR: Final = 0.5  #: of the log density, by which it may be off


@dataclass(frozen=True, eq=False)
class Target:
    """Logarithm of the posterior density of the parameters in the unit box, up to a constant.

    Attributes
    ----------
    optimum : Optimum
        With all entries free.
    stretch : (k, k)
        Takes a step of the posterior to one of the likelihood, see :func:`stretch`.
    """

    optimum: Optimum
    stretch: FloatArray

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
        with np.errstate(invalid="ignore", over="ignore"):
            residuals = self.optimum.problem.residuals(self._followed(steps), self.optimum.rung)
            density = -0.5 * (np.sum(residuals**2, axis=1) - self._taken(residuals))
        return np.where(np.isfinite(density), density, -np.inf)

    def _taken(self, residuals: FloatArray) -> FloatArray:
        """Return by how much the nuisances lower the cost (W,) from where they stand."""
        if not self._any:
            return np.zeros(len(residuals))
        gradient = residuals @ self._nuisances
        return np.asarray(
            np.sum(gradient * cho_solve(self._factor, gradient.T, check_finite=False).T, axis=1)
        )

    def _followed(self, steps: FloatArray) -> FloatArray:
        """Return vectors (W, D + E) with the nuisances where the linear model puts them."""
        Z = np.repeat(self.optimum.z[None, :], len(steps), axis=0)
        Z[:, : self.size] += steps
        Z[:, self.size :] += steps @ self._follow.T
        return Z

    @property
    def _any(self) -> bool:
        return self.size < len(self.optimum.z)

    @cached_property
    def _nuisances(self) -> FloatArray:
        return np.ascontiguousarray(self.optimum.jacobian[:, self.size :])

    @cached_property
    def _factor(self) -> tuple[FloatArray, bool]:
        return cho_factor(self.optimum.information[self.size :, self.size :])  # their priors make it definite

    @cached_property
    def _follow(self) -> FloatArray:
        """How the nuisances follow the parameters, (E, k)."""
        if not self._any:
            return np.empty((0, self.size))
        return np.asarray(-cho_solve(self._factor, self.optimum.information[self.size :, : self.size]))

    @cached_property
    def information(self) -> FloatArray:
        """Of the parameters with the nuisances unknown, as the weights have it, (k, k)."""
        whole, k = self.optimum.information, self.size
        return np.asarray(whole[:k, :k] + whole[:k, k:] @ self._follow)

    def error(self, X: FloatArray) -> FloatArray:
        """Return by how much the marginalization misses the log density (W,) at points (W, k).

        What is compared is the least cost over the nuisances: by one projection, and by Gauss-Newton steps.
        """
        steps = (X - self.center) @ self.stretch.T
        found = np.array([self._conditional(z) for z in self._followed(steps)])
        return np.asarray(found - self._densities(steps))

    def _conditional(self, z: FloatArray, rounds: int = 4) -> float:
        """Return the log density at the best nuisances."""
        problem, rung, k = self.optimum.problem, self.optimum.rung, self.size
        for _ in range(rounds if self._any else 0):
            r = problem.residuals(z[None, :], rung)[0]
            jacobian = problem.jacobian(z, rung, r)[0][:, k:]
            z = z.copy()
            z[k:] -= np.linalg.lstsq(jacobian, r, rcond=None)[0]
        r = problem.residuals(z[None, :], rung)[0]
        return -0.5 * float(r @ r)


def stretch(information: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the matrix M (k, k) with M' `information` M the inverse of `covariance`: the most even one.

    Among all such it is the symmetric one, in coordinates in which the information has a unit diagonal: the
    optimal transport between the two normal distributions.
    """
    scale = np.sqrt(np.diag(information))
    root, inverse = _roots(information / np.outer(scale, scale))
    turned = root @ _inverse(covariance * np.outer(scale, scale)) @ root
    middle, _ = _roots(turned)
    return np.asarray((inverse @ middle @ inverse) / scale[:, None] * scale[None, :])


def _roots(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the symmetric square root of a positive matrix, and its inverse."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    values = np.sqrt(np.maximum(values, MIN_EIGENVALUE * values[-1]))
    return (vectors * values) @ vectors.T, (vectors / values) @ vectors.T


def _inverse(matrix: FloatArray) -> FloatArray:
    _, inverse = _roots(matrix)
    return inverse @ inverse


@dataclass(frozen=True, eq=False)
class Reference:
    """The normal distribution that the posterior would be if the model were linear and the box wide.

    Attributes
    ----------
    center : (k,)
    factor : (k, k)
        Its product with its own transpose is the covariance.
    """

    center: FloatArray
    factor: FloatArray

    def draw(self, count: int, random: np.random.RandomState) -> FloatArray:
        """Return points (count, k) of the box."""
        points = self.center + random.standard_normal((count, len(self.center))) @ self.factor.T
        return np.asarray(np.abs(points) - 2.0 * np.maximum(np.abs(points) - 1.0, 0.0)).clip(0.0, 1.0)

    def propose(self, X: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """Return new points (W, k) and what the acceptance owes to the proposal (W,): emcee's `MHMove`.

        The preconditioned Crank-Nicolson step leaves this distribution as it is, whatever its length. Long and
        short ones are mixed: near a normal posterior the long ones are accepted, elsewhere the short ones.
        """
        reach = random.choice(REACHES, size=(len(X), 1))
        before = np.linalg.solve(self.factor, (X - self.center).T).T
        after = np.sqrt(1.0 - reach**2) * before + reach * random.standard_normal(X.shape)
        owed = 0.5 * (np.sum(after**2, axis=1) - np.sum(before**2, axis=1))
        return self.center + after @ self.factor.T, owed


def reference(target: Target) -> Reference:
    """Return the normal distribution beside a target; what the data do not see is as wide as the box."""
    information = target.stretch.T @ target.information @ target.stretch
    values, vectors = np.linalg.eigh(0.5 * (information + information.T) + np.eye(target.size) / BOX_STD**2)
    return Reference(target.center, vectors / np.sqrt(values))


def fitted(before: Reference, draws: FloatArray) -> Reference:
    """Return a reference with center and spread of draws (m, k), kept definite by a little of the one before."""
    spread: FloatArray = (1.0 - BLEND) * np.cov(draws.T).reshape(
        draws.shape[1], -1
    ) + BLEND * before.factor @ before.factor.T
    return Reference(np.asarray(draws.mean(axis=0)), np.asarray(np.linalg.cholesky(spread)))


@dataclass(frozen=True, eq=False)
class Chains:
    """Draws of a posterior.

    Attributes
    ----------
    draws : (walkers, steps, k)
        In the unit box, warm-up left out.
    density : (walkers, steps)
        Logarithm, up to a constant.
    figures : dict of str to float
        Convergence: ``rhat`` (greatest), ``ess_bulk``, ``ess_tail`` (least), ``autocorrelation_time`` (longest,
        steps), ``acceptance`` (mean), ``walkers``, ``steps``.
    """

    draws: FloatArray
    density: FloatArray
    figures: dict[str, float]

    @property
    def converged(self) -> bool:
        """Whether all walkers tell the same, often enough."""
        f = self.figures
        return f["rhat"] <= MAX_RHAT and min(f["ess_bulk"], f["ess_tail"]) >= MIN_SAMPLE_SIZE


def sample(
    target: Callable[[FloatArray], FloatArray],
    reference: Reference,
    seed: int,
    watch: Callable[[int], None] | None = None,
) -> Chains:
    """Walk until R-hat and the effective sample size are good, at most `MAX_STEPS` steps.

    Parameters
    ----------
    target : callable
        Log density (W,) of points (W, k): all walkers at once.
    reference : Reference
        Where walkers start and what most of their proposals come from.
    seed : int
    watch : callable, optional
        Told the number of steps so far.

    Raises
    ------
    IdentificationError
        emcee or arviz is not installed.
    """
    emcee, arviz = libraries()
    walkers = max(MIN_WALKERS, 2 * len(reference.center) + 2)
    random = np.random.RandomState(seed)
    state = emcee.State(_start(target, reference, walkers, random), random_state=random.get_state())
    for steps in WARM_UP:
        sampler = _sampler(emcee, target, reference, walkers)
        state = sampler.run_mcmc(state, steps, skip_initial_state_check=True)
        reference = fitted(reference, sampler.get_chain(discard=steps // 2, flat=True))
    sampler = _sampler(emcee, target, reference, walkers)
    while sampler.iteration < MAX_STEPS:
        state = sampler.run_mcmc(state, STEPS_PER_ROUND, skip_initial_state_check=True)
        chains = _chains(sampler, arviz)
        if watch is not None:
            watch(sampler.iteration)
        if chains.converged:
            break
    return chains


def _sampler(
    emcee: Any, target: Callable[[FloatArray], FloatArray], reference: Reference, walkers: int
) -> Any:
    """Return emcee's sampler: most proposals from the reference, the others from the differences of walkers."""
    moves = [
        (emcee.moves.MHMove(reference.propose), 0.6),
        (emcee.moves.DEMove(), 0.3),
        (emcee.moves.DESnookerMove(), 0.1),
    ]
    return emcee.EnsembleSampler(walkers, len(reference.center), target, vectorize=True, moves=moves)


def libraries() -> tuple[Any, Any]:
    """Return emcee and arviz.

    Raises
    ------
    IdentificationError
        One of them is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # arviz announces its next version
            import arviz
            import emcee
    except ImportError:
        raise IdentificationError(MISSING) from None
    return emcee, arviz


def _start(
    target: Callable[[FloatArray], FloatArray],
    reference: Reference,
    walkers: int,
    random: np.random.RandomState,
) -> FloatArray:
    """Return walkers where the density is above zero; a walker that is lost begins beside one that is not."""
    points = reference.draw(walkers, random)
    lost = ~np.isfinite(target(points))
    if lost.all():
        points = reference.center + 1e-3 * (points - reference.center)
        lost = ~np.isfinite(target(points))
    if lost.any() and not lost.all():
        found = points[~lost]
        chosen = found[random.randint(len(found), size=int(lost.sum()))]
        points[lost] = chosen + 1e-3 * (reference.center - chosen)
    return points


def _chains(sampler: Any, arviz: Any) -> Chains:
    draws = np.swapaxes(sampler.get_chain(), 0, 1)
    density = sampler.get_log_prob().T
    data = arviz.convert_to_dataset({"x": draws})
    with np.errstate(all="ignore"):
        rhat = np.asarray(arviz.rhat(data)["x"])
        bulk, tail = (np.asarray(arviz.ess(data, method=m)["x"]) for m in ("bulk", "tail"))
        time = sampler.get_autocorr_time(tol=0, quiet=True)
    figures = {
        "rhat": float(np.max(rhat)),
        "ess_bulk": float(np.min(bulk)),
        "ess_tail": float(np.min(tail)),
        "autocorrelation_time": float(np.max(time)),
        "acceptance": float(np.mean(sampler.acceptance_fraction)),
        "walkers": float(draws.shape[0]),
        "steps": float(draws.shape[1]),
    }
    return Chains(draws, density, figures)


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
            checked = every[np.linspace(0, len(every) - 1, CHECKED_DRAWS).astype(int)]
            error = float(np.max(np.abs(target.error(checked))))
        chains = Chains(chains.draws, chains.density, {**chains.figures, "marginalization_error": error})
        return Finding(_intervals(fit, chains), {FILE: _file(fit, chains)})


def posterior_target(fit: AssessedFit) -> Target:
    """Return the posterior; its likelihood is stretched to the covariance corrected for color, where there is one."""
    z = fit.fit.z
    optimum = linearize(fit.problem, z, np.arange(len(z)))
    if not isinstance(fit.problem, Misfit):
        optimum = stationary(optimum)
    plain = Target(optimum, np.eye(optimum.shared))
    covariance = _corrected(fit, plain)
    return plain if covariance is None else Target(optimum, stretch(plain.information, covariance))


def _corrected(fit: AssessedFit, plain: Target) -> FloatArray | None:
    """Return the corrected covariance of the parameters in the unit box; None where something is not determined.

    Parameters at a bound keep the variance that the weights give them.
    """
    k, width = plain.size, fit.fit.problem.layout.width
    free = fit.free[fit.free < k]
    corrected = fit.bars.covariance[np.ix_(free, free)] / np.outer(width[free], width[free])
    if not (np.isfinite(corrected).all() and np.all(np.linalg.eigvalsh(plain.information) > 0.0)):
        return None
    covariance = np.linalg.inv(plain.information)
    held = np.setdiff1d(np.arange(k), free)
    out = np.zeros((k, k))
    out[np.ix_(free, free)] = corrected
    out[np.ix_(held, held)] = covariance[np.ix_(held, held)]
    return out


def _intervals(fit: AssessedFit, chains: Chains) -> MethodIntervals:
    layout, f = fit.fit.problem.layout, chains.figures
    values = layout.physical(chains.draws.reshape(-1, layout.dimension))
    lower, upper = np.quantile(values, [0.025, 0.975], axis=0)
    parameters = {
        name: Interval(float(s), float(a), float(b))
        for name, s, a, b in zip(fit.names, values.std(axis=0), lower, upper, strict=True)
    }
    notices = []
    if not chains.converged:
        size = min(f["ess_bulk"], f["ess_tail"])
        notices.append(
            notice(
                "posterior-not-converged",
                rhat=f["rhat"],
                max_rhat=MAX_RHAT,
                sample_size=size,
                needed=MIN_SAMPLE_SIZE,
            )
        )
    if f["marginalization_error"] > MAX_DENSITY_ERROR:
        notices.append(notice("posterior-nuisances-nonlinear", error=f["marginalization_error"]))
    return MethodIntervals(parameters, f, tuple(map(str, notices)))


def _file(fit: AssessedFit, chains: Chains) -> bytes:
    """Return an ArviZ InferenceData as NetCDF, SI units, thinned."""
    _, arviz = libraries()
    layout = fit.fit.problem.layout
    thin = max(1, chains.draws.shape[1] // FILE_DRAWS)
    draws = chains.draws[:, ::thin]
    values = layout.lower + draws * layout.width
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
