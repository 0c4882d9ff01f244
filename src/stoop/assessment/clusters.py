r"""Comparison of the disagreement of maneuvers (or flights) with what the color of their residuals explains.

Errors of a model persist throughout a maneuver and differ between maneuvers: the scores of maneuvers, s_g = S_g' r_g, then
scatter more than under stationary noise. To first order the influence of maneuver g on the estimate of a parameter j is

.. math:: u_{gj} = (D^{-1} s_g)_j, \qquad \textstyle\sum_g u_{gj} = 0.

The sum of their squares is the sandwich covariance clustered by maneuver. With few maneuvers it is biased toward zero, because
each maneuver takes part in the fit, and it has few degrees of freedom. Both follow exactly from the color of the residuals: with
K_j the covariance (G, G) of the influences of G clusters under that noise,

.. math:: t_j^2 = \sum_g u_{gj}^2 / \mathrm{tr} K_j, \qquad \nu_j = (\mathrm{tr} K_j)^2 / \mathrm{tr} K_j^2

is the ratio of the variance found to the one expected, with :math:`\nu_j` degrees of freedom (Bell and McCaffrey; Satterthwaite).
Two to eight maneuvers give a parameter one to seven degrees of freedom, too few for a test of one parameter, but a fit has many
parameters. Their ratios are modeled as draws from one population, t_j^2 / s^2 ~ F(nu_j, d): s^2 is their common excess, and a
large d means that the excess is the same for all of them. The ratios of the others moderate that of each parameter,

.. math:: (d s^2 + \nu_j t_j^2) / (d + \nu_j),

with d + nu_j degrees of freedom (Smyth). The half width of the 95 % interval is averaged over the posterior distribution of s
and d, and over whether the model is right (prior probability 0.8). A variance is never reduced: a ratio below 1 is chance. The
common excess of the others widens the interval of a parameter that one maneuver alone determines. The share of the priors in a
variance is not widened.

References
----------
R. M. Bell and D. F. McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples", *Survey
Methodology* 28(2), 2002, pp. 169-181.
G. K. Smyth, "Linear models and empirical Bayes methods for assessing differential expression in microarray experiments",
*Statistical Applications in Genetics and Molecular Biology* 3(1), 2004, article 3, section 3 to 6.
R. T. Birge, "The calculation of errors by the method of least squares", *Physical Review* 40, 1932, pp. 207-227.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from stoop.assessment.coloring import ColoredNoise, Coloring
from stoop.assessment.covariance import NORMAL_95
from stoop.base.arrays import FloatArray


class Limits:
    """Thresholds and grids of the comparison of clusters; verified by ``stoop verify misspecified``."""

    #: least share of a parameter's variance that is expected between clusters; below it one cluster alone determines the
    #: parameter
    min_share: Final = 0.1
    #: largest share of the priors in a variance: maneuvers cannot disagree about priors
    max_prior: Final = 0.5
    #: grid of the degrees of freedom d of the population; infinite: the same excess for all parameters
    degrees: Final = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 64.0, np.inf)
    excess: Final = (-2.3, 4.6, 70)  #: grid of log s^2
    #: prior standard deviation of log s^2, which dominates in a fit of few parameters
    prior: Final = 2.0
    #: prior probability that the model is right: no excess in any parameter
    right: Final = 0.8


@dataclass(frozen=True, eq=False)
class Influence:
    """Squared influence of clusters on k parameters, relative to its expectation under colored noise."""

    ratio: FloatArray  #: (k,), t^2
    degrees: FloatArray  #: (k,), nu; zero where one cluster alone determines the parameter
    prior: FloatArray  #: (k,), share of the priors in the variance


@dataclass(frozen=True, eq=False)
class Scatter:
    """Factors by which the disagreement of clusters widens the intervals of k parameters."""

    clusters: int
    compared: int  #: parameters that two clusters or more determine
    excess: float  #: s, the factor on standard errors that parameters have in common; its geometric mean
    #: (k,), factor on each standard error, at least 1: half width of the interval over 1.96
    stretch: FloatArray


def cluster_scatter(
    coloring: Coloring, noise: ColoredNoise, labels: Sequence[Hashable], count: int
) -> Scatter | None:
    """Return the scatter of the first `count` unknowns between clusters of segments.

    `labels` names the cluster of each segment. None where there is one cluster, or no parameter that two determine.
    """
    names = list(dict.fromkeys(labels))
    if len(names) < 2 or not count:
        return None
    influence = cluster_influence(coloring, noise, [names.index(label) for label in labels], count)
    if not influence.degrees.any():
        return None
    return moderated_scatter(influence, len(names))


def cluster_influence(
    coloring: Coloring, noise: ColoredNoise, cluster_of: Sequence[int], count: int
) -> Influence:
    """Return the influence of clusters on the first `count` unknowns; `cluster_of` each segment, from 0 to G - 1.

    The score of unknowns of one cluster (its initial states and biases), priors included, is zero at the optimum.
    """
    inverse, clusters, total = coloring.inverse, max(cluster_of) + 1, coloring.middles(noise)
    direction = inverse.factor[:count].T  # (r, j): rows of the inverse, in coordinates of unit information
    row = inverse.factor @ direction  # (k, j)
    score = np.zeros((clusters, len(row)))
    seen = np.zeros((clusters, *row.shape))  # information of a cluster times the rows
    noisy = np.zeros((clusters, *direction.shape))  # covariance of its score times the rows
    priors = coloring.prior
    parts = zip(coloring.segments, coloring.blocks, total, cluster_of, strict=True)
    for segment, block, middle, g in parts:
        residual, jacobian = segment.rows()
        score[g] += jacobian.T @ residual
        seen[g] += jacobian.T @ (jacobian @ row)
        noisy[g] += block.basis.T @ (middle @ (block.basis @ direction))
        noisy[g] += inverse.factor.T @ (segment.gap_information @ row)
        priors = priors - segment.gap_information
    sees = np.zeros((clusters, len(coloring.prior)), dtype=np.bool_)
    for segment, g in zip(coloring.segments, cluster_of, strict=True):
        sees[g] |= segment.filled()[1].any(axis=(0, 1))
    for g, own in enumerate(sees & (sees.sum(axis=0) == 1)):  # unknowns that act on one cluster only
        score[g, own] = 0.0
        prior = priors[np.ix_(own, own)] @ row[own]
        seen[g, own] += prior
        noisy[g] += inverse.factor[own].T @ prior
    answer = np.einsum("kr,gkj->jgr", inverse.factor, seen)  # of a cluster's score to the scores of all
    crossed = np.einsum("jgr,hrj->jgh", answer, noisy)
    covariance = answer @ coloring.spread(total) @ answer.transpose(0, 2, 1)
    covariance -= crossed + crossed.transpose(0, 2, 1)
    each = np.arange(clusters)
    covariance[:, each, each] += np.einsum("rj,grj->jg", direction, noisy)
    expected = np.einsum("jgg->j", covariance)
    squares = np.sum(covariance**2, axis=(1, 2))
    variance = np.einsum("rj,rs,sj->j", direction, coloring.spread(total), direction)
    prior_share = np.einsum("kj,kl,lj->j", row, priors, row) / variance
    seen_enough = (prior_share < Limits.max_prior) & (expected > Limits.min_share * variance)
    compared = inverse.determined[:count] & seen_enough
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio, degrees = np.sum((score @ row) ** 2, axis=0) / expected, expected**2 / squares
    shares = np.clip(np.nan_to_num(prior_share), 0.0, 1.0)
    return Influence(np.where(compared, ratio, 1.0), np.where(compared, degrees, 0.0), shares)


def moderated_scatter(influence: Influence, clusters: int) -> Scatter:
    """Return the scatter of clusters, each parameter's own ratio moderated by that of all."""
    compared = influence.degrees > 0.0
    degrees, logs = np.array(Limits.degrees), np.linspace(*Limits.excess)
    weights, right = _weights(influence.ratio[compared], influence.degrees[compared], degrees, logs)
    widths = np.full(len(compared), right)
    for d, row in zip(degrees, weights, strict=True):
        # of a parameter's own ratio
        share = 0.0 if np.isinf(d) else influence.degrees / (d + influence.degrees)
        quantile = stats.t.ppf(0.975, d + influence.degrees) / NORMAL_95
        variances = (1.0 - share) * np.exp(logs)[:, None] + share * influence.ratio
        widths += row @ np.sqrt(np.maximum(variances, 1.0)) * quantile
    excess = float(np.exp(0.5 * (weights.sum(axis=0) @ logs)))  # a right model has a logarithm of zero
    stretch = np.sqrt(influence.prior + (1.0 - influence.prior) * widths**2)
    return Scatter(clusters, int(compared.sum()), excess, stretch)


def _weights(
    ratio: FloatArray, own: FloatArray, degrees: FloatArray, logs: FloatArray
) -> tuple[FloatArray, float]:
    """Return posterior probabilities (d, s) of degrees of freedom and excess given t^2 and nu (j,), and that of a right model."""
    ratio = np.maximum(ratio, np.finfo(np.float64).tiny)
    scaled = ratio / np.exp(logs)[:, None]

    def chances(values: FloatArray, d: float) -> FloatArray:
        if np.isinf(d):
            return np.asarray(np.sum(stats.chi2.logpdf(own * values, own) + np.log(own), axis=-1))
        return np.asarray(np.sum(stats.f.logpdf(values, own, d), axis=-1))

    likelihood = np.array([chances(scaled, d) - len(ratio) * logs for d in degrees])
    right = float(chances(ratio, np.inf))
    top = max(float(likelihood.max()), right)
    prior = np.exp(-0.5 * (logs / Limits.prior) ** 2)
    weights = (1.0 - Limits.right) * prior / prior.sum() / len(degrees) * np.exp(likelihood - top)
    chance = Limits.right * float(np.exp(right - top))
    total = float(weights.sum()) + chance
    return weights / total, chance / total
