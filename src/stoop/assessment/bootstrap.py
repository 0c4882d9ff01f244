"""The bootstrap of a fit: refits to the model's own curves with noise like that of the residuals.

The autoregression that also corrects the covariance takes off the color of the residuals; blocks of the innovations are drawn,
all channels together, and colored again. Blocks keep the remaining correlation, heavy tails, and common disturbances. Residuals
of windows with initial states of their own are no stationary noise: whole windows are drawn, with the gaps behind them.

References
----------
B. Efron and R. J. Tibshirani, *An Introduction to the Bootstrap*, Chapman and Hall, 1993, chapters 9 (residuals)
and 14 (bias-corrected percentiles).
H. R. Kuensch, "The jackknife and the bootstrap for general stationary observations", *Annals of Statistics*
17(3), 1989, pp. 1217-1241 (moving blocks).
A. C. Davison and D. V. Hinkley, *Bootstrap Methods and their Application*, Cambridge, 1997, section 8.2
(post-blackening).
D. N. Politis and H. White, "Automatic block-length selection for the dependent bootstrap", *Econometric
Reviews* 23(1), 2004, pp. 53-70, and the correction with A. Patton, 28(4), 2009, pp. 372-375.
A. C. Cameron, J. B. Gelbach and D. L. Miller, "Bootstrap-based improvements for inference with clustered errors",
*Review of Economics and Statistics* 90(3), 2008, pp. 414-427 (random signs of whole clusters).
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.signal import lfilter
from scipy.special import ndtr, ndtri

from stoop.assessment.assessment import Finding, Optimum, Watch, packed, refit, refits, unpacked_optimum
from stoop.assessment.coloring import ColoredNoise
from stoop.assessment.covariance import MIN_WINDOWS, NORMAL_95, leave_window_out
from stoop.assessment.error_bars import ErrorBars
from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import Notice, notice
from stoop.estimate.estimate import Estimate
from stoop.estimate.noise import lagged_products
from stoop.estimate.refit_problem import RefitProblem
from stoop.parallel import Json, LocalProcesses, Plan, Pool, Run
from stoop.problem.color import least_squares_autoregression
from stoop.results.uncertainty import Interval, MethodIntervals

LONGEST_BLOCK: Final = 0.25  #: of a segment: fewer than four blocks would repeat the record
MIN_INNOVATIONS: Final = 20  #: of its own that a segment must have; else it takes those of all
MIN_REPLICATES: Final = 40  #: with fewer there is no 2.5 % to either side
CHUNK: Final = 25  #: replicates of one run: what a kill may cost
WORK: Final = "stoop.assessment.bootstrap:refit_chunk"
MAX_FAILED: Final = 0.02  #: share of replicates without an optimum from which it is reported


def block_length(series: FloatArray) -> float:
    """Return the length of moving blocks, samples, at least 1, of a series (n,) by Politis and White (2004, corrected 2009)."""
    n = len(series)
    centered = series - series.mean()
    digits = np.log10(max(n, 10))
    most = min(n - 1, int(np.ceil(np.sqrt(n))) + max(5, int(digits**1.5)))
    covariance = lagged_products([centered[:, None]], [np.ones((n, 1))], most)[0][0] / n
    if not covariance[0] > 0.0:
        return 1.0
    run = max(5, int(np.sqrt(digits)))
    small = np.abs((covariance / covariance[0])[1:]) < 2.0 * np.sqrt(digits / n)
    last = max(1, next((lag for lag in range(len(small)) if small[lag : lag + run].all()), len(small)))
    lags = np.arange(-min(2 * last, most), min(2 * last, most) + 1)
    taper = np.clip(2.0 * (1.0 - np.abs(lags) / (2.0 * last)), 0.0, 1.0)
    smoothed = taper * covariance[np.abs(lags)]
    level, slope = float(smoothed.sum()), float(np.sum(np.abs(lags) * smoothed))
    return max(1.0, float(np.cbrt(2.0 * slope**2 / (4.0 / 3.0 * level**2) * n))) if level > 0.0 else 1.0


@dataclass(frozen=True, eq=False)
class ColoredBlocks:
    """Blocks of innovations, colored again."""

    noise: ColoredNoise  #: color and strength of the weighted noise
    #: (m_i, ny), innovations of each segment, of the noise's strength; NaN if unknown
    pools: tuple[FloatArray, ...]
    present: tuple[BoolArray, ...]  #: (n_i, ny) bool; where each segment was measured
    block: int  #: samples of one block
    rest: int = 0  #: residuals behind those of the readings, without noise (gaps between windows that meet)

    @classmethod
    def of(cls, noise: ColoredNoise, residuals: Sequence[FloatArray], rest: int = 0) -> ColoredBlocks:
        """Return the source of noise like `residuals`, a sequence of weighted (n_i, ny), NaN where missing."""
        order, channels = noise.coefficients.shape[1], []
        for i in range(len(noise.coefficients)):  # mean zero and the strength of the noise over all segments
            innovations = whitened([r[:, i] for r in residuals], order)
            seen = np.concatenate(innovations)
            seen = seen[np.isfinite(seen)]
            spread, mean = (float(np.std(seen)), seen.mean()) if seen.size else (0.0, 0.0)
            factor = float(np.sqrt(noise.innovation[i, i])) / spread if spread > 0.0 else 0.0
            channels.append([(segment - mean) * factor for segment in innovations])
        own = [np.column_stack(segment) for segment in zip(*channels, strict=True)]
        whole = np.concatenate(own)
        whole = whole if len(whole) else np.full((1, len(noise.coefficients)), np.nan)
        pools = tuple(pool if len(pool) >= MIN_INNOVATIONS else whole for pool in own)
        columns = [column[np.isfinite(column)] for column in whole.T]
        longest = max((block_length(c) for c in columns if len(c) >= MIN_INNOVATIONS), default=1.0)
        return cls(noise, pools, tuple(np.isfinite(r) for r in residuals), int(np.ceil(longest)), rest)

    def draw(self, random: np.random.Generator) -> FloatArray:
        """Return noise (m,); zero where nothing was measured."""
        drawn = [self.segment(i, random) for i in range(len(self.pools))]
        parts = [np.where(mask, v, 0.0).ravel() for v, mask in zip(drawn, self.present, strict=True)]
        return np.concatenate([*parts, np.zeros(self.rest)])

    def segment(self, index: int, random: np.random.Generator) -> FloatArray:
        """Return a record (n_i, ny) that has run as long before it begins, so that it begins like any other stretch."""
        pool, length = self.pools[index], len(self.present[index])
        block, total = max(1, min(self.block, int(LONGEST_BLOCK * len(pool)))), 2 * length
        starts = random.integers(0, len(pool) - block + 1, -(-total // block))
        innovations = pool[(starts[:, None] + np.arange(block)).ravel()[:total]]
        gaps = ~np.isfinite(innovations)
        if gaps.any():
            strength = np.sqrt(np.diag(self.noise.innovation))
            innovations[gaps] = (random.standard_normal(innovations.shape) * strength)[gaps]
        columns = zip(self.noise.coefficients, innovations.T, strict=True)
        colored = [lfilter([1.0], np.concatenate([[1.0], -a]), e) for a, e in columns]
        return np.ascontiguousarray(np.array(colored).T[length:])


def whitened(segments: Sequence[FloatArray], order: int) -> list[FloatArray]:
    """Return the innovations of a series, (n_i - order,) for segments (n_i,); NaN where unknown."""
    coefficients, rows = least_squares_autoregression(segments, order)
    enough = rows >= MIN_INNOVATIONS + 2 * order
    known = np.append(1.0, -coefficients) if enough else np.full(order + 1, np.nan)
    return [np.convolve(s, known, "valid") if len(s) > order else s[:0] for s in segments]


@dataclass(frozen=True, eq=False)
class WholeWindows:
    """Residuals of whole windows, with the gaps behind them, each of random sign in the place of another."""

    #: (w_i, n_i, ny), as a fit to all others would leave them; as long as the longest
    windows: tuple[FloatArray, ...]
    gaps: tuple[FloatArray, ...]  #: (w_i, e); from each window to the next; zero for the last
    edges: tuple[tuple[int, ...], ...]  #: first sample of each window, then the number of samples
    present: tuple[BoolArray, ...]  #: (m_i, ny) bool; where each piece was measured

    @classmethod
    def of(cls, problem: RefitProblem, optimum: Optimum) -> WholeWindows:
        """Return the source of noise like the residuals of windows at an optimum."""
        present, many = problem.present, problem.gaps
        first, gap = 0, sum(mask.size for mask in present)
        windows, gaps = [], []
        residual, jacobian, factor = optimum.residual, optimum.jacobian, optimum.inverse.factor
        for mask, edges in zip(present, problem.windows, strict=True):
            ny, count, longest = mask.shape[1], len(edges) - 1, int(np.max(np.diff(edges)))
            left, behind = np.zeros((count, longest, ny)), np.zeros((count, many))
            for w, (start, stop) in enumerate(pairwise(edges)):
                own = np.arange(first + start * ny, first + stop * ny)
                last = np.arange(gap + w * many, gap + (w + 1) * many) if w + 1 < count else own[:0]
                rows = np.concatenate([own, last])
                r = leave_window_out(residual[rows], jacobian.rows(rows), factor)
                left[w, : stop - start] = r[: len(own)].reshape(-1, ny)
                left[w, stop - start :] = left[w, stop - start - 1]
                behind[w, : len(last)] = r[len(own) :]
            windows.append(left)
            gaps.append(behind)
            first, gap = first + mask.size, gap + (count - 1) * many
        return cls(tuple(windows), tuple(gaps), problem.windows, present)

    def draw(self, random: np.random.Generator) -> FloatArray:
        """Return noise (m,) for the readings of all pieces, then for all gaps."""
        readings, gaps = [], []
        for left, behind, edges, mask in zip(self.windows, self.gaps, self.edges, self.present, strict=True):
            count = len(edges) - 1
            chosen = random.integers(0, count, count)
            signs = random.choice([-1.0, 1.0], count)
            parts = [s * left[c, :n] for c, s, n in zip(chosen, signs, np.diff(edges), strict=True)]
            readings.append(np.where(mask, np.concatenate(parts), 0.0).ravel())
            gaps.append((signs[:-1, None] * behind[chosen[:-1]]).ravel())
        return np.concatenate([*readings, *gaps])


NoiseSource = ColoredBlocks | WholeWindows


def shifts(optimum: Optimum, noise: NoiseSource, numbers: Sequence[int], seed: int) -> FloatArray:
    """Return what replicates add to the residuals, (B, n_r).

    Priors are drawn anew, too, as measurements with errors of their own. The noise depends on number and `seed` alone.
    """
    out = np.empty((len(numbers), len(optimum.residual)))
    for row, number in zip(out, numbers, strict=True):
        random = np.random.default_rng([seed, number])
        drawn = noise.draw(random)
        row[: len(drawn)] = drawn
        row[len(drawn) :] = random.standard_normal(len(row) - len(drawn))
    return np.asarray(-optimum.residual - out)


def percentiles(estimate: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return std of replicates (B, k) of an estimate (k,), and ends of bias-corrected 95 % intervals; NaN of too few."""
    if len(values) < MIN_REPLICATES:
        return (np.full(len(estimate), np.nan),) * 3
    below = np.mean(values < estimate, axis=0) + 0.5 * np.mean(values == estimate, axis=0)
    reach = 1.0 / len(values)
    shift = 2.0 * ndtri(np.clip(below, reach, 1.0 - reach))
    lower, upper = (
        np.array([np.quantile(values[:, i], ndtr(s + end)) for i, s in enumerate(shift)])
        for end in (-NORMAL_95, NORMAL_95)
    )
    return values.std(axis=0, ddof=1), lower, upper


@dataclass(frozen=True)
class Bootstrap:
    """Refit the fit to its own curves with noise like its residuals, many times."""

    replicates: int = 1000
    pool: Pool = field(default_factory=LocalProcesses)  #: where they are refitted
    #: what is done is kept there, and not done again; in a temporary folder when absent
    store: Path | None = None

    name: str = field(default="bootstrap", init=False)

    def __call__(self, fit: Estimate, bars: ErrorBars, seed: int, watch: Watch) -> Finding:
        """Return standard errors and bias-corrected percentile intervals; none at a bound or not identifiable."""
        plan = bootstrap_plan(fit, bars, seed, self.replicates)
        found = refits(plan, self.store, self.pool, "bootstrap: {} of {} replicates", CHUNK, watch)
        parts: list[Any] = list(found.values())
        values = np.concatenate([np.array(part["values"], dtype=np.float64) for part in parts])
        endings = Counter(ending for part in parts for ending in part["endings"])
        converged = np.isfinite(values).all(axis=1)
        spread = percentiles(np.array(list(fit.estimates.values())), values[converged])
        parameters = {}
        for i, name in enumerate(fit.estimates):
            sure = not bars.at_bound[i] and bars.identifiability[name].identifiable
            parameters[name] = Interval(*(float(one[i]) for one in spread)) if sure else Interval()
        total, count, failed = endings.total(), int(converged.sum()), endings["failed"]
        notices: list[Notice] = []
        if count < MIN_REPLICATES:
            notices.append(notice("bootstrap-too-few-replicates", count=count, needed=MIN_REPLICATES))
        if failed > MAX_FAILED * total:
            notices.append(notice("bootstrap-replicates-failed", failed=failed, replicates=total))
        figures = {"replicates": float(total), "refined": float(endings["refined"]), "failed": float(failed)}
        return Finding(MethodIntervals(parameters, figures, tuple(notices)))


def bootstrap_plan(fit: Estimate, bars: ErrorBars, seed: int, count: int) -> Plan:
    """Return the campaign: `count` replicates, rounded up to whole chunks."""
    noise = bars.uncertainty.noise
    whole = sum(len(p.edges) - 1 for p in fit.evidence.pieces if p.edges) >= MIN_WINDOWS
    more = {"color": noise.coefficients, "innovation": noise.innovation, "whole_windows": np.array(whole)}
    problem = packed(fit, bars, more)
    digest = hashlib.sha256(problem.encode()).hexdigest()
    given: dict[str, Json] = {"problem": problem, "seed": seed, "count": CHUNK}
    runs = (Run(f"{i:06d}", WORK, {**given, "first": i}) for i in range(0, count, CHUNK))
    return Plan("bootstrap of a fit", {"problem": digest, "seed": seed}, tuple(runs))


@on_one_blas_thread
def refit_chunk(arguments: Mapping[str, Json], stops: Sequence[int | None]) -> list[Json]:
    """Refit `count` replicates from the `first` of a packed problem: their parameters, SI, as ``values``, and ``endings``."""
    given: Any = arguments
    first, count, seed = (int(given[name]) for name in ("first", "count", "seed"))
    problem, optimum, noise = _unpacked(given["problem"])
    found = refit(optimum, shifts(optimum, noise, range(first, first + count), seed))
    values = problem.problem.layout.physical(found.z)  # NaN for those that failed
    return [{"values": values.tolist(), "endings": list(found.endings)} for _ in stops]


@lru_cache(maxsize=1)
def _unpacked(text: str) -> tuple[RefitProblem, Optimum, NoiseSource]:
    """Return the problem, its optimum, and what draws its noise."""
    problem, optimum, arrays = unpacked_optimum(text)
    if problem.windows and arrays["whole_windows"]:
        return problem, optimum, WholeWindows.of(problem, optimum)
    residuals, first = [], 0
    for mask in problem.present:
        block = -optimum.residual[first : first + mask.size].reshape(mask.shape)
        residuals.append(np.where(mask, block, np.nan))
        first += mask.size
    priors = problem.problem.layout.prior_residuals(arrays["z"][None, :])[0]
    rest = len(optimum.residual) - first - len(priors)
    noise = ColoredNoise(arrays["color"], arrays["innovation"])
    return problem, optimum, ColoredBlocks.of(noise, residuals, rest)
