"""Which parameters stand in for which: correlated pairs, partners, and directions that the data hardly see."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.assess.covariance import invert
from stoop.assess.identifiability import COLLINEAR
from stoop.base.arrays import FloatArray
from stoop.results.uncertainty import CorrelatedPair, NearNullDirection

STRONG: Final = 0.9  #: correlation from which a pair is named
PARTNER: Final = 0.7  #: correlation from which another parameter counts as able to stand in
MOST_PAIRS: Final = 20
MOST_PARTNERS: Final = 4
MOST_DIRECTIONS: Final = 6
PART: Final = 0.3  #: of its standard error, by which a parameter must move along a direction to be named


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


def blind_directions(
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
