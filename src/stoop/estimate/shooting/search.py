"""The least-squares problem of windows that do not meet yet, and its solution by Gauss-Newton.

A step fits the readings and closes the gaps at once. The gaps' scale in winds, which decides how much of a velocity a gust
explains, is estimated by maximum likelihood of the linearized problem, states, winds and search vector integrated out (the
Laplace approximation); in calm air it goes to zero and the winds are one.

References
----------
H. E. Rauch, F. Tung and C. T. Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA Journal 3(8), 1965.
D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4(3), 1992, section 4 (the evidence for a scale).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar

from stoop.base.arrays import FloatArray
from stoop.estimate.shooting.condense import Node, Reduced, Weighted, reduced
from stoop.estimate.shooting.windows import AircraftWindows, Shot, Shots, residual, window_model
from stoop.optimize.normal_equations import solve_damped
from stoop.problem import Misfit, Weights
from stoop.problem.evidence import Evidence, PieceEvidence, unknowns_of
from stoop.simulate import parameter_rows
from stoop.simulate.initial import commanded

MAX_ITERATIONS: Final = 60
TOLERANCE: Final = 1e-4  #: of half the cost that is left to gain
MIN_DAMPING: Final = 1e-10
MAX_DAMPING: Final = 1e8
MAX_STRICTNESS: Final = AircraftWindows.strictness[-1]  #: with which starts are compared
GUST_SCALE: Final = 1.0  #: m/s, of a gap of a gust state
SPIN_SCALE: Final = 1e-3  #: of a rotor's largest x, of a gap of its lag: no gust changes that
FIRST_WIND_STEP: Final = 0.2  #: m/s from one window to the next, before it is estimated
WIND_STEPS: Final = (1e-3, 3.0)  #: m/s: bounds
WIND_ROUNDS: Final = 2
WIND_COMPONENTS: Final = ((-3, -2), (-1,))  #: of the scales: level, vertical
MIN_GAPS: Final = 3  #: below which nothing tells the size of wind steps
ROUNDING: Final = 1e-12  #: of the greatest eigenvalue


@dataclass(frozen=True, eq=False)
class Iterate:
    """A point of the search.

    Attributes
    ----------
    z : (D + E,)
    nodes : tuple of (n_x, w) or, with winds, (n_x + 3, w)
        What the windows of each piece begin with.
    cost : float
        Gaps included, as strictly as the problem takes them.
    gap : float
        Largest gap, in its scale.
    """

    z: FloatArray
    nodes: tuple[FloatArray, ...]
    cost: float
    gap: float


@dataclass(frozen=True, eq=False)
class ShootingProblem:
    """The least-squares problem of all windows of all pieces.

    Attributes
    ----------
    problem : Misfit
    shots : tuple of Shots
        One per piece.
    scales : (e,)
        Of a gap, see :func:`gap_scales`.
    strictness : float
        A gap counts so many times its scale.
    """

    problem: Misfit
    shots: tuple[Shots, ...]
    scales: FloatArray
    strictness: float

    @classmethod
    def of(cls, problem: Misfit, length: float) -> ShootingProblem:
        """Return the problem in windows of about so many seconds, with gaps that count as strictly as any."""
        shots = tuple(Shots.of(problem, i, length) for i in range(len(problem.pieces)))
        return cls(problem, shots, gap_scales(problem), MAX_STRICTNESS)

    def weighted(self, weights: Weights) -> ShootingProblem:
        """Return the same windows with another Q."""
        problem = self.problem.weighted(weights)
        return replace(self, problem=problem, shots=tuple(replace(s, problem=problem) for s in self.shots))

    @cached_property
    def gap_weights(self) -> FloatArray:
        """What a gap (e,) is multiplied with."""
        return self.strictness / self.scales

    def iterate(self, z: FloatArray, nodes: Sequence[FloatArray]) -> Iterate:
        """Simulate all windows."""
        total = float(np.sum(self.problem.layout.prior_residuals(z[None, :]) ** 2))
        worst = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for shots, own in zip(self.shots, nodes, strict=True):
                readings, gaps, _ = shots.simulate(z, own)
                measured = shots.piece.measured
                off = residual(self.problem, readings, measured)
                total += float(np.sum(self.problem.weights.whiten(off, np.isfinite(measured)) ** 2))
                total += float(np.sum((gaps * self.gap_weights) ** 2))
                worst = max(worst, float(np.max(np.abs(gaps * self.gap_weights), initial=0.0)))
        return Iterate(z, tuple(nodes), total if np.isfinite(total) else np.inf, worst / self.strictness)

    def leveled(self, at: Iterate) -> Iterate:
        """Return the iterate with altitudes taken from where the window before ended.

        Not at every step: an altitude that follows its window says nothing of its own, but changes the cost.
        """
        row, leveled = self.problem.layout.vehicle.states.index("h"), []
        for shots, own in zip(self.shots, at.nodes, strict=True):
            ends, nodes = shots.simulate(at.z, own)[2], own.copy()
            nodes[row, 1:] = ends[row]
            leveled.append(nodes)
        return self.iterate(at.z, leveled)

    def simulated(self, at: Iterate) -> tuple[FloatArray, ...]:
        """Return the readings (n, n_y) of each piece."""
        pairs = zip(self.shots, at.nodes, strict=True)
        return tuple(shots.simulate(at.z, own)[0] for shots, own in pairs)

    def residuals(self, at: Iterate) -> list[FloatArray]:
        """Return measured less simulated (n, n_y) of each piece, NaN where nothing was measured."""
        out = []
        for shots, readings in zip(self.shots, self.simulated(at), strict=True):
            measured = shots.piece.measured
            off = residual(self.problem, readings, measured)
            out.append(np.where(np.isfinite(measured), -off, np.nan))
        return out

    def linearize(self, at: Iterate) -> list[list[Shot]]:
        """Return the windows of every piece with their derivatives, residuals whitened."""
        whiten, out = self.problem.weights.whiten, []
        for shots, own in zip(self.shots, at.nodes, strict=True):
            found = []
            for i, shot in enumerate(shots.linearize(at.z, own)):
                present = np.isfinite(shots.piece.measured[shots.edges[i] : shots.edges[i + 1]])
                by_unknown, by_state = (
                    np.moveaxis(whiten(np.moveaxis(slopes, 2, 0) * present, present), 0, 2)
                    for slopes in (shot.by_unknown, shot.by_state)
                )
                left = whiten(shot.residual, present)
                found.append(replace(shot, residual=left, by_unknown=by_unknown, by_state=by_state))
            out.append(found)
        return out

    def weigh(self, shot: Shot) -> Weighted:
        """Return a whitened window as rows of a least-squares problem."""
        weights = self.gap_weights if len(shot.gap) else np.empty(0)
        by_unknown, by_state = (
            np.ascontiguousarray(slopes.reshape(-1, slopes.shape[2]).T)
            for slopes in (shot.by_unknown, shot.by_state)
        )
        return Weighted(
            shot.residual.ravel(),
            by_unknown,
            by_state,
            weights * shot.gap,
            weights[:, None] * shot.gap_by_unknown,
            weights[:, None] * shot.gap_by_state,
            weights,
        )

    def reduce(
        self, at: Iterate, pieces: Sequence[Sequence[Weighted]], damping: float
    ) -> tuple[FloatArray, FloatArray, list[Reduced]]:
        """Return normal matrix (j, j) and gradient (j,) of half the cost, the states of the windows eliminated."""
        layout = self.problem.layout
        prior = layout.prior_jacobian()
        normal, gradient = prior.T @ prior, prior.T @ layout.prior_residuals(at.z[None, :])[0]
        found = [reduced(windows, damping) for windows in pieces]
        return normal + sum(r.normal for r in found), gradient + sum(r.gradient for r in found), found

    def evidence(self, at: Iterate) -> Evidence:
        """Return residuals and sensitivities of the search vector, the states that windows begin with left free.

        These states follow the search vector as suits them best, so a sensitivity is that of the window with its state
        following: what is left of the whole problem once its states are eliminated (a Schur complement).
        """
        layout = self.problem.layout
        scales, model = layout.scales, window_model(layout.vehicle)
        rows = layout.prior_jacobian() / scales
        information, pieces = rows.T @ rows, []
        for shots, windows in zip(self.shots, self.linearize(at), strict=True):
            nodes = reduced([self.weigh(shot) for shot in windows], 0.0).nodes
            follow = following(nodes, windows[0].by_state.shape[2], scales)
            jacobian = [
                w.by_unknown / scales + w.by_state @ own for w, own in zip(windows, follow, strict=True)
            ]
            gaps, slopes = self._gaps(windows, follow)
            rows = slopes.reshape(-1, len(scales))
            information = information + rows.T @ rows
            measured, left = shots.piece.measured, -np.concatenate([shot.residual for shot in windows])
            one = PieceEvidence(np.where(np.isfinite(measured), left, np.nan), np.concatenate(jacobian))
            anew = len(model.strictness) == 1
            pieces.append(replace(one, edges=shots.edges, gaps=gaps, gap_jacobian=slopes) if anew else one)
        return Evidence(unknowns_of(layout, at.z), tuple(pieces), information)

    def _gaps(self, windows: Sequence[Shot], follow: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return residuals (w - 1, e) of the gaps between windows, and their derivatives (w - 1, e, j)."""
        scales, weights = self.problem.layout.scales, self.gap_weights
        slopes = [
            weights[:, None] * (s.gap_by_unknown / scales + s.gap_by_state @ follow[w] - follow[w + 1])
            for w, s in enumerate(windows[:-1])
        ]
        gaps = np.array([-weights * s.gap for s in windows[:-1]]).reshape(-1, len(weights))
        return gaps, np.array(slopes).reshape(*gaps.shape, len(scales))


def following(nodes: Sequence[Node], size: int, scales: FloatArray) -> list[FloatArray]:
    """Return how the state of each window changes with the search vector, (e, j) each, per SI unit."""
    out = [np.zeros((size, len(scales)))]
    for node in nodes:
        out.append(-(node.unknowns / scales + node.before @ out[-1]))
    return out


def gap_scales(problem: Misfit) -> FloatArray:
    """Return the size (e,) of a gap that counts as one standard deviation at strictness one."""
    vehicle, model = problem.layout.vehicle, window_model(problem.layout.vehicle)
    rows, scales = parameter_rows(vehicle), []
    for name in vehicle.moves:
        rotor = name.removesuffix(".lag")
        if rotor in vehicle.rotors:
            spins = [
                np.max(commanded(vehicle, rotor, np.repeat(rows, len(p.inputs), axis=1), p.inputs.T))
                for p in problem.pieces
            ]
            scales.append(SPIN_SCALE * (float(np.nanmax(spins)) or 1.0))
        else:
            usual = model.gap_scales.get(name, model.angle_scale)
            scales.append(GUST_SCALE if name.startswith("gust.") else usual)
    return np.array([*scales, *(FIRST_WIND_STEP for _ in model.winds)])


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a search ended."""

    at: Iterate
    converged: bool
    iterations: int


def solve(problem: ShootingProblem, at: Iterate, schedule: Sequence[float]) -> Solution:
    """Step until nothing is left to gain, with gaps that count ever more."""
    end, iterations = Solution(at, False, 0), 0
    for strictness in schedule:
        stricter = replace(problem, strictness=strictness)
        end = _gauss_newton(stricter, stricter.leveled(end.at))
        iterations += end.iterations
    return Solution(end.at, end.converged, iterations)


def _gauss_newton(problem: ShootingProblem, at: Iterate) -> Solution:
    damping = 1e-4
    for i in range(MAX_ITERATIONS):
        if not np.isfinite(at.cost):
            return Solution(at, False, i)
        pieces = [[problem.weigh(w) for w in windows] for windows in problem.linearize(at)]
        if 0.5 * _step(problem, at, pieces, MIN_DAMPING)[2] < TOLERANCE:
            return Solution(at, True, i)
        after = None
        while after is None and damping < MAX_DAMPING:
            step, found, _ = _step(problem, at, pieces, damping)
            trial = _advanced(problem, at, step, found)
            after = trial if trial.cost < at.cost else None
            damping = max(damping / 10.0, 1e-10) if after is not None else damping * 8.0
        if after is None:
            return Solution(at, False, i + 1)
        at = after
    return Solution(at, False, MAX_ITERATIONS)


def _step(
    problem: ShootingProblem, at: Iterate, pieces: Sequence[Sequence[Weighted]], damping: float
) -> tuple[FloatArray, list[Reduced], float]:
    """Return the step of the search vector within its bounds, the eliminated states, and what both take off the cost."""
    normal, gradient, found = problem.reduce(at, pieces, damping)
    d = problem.problem.dimension
    x, slope = at.z[:d], gradient[:d]
    at_bound = np.zeros(len(gradient), dtype=np.bool_)
    at_bound[:d] = ((x <= 0.0) & (slope > 0.0)) | ((x >= 1.0) & (slope < 0.0))
    free = np.flatnonzero(~at_bound)
    step = np.zeros_like(gradient)
    step[free] = solve_damped(normal[np.ix_(free, free)], -gradient[free], damping)
    return step, found, sum(r.gain for r in found) - float(gradient @ step)


def _advanced(problem: ShootingProblem, at: Iterate, step: FloatArray, found: Sequence[Reduced]) -> Iterate:
    d = problem.problem.dimension
    z = at.z + step
    z[:d] = np.clip(z[:d], 0.0, 1.0)
    nodes = [
        shots.perturbed(own, r.moves(z - at.z).T) if r.nodes else own
        for shots, own, r in zip(problem.shots, at.nodes, found, strict=True)
    ]
    return problem.iterate(z, nodes)


def with_likeliest_wind_steps(problem: ShootingProblem, at: Iterate) -> ShootingProblem:
    """Return the problem with the likeliest size of the steps of the wind from window to window, if there are any."""
    gaps = sum(shots.count - 1 for shots in problem.shots)
    if not window_model(problem.problem.layout.vehicle).winds or gaps < MIN_GAPS:
        return problem
    windows = problem.linearize(at)
    low, high = np.log(WIND_STEPS).tolist()
    for _ in range(WIND_ROUNDS):
        for part in WIND_COMPONENTS:
            found = minimize_scalar(
                lambda x, p, part: _wind_cost(_rescaled(p, part, x), at, windows, gaps),
                args=(problem, part), bounds=(low, high), method="bounded", options={"xatol": 0.05},
            )  # fmt: skip
            problem = _rescaled(problem, part, float(found.x))
    return problem


def _rescaled(problem: ShootingProblem, part: Sequence[int], logarithm: float) -> ShootingProblem:
    scales = problem.scales.copy()
    scales[list(part)] = float(np.exp(logarithm))
    return replace(problem, scales=scales)


def _wind_cost(problem: ShootingProblem, at: Iterate, linear: Sequence[Sequence[Shot]], gaps: int) -> float:
    """Return twice the negative logarithm of the likelihood, less what does not depend on the wind."""
    pieces = [[problem.weigh(shot) for shot in windows] for windows in linear]
    normal, gradient, found = problem.reduce(at, pieces, 0.0)
    cost = sum(float(w.gap @ w.gap) for windows in pieces for w in windows) - sum(r.gain for r in found)
    observed = np.diag(normal) > 0.0  # what no window observes has no part in it
    normal, gradient = normal[np.ix_(observed, observed)], gradient[observed]
    size = np.sqrt(np.diag(normal))
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    kept = np.maximum(values, ROUNDING * values[-1])
    along = vectors.T @ (gradient / size)
    logdet = sum(r.logdet for r in found) + float(np.sum(np.log(kept))) + 2.0 * float(np.sum(np.log(size)))
    steps = 2.0 * gaps * float(np.sum(np.log(problem.scales[-3:])))
    return cost - float(np.sum(along**2 / kept)) + logdet + steps
