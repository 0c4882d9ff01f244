r"""Noise that is not normal, or not the same in every maneuver: a scale mixture, and a variance a maneuver.

**Outliers.** The residuals of a channel have the density of a mixture of two normals about zero,
:math:`f(r) = (1 - p) N(r; 0, \sigma^2) + p N(r; 0, \tau^2)`. Share p and width :math:`\tau / \sigma` are of maximum likelihood,
by the EM algorithm [1]_. A reading then weighs :math:`w(r) = \sigma^2 E[1 / s^2 | r] = 1 - P (1 - \sigma^2 / \tau^2)`, P the
probability that it belongs to the wide normal [2]_, and :math:`\psi(r) = w(r) r` is its score.

The fit sees pseudo-observations [3]_: the simulated reading plus :math:`u = \psi(r) / m`, where m is the mean of
:math:`\psi'(r)`, the share of the information that is left. Least squares on these solve the equations of maximum likelihood,
:math:`\sum J' \psi(r) = 0`; and the variance of u, :math:`E[\psi^2] / m^2`, is that with which an M-estimator scatters. Cost,
information, color and error bars therefore need no special case.

A filter takes the readings of the smallest weights as not measured: an outlier that corrects the state disturbs what follows.

**Maneuvers.** Variances of a channel that differ between maneuvers by more than chance (Bartlett's test, each maneuver with as
many samples as are independent) are estimated one by one. Their logarithms are drawn toward their mean by empirical Bayes, the
more the fewer samples a maneuver has [4]_. A channel of a maneuver that has next to none is left out.

Normal noise that is the same in all maneuvers is the default: it is left as it is unless the residuals speak against it.

References
----------
.. [1] A. P. Dempster, N. M. Laird and D. B. Rubin, "Maximum likelihood from incomplete data via the EM algorithm", *Journal of
   the Royal Statistical Society B* 39(1), 1977.
.. [2] K. L. Lange, R. J. A. Little and J. M. G. Taylor, "Robust statistical modeling using the t distribution", *Journal of
   the American Statistical Association* 84(408), 1989, section 3; the contaminated normal is one of its scale mixtures.
.. [3] P. J. Huber, *Robust Statistics*, Wiley, 1981, sections 7.3 and 7.8 (modified residuals).
.. [4] G. K. Smyth, "Linear models and empirical Bayes methods for assessing differential expression in microarray
   experiments", *Statistical Applications in Genetics and Molecular Biology* 3(1), 2004, section 6.2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from scipy.special import digamma, expit, polygamma
from scipy.stats import chi2

from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.base.notices import Notice, notice
from stoop.base.robust import robust_std
from stoop.estimate.noise import correlation_times, effective_variance
from stoop.estimate.treatment import DEFAULT as TREATMENT
from stoop.estimate.treatment import Treatment
from stoop.problem import Misfit, Weights
from stoop.results.decisions import DecisionRecord, applied

EM_STEPS: Final = 500  #: at most
EM_TOLERANCE: Final = 1e-7  #: change of the mean logarithm of the likelihood at which EM ends


class Limits:
    """When residuals are taken as other than normal, and other in each maneuver."""

    #: twice the gain in the logarithm of the likelihood, by independent samples; two more parameters, one at its bound, gain
    #: 40 by chance less often than once in 10^8 channels, and residuals that a model error colors seldom
    likelihood_ratio: Final = 40.0
    #: samples over which outliers correlate, from which they are of the model and not of the sensor
    stretch: Final = 3.0
    variance_ratio: Final = 1.2  #: by which the variance of an estimate must fall
    #: excess kurtosis, below which no mixture is fitted, for time: one of which the wide part is less than half, and that
    #: lowers the variance by that ratio, has a larger one
    kurtosis: Final = 1.0
    level: Final = 1e-8  #: of Bartlett's test: that of the likelihood ratio
    min_samples: Final = 4.0  #: independent ones, below which a variance is not estimated
    weight: Final = 0.1  #: below which a filter leaves a reading out
    #: robust standard deviations, to which residuals are limited in the variance of a maneuver
    clipped: Final = 3.0
    named: Final = 1.5  #: times the noise of the other maneuvers, from which a maneuver is named


OUTLIERS_WEIGHTED: Final = "outliers weighted less or left out"


@dataclass(frozen=True)
class Mixture:
    """Two normal distributions about zero."""

    sigma: float  #: standard deviation of the clean readings
    share: float = 0.0  #: of the readings in the wide one
    width: float = 1.0  #: standard deviation of the wide one over sigma

    def _parts(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the logarithms of the densities of both parts."""
        clean = _log_normal(residuals, self.sigma) + np.log1p(-self.share)
        return clean, _log_normal(residuals, self.width * self.sigma) + np.log(self.share)

    def log_density(self, residuals: FloatArray) -> FloatArray:
        """Return the logarithm of the density of residuals."""
        return np.logaddexp(*self._parts(residuals)) if self.share else _log_normal(residuals, self.sigma)

    def outlying(self, residuals: FloatArray) -> FloatArray:
        """Return the probability that residuals are of the wide part."""
        clean, wide = self._parts(residuals)
        return np.asarray(expit(wide - clean))

    def weights(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the weights w and the derivatives of the score w r, like the residuals; those of NaN are NaN."""
        lost = 1.0 - self.width**-2.0
        probability = self.outlying(residuals)
        w = 1.0 - lost * probability
        return w, w - lost**2 * probability * (1.0 - probability) * (residuals / self.sigma) ** 2


def _log_normal(residuals: FloatArray, sigma: float) -> FloatArray:
    """Return the logarithm of the normal density about zero."""
    return np.asarray(-0.5 * (residuals / sigma) ** 2 - np.log(sigma * np.sqrt(2.0 * np.pi)))


def fit_mixture(residuals: FloatArray) -> Mixture:
    """Return the likeliest mixture for residuals (n,), by EM from a robust scale; one normal where all are equal in size."""
    squares = residuals**2
    mean = float(np.mean(squares))
    sigma = min(robust_std(residuals), 0.99 * float(np.sqrt(mean)))
    if not sigma > 0.0:
        return Mixture(float(np.sqrt(mean)))
    share = 0.1
    wide = max((mean - (1.0 - share) * sigma**2) / share, 4.0 * sigma**2)
    found, before = Mixture(sigma, share, float(np.sqrt(wide)) / sigma), -np.inf
    for _ in range(EM_STEPS):
        likelihood = float(np.mean(found.log_density(residuals)))
        if likelihood - before < EM_TOLERANCE:
            break
        probability, before = found.outlying(residuals), likelihood
        share = float(np.mean(probability))
        if not 0.0 < share < 1.0:
            break
        inside = float((1.0 - probability) @ squares) / (len(squares) * (1.0 - share))
        outside = float(probability @ squares) / (len(squares) * share)
        if not (inside > 0.0 and outside > 0.0):
            break
        found = Mixture(float(np.sqrt(inside)), share, float(np.sqrt(outside / inside)))
    return found


def homogeneous(variances: FloatArray, samples: FloatArray) -> float:
    """Return the probability of variances (k,) that differ so much, from so many independent samples (k,), by Bartlett's test."""
    total, pooled = float(samples.sum()), float(samples @ variances / samples.sum())
    statistic = total * np.log(pooled) - float(samples @ np.log(variances))
    correction = 1.0 + (float(np.sum(1.0 / samples)) - 1.0 / total) / (3.0 * (len(samples) - 1))
    return float(chi2.sf(statistic / correction, len(samples) - 1))


def shrunk(variances: FloatArray, samples: FloatArray) -> FloatArray:
    """Return variances (k,) of so many independent samples (k,), drawn toward their geometric mean by empirical Bayes.

    Logarithms of variances scatter by chance with the variance trigamma(n / 2); what they scatter more is of the maneuvers,
    by the method of moments.
    """
    half = 0.5 * samples
    logs, chance = np.log(variances) - digamma(half) + np.log(half), polygamma(1, half)
    own = 1.0 / chance
    mean = float(own @ logs / own.sum())
    surplus = float(own @ (logs - mean) ** 2) - (len(logs) - 1)
    between = max(0.0, surplus / (own.sum() - float(own @ own) / own.sum()))
    own = 1.0 / (between + chance)
    mean = float(own @ logs / own.sum())
    return np.asarray(np.exp(mean + between / (between + chance) * (logs - mean)))


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Shape and size of the noise of every channel."""

    #: (n_y,) of the residuals over `relative`; None where they are normal
    mixtures: tuple[Mixture | None, ...]
    information: FloatArray  #: (n_y,), share of the information that is left: mean derivative m of the score
    relative: FloatArray  #: (k, n_y), standard deviation in each maneuver over that of the channel
    unequal: tuple[bool, ...]  #: (n_y,), whether maneuvers differ
    unknown: BoolArray  #: (k, n_y), where maneuvers differ, and one has too few samples to estimate its own

    @classmethod
    def plain(cls, channels: int, maneuvers: int) -> NoiseModel:
        """Return normal noise, the same in all maneuvers."""
        ones, none = np.ones((maneuvers, channels)), (False,) * channels
        return cls((None,) * channels, np.ones(channels), ones, none, np.zeros(ones.shape, np.bool_))

    def adjusted(self, problem: Misfit, residuals: Sequence[FloatArray]) -> Misfit:
        """Return a problem, of the readings as recorded, with pseudo-observations, and with the noise of each maneuver.

        The residuals (n, n_y) of each piece are measured less simulated. Readings of unknown noise become NaN: not measured.
        """
        if not any(self.unequal) and not any(self.mixtures):
            return problem
        pieces = []
        for piece, own in zip(problem.pieces, residuals, strict=True):
            measured, relative = piece.measured.copy(), self.relative[piece.maneuver]
            for i, mixture in enumerate(self.mixtures):
                if mixture is not None:
                    w = mixture.weights(own[:, i] / relative[i])[0]
                    measured[:, i] += (w / self.information[i] - 1.0) * own[:, i]
            measured[:, self.unknown[piece.maneuver]] = np.nan
            factors = tuple(relative.tolist()) if any(self.unequal) else ()
            pieces.append(replace(piece, measured=measured, relative_noise=factors))
        return replace(problem, pieces=tuple(pieces))

    def findings(
        self, problem: Misfit, maneuvers: Sequence[str]
    ) -> tuple[list[Notice], tuple[DecisionRecord, ...]]:
        """Return what differs from normal noise that is the same in all maneuvers, whose names are given, and decisions."""
        outputs, outliers, out = problem.layout.vehicle.outputs, list[Notice](), list[Notice]()
        found = {c: m for c, m in zip(outputs, self.mixtures, strict=True) if m is not None}
        if found:
            shares, widths = (tuple(getattr(m, name) for m in found.values()) for name in ("share", "width"))
            share, width = float(np.median(shares)), float(np.median(widths))
            several: dict[str, Any] = {"shares": shares, "widths": widths}
            outliers.append(notice("outliers", channels=tuple(found), share=share, width=width, **several))
        shape = applied("noise-shape", outliers, OUTLIERS_WEIGHTED)
        if not any(self.unequal):
            return outliers, shape
        logs, count = np.log(self.relative), len(self.relative)
        # over the mean of the others
        factors = np.exp((logs - logs.mean(axis=0)) * count / max(count - 1, 1))
        channels = np.array(outputs)
        for name, own, unknown in zip(maneuvers, factors, self.unknown, strict=True):
            if (noisy := own >= Limits.named).any():
                size = float(np.median(own[noisy]))
                out.append(notice("maneuver-noise", name, channels=tuple(channels[noisy]), factor=size))
            if unknown.any():
                out.append(notice("maneuver-noise-unknown", name, channels=tuple(channels[unknown])))
        return [*outliers, *out], (*shape, *applied("maneuver-noise", out, "a variance for each maneuver"))


def noise_model(
    problem: Misfit,
    residuals: Sequence[FloatArray],
    before: NoiseModel | None,
    treatment: Treatment = TREATMENT,
) -> NoiseModel:
    """Return the noise behind residuals (n, n_y) of each piece, measured less simulated, NaN where nothing was measured.

    What an earlier model found stays, with new numbers, so that the alternation with the fit ends.
    """
    labels = np.array([p.maneuver for p in problem.pieces])
    count, dt, channels = int(labels.max()) + 1, problem.pieces[0].dt, residuals[0].shape[1]
    before = NoiseModel.plain(channels, count) if before is None else before
    relative, unequal, unknown = before.relative, before.unequal, before.unknown
    if treatment.maneuver_noise:
        relative, unequal, unknown = maneuver_noise(residuals, labels, dt, before)
    scaled = [r / relative[m] for r, m in zip(residuals, labels, strict=True)]
    mixtures, information = list[Mixture | None](), np.ones(channels)
    times = correlation_times(scaled, dt) if treatment.noise_shape else np.full(channels, np.nan)
    for i, time in enumerate(times):
        columns, kept = [r[:, i : i + 1] for r in scaled], before.mixtures[i] is not None
        found = outlier_model(columns, dt, float(time), kept) if treatment.noise_shape else None
        mixtures.append(None if found is None else found[0])
        information[i] = 1.0 if found is None else found[1]
    return NoiseModel(tuple(mixtures), information, relative, unequal, unknown)


def with_noise(
    recorded: Misfit,
    residuals: Callable[[Misfit], Sequence[FloatArray]],
    before: NoiseModel | None,
    treatment: Treatment = TREATMENT,
) -> tuple[NoiseModel, Misfit]:
    """Return the noise behind the residuals of a problem as recorded, and the problem that the fit sees, with its weights.

    The `residuals` of a problem are (n, n_y) of each piece, where the fit is; `before` is the noise of the round before. Of
    what may differ from normal noise that is the same in all maneuvers, the `treatment` says what is looked for.
    """
    own = residuals(recorded)
    noise = noise_model(recorded, own, before, treatment)
    problem = noise.adjusted(recorded, own)
    if problem is not recorded:
        own = residuals(problem)
    return noise, problem.weighted(Weights.of(effective_variance(problem, own)))


def maneuver_noise(
    residuals: Sequence[FloatArray], labels: IntArray, dt: float, before: NoiseModel
) -> tuple[FloatArray, tuple[bool, ...], BoolArray]:
    """Return the relative noise (k, n_y) of the maneuvers, the channels that differ (n_y,), where samples are too few (k, n_y).

    The `labels` are the maneuvers of the residuals (n, n_y) of each piece, sampled every `dt` s.
    """
    k, channels = before.relative.shape
    relative, unequal = np.ones((k, channels)), [False] * channels
    unknown = np.zeros((k, channels), np.bool_)
    counts, variances, squares = np.zeros((k, channels)), np.full((k, channels), np.nan), list(residuals)
    for m in np.unique(labels):
        whole = np.concatenate([r for r, label in zip(residuals, labels, strict=True) if label == m])
        limits = np.full(channels, np.inf)
        for i, column in enumerate(whole.T):
            present = column[np.isfinite(column)]
            counts[m, i] = present.size
            if present.size:
                limits[i] = (Limits.clipped * robust_std(present)) ** 2 or np.inf
                variances[m, i] = float(np.mean(np.minimum(present**2, limits[i])))
        for j in np.flatnonzero(labels == m).tolist():
            squares[j] = np.minimum(residuals[j] ** 2, limits) - variances[m]
    samples = counts / correlation_times(squares, dt)
    for i in range(channels):
        known = (samples[:, i] >= Limits.min_samples) & (variances[:, i] > 0.0)
        if known.sum() < 2:
            continue
        own, n, many = variances[known, i], samples[known, i], counts[known, i]
        loss = float(many @ own) * float(many @ (1.0 / own)) / float(many.sum()) ** 2
        differ = loss > Limits.variance_ratio and homogeneous(own, n) < Limits.level
        if differ or before.unequal[i]:
            found = shrunk(own, n)
            relative[known, i] = np.sqrt(found * many.sum() / float(many @ found))
            unequal[i] = True
            unknown[:, i] = ~known & (counts[:, i] > 0)
    return relative, tuple(unequal), unknown


def outlier_model(
    columns: Sequence[FloatArray], dt: float, time: float, keep: bool = False, stretch: float = Limits.stretch
) -> tuple[Mixture, float] | None:
    """Return the mixture for the residuals of a channel, (n, 1) of each piece, and the share of information that is left.

    None where it is not enough likelier than one normal, by independent residuals; these are as far apart as residuals or
    outliers correlate, whichever is more (`time`, of the residuals, in samples); nor where outliers come in stretches of more
    than `stretch` samples, as those of a wrong model do. `keep` asks for no test.
    """
    whole = np.concatenate(columns)[:, 0]
    whole = whole[np.isfinite(whole)]
    variance = float(np.mean(whole**2)) if whole.size >= Limits.min_samples else 0.0
    if not variance > 0.0 or not (keep or float(np.mean(whole**4)) >= (3.0 + Limits.kurtosis) * variance**2):
        return None
    mixture = fit_mixture(whole)
    if mixture.share == 0.0:
        return None
    w, slopes = mixture.weights(whole)
    left = float(np.mean(slopes))
    if keep:
        return (mixture, left) if left > 0.0 else None
    normal = Mixture(float(np.sqrt(variance)))
    ratio = 2.0 * float(np.sum(mixture.log_density(whole) - normal.log_density(whole)))
    robust = float(np.mean((w * whole) ** 2)) / left**2
    if not (left > 0.0 and ratio > Limits.likelihood_ratio and variance > Limits.variance_ratio * robust):
        return None
    together = float(correlation_times([mixture.outlying(c) - mixture.share for c in columns], dt)[0])
    if together > stretch or ratio <= Limits.likelihood_ratio * max(time, together):
        return None
    return mixture, left


def outlying_innovations(innovations: Sequence[FloatArray], dt: float) -> list[BoolArray]:
    """Return which innovations (n, n_y) of each piece are outliers; NaN are none.

    Of neighbors in time the first counts: what follows may be its effect on the state.
    """
    masks = [np.zeros(v.shape, dtype=np.bool_) for v in innovations]
    for i, time in enumerate(correlation_times(innovations, dt)):
        columns = [v[:, i : i + 1] for v in innovations]
        found = outlier_model(columns, dt, float(time), stretch=np.inf)  # a filter passes an outlier on
        for mask, column in zip(masks, columns, strict=True):
            if found is not None:
                mask[:, i] = found[0].weights(column[:, 0])[0] < Limits.weight
    out = []
    for mask in masks:
        rows = np.asarray(mask.any(axis=1))
        first = rows & ~np.append(False, rows[:-1])
        out.append(mask & first[:, None])
    return out
