r"""Score tests of model extensions: their significance and first-order estimates without another fit.

With residuals r, sensitivities S of the n unknowns, information D = S'S + priors, and the response s of the readings to an
extension, the part of s that is orthogonal to the unknowns is v = s - S D^-1 S's. At the estimate S'r balances the priors, so
the score test (Rao; Lagrange multiplier) of the extension is

.. math:: t = \frac{v'r}{\sqrt{v' R_{vv} v}}, \qquad \hat\delta = \frac{s'r}{v's}, \qquad
          \Delta\hat\theta = -D^{-1} S's\,\hat\delta,

with the autocovariance :math:`R_{vv}` of the residuals, so that colored residuals are not mistaken for an effect; v includes
the priors, and gaps between windows are residuals like others. The gain of log-likelihood is t^2/2, the extension takes its null
value plus :math:`\hat\delta`, and the parameters change by :math:`\Delta\hat\theta`. The level is divided by the number of
tests. A missing term colors the residuals, which weakens its own test and makes others resemble it. The strongest extensions,
significant or not, are therefore tested again with the color of the residuals that they would leave, and the significant ones
once more with the strongest extension among the unknowns.

References
----------
C. R. Rao, "Large sample tests of statistical hypotheses concerning several parameters", *Mathematical Proceedings of the
Cambridge Philosophical Society* 44(1), 1948, pp. 50-57.
R. F. Engle, "Wald, likelihood ratio, and Lagrange multiplier tests in econometrics", *Handbook of Econometrics* 2, 1984.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.stats import norm

from stoop.assessment.coloring import ColoredNoise, Coloring
from stoop.assessment.covariance import MIN_WINDOWS, by_window, leave_windows_out, widened, window_scatter
from stoop.assessment.error_bars import ErrorBars
from stoop.assessment.verdict import CONFIRMED
from stoop.assessment.verdict import Limits as VerdictLimits
from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import Notice, notice
from stoop.estimate.estimate import Estimate
from stoop.problem.evidence import Inverse, PieceEvidence, Unknown
from stoop.results.extensions import ExtensionTest, ExtensionTests
from stoop.vehicle.extensions import Extension


class Limits:
    """Limits of the tests."""

    level: Final = 0.01  #: of all tests of a fit together (Bonferroni)
    #: share of its response that is orthogonal to the unknowns, below which nothing is tested
    distinct: Final = 1e-4
    #: share of the information on it that is the priors', from which nothing is tested: without them no flight shows the mass,
    #: which scales all forces and moments
    max_prior: Final = 0.5
    alike: Final = 0.8  #: correlation of two responses from which only a fit distinguishes extensions
    #: difference of log-likelihood below which no extension is preferred: odds of ten to one
    tie: Final = 2.3
    shown: Final = 12  #: extensions that are listed
    leaders: Final = 4  #: extensions whose statistics are weighed against each other once more
    moves: Final = 5  #: parameters that are listed for each
    least_move: Final = 0.5  #: of its standard error, by which a parameter must move to be listed


GIVEN: Final = ("number", "gain")  #: kinds of extensions that are fixed numbers of the file


@dataclass(frozen=True, eq=False)
class Scores:
    """Score tests of m extensions; k unknowns."""

    statistic: FloatArray  #: (m,), t; zero where there is no test
    change: FloatArray  #: (m,), from the null value, SI
    std: FloatArray  #: (m,), of the change
    tested: BoolArray  #: (m,)
    shifts: FloatArray  #: (k, m), of the unknowns for a unit of change
    score: FloatArray  #: (m,), s'r
    information: FloatArray  #: (m, m), v's; the mean of the scores for a unit of each change
    noise: FloatArray  #: (m, m), covariance of the scores where the model lacks nothing
    #: (N, m) of each piece: v, the part of the response that is the extension's alone
    own: tuple[FloatArray, ...]

    @property
    def p_value(self) -> FloatArray:
        """Chance (m,) of such a statistic among all that were tested (Bonferroni)."""
        return np.asarray(np.minimum(1.0, 2.0 * self.tested.sum() * norm.sf(np.abs(self.statistic))))

    @property
    def gain(self) -> FloatArray:
        """Gain of log-likelihood (m,)."""
        return np.asarray(0.5 * self.statistic**2)

    def correlation(self, index: int) -> FloatArray:
        """Return the correlation (m,) of one extension's own response with those of all."""
        products = sum(v.T @ v[:, index] for v in self.own)
        sizes = np.sqrt(sum(np.einsum("nm,nm->m", v, v) for v in self.own))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.nan_to_num(products / (sizes * sizes[index])))


def scores(
    coloring: Coloring,
    responses: Sequence[PieceEvidence],
    leaders: Callable[[Scores], Sequence[int]] = lambda scores: (),
) -> Scores:
    """Return the score tests of m extensions of a fit with k unknowns.

    `responses` are the segments of `coloring` with the m extensions in place of the unknowns. `leaders` selects, among the
    first tests, extensions that are tested again with the color of the residuals that they would leave: the residuals of the
    fit contain the effect of a missing term, which would count as noise in its own test.
    """
    segments, inverse = coloring.segments, coloring.inverse
    prior = coloring.prior - sum(piece.gap_information for piece in segments)  # gaps are residuals here
    residuals, S = zip(*(one.rows() for one in segments), strict=True)
    s = [one.rows()[1] for one in responses]
    shifts = -inverse.matrix @ sum(a.T @ b for a, b in zip(S, s, strict=True))
    own = [b + a @ shifts for a, b in zip(S, s, strict=True)]
    score = sum(b.T @ r for b, r in zip(s, residuals, strict=True))
    total = sum(np.einsum("nm,nm->m", b, b) for b in s)
    information = np.asarray(sum(v.T @ b for v, b in zip(own, s, strict=True)))
    alone = np.diag(information)
    parts = [_split(one, v) for one, v in zip(segments, own, strict=True)]
    of_prior = shifts.T @ prior @ shifts
    covariance = of_prior + _noise_covariance(segments, parts, inverse, coloring.noise)
    variance = np.diag(covariance).copy()
    by_readings = np.diag(of_prior) < Limits.max_prior * alone
    tested = (alone > Limits.distinct * total) & (variance > 0.0) & by_readings

    def found() -> Scores:
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.where(tested, score / np.sqrt(variance), 0.0)
            change = np.where(tested, score / alone, 0.0)
            std = np.where(tested, np.sqrt(variance) / alone, np.inf)
        return Scores(t, change, std, tested, shifts, np.asarray(score), information, covariance, tuple(own))

    first = found()
    for j in leaders(first):
        left = [_left(one, v[:, j], first.change[j]) for one, v in zip(segments, own, strict=True)]
        column = [_split(one, v[:, [j]]) for one, v in zip(segments, own, strict=True)]
        noise = coloring.noise_behind([one.filled()[0] for one in left])
        again = _noise_covariance(left, column, inverse, noise)
        variance[j] = of_prior[j, j] + again[0, 0]
    return found()


def _split(piece: PieceEvidence, rows: FloatArray) -> PieceEvidence:
    """Return a piece with other derivatives, as `PieceEvidence.rows` gives them."""
    n, m = piece.residual.size, rows.shape[1]
    parts = (rows[:n], piece.residual), (rows[n:], piece.continuity_residuals[0])
    readings, gaps = (part.reshape(*of.shape, m) for part, of in parts)
    return replace(piece, jacobian=readings, gap_jacobian=gaps)


def _noise_covariance(
    segments: Sequence[PieceEvidence], own: Sequence[PieceEvidence], inverse: Inverse, noise: ColoredNoise
) -> FloatArray:
    """Return the covariance (m, m) of the scores under the noise of the residuals.

    As in error bars, the variance between independent windows is at least that of stationary noise.
    """
    covariance = np.asarray(sum(noise.covariance(one.jacobian) for one in own), dtype=np.float64)
    if sum(len(one.edges) - 1 for one in segments if one.edges) < MIN_WINDOWS:
        return covariance
    windowed = np.zeros_like(covariance)
    for segment, one in zip(segments, own, strict=True):
        r, S = by_window(segment, segment.edges, *segment.continuity_residuals)
        V = by_window(one, one.edges, *one.continuity_residuals)[1]
        windowed += window_scatter(leave_windows_out(r, S, inverse.factor), V)
    return widened(covariance, windowed)


@dataclass(frozen=True, eq=False)
class Scored:
    """The extensions of a fit with their responses, by segment, and first tests."""

    extensions: tuple[Extension, ...]
    responses: tuple[PieceEvidence, ...]
    scores: Scores


@on_one_blas_thread
def scored(fit: Estimate, bars: ErrorBars) -> Scored | None:
    """Return the first tests of the model extensions.

    There are none where the estimator does not know the responses, nor away from an optimum, where the score has no meaning.
    """
    if fit.outcome.status not in CONFIRMED:
        return None
    found = fit.responses()
    if not found.extensions:
        return None
    segments = bars.uncertainty.coloring.segments
    gaps = found.gaps or [None] * len(segments)
    rows = zip(segments, found.pieces, gaps, strict=True)
    responses = [replace(s, jacobian=readings, gap_jacobian=gap) for s, readings, gap in rows]

    def leaders(of: Scores) -> list[int]:
        return _strongest(found.extensions, of)[: Limits.leaders]

    first = scores(bars.uncertainty.coloring, responses, leaders)
    return Scored(tuple(found.extensions), tuple(responses), first)


def _strongest(extensions: Sequence[Extension], of: Scores) -> list[int]:
    """Return the plausible extensions, the strongest first."""
    sense = [one.believes(change) for one, change in zip(extensions, of.change.tolist(), strict=True)]
    return [j for j in np.argsort(-of.gain, kind="stable").tolist() if sense[j]]


def extension_tests(fit: Estimate, bars: ErrorBars) -> ExtensionTests:
    """Return score tests of the model extensions, empty where there are none."""
    known = scored(fit, bars)
    return ExtensionTests() if known is None else tests_of(known, fit, bars)


@on_one_blas_thread
def tests_of(known: Scored, fit: Estimate, bars: ErrorBars) -> ExtensionTests:
    """Return the significant extensions among those that were scored."""
    evidence, first, responses = fit.evidence, known.scores, known.responses
    free = evidence.free
    coloring = bars.uncertainty.coloring
    segments = coloring.segments
    order = [j for j in _strongest(known.extensions, first) if first.p_value[j] < Limits.level]
    each = list(zip(known.extensions, first.change.tolist(), strict=True))
    beside, others = np.full(len(each), np.nan), order[1 : Limits.shown]
    if others:
        parts = zip(segments, responses, first.own, strict=True)
        joined = [_joined(segment, one, v, first, order[0]) for segment, one, v in parts]
        prior = coloring.prior - sum(piece.gap_information for piece in segments)
        again = Coloring.of(joined, np.pad(prior, (0, 1)) + sum(one.gap_information for one in joined))
        beside[others] = scores(again, [one.of(np.array(others)) for one in responses]).statistic
    tests = []
    for j in order[: Limits.shown]:
        (one, change), std = each[j], float(first.std[j])
        error = std / change**2 if one.reciprocal else std
        tests.append(
            ExtensionTest(
                name=one.name,
                kind=one.kind,
                value=one.value(change),
                std_error=error,
                unit=one.unit,
                statistic=float(first.statistic[j]),
                p_value=float(first.p_value[j]),
                gain=float(first.gain[j]),
                line=one.line(change),
                change=change,
                beside=float(beside[j]),
                rivals=_rivals(first, known.extensions, j, order),
                moves=_moves(first, j, bars, evidence.unknowns, free),
            )
        )
    pairs = [(e, std) for e, std in zip(known.extensions, first.std.tolist(), strict=True) if e.kind in GIVEN]
    unresolved = tuple(e.name for e, std in pairs if 0.0 < VerdictLimits.moved_share * abs(e.null) < std)
    return ExtensionTests(int(first.tested.sum()), Limits.level, tuple(tests), unresolved)


def _left(segment: PieceEvidence, own: FloatArray, change: float) -> PieceEvidence:
    """Return a piece with the residuals that an extension leaves."""
    left, size = segment.rows()[0] - change * own, segment.residual.size
    residual = np.where(segment.present, left[:size].reshape(segment.residual.shape), np.nan)
    gaps = left[size:].reshape(segment.continuity_residuals[0].shape)
    return replace(segment, residual=residual, gaps=gaps)


def _joined(
    segment: PieceEvidence, response: PieceEvidence, own: FloatArray, found: Scores, index: int
) -> PieceEvidence:
    """Return the evidence of a piece with an extension at its estimate among the unknowns."""
    rows = np.column_stack([segment.rows()[1], response.rows()[1][:, index]])
    return _split(_left(segment, own[:, index], float(found.change[index])), rows)


def _rivals(
    found: Scores, extensions: Sequence[Extension], index: int, significant: Sequence[int]
) -> tuple[str, ...]:
    """Return the significant extensions with a similar response or a similar gain."""
    alike = np.abs(found.correlation(index)) >= Limits.alike
    near = np.abs(found.gain - found.gain[index]) < Limits.tie
    others = (j for j in significant if j != index and (alike[j] or near[j]))
    return tuple(extensions[j].name for j in others)


def _moves(
    found: Scores, index: int, bars: ErrorBars, unknowns: Sequence[Unknown], free: IntArray
) -> dict[str, float]:
    """Return the largest changes of parameters, in their standard errors."""
    shift = found.shifts[:, index] * found.change[index]
    rows = [(row, i) for row, i in enumerate(free) if unknowns[i].kind == "parameter"]  # noise has no error
    moved = {
        unknowns[i].name: float(shift[row] / bars.std[i]) for row, i in rows if 0.0 < bars.std[i] < np.inf
    }
    largest = sorted(moved, key=lambda name: -abs(moved[name]))[: Limits.moves]
    return {name: moved[name] for name in largest if abs(moved[name]) >= Limits.least_move}


def extension_notices(found: ExtensionTests) -> tuple[Notice, ...]:
    """Return a notice of the strongest significant extension, if there is one."""
    if not found.found:
        return ()
    best = found.found[0]
    moves = tuple(f"{name} {value:+.1f}" for name, value in best.moves.items())
    about = notice(
        "model-lacks-one-of" if best.rivals else "model-lacks", best.name, line=best.line, gain=best.gain,
        statistic=best.statistic, tested=found.tested, moves=moves, rivals=best.rivals,
    )  # fmt: skip
    return (about,)
