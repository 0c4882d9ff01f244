r"""Covariance of estimates by a model that lacks something.

Error bars from residuals hold for the model. Where the score tests of its extensions together are significant, it lacks some of
them, or something that they stand for. They are taken as random, each with a variance of its own, those of greatest evidence
(automatic relevance determination): with the information G of the extensions, the unknowns having taken what they can, and the
covariance S of their scores z by noise and by numbers that are held at values with priors,

.. math:: z \sim N(0, S + G T G), \qquad T = \mathrm{diag}(\tau^2),

and the estimates, which move by L for a unit of each, have the further covariance L T L' (consider covariance).

References
----------
D. J. C. MacKay, "Bayesian interpolation", *Neural Computation* 4(3), 1992, pp. 415-447.
M. E. Tipping, "Sparse Bayesian learning and the relevance vector machine", *Journal of Machine Learning Research* 1, 2001,
pp. 211-244.
B. D. Tapley, B. E. Schutz and G. H. Born, *Statistical Orbit Determination*, 2004, section 6.2.
F. E. Satterthwaite, "An approximate distribution of estimates of variance components", *Biometrics Bulletin* 2(6), 1946,
pp. 110-114.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.stats import chi2

from stoop.assessment.extensions import GIVEN, Scored
from stoop.base.arrays import FloatArray
from stoop.base.blas import on_one_blas_thread

#: of the test whether a model lacks anything: to miss that costs coverage, to be wrong about it only width
LEVEL: Final = 0.05
ROUNDS: Final = 300
TOLERANCE: Final = 1e-3  #: relative change of the variances
IDLE: Final = 1e-8  #: of the variance that noise gives an extension alone; below it is zero
#: of the greatest eigenvalue of the scores' correlation; below it is rounding
ROUNDING: Final = 1e-10


@on_one_blas_thread
def model_error(known: Scored, held: Mapping[str, float]) -> FloatArray:
    """Return the covariance (k, k) that what the model lacks adds to the unknowns; zero where it lacks nothing.

    Left out are numbers that the file gives, changes that make no sense, and what errors of `held` numbers (SI) explain.
    """
    own = known.scores
    pairs = zip(known.extensions, own.change.tolist(), strict=True)
    sense = [e.kind not in GIVEN and e.name not in held and e.believes(change) for e, change in pairs]
    kept = np.flatnonzero(own.tested & sense)
    z, G = own.score[kept], own.information[np.ix_(kept, kept)]
    answers = own.information[kept] * [held.get(one.name, 0.0) for one in known.extensions]
    S = own.noise[np.ix_(kept, kept)] + answers @ answers.T
    std = np.sqrt(np.diag(S))
    if not kept.size or lacks_nothing(z / std, S / np.outer(std, std)):
        return np.zeros((len(own.shifts),) * 2)
    shifts = own.shifts[:, kept]
    return np.asarray(shifts * variances(z, G, S) @ shifts.T)


def lacks_nothing(statistics: FloatArray, correlation: FloatArray) -> bool:
    """Whether the sum of squares of m statistics is one by chance (Satterthwaite's approximation)."""
    scale = float(np.sum(correlation**2)) / len(statistics)
    return bool(chi2.sf(np.sum(statistics**2) / scale, len(statistics) / scale) >= LEVEL)


def variances(z: FloatArray, G: FloatArray, S: FloatArray) -> FloatArray:
    """Return the variances (m,) of greatest evidence for scores z (m,), by MacKay's fixed point."""
    unit = 1.0 / np.sqrt(np.diag(G))
    z, G, S = z * unit, G * np.outer(unit, unit), S * np.outer(unit, unit)
    values, vectors = np.linalg.eigh(S)
    inverse = (vectors / np.maximum(values, ROUNDING * values[-1])) @ vectors.T
    information, scores = G @ inverse @ G, G @ inverse @ z
    noise = 1.0 / np.diag(information)
    tau = np.maximum((scores * noise) ** 2 - noise, 0.0) + 0.01 * noise
    for _ in range(ROUNDS):
        own, before = np.flatnonzero(tau > IDLE * noise), tau
        inner = information[np.ix_(own, own)] + np.diag(1.0 / tau[own])
        left = np.linalg.inv(inner)
        known = 1.0 - np.diag(left) / tau[own]  # share that is not the prior's
        tau = np.zeros_like(tau)
        tau[own] = (left @ scores[own]) ** 2 / np.maximum(known, np.finfo(float).tiny)
        if np.max(np.abs(tau - before) / np.maximum(before, IDLE * noise)) < TOLERANCE:
            break
    return np.asarray(tau * unit**2)
