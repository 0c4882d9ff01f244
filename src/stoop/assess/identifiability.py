"""Identifiability: which parameters the data determine, which stand in for which, and near-null directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.assess.covariance import Inverse, invert, standard_errors
from stoop.base.arrays import FloatArray
from stoop.results.uncertainty import CorrelatedPair, NearNullDirection

PRIOR_SHARE: Final = (
    0.95  #: of the prior's standard deviation left after the fit: the data added next to nothing
)
BOX_SHARE: Final = 0.25  #: of the box's width; a value thrown into the box blindly would have 0.29
RELATIVE: Final = (
    3.0  #: times the size of the parameter, where there is neither prior nor box to compare with
)
COLLINEAR: Final = 30.0  #: marginal over conditional standard error; correlated above 0.999 with the others
STRONG: Final = 0.9  #: correlation from which a pair is named
PARTNER: Final = 0.7  #: correlation from which another parameter counts as able to stand in
MOST_PAIRS: Final = 20
MOST_PARTNERS: Final = 4
MOST_DIRECTIONS: Final = 6
PART: Final = 0.3  #: of its standard error, by which a parameter must move along a direction to be named
COMBINED: Final = "known only in combination with others: they can almost take its place"


@dataclass(frozen=True)
class Identifiability:
    """What the data say about one parameter.

    Attributes
    ----------
    name : str
    identifiable : bool
        False when the number is not the data's.
    reason : str
        Why, in plain words; empty when nothing is amiss.
    conditional_std : float
        Standard error if everything else were known.
    marginal_std : float
        Standard error as it is; infinite when the data leave it free.
    multiple_correlation : float
        With all other unknowns together; 1 means that they can take its place.
    """

    name: str
    identifiable: bool
    reason: str
    conditional_std: float
    marginal_std: float
    multiple_correlation: float

    @classmethod
    def none(cls, name: str, reason: str) -> Identifiability:
        """Return that of a parameter that nothing was learned about."""
        return cls(name, False, reason, np.inf, np.inf, 0.0)


@dataclass(frozen=True, eq=False)
class ComparisonScale:
    """Scales (k,) with which standard errors are compared; infinite where there is none.

    Attributes
    ----------
    prior_std : (k,)
        Standard deviation of the prior.
    box : (k,)
        Width between the bounds.
    size : (k,)
        Magnitude of the parameter: the greater of estimate and starting value.
    """

    prior_std: FloatArray
    box: FloatArray
    size: FloatArray


def identifiability(
    names: Sequence[str], information: FloatArray, covariance: FloatArray, scale: ComparisonScale
) -> tuple[Identifiability, ...]:
    """Judge every unknown.

    Parameters
    ----------
    names : sequence of str
        Of the k unknowns.
    information : (k, k)
        Priors included.
    covariance : (k, k)
        The covariance that will be published; infinite variance where nothing is known.
    scale : ComparisonScale
        Of the same unknowns.
    """
    inverse = invert(information)
    sigma = standard_errors(covariance)
    alone = 1.0 / np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    marginal = standard_errors(inverse.matrix)
    # 1 - R^2 = (conditional / marginal)^2
    multiple = np.sqrt(np.clip(1.0 - (alone / np.maximum(marginal, alone)) ** 2, 0.0, 1.0))
    return tuple(
        _judge(name, i, inverse, scale, (float(alone[i]), float(sigma[i]), float(multiple[i])))
        for i, name in enumerate(names)
    )


def scaled_singular_values(information: FloatArray) -> FloatArray:
    """Return the singular values (k,), descending, of the sensitivities with columns scaled to length 1.

    First over last is the condition of the problem; a value near 0 is a direction that the data cannot see.
    """
    values = np.sqrt(np.maximum(invert(information).eigenvalues[::-1], 0.0))
    return np.asarray(values, dtype=np.float64)


def _judge(
    name: str, i: int, inverse: Inverse, scale: ComparisonScale, figures: tuple[float, float, float]
) -> Identifiability:
    alone, sigma, multiple = figures
    if not inverse.determined[i]:
        return Identifiability(name, False, "the data do not see it", alone, float("inf"), multiple)
    reason = _doubt(sigma, float(scale.prior_std[i]), float(scale.box[i]), float(scale.size[i]))
    identifiable = not reason
    if identifiable and multiple > np.sqrt(1.0 - COLLINEAR**-2):
        reason = COMBINED
    return Identifiability(name, identifiable, reason, alone, sigma, multiple)


def _doubt(sigma: float, prior_std: float, box: float, size: float) -> str:
    """Return why a standard error says nothing, or an empty text."""
    if sigma > PRIOR_SHARE * prior_std:
        return "the data add next to nothing to the prior"
    if sigma > BOX_SHARE * box:
        return "its error is as wide as its box: the box decides, not the data"
    if not np.isfinite(min(prior_std, box)) and sigma > RELATIVE * size:
        return f"its error is more than {RELATIVE:g} times its size"
    return ""


def worst_pairs(names: Sequence[str], correlation: FloatArray) -> tuple[CorrelatedPair, ...]:
    """Return the most correlated pairs of a matrix (k, k), the worst first."""
    found = [
        CorrelatedPair(names[j], names[i], float(correlation[i, j]))
        for i in range(len(names))
        for j in range(i)
        if np.isfinite(correlation[i, j]) and abs(correlation[i, j]) >= STRONG
    ]
    return tuple(sorted(found, key=lambda pair: -abs(pair.correlation))[:MOST_PAIRS])


def partners(names: Sequence[str], correlation: FloatArray, index: int) -> tuple[str, ...]:
    """Return the parameters that are strongly correlated with one of them, the strongest first."""
    strength = np.abs(np.nan_to_num(correlation[index]))
    strength[index] = 0.0
    order = np.argsort(-strength, kind="stable")[:MOST_PARTNERS]
    return tuple(names[i] for i in order if strength[i] >= PARTNER)


def marginal_information(information: FloatArray, count: int) -> FloatArray:
    """Return the information of the first `count` unknowns when the others are unknown, too."""
    inner, cross = information[:count, :count], information[:count, count:]
    if not cross.shape[1]:
        return inner
    factor = invert(information[count:, count:]).factor
    across = cross @ factor
    return np.asarray(inner - across @ across.T)


def near_null_directions(
    names: Sequence[str], information: FloatArray, sizes: FloatArray
) -> tuple[NearNullDirection, ...]:
    """Return the directions in which the data hardly change, the darkest first.

    Parameters
    ----------
    names : sequence of str
        Of the k parameters.
    information : (k, k)
        Of the data alone, initial states and biases unknown.
    sizes : (k,)
        Magnitude of each parameter: a step for which the cost rises by 1 is cut to one that doubles none.
    """
    diagonal = np.sqrt(np.maximum(np.diag(information), 0.0))
    unseen = [name for name, d in zip(names, diagonal, strict=True) if not d > 0.0]
    seen = np.flatnonzero(diagonal > 0.0)
    out = [
        NearNullDirection(0.0, {name: 1.0}, f"The data do not change with {name} at all.") for name in unseen
    ]
    if seen.size > 1:
        scale = diagonal[seen]
        values, vectors = np.linalg.eigh(information[np.ix_(seen, seen)] / np.outer(scale, scale))
        floor = np.finfo(np.float64).eps * values[-1]
        singular = np.sqrt(np.maximum(values, floor))
        sigma = np.sqrt(np.sum((vectors / singular) ** 2, axis=1))
        for i in np.flatnonzero(singular < 1.0 / COLLINEAR)[:MOST_DIRECTIONS]:
            step = vectors[:, i] / singular[i]
            parts = _parts([names[int(j)] for j in seen], step / sigma, _cut(step / scale, sizes[seen]))
            out.append(NearNullDirection(float(singular[i]), parts, _words(parts)))
    return tuple(out[:MOST_DIRECTIONS])


def _cut(step: FloatArray, sizes: FloatArray) -> FloatArray:
    longest = float(np.max(np.abs(step) / np.where(sizes > 0.0, sizes, np.inf)))
    return step / max(1.0, longest)


def _parts(names: Sequence[str], share: FloatArray, step: FloatArray) -> dict[str, float]:
    """Return the parameters that matter along a direction with their steps, the most moved first and upward."""
    order = [int(i) for i in np.argsort(-np.abs(share), kind="stable") if abs(share[i]) >= PART][:6]
    sign = np.sign(step[order[0]]) if order else 1.0
    return {names[i]: float(sign * step[i]) for i in order}


def _words(parts: dict[str, float]) -> str:
    moves = [f"{name} by {value:+.3g}" for name, value in parts.items()]
    if not moves:
        return "Many parameters share it, none with much weight."
    if len(moves) == 1:
        return f"The data hardly change with {moves[0]}."
    return f"The data hardly change when these move together: {', '.join(moves)}."
