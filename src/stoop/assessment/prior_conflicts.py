r"""Whether priors contradict the flight: each one against the estimate without it, and all together.

With the information A of a fit (data and priors, as they were weighted), C its inverse, K the covariance of its error bars and
S the diagonal matrix of the variances of the priors, the estimates x of numbers with priors differ from the means m by

.. math:: e = x - m, \qquad \operatorname{cov} e = V = S + K - 2 C,

for what an estimate has of its own prior is C / S of that prior's error. (With noise as it was weighted K = C, and V = S - C.)
:math:`z_i = e_i / \sqrt{V_{ii}}` is the difference between the estimate without the prior i and that prior over the standard
deviation of both; :math:`e' V^{-1} e` is chi-square. The estimate itself has been moved to the prior, and is nearer to it.

To count conflicts that another one causes once, the prior of the largest z that is significant among all (Bonferroni) is
widened to the standard deviation of greatest marginal likelihood, the fit is updated to first order, and the next one is looked
for.

References
----------
M. Evans and H. Moshonov, "Checking for prior-data conflict", *Bayesian Analysis* 1(4), 2006, pp. 893-914.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import chi2, norm

from stoop.assessment.error_bars import GIVEN_MODEL, ErrorBars, Limits
from stoop.assessment.verdict import Limits as VerdictLimits
from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.estimate.estimate import Estimate

#: probability that right priors are said to contradict the flight
LEVEL: Final = VerdictLimits.chance


@dataclass(frozen=True)
class PriorConflict:
    """A prior and what the flight and all other priors say of its number, SI."""

    name: str
    mean: float
    prior: float
    #: without the prior, and its standard error
    estimate: float
    std: float
    #: difference over the standard deviation of both
    ratio: float
    #: standard deviation of greatest marginal likelihood, at least that of the prior
    consistent: float


@dataclass(frozen=True, eq=False)
class PriorTests:
    """Conflicts, the worst first, and the test of all priors together once these are widened."""

    conflicts: tuple[PriorConflict, ...] = ()
    chi_square: float = 0.0
    degrees: int = 0
    p_value: float = 1.0


@dataclass(eq=False)
class _Linearized:
    """A fit to first order: information A (f, f), covariance K (f, f), and m of its unknowns that have priors."""

    A: FloatArray
    K: FloatArray
    own: IntArray  #: (m,)
    error: FloatArray  #: (f,), of the estimates from the means
    prior: FloatArray  #: (m,), standard deviations

    def difference(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return C (m, m) of A's inverse, V (m, m), and which priors (m,) the data add something to."""
        own = np.ix_(self.own, self.own)
        C, K = np.asarray(np.linalg.inv(self.A))[own], self.K[own]
        V = np.diag(self.prior**2) + K - 2.0 * C
        at_least = self.prior**2 - np.diag(C)  # noise is not less than it was weighted for
        np.fill_diagonal(V, np.maximum(np.diag(V), at_least))
        seen: BoolArray = np.sqrt(np.diag(C)) < Limits.prior_share * self.prior
        return C, V, seen

    def worst(self, names: list[str], means: FloatArray, level: float) -> tuple[int, PriorConflict] | None:
        """Return the prior that contradicts the flight most, if it does at a level."""
        C, V, seen = self.difference()
        e, variance = self.error[self.own], np.diag(V)
        z = np.where(seen, e / np.sqrt(np.where(seen, variance, 1.0)), 0.0)
        i = int(np.argmax(np.abs(z)))
        if abs(z[i]) <= norm.isf(0.5 * level / max(int(seen.sum()), 1)):
            return None
        rest = 1.0 - C[i, i] / self.prior[i] ** 2  # of the information, without this prior
        apart, spread = float(e[i]) / rest, float(variance[i]) / rest**2
        mean, prior = float(means[i]), float(self.prior[i])
        std = math.sqrt(max(spread - prior**2, 0.0))
        wide = math.sqrt(max(apart**2 - std**2, prior**2))
        return i, PriorConflict(names[i], mean, prior, float(means[i] + apart), std, float(z[i]), wide)

    def widen(self, i: int, std: float) -> None:
        """Widen a prior: the estimates move to where the rest has them."""
        j, before = self.own[i], self.A.copy()
        change = std**-2 - self.prior[i] ** -2
        self.A[j, j] += change
        C = np.linalg.inv(self.A)
        middle = before @ self.K @ before
        middle[j, j] += change
        self.K = C @ middle @ C
        self.error = self.error - C[:, j] * change * self.error[j]
        self.prior = self.prior.copy()
        self.prior[i] = std


def prior_tests(fit: Estimate, bars: ErrorBars) -> PriorTests:
    """Return which priors of free parameters contradict the flight; none away from an optimum's evidence."""
    layout, found = fit.problem.layout, bars.uncertainty
    there = np.flatnonzero(np.isfinite(np.diag(found.corrected)) & np.isfinite(np.diag(found.cramer_rao)))
    place = {int(unknown): k for k, unknown in enumerate(bars.free[there])}
    known = [(i, p) for i, p in enumerate(layout.parameters) if p.prior is not None and i in place]
    if not known:
        return PriorTests()
    K = bars.of_free(*GIVEN_MODEL, "maneuvers")[np.ix_(there, there)]
    own = np.array([place[i] for i, _ in known], dtype=np.intp)
    estimates = np.array([fit.estimates[p.name] for _, p in known])
    means, prior = np.array([p.prior_about(x) for (_, p), x in zip(known, estimates, strict=True)]).T
    error = np.zeros(len(there))
    error[own] = estimates - means
    one = _Linearized(found.information[np.ix_(there, there)], K, own, error, prior)
    conflicts, names = list[PriorConflict](), [p.name for _, p in known]
    while len(conflicts) < len(names) and (worst := one.worst(names, means, LEVEL)):
        conflicts.append(worst[1])
        one.widen(worst[0], worst[1].consistent)
    _, V, seen = one.difference()
    if not seen.any():
        return PriorTests(tuple(conflicts))
    values, axes = np.linalg.eigh(V[np.ix_(seen, seen)] / np.outer(one.prior[seen], one.prior[seen]))
    kept = values > 1.0 - Limits.prior_share**2  # of other directions the data say next to nothing
    along = axes[:, kept].T @ (one.error[own] / one.prior)[seen]
    total, degrees = float(np.sum(along**2 / values[kept])), int(kept.sum())
    return PriorTests(tuple(conflicts), total, degrees, float(chi2.sf(total, degrees)) if degrees else 1.0)
