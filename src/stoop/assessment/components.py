r"""Components of the covariance of estimates: what each source of error adds.

The covariance of the estimates is the sum of

- ``noise``: the inverse of Fisher's information, priors included, as if residuals were white (Cramer-Rao);
- ``color``: what correlated residuals and the curvature of the cost add to it (`stoop.assessment.coloring`);
- ``windows``: what the scatter between windows that begin anew adds (`stoop.assessment.covariance`);
- ``maneuvers``: what the disagreement of maneuvers or flights adds (`stoop.assessment.clusters`);
- ``held``: the priors of moments of inertia that are held (consider covariance);
- ``model``: what the model lacks, by the score tests of its extensions (`stoop.assessment.model_error`) and by what chance
  does not explain of the difference of two weightings.

With the covariance :math:`C` before it, ``windows`` is the positive semidefinite part of :math:`W - C` in coordinates in which
:math:`C` is one: the least that makes no variance smaller than that of either. ``maneuvers`` is :math:`E C E` with
:math:`E = \mathrm{diag}\sqrt{f^2 - 1}` and the factors :math:`f \ge 1` on standard errors. A shift of the estimates by what
the model lacks, of covariance :math:`K`, cannot exceed what the priors of parameters allow: with a measurement of zero of each
shift, of the error :math:`s` of its prior, it is :math:`K - K (K + \mathrm{diag}\,s^2)^{-1} K`. Biases and initial states absorb
what the model lacks, whatever their priors say of instruments: these limit the errors of biases and initial states alone.

References
----------
B. D. Tapley, B. E. Schutz and G. H. Born, *Statistical Orbit Determination*, 2004, section 6.2.
J. A. Hausman, "Specification tests in econometrics", *Econometrica* 46(6), 1978, pp. 1251-1271.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.assessment.clusters import Scatter
from stoop.assessment.coloring import Coloring
from stoop.base.arrays import BoolArray, FloatArray
from stoop.estimate.estimate import Estimate
from stoop.estimate.response import Responses

#: of the covariance of efficient weights, which the other exceeds it by at least
LEAST_GAIN: Final = 0.05


@dataclass(frozen=True, eq=False)
class Component:
    """A contribution to the covariance (f, f) of the estimated unknowns; `name` is one of `COMPONENTS`."""

    name: str
    covariance: FloatArray


def nonzero(component: Component) -> tuple[Component, ...]:
    """Return a component, or nothing where it adds nothing."""
    return (component,) if component.covariance.any() else ()


def _roots(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rows (f, r) whose products are a covariance (f, f) of rank r, and their left inverse (r, f)."""
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > np.finfo(float).eps * len(values) * values[-1]
    root, vectors = np.sqrt(values[kept]), vectors[:, kept]
    return scale[:, None] * vectors * root, (vectors / root).T / scale


def excess(covariance: FloatArray, before: FloatArray) -> FloatArray:
    """Return the positive semidefinite part (f, f) of the difference of a covariance and another of the same estimates."""
    rows, inverse = _roots(before)
    gains, axes = np.linalg.eigh(inverse @ covariance @ inverse.T)
    rows = rows @ axes * np.sqrt(np.maximum(gains - 1.0, 0.0))
    return np.asarray(rows @ rows.T)


def beyond_chance(difference: FloatArray, covariance: FloatArray, efficient: FloatArray) -> FloatArray:
    """Return the part (f,) of a difference of two estimates that their covariances (f, f) do not explain.

    With those of `efficient` weights a right model makes the difference d one of the covariance V of the other less this
    (Hausman). Its square d' V^-1 d then has the mean r, the number of directions; of a larger one the rest is not chance.
    """
    _, inverse = _roots(efficient)
    gains, axes = np.linalg.eigh(inverse @ covariance @ inverse.T)
    square = float(np.sum((axes.T @ (inverse @ difference)) ** 2 / np.maximum(gains - 1.0, LEAST_GAIN)))
    return difference * np.sqrt(max(0.0, 1.0 - len(gains) / square)) if square > 0.0 else difference


def of_scatter(scatter: Scatter, before: FloatArray) -> FloatArray:
    """Return what the disagreement of maneuvers adds to a covariance (f, f)."""
    more = np.zeros(len(before))
    more[: len(scatter.stretch)] = np.sqrt(np.maximum(scatter.stretch**2 - 1.0, 0.0))
    return np.asarray(before * np.outer(more, more))


def within_priors(shifts: FloatArray, priors: FloatArray, joint: BoolArray) -> FloatArray:
    """Return the covariance (f, f) of shifts of the estimates, limited by priors (f,) > 0, infinite without a prior.

    Priors marked `joint` (f,) limit the shifts of all unknowns, the other priors the shift of their own unknown alone.
    """
    rows, _ = _roots(shifts)
    measured = rows / np.where(joint, priors, np.inf)[:, None]
    limited = rows @ np.linalg.solve(np.eye(rows.shape[1]) + measured.T @ measured, rows.T)
    each = 1.0 / np.hypot(1.0, np.sqrt(np.maximum(np.diag(limited), 0.0)) / np.where(joint, np.inf, priors))
    return np.asarray(limited * np.outer(each, each))


def held_inertia(fit: Estimate) -> dict[str, float]:
    """Return the priors of the moments of inertia that are held, by name."""
    moments = [p for p in fit.problem.layout.vehicle.parameters if p.name.startswith("mass.inertia.")]
    return {p.name: p.prior for p in moments if not p.free and p.prior is not None}


def of_held_inertia(fit: Estimate, coloring: Coloring) -> FloatArray:
    """Return the covariance (f, f) that moments of inertia add which are held.

    The estimates move with a held number c by dx/dc = -D^-1 S' s, with the sensitivities S and s of the readings. How wrong c may
    be is what the flight leaves of its prior, and how far the flight would move it, if no further than the prior.
    """
    held = held_inertia(fit)
    responses = fit.responses() if held else Responses()
    own = [(j, held[e.name]) for j, e in enumerate(responses.extensions) if e.name in held]
    if not own:
        return np.zeros_like(coloring.prior)
    columns, priors = np.array([j for j, _ in own]), np.array([prior for _, prior in own])
    total, information = np.zeros((len(coloring.prior), len(own))), np.diag(priors**-2.0)
    slope = np.zeros(len(own))
    gaps = responses.gaps or [None] * len(coloring.segments)
    for segment, readings, gap in zip(coloring.segments, responses.pieces, gaps, strict=True):
        residual, S = segment.rows()
        _, s = replace(segment, jacobian=readings, gap_jacobian=gap).of(columns).rows()
        total += S.T @ s
        information += s.T @ s
        slope += s.T @ residual
    moved = coloring.inverse.matrix @ total
    left = np.linalg.inv(information - total.T @ moved)
    far = np.clip(left @ slope, -priors, priors)
    return np.asarray(moved @ (left + np.outer(far, far)) @ moved.T)
