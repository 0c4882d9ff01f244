r"""What a fitted model lacks: score tests of extensions, one step of each, without another fit.

With residuals r, sensitivities S of the n unknowns, information D = S'S + priors, and the response s of the readings to an
extension, the part of s that no unknown can take over is v = s - S D^-1 S's. The score test (Rao; Lagrange multiplier) of
the extension is

.. math:: t = \frac{v'r}{\sqrt{v' R_{vv} v}}, \qquad \hat\delta = \frac{v'r}{v's}, \qquad
          \Delta\hat\theta = -D^{-1} S's\,\hat\delta,

with the autocovariance :math:`R_{vv}` of the residuals, so that colored residuals do not pass for an effect. The gain of
log-likelihood is t^2/2, the value that the extension would take is its null value plus :math:`\hat\delta`, and
:math:`\Delta\hat\theta` is how far the parameters would move. The level is divided by the number of tests. What is
significant is tested once more with the strongest extension among the unknowns.

References
----------
C. R. Rao, "Large sample tests of statistical hypotheses concerning several parameters", *Mathematical Proceedings of the
Cambridge Philosophical Society* 44(1), 1948, pp. 50-57.
R. F. Engle, "Wald, likelihood ratio, and Lagrange multiplier tests in econometrics", *Handbook of Econometrics* 2, 1984.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from stoop.assessment.covariance import Coloring, data_information
from stoop.assessment.error_bars import ErrorBars
from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.base.notices import Notice, notice
from stoop.estimate.fit import Fit
from stoop.estimate.response import Responses, simulation_responses
from stoop.problem.evidence import PieceEvidence, Unknown, invert
from stoop.results.extensions import ExtensionTest, ExtensionTests


@dataclass(frozen=True)
class Limits:
    """Limits of the tests."""

    level: float = 0.01  #: of all tests of a fit together (Bonferroni)
    distinct: float = (
        1e-4  #: share of its response that the unknowns cannot take over, below which nothing is tested
    )
    alike: float = 0.9  #: correlation of two responses from which only a fit tells extensions apart
    tie: float = (
        2.3  #: difference of log-likelihood below which no extension is preferred: odds of ten to one
    )
    shown: int = 12  #: extensions that are listed
    moves: int = 5  #: parameters that are listed for each
    least_move: float = 0.5  #: of its standard error, by which a parameter must move to be listed


LIMITS: Final = Limits()


@dataclass(frozen=True, eq=False)
class Scores:
    """Score tests of m extensions; k unknowns."""

    statistic: FloatArray  #: (m,), t; zero where nothing can be tested
    change: FloatArray  #: (m,), from the null value, SI
    std: FloatArray  #: (m,), of the change
    tested: BoolArray  #: (m,)
    shifts: FloatArray  #: (k, m), of the unknowns for a unit of change
    own: tuple[
        FloatArray, ...
    ]  #: (n, n_y, m) of each piece: v, the part of the response that is the extension's alone

    @property
    def gain(self) -> FloatArray:
        """Gain of log-likelihood (m,)."""
        return np.asarray(0.5 * self.statistic**2)

    def correlation(self, index: int) -> FloatArray:
        """Return the correlation (m,) of one extension's own response with those of all."""
        products = sum(np.einsum("nim,ni->m", v, v[:, :, index]) for v in self.own)
        sizes = np.sqrt(sum(np.einsum("nim,nim->m", v, v) for v in self.own))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.nan_to_num(products / (sizes * sizes[index])))


def scores(segments: Sequence[PieceEvidence], prior: FloatArray, columns: Sequence[FloatArray]) -> Scores:
    """Return the score tests of whitened responses (n, n_y, m) of each piece, beside k unknowns and their prior (k, k)."""
    inverse = invert(data_information(segments) + prior)
    noise = Coloring(tuple(segments), inverse, prior).noise()
    filled = [segment.filled() for segment in segments]
    S = [j.reshape(-1, j.shape[2]) for _, j in filled]
    flat = [c.reshape(-1, c.shape[2]) for c in columns]
    shifts = -inverse.matrix @ sum(a.T @ b for a, b in zip(S, flat, strict=True))
    own = [b + a @ shifts for a, b in zip(S, flat, strict=True)]
    score = sum(v.T @ r.ravel() for v, (r, _) in zip(own, filled, strict=True))
    total = sum(np.einsum("nm,nm->m", b, b) for b in flat)
    information = sum(np.einsum("nm,nm->m", v, b) for v, b in zip(own, flat, strict=True))
    shaped = tuple(v.reshape(c.shape) for v, c in zip(own, columns, strict=True))
    variance = sum(noise.variance(v) for v in shaped)
    tested = (information > LIMITS.distinct * total) & (variance > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(tested, score / np.sqrt(variance), 0.0)
        change = np.where(tested, score / information, 0.0)
        std = np.where(tested, np.sqrt(variance) / information, np.inf)
    return Scores(t, change, std, tested, shifts, shaped)


def extension_tests(fit: Fit, bars: ErrorBars) -> ExtensionTests:
    """Return what the data of a fit ask for beside its model; nothing is tested for methods without a simulation."""
    if fit.own_evidence is not None:
        return ExtensionTests()
    with threadpool_limits(limits=1, user_api="blas"):
        evidence = fit.evidence
        free = evidence.free
        segments, prior = [piece.of(free) for piece in evidence.pieces], evidence.prior[np.ix_(free, free)]
        found = simulation_responses(fit.problem, fit.z)
        first = scores(segments, prior, found.pieces)
        values = first.change + [one.null for one in found.extensions]
        count = max(int(first.tested.sum()), 1)
        p_values = np.minimum(1.0, 2.0 * count * norm.sf(np.abs(first.statistic)))
        believed = [
            e.believed[0] < value < e.believed[1] for e, value in zip(found.extensions, values, strict=True)
        ]
        order = [
            j for j in np.argsort(-first.gain, kind="stable") if believed[j] and p_values[j] < LIMITS.level
        ]
        beside = np.full(len(values), np.nan)
        if order:
            joined = [_joined(s, v, first, order[0]) for s, v in zip(segments, first.own, strict=True)]
            again = scores(joined, np.pad(prior, (0, 1)), found.pieces)
            beside[order[1:]] = again.statistic[order[1:]]
        kept = order[: LIMITS.shown]
        tests = tuple(
            ExtensionTest(
                one.name, one.kind, float(values[j]), float(first.std[j]), one.unit, float(first.statistic[j]),
                float(p_values[j]), float(first.gain[j]), one.line(float(values[j])), float(beside[j]),
                _rivals(first, found, j, order), _moves(first, j, bars, evidence.unknowns, free),
            )
            for j, one in ((j, found.extensions[j]) for j in kept)
        )  # fmt: skip
    return ExtensionTests(int(first.tested.sum()), LIMITS.level, tests)


def _joined(segment: PieceEvidence, own: FloatArray, found: Scores, index: int) -> PieceEvidence:
    """Return the evidence of a piece once an extension has taken its value."""
    column, change = own[:, :, index], float(found.change[index])
    residual = segment.residual - change * column
    return replace(
        segment, residual=residual, jacobian=np.concatenate([segment.jacobian, column[:, :, None]], axis=2)
    )


def _rivals(found: Scores, responses: Responses, index: int, significant: Sequence[int]) -> tuple[str, ...]:
    """Return the significant extensions whose response is much the same, or that explain as much."""
    alike = np.abs(found.correlation(index)) >= LIMITS.alike
    near = np.abs(found.gain - found.gain[index]) < LIMITS.tie
    others = (j for j in significant if j != index and (alike[j] or near[j]))
    return tuple(responses.extensions[j].name for j in others)


def _moves(
    found: Scores, index: int, bars: ErrorBars, unknowns: Sequence[Unknown], free: IntArray
) -> dict[str, float]:
    """Return the parameters that would move most, in their standard errors."""
    shift = found.shifts[:, index] * found.change[index]
    moved = {
        unknowns[i].name: float(shift[row] / bars.std[i])
        for row, i in enumerate(free)
        if unknowns[i].kind == "parameter" and np.isfinite(bars.std[i]) and bars.std[i] > 0.0
    }
    largest = sorted(moved, key=lambda name: -abs(moved[name]))[: LIMITS.moves]
    return {name: moved[name] for name in largest if abs(moved[name]) >= LIMITS.least_move}


def extension_notices(found: ExtensionTests) -> tuple[Notice, ...]:
    """Return what the model lacks, if anything: the strongest extension."""
    if not found.found:
        return ()
    best = found.found[0]
    moves = tuple(f"{name} {value:+.1f}" for name, value in best.moves.items())
    about = notice(
        "model-lacks-one-of" if best.rivals else "model-lacks", best.name, line=best.line, gain=best.gain,
        statistic=best.statistic, tested=found.tested, moves=moves, rivals=best.rivals,
    )  # fmt: skip
    return (about,)
