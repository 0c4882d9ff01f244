"""Walkers through a posterior: emcee, until its own statistics say that it has converged.

References
----------
A. Vehtari, A. Gelman, D. Simpson, B. Carpenter and P.-C. Buerkner, "Rank-normalization, folding, and localization: an
improved R-hat for assessing convergence of MCMC", *Bayesian Analysis* 16(2), 2021, pp. 667-718.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.assess.posterior import Reference, fitted
from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError

WARM_UP: Final = (150, 300)  #: steps thrown away; after each the proposals are fitted to its second half
ROUND: Final = 250  #: steps between looks at convergence
MOST: Final = 8000  #: steps at most
RHAT: Final = 1.01  #: of every parameter, at most
ESS: Final = 1000.0  #: independent draws' worth, in the middle and in the tails of every parameter, at least
LEAST_WALKERS: Final = 32
MISSING: Final = "the posterior needs emcee and arviz; install them with pip install 'stoop[posterior]'"


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
        return f["rhat"] <= RHAT and min(f["ess_bulk"], f["ess_tail"]) >= ESS


def sample(
    target: Callable[[FloatArray], FloatArray],
    reference: Reference,
    seed: int,
    watch: Callable[[int], None] | None = None,
) -> Chains:
    """Walk until R-hat and the effective sample size are good, at most `MOST` steps.

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
    walkers = max(LEAST_WALKERS, 2 * len(reference.center) + 2)
    random = np.random.RandomState(seed)
    state = emcee.State(_start(target, reference, walkers, random), random_state=random.get_state())
    for steps in WARM_UP:
        sampler = _sampler(emcee, target, reference, walkers)
        state = sampler.run_mcmc(state, steps, skip_initial_state_check=True)
        reference = fitted(reference, sampler.get_chain(discard=steps // 2, flat=True))
    sampler = _sampler(emcee, target, reference, walkers)
    while sampler.iteration < MOST:
        state = sampler.run_mcmc(state, ROUND, skip_initial_state_check=True)
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
