r"""Linear mixed model of a figure over a fleet, with the known error of every flight, by restricted maximum likelihood.

.. math:: y = X \beta + \sum_g Z_g u_g + f + e

A group g (vehicles, parts in a place) has levels u_g of one variance; they may be crossed, since parts move between vehicles.
f is what differs from flight to flight, of one unknown variance; e is the error of each flight's estimate, of known variance.

References
----------
.. [1] H. D. Patterson, R. Thompson, "Recovery of inter-block information when block sizes are unequal", Biometrika 58
   (1971) 545.
.. [2] D. Bates, M. Mächler, B. Bolker, S. Walker, "Fitting linear mixed-effects models using lme4", Journal of
   Statistical Software 67 (2015), section 3: the penalized least-squares problem.
.. [3] W. Viechtbauer, "Bias and efficiency of meta-analytic variance estimators in the random-effects model", Journal of
   Educational and Behavioral Statistics 30 (2005) 261: known errors.
.. [4] Y. Chung, S. Rabe-Hesketh, V. Dorie, A. Gelman, J. Liu, "A nondegenerate penalized likelihood estimator for variance
   parameters in multilevel models", Psychometrika 78 (2013) 685.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Final

import numpy as np
from scipy.linalg import cho_solve, cholesky
from scipy.optimize import Bounds, minimize
from scipy.sparse import csr_array, hstack, vstack
from scipy.stats import norm

from stoop.extend.arrays import FloatArray, IntArray

LEVEL: Final = 0.01  #: probability that of all levels one is taken for outlying by chance
MOST_OUTLYING: Final = 0.2  #: share of the levels
NARROWEST: Final = 1e-6  #: likewise at least, of a penalized model
WIDEST: Final = 3.0  #: standard deviation of an effect over that of all readings, at most


@dataclass(frozen=True, eq=False)
class Design:
    """Rows of a figure: readings with their known errors, fixed effects, and levels of groups.

    Attributes
    ----------
    values : (n,)
    errors : (n,) known standard deviations, unit of the values
    fixed : (n, p) regressors of full column rank, the intercept among them
    groups : group -> (n,) index of the level of each row, -1 where it has none
    """

    values: FloatArray
    errors: FloatArray
    fixed: FloatArray
    groups: Mapping[str, IntArray]

    def with_apart(self, group: str, level: int) -> Design:
        """Return the design with a level of a group as a fixed effect of its own, the last one."""
        own = self.groups[group] == level
        groups = {**self.groups, group: np.where(own, -1, self.groups[group])}
        return replace(self, fixed=np.column_stack([self.fixed, own]), groups=groups)

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Number of levels of each group."""
        return tuple(int(levels.max(initial=-1)) + 1 for levels in self.groups.values())

    @cached_property
    def matrix(self) -> csr_array:
        """The columns [X Z] (n, p + q), sparse."""
        blocks = [csr_array(self.fixed)]
        for levels, size in zip(self.groups.values(), self.sizes, strict=True):
            rows = np.flatnonzero(levels >= 0)
            shape = (len(levels), size)
            blocks.append(csr_array((np.ones(len(rows)), (rows, levels[rows])), shape=shape))
        return csr_array(hstack(blocks))

    @cached_property
    def sums(self) -> csr_array:
        """What makes of weights (n,) the sums [X Z]' W [X Z], by rows, then [X Z]' W y, then y' W y."""
        columns = self.matrix.shape[1]
        entries = self.matrix.tocoo()
        of_rows = csr_array(
            (entries.data, (entries.coords[0], np.arange(entries.nnz))), (len(self.values), entries.nnz)
        )
        row, pair = (of_rows.T @ of_rows).nonzero()  # entries that stand in one row
        at, values = entries.coords[1], entries.data
        products = csr_array(
            (values[row] * values[pair], (at[row] * columns + at[pair], entries.coords[0][row])),
            (columns**2, len(self.values)),
        )
        with_values = csr_array(self.matrix.T.multiply(self.values))
        return csr_array(vstack([products, with_values, csr_array(self.values[None] ** 2)]))


@dataclass(frozen=True, eq=False)
class MixedModel:
    """A fitted model.

    Attributes
    ----------
    design : Design
    deviations : group -> standard deviation of its levels, unit of the values
    flight : standard deviation from flight to flight beside the known errors
    coefficients : (p,) of the fixed effects
    levels : group -> (k,) best linear unbiased predictions of its levels
    covariance : (p + q, p + q) of the errors of coefficients and levels, given the deviations
    log_likelihood : restricted
    """

    design: Design
    deviations: Mapping[str, float]
    flight: float
    coefficients: FloatArray
    levels: Mapping[str, FloatArray]
    covariance: FloatArray
    log_likelihood: float

    @property
    def errors(self) -> FloatArray:
        """Standard errors (p,) of the coefficients."""
        return np.sqrt(np.diag(self.covariance)[: len(self.coefficients)])


@dataclass(frozen=True)
class Outlier:
    """A level of a group that differs from the others by more than these from each other."""

    group: str
    level: int
    difference: float  #: from the mean of the fleet
    error: float  #: standard error of that
    ratio: float  #: difference over its standard deviation by chance, the spread of the group among it


@dataclass(frozen=True, eq=False)
class _Solution:
    root: FloatArray  #: lower Cholesky factor of the scaled normal matrix
    scales: FloatArray  #: (p + q,) of its columns
    effects: FloatArray  #: (p + q,), scales taken off
    deviance: float  #: -2 times the restricted log-likelihood, without constants
    slope: FloatArray  #: of the deviance by the standard deviations of flights and groups


def fit_mixed_model(design: Design, penalized: bool = False) -> MixedModel:
    """Return the model whose standard deviations have the highest restricted likelihood.

    Parameters
    ----------
    design : Design
    penalized : bool
        Whether the likelihood is multiplied by the standard deviation of each group ([4]_). Of few levels it is often highest at
        zero, that is at levels which are known to be equal; the penalty moves that by about its standard error.

    Raises
    ------
    numpy.linalg.LinAlgError
        When the fixed effects are collinear.
    """
    mean = np.linalg.lstsq(design.fixed, design.values)[0]
    centered = replace(
        design, values=design.values - design.fixed @ mean
    )  # else sums of squares would cancel
    unit = float(np.std(centered.values)) or 1.0
    count = 1 + len(design.groups)

    def deviance(x: FloatArray) -> tuple[float, FloatArray]:
        own, spreads = _solved(centered, unit * x), x[1:] if penalized else np.ones(count - 1)
        penalty_slope = np.array([0.0, *(2.0 * penalized / spreads)])
        return own.deviance - 2.0 * float(np.sum(np.log(spreads))), unit * own.slope - penalty_slope

    least = np.array([0.0] + [NARROWEST * penalized] * len(design.groups))
    starts = product((0.1, 0.5), repeat=count)
    start = min(starts, key=lambda x: deviance(np.array(x))[0])
    found = minimize(
        deviance, np.array(start), method="L-BFGS-B", jac=True, bounds=Bounds(least, WIDEST),
        options={"ftol": 1e-12, "gtol": 1e-8},
    )  # fmt: skip
    deviations = unit * found.x
    solution = _solved(centered, deviations)
    inverse = cho_solve((solution.root, True), np.eye(len(solution.effects)))
    covariance = solution.scales[:, None] * inverse * solution.scales
    p = design.fixed.shape[1]
    levels = np.split(solution.effects[p:], np.cumsum(design.sizes))[:-1]
    n = len(design.values)
    return MixedModel(
        design,
        dict(zip(design.groups, deviations[1:].tolist(), strict=True)),
        float(deviations[0]),
        mean + solution.effects[:p],
        dict(zip(design.groups, levels, strict=True)),
        covariance,
        -0.5 * (solution.deviance + (n - p) * float(np.log(2.0 * np.pi))),
    )


def fit_robust_model(design: Design) -> tuple[MixedModel, tuple[Outlier, ...]]:
    """Return the model whose spreads are those of the levels without the outlying ones, and these.

    Spreads are penalized, see `fit_mixed_model`. One after the other, the level that differs most becomes a fixed effect of its
    own, as long as it differs by more than chance would let the largest of all levels do (Bonferroni, `LEVEL`).
    """
    model, out = fit_mixed_model(design, True), list[Outlier]()
    room = len(design.errors) - design.fixed.shape[1] - 1  # for effects beside which readings are left
    for _ in range(min(int(MOST_OUTLYING * sum(design.sizes)), room)):
        ratios = {
            (group, int(k)): abs(levels[k]) / (model.deviations[group] or np.inf)
            for group, levels in model.levels.items()
            if len(levels)
            for k in [np.argmax(np.abs(levels))]
        }
        (group, level) = max(ratios, key=lambda place: ratios[place])
        apart = design.with_apart(group, level)
        trial = fit_mixed_model(apart, True)
        difference, error = float(trial.coefficients[-1]), float(trial.errors[-1])
        by_chance = float(np.hypot(trial.deviations[group], error))
        if abs(difference) <= norm.isf(0.5 * LEVEL / sum(design.sizes)) * by_chance:
            break
        design, model = apart, trial
        out.append(Outlier(group, level, difference, error, difference / by_chance))
    return model, tuple(out)


def _solved(design: Design, deviations: FloatArray) -> _Solution:
    """Solve the mixed-model equations for standard deviations of flights and groups, which may be zero."""
    p = design.fixed.shape[1]
    variances = deviations[0] ** 2 + design.errors**2
    scales = np.concatenate([np.ones(p), np.repeat(deviations[1:], design.sizes)])
    columns = len(scales)
    sums = design.sums @ np.column_stack([1.0 / variances, variances**-2.0])
    normal, again = sums[: columns**2].T.reshape(2, columns, columns)
    right, right_again = sums[columns**2 : -1].T
    random = np.diag((np.arange(columns) >= p).astype(float))
    root = cholesky(scales[:, None] * normal * scales + random, lower=True)
    scaled = cho_solve((root, True), scales * right)
    effects = scales * scaled
    squares = float(sums[-1, 0] - effects @ right)
    deviance = float(np.sum(np.log(variances))) + 2.0 * float(np.sum(np.log(np.diag(root)))) + squares
    half = scales[:, None] * cho_solve((root, True), np.eye(columns))
    left = float(sums[-1, 1] - 2.0 * effects @ right_again + effects @ again @ effects)
    by_flight = float(np.sum(1.0 / variances)) - float(np.sum(again * (half * scales))) - left
    by_level = np.sum(normal * half.T, axis=1) - scaled * (right - normal @ effects)
    of = np.repeat(np.arange(len(design.sizes)), design.sizes)
    by_group = np.bincount(of, by_level[p:], len(design.sizes))
    slope = 2.0 * np.array([deviations[0] * by_flight, *by_group])
    return _Solution(root, scales, effects, deviance, slope)


def indices(labels: Sequence[str | None]) -> tuple[IntArray, tuple[str, ...]]:
    """Return the index of each label among the sorted different ones, -1 for None, and these."""
    names = tuple(sorted({label for label in labels if label is not None}))
    place = {name: i for i, name in enumerate(names)}
    return np.array([-1 if label is None else place[label] for label in labels], dtype=np.intp), names
