"""Draws from a density on the unit box, by Hamiltonian Monte Carlo in coordinates that make it nearly normal.

A posterior of a flight-dynamics model is a bent ridge: products of what the data know well and what they know badly (a
moment's coefficient over an inertia) turn stiff directions as weak ones move, so a sampler in straight coordinates takes
steps of the narrowest place. `Coordinates` straighten it by a triangular map: each coordinate is shifted by a square of
weaker ones and scaled by an exponential of them. The map is one to one whatever its numbers, so the draws are of the
density itself however well it fits.

A density is drawn from by NUTS (nutpie), whose every step takes the derivatives in all directions.

References
----------
M. D. Parno and Y. M. Marzouk, "Transport map accelerated Markov chain Monte Carlo", *SIAM/ASA Journal on Uncertainty
Quantification* 6(2), 2018, pp. 645-682.
M. D. Hoffman and A. Gelman, "The No-U-Turn Sampler: adaptively setting path lengths in Hamiltonian Monte Carlo", *Journal
of Machine Learning Research* 15, 2014, pp. 1593-1623.
A. Vehtari, A. Gelman, D. Simpson, B. Carpenter and P.-C. Buerkner, "Rank-normalization, folding, and localization: an
improved R-hat for assessing convergence of MCMC", *Bayesian Analysis* 16(2), 2021, pp. 667-718.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final, Protocol, Self

import numpy as np
from scipy.special import expit

from stoop.extend.arrays import FloatArray, thread_count
from stoop.extend.errors import IdentificationError
from stoop.extend.fits import MethodIntervals
from stoop.extend.verbs import install


@dataclass(frozen=True)
class SamplerSettings:
    """Settings of the sampler and of its checks."""

    box_std: float = 0.29  #: of a value thrown blindly into a box of width 1
    corner: float = 0.3  #: standard deviations over which a bound is rounded
    #: independent draws' worth, in the middle and in the tails of every parameter (Vehtari et al. 2021, section 4)
    min_sample_size: float = 400.0
    #: Monte Carlo standard error of every parameter's standard deviation, of this
    max_std_error: float = 0.03
    chains: int = 4  #: as R-hat's authors ask for
    tuning: int = 300  #: draws of every chain that find length and scale of steps, and are thrown away
    draws: int = 900  #: of every chain
    rounds: int = 5  #: of as many chains more, until all together have converged
    file_draws: int = 25000  #: draws in the file, at most
    block: int = 512  #: points that are mapped at a time


SAMPLER: Final = SamplerSettings()
MISSING: Final = f"the posterior needs nutpie and arviz; {install('posterior')}"


class Density(Protocol):
    """Logarithm of a density on the unit box, up to a constant."""

    def slopes(self, x: FloatArray, directions: FloatArray) -> tuple[float, FloatArray]:
        """Return it at a point (k,), and its derivatives (m,) along directions (k, m)."""
        ...


@dataclass(frozen=True, eq=False)
class Coordinates:
    r"""Unbounded coordinates :math:`\xi` of the unit box, the weakest first.

    .. math:: w_i = \xi_i \exp\Big(\sum_{j<i} g_{ij} \xi_j\Big) + \sum_{j,l<i} b_{ijl} \xi_j \xi_l, \qquad
              u = c + F w, \qquad x = s \ln\frac{1 + e^{u/s}}{1 + e^{(u-1)/s}}

    The last is u itself in the box, rounded off towards its bounds over the length s.
    """

    center: FloatArray  #: c, (k,)
    factor: FloatArray  #: F, (k, k); its product with its own transpose is a covariance near the density's
    corner: FloatArray  #: s, (k,)
    bend: FloatArray  #: b, (k, k, k), symmetric in the last two
    growth: FloatArray  #: g, (k, k)

    @classmethod
    def straight(cls, center: FloatArray, factor: FloatArray) -> Self:
        """Return coordinates without bends."""
        k = len(center)
        corner = SAMPLER.corner * np.sqrt(np.sum(factor**2, axis=1))
        return cls(center, factor, corner, np.zeros((k, k, k)), np.zeros((k, k)))

    def bent(self, curvature: FloatArray) -> Self:
        """Return the coordinates that take off a `curvature` (k, k, k), d^2 phi_i / dw_j dw_l, as far as j, l <= i."""
        k = len(self.center)
        even = 0.5 * (curvature + np.swapaxes(curvature, 1, 2))
        own = np.arange(k)
        weaker = own[None, :] < own[:, None]
        bend = np.where(weaker[:, :, None] & weaker[:, None, :], -0.5 * even, 0.0)
        growth = np.where(weaker, -even[own, own], 0.0)
        return type(self)(self.center, self.factor, self.corner, bend, growth)

    def points(self, xi: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points (W, k) of the box for (W, k), and the logarithms (W,) of their volume."""
        found = [self._block(xi[i : i + SAMPLER.block]) for i in range(0, len(xi), SAMPLER.block)]
        return np.concatenate([x for x, _ in found]), np.concatenate([v for _, v in found])

    def _block(self, xi: FloatArray) -> tuple[FloatArray, FloatArray]:
        with np.errstate(over="ignore", invalid="ignore"):
            growth = xi @ self.growth.T
            turned = np.tensordot(xi, self.bend, axes=(1, 2))  # (W, k, k)
            w = xi * np.exp(growth) + np.einsum("wij,wj->wi", turned, xi)
            low, high = self._ends(self.center + w @ self.factor.T)
            x = self.corner * (np.logaddexp(0.0, low) - np.logaddexp(0.0, high))
            volume = np.sum(growth - np.logaddexp(0.0, -low) - np.logaddexp(0.0, high), axis=1)
        return np.asarray(x), np.asarray(volume)

    def _ends(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        return u / self.corner, (u - 1.0) / self.corner

    def tangent(self, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the point (k,) of the box for w (k,), and its derivatives (k, k)."""
        low, high = self._ends(self.center + self.factor @ w)
        x = self.corner * (np.logaddexp(0.0, low) - np.logaddexp(0.0, high))
        return x, (expit(low) * expit(-high))[:, None] * self.factor

    def density(self, target: Density, xi: FloatArray) -> tuple[float, FloatArray]:
        """Return the log density of the coordinates at (k,), and its gradient (k,)."""
        with np.errstate(over="ignore", invalid="ignore"):
            growth, turned = np.exp(self.growth @ xi), self.bend @ xi
            w = xi * growth + turned @ xi
            low, high = self._ends(self.center + self.factor @ w)
            x, directions = self.tangent(w)
            if not (np.isfinite(x).all() and np.isfinite(directions).all()):
                return -np.inf, np.zeros(len(xi))
            value, slopes = target.slopes(x, directions)
            slopes = slopes + self.factor.T @ ((expit(-low) - expit(high)) / self.corner)
            volume = self.growth @ xi - np.logaddexp(0.0, -low) - np.logaddexp(0.0, high)
            gradient = slopes * growth + 2.0 * turned.T @ slopes
            gradient += self.growth.T @ (slopes * xi * growth + 1.0)
            value += float(np.sum(volume))
        found = np.isfinite(value) and np.isfinite(gradient).all()
        return (value, gradient) if found else (-np.inf, np.zeros(len(xi)))


@dataclass(frozen=True, eq=False)
class Chains:
    """Draws of a posterior."""

    draws: FloatArray  #: (chains, steps, k); in the unit box, warm-up left out
    density: FloatArray  #: (chains, steps); logarithm, up to a constant
    #: convergence: ``rhat`` (greatest), ``ess_bulk``, ``ess_tail`` (least), ``std_error`` (greatest Monte Carlo standard error
    #: of a standard deviation, of this), ``acceptance`` (mean), ``chains``, ``steps``, and ``divergences`` of Hamiltonian
    #: Monte Carlo
    figures: dict[str, float]

    @property
    def sample_size(self) -> float:
        """Independent draws' worth, of the worst parameter."""
        return min(self.figures["ess_bulk"], self.figures["ess_tail"])

    @property
    def converged(self) -> bool:
        """Whether the chains agree, with enough independent draws."""
        enough = self.sample_size >= SAMPLER.min_sample_size
        return (
            enough
            and self.figures["rhat"] <= MethodIntervals.MAX_RHAT
            and self.figures["std_error"] <= SAMPLER.max_std_error
        )

    @classmethod
    def of(cls, draws: FloatArray, density: FloatArray, **more: float) -> Self:
        """Return the chains with their figures."""
        arviz = library("arviz")
        square = (draws - draws.mean(axis=(0, 1))) ** 2
        data = arviz.convert_to_dataset({"x": draws, "square": square})
        with np.errstate(all="ignore"):
            scatter = np.var(square, axis=(0, 1)) / np.mean(square, axis=(0, 1)) ** 2
            figures = {
                "rhat": float(np.max(np.asarray(arviz.rhat(data)["x"]))),
                "ess_bulk": float(np.min(np.asarray(arviz.ess(data, method="bulk")["x"]))),
                "ess_tail": float(np.min(np.asarray(arviz.ess(data, method="tail")["x"]))),
                "std_error": float(
                    np.max(0.5 * np.sqrt(scatter / np.asarray(arviz.ess(data, method="mean")["square"])))
                ),
            }
        counts = {"chains": float(draws.shape[0]), "steps": float(draws.shape[1])}
        return cls(draws, density, figures | more | counts)


Watch = Callable[[str], None]


def sample(target: Density, coordinates: Coordinates, seed: int, watch: Watch = lambda _: None) -> Chains:
    """Draw until R-hat, the effective sample size and the error of standard deviations are good, or as often as allowed.

    `watch` receives the progress. Errors are those of :func:`check_libraries`.
    """
    check_libraries()
    for chains in hamiltonian(target, coordinates, seed, watch):
        if chains.converged:
            break
    return chains


def hamiltonian(target: Density, coordinates: Coordinates, seed: int, watch: Watch) -> Iterator[Chains]:
    """Yield more and more chains of NUTS; they run side by side, and each depends on its number and the seed alone."""
    nutpie, k = library("nutpie"), len(coordinates.center)
    evaluations = 0

    def evaluate(xi: FloatArray) -> tuple[float, FloatArray]:
        nonlocal evaluations
        evaluations += 1
        return coordinates.density(target, np.array(xi))

    def begin(chain_seed: int) -> FloatArray:
        random, spread = np.random.default_rng(chain_seed), 1.0
        while True:  # nearer to the estimate until the density is above zero
            xi = spread * random.standard_normal(k)
            if np.isfinite(evaluate(xi)[0]) or spread < 1e-3:
                return np.asarray(xi)
            spread *= 0.7

    model = library("nutpie.compiled_pyfunc").from_pyfunc(
        k, lambda: evaluate, lambda *_: lambda xi: {"xi": xi}, [np.dtype(np.float64)], [(k,)], ["xi"],
        make_initial_point_fn=begin,
    )  # fmt: skip
    drawn: list[Any] = []
    for own in (seed, *np.random.SeedSequence(seed).generate_state(SAMPLER.rounds - 1).tolist()):
        run = nutpie.sample(
            model, draws=SAMPLER.draws, tune=SAMPLER.tuning, chains=SAMPLER.chains, seed=own, blocking=False,
            cores=min(thread_count(), SAMPLER.chains), progress_bar=False, save_warmup=False,
        )  # fmt: skip
        drawn.append(_finished(run, lambda: watch(f"posterior: {evaluations} gradients")))
        xi = np.concatenate([np.asarray(one.posterior["xi"]) for one in drawn])
        height, accepted, diverging = (
            np.concatenate([np.asarray(one.sample_stats[name]) for one in drawn])
            for name in ("logp", "mean_tree_accept", "diverging")
        )
        points, volume = coordinates.points(xi.reshape(-1, k))
        more = {"acceptance": float(accepted.mean()), "divergences": float(diverging.sum())}
        density = height - volume.reshape(height.shape)
        yield Chains.of(points.reshape(xi.shape), density, **more, gradients=float(evaluations))


def _finished(run: Any, watch: Callable[[], None]) -> Any:
    """Return the draws of a run when it has ended; an interruption ends it, without any."""
    try:
        while True:
            try:
                return run.wait(timeout=1.0)
            except TimeoutError:
                watch()
    except BaseException:
        run.cancel()
        raise


def check_libraries() -> None:
    """Import nutpie and arviz; an IdentificationError says that one is not installed."""
    for name in ("nutpie", "arviz"):
        library(name)


def library(name: str) -> Any:
    """Return a module; an IdentificationError says that it is not installed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # arviz announces its next version
            return importlib.import_module(name)
    except ImportError:
        raise IdentificationError(MISSING) from None
