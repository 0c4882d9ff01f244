"""The least-squares problem of windows with gaps between them.

The states of the windows couple to their neighbors and to the search vector only, so they are eliminated one after the other
(a Schur complement), and a step costs in proportion to the number of windows. The gaps' scale in winds, which decides how
much of a velocity a gust explains, is estimated by maximum likelihood of the linearized problem, states, winds and search
vector integrated out (the Laplace approximation); in calm air it goes to zero and the winds are one.

Axes: j = unknown of the search vector, e = number of a perturbation of a window's state, w = window.

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

from stoop.base.arrays import FloatArray, IntArray
from stoop.base.variables import VARIABLES
from stoop.estimate.shooting_windows import (
    AIRCRAFT,
    Products,
    Shot,
    Shots,
    lanes_first,
    residual,
    window_model,
)
from stoop.optimize.normal_equations import project
from stoop.problem import Misfit
from stoop.problem.evidence import Evidence, PieceEvidence, unknowns_of

GUST_SCALE: Final = 1.0  #: m/s, of a gap of a gust state
SPIN_SCALE: Final = 1e-3  #: of a rotor's largest x, of a gap of its lag: no gust changes that
FIRST_WIND_STEP: Final = 0.2  #: m/s from one window to the next, before it is estimated
WIND_STEPS: Final = (1e-3, 3.0)  #: m/s: bounds
WIND_COMPONENTS: Final = ((-3, -2), (-1,))  #: of the scales: level, vertical
MIN_GAPS: Final = 3  #: below which the size of wind steps is unknown
BODY_VELOCITY: Final = ("u", "v", "w")  #: states
ROUNDING: Final = 1e-12  #: of the greatest eigenvalue
LEAST_DAMPING: Final = 1e-13  #: of states: information of windows that diverge may round to none


@dataclass(frozen=True, eq=False)
class Weighted:
    """A window, whitened: residual and gap are in standard deviations."""

    products: Products  #: of its readings
    by_state: FloatArray  #: (n, n_y, e), derivative of its readings by the state that it begins with
    gap: FloatArray  #: (e,), empty for the last window
    gap_by_unknown: FloatArray  #: (e, j)
    gap_by_state: FloatArray  #: (e, e)
    closing: FloatArray  #: (e,), what a perturbation of the next window's state takes off the gap


@dataclass(frozen=True, eq=False)
class Node:
    """A window's state, eliminated: its step is - (own + unknowns dz + before times the step of the one before).

    Shapes are (e,), (e, j), (e, e).
    """

    own: FloatArray
    unknowns: FloatArray
    before: FloatArray


@dataclass(frozen=True, eq=False)
class Reduced:
    """Reduced normal equations of a piece."""

    normal: FloatArray  #: (j, j), of half the cost, the windows' states at their best
    gradient: FloatArray  #: (j,), of half the cost, the windows' states at their best
    nodes: tuple[Node, ...]  #: the eliminated states, first to last
    states: int  #: number e of perturbations of a state
    gain: float  #: what the steps of the windows' states alone take off the cost
    logdet: float  #: of the information about the states

    def add_to(self, normal: FloatArray, gradient: FloatArray, entries: IntArray) -> None:
        """Add the equations to those of the whole search vector, in which the unknowns are `entries` (j,)."""
        normal[np.ix_(entries, entries)] += self.normal
        gradient[entries] += self.gradient

    def moves(self, step: FloatArray) -> FloatArray:
        """Return the steps (w, e) of the windows' states for a step (j,); the first window's is zero."""
        out = [np.zeros(self.states)]
        for node in self.nodes:
            out.append(-(node.own + node.unknowns @ step + node.before @ out[-1]))
        return np.array(out)

    def following(self, scales: FloatArray) -> list[FloatArray]:
        """Return the derivative (e, j) of each window's initial state by the search vector, per unit of `scales`."""
        out = [np.zeros((self.states, len(scales)))]
        for node in self.nodes:
            out.append(-(node.unknowns / scales + node.before @ out[-1]))
        return out


def reduced(windows: Sequence[Weighted], damping: float) -> Reduced:
    """Eliminate the states of all windows but the first, whose state is the search vector's."""
    e, j = windows[0].products.across.shape
    each, meet = [w.products for w in windows], windows[:-1]
    by_unknown = np.array([w.gap_by_unknown for w in meet]).reshape(len(meet), e, j)
    by_state = np.array([w.gap_by_state for w in meet]).reshape(len(meet), e, e)
    gap = np.array([w.gap for w in meet]).reshape(-1, e)
    closing = np.array([w.closing for w in meet]).reshape(-1, e)
    # normal matrix of (1, unknowns): its first row holds the gradient
    gaps = np.concatenate([gap[:, :, None], by_unknown], axis=2)
    rows = gaps.reshape(-1, 1 + j)
    whole = rows.T @ rows
    whole[1:, 1:] += np.sum([p.by_unknown for p in each], axis=0)
    slope = np.sum([p.unknown_slope for p in each], axis=0)
    whole[0, 1:] += slope
    whole[1:, 0] += slope
    whole[0, 0] = 0.0
    # of each later state: by state (e, e), and by 1, unknowns and the state before (e, 1 + j + e)
    A = np.array([p.by_state for p in each[1:]]).reshape(-1, e, e)
    A[:-1] += by_state[1:].transpose(0, 2, 1) @ by_state[1:]
    A += closing[:, :, None] ** 2 * np.eye(e)
    right = np.array([np.column_stack([p.state_slope, p.across]) for p in each[1:]]).reshape(-1, e, 1 + j)
    right[:-1] += by_state[1:].transpose(0, 2, 1) @ gaps[1:]
    right = np.concatenate([right, np.zeros((len(A), e, e))], axis=2)
    right -= closing[:, :, None] * np.concatenate([gaps, by_state], axis=2)
    nodes: list[Node] = []
    for k in reversed(range(len(A))):
        A[k] += max(damping, LEAST_DAMPING) * np.diag(np.diag(A[k]))
        solved = np.linalg.solve(A[k], right[k])
        whole -= right[k, :, : 1 + j].T @ solved[:, : 1 + j]
        if k:
            back = right[k, :, 1 + j :].T @ solved
            A[k - 1] -= back[:, 1 + j :]
            right[k - 1, :, : 1 + j] -= back[:, : 1 + j]
        before = solved[:, 1 + j :] if k else np.zeros((e, e))
        nodes.append(Node(solved[:, 0], solved[:, 1 : 1 + j], before))
    logdet = float(np.sum(np.linalg.slogdet(A)[1]))
    normal = 0.5 * (whole[1:, 1:] + whole[1:, 1:].T)
    return Reduced(normal, whole[1:, 0], tuple(reversed(nodes)), e, -float(whole[0, 0]), logdet)


def spread(derivatives: FloatArray, entries: IntArray, count: int) -> FloatArray:
    """Return derivatives (..., j) by some entries as derivatives (..., count) by the whole search vector."""
    out = np.zeros((*derivatives.shape[:-1], count))
    out[..., entries] = derivatives
    return out


@dataclass(frozen=True, eq=False)
class Iterate:
    """A point of the search."""

    z: FloatArray  #: (D + E,)
    nodes: tuple[FloatArray, ...]  #: (n_x, w) or, with winds, (n_x + 3, w): begin of each window
    cost: float  #: gaps included, as strictly as the problem takes them
    gap: float  #: largest gap, in its scale


@dataclass(frozen=True, eq=False)
class ShootingProblem:
    """The least-squares problem of all windows of all pieces."""

    problem: Misfit
    shots: tuple[Shots, ...]  #: one per piece
    scales: FloatArray  #: (e,), of a gap that counts as one standard deviation at strictness one
    strictness: float  #: a gap counts so many times its scale

    @classmethod
    def of(cls, problem: Misfit, length: float) -> ShootingProblem:
        """Return the problem in windows of about a given length, s, with the largest weights of the gaps."""
        vehicle, model = problem.layout.vehicle, window_model(problem.layout.vehicle)
        rows, scales = vehicle.parameter_rows(), []
        for name in vehicle.moves:
            rotor = name.removesuffix(".lag")
            if rotor in vehicle.rotors:
                flown = [(np.repeat(rows, len(p.inputs), axis=1), p.inputs.T) for p in problem.pieces]
                spins = [np.max(vehicle.commanded(rotor, *one)) for one in flown]
                scales.append(SPIN_SCALE * (float(np.nanmax(spins)) or 1.0))
            else:
                usual = model.gap_scales.get(name, model.angle_scale)
                scales.append(GUST_SCALE if name.startswith("gust.") else usual)
        scales += [FIRST_WIND_STEP for _ in model.winds]
        shots = tuple(Shots.of(problem, i, length) for i in range(len(problem.pieces)))
        return cls(problem, shots, np.array(scales), AIRCRAFT.strictness[-1])

    def of_problem(self, problem: Misfit) -> ShootingProblem:
        """Return the same windows with another Q, or with readings moved by other delays."""
        return replace(self, problem=problem, shots=tuple(replace(s, problem=problem) for s in self.shots))

    @cached_property
    def gap_weights(self) -> FloatArray:
        """Weights (e,) of a gap."""
        return self.strictness / self.scales

    def whitened(self, z: FloatArray, nodes: Sequence[FloatArray]) -> list[tuple[FloatArray, FloatArray]]:
        """Return whitened simulated less measured readings (n, n_y) and weighted gaps (w - 1, e) of each piece."""
        out = []
        with np.errstate(over="ignore", invalid="ignore"):
            for shots, own, weights in zip(self.shots, nodes, self.problem.piece_weights, strict=True):
                readings, gaps, _ = shots.simulate(z, own)
                measured = shots.piece.measured
                left = residual(self.problem, readings, measured)
                white = weights.whiten(left, np.isfinite(measured))
                out.append((white, gaps * self.gap_weights))
        return out

    def iterate(self, z: FloatArray, nodes: Sequence[FloatArray]) -> Iterate:
        """Simulate all windows."""
        total = float(np.sum(self.problem.layout.prior_residuals(z[None, :]) ** 2))
        worst = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for white, gaps in self.whitened(z, nodes):
                total += float(np.sum(white**2))
                total += float(np.sum(gaps**2))
                worst = max(worst, float(np.max(np.abs(gaps), initial=0.0)))
        return Iterate(z, tuple(nodes), total if np.isfinite(total) else np.inf, worst / self.strictness)

    def worst_gap(self, at: Iterate) -> str:
        """Return the largest gap, in words."""
        vehicle, worst, text = self.problem.layout.vehicle, -1.0, "there is one window"
        for shots, (_, gaps) in zip(self.shots, self.whitened(at.z, at.nodes), strict=True):
            if not gaps.size or np.max(np.abs(gaps)) <= worst:
                continue
            w, e = np.unravel_index(int(np.argmax(np.abs(gaps))), gaps.shape)
            worst, name = float(np.max(np.abs(gaps))), vehicle.moves[e].removeprefix("turn ")
            unit = "m/s" if name in BODY_VELOCITY else VARIABLES[name].unit if name in VARIABLES else ""
            size = f"{worst / self.gap_weights[e]:.2g} {unit}".rstrip()
            time = shots.piece.time[shots.edges[w + 1]]
            text = f"the windows meet within {size} of {name} or better, at {time:g} s worst"
        return text

    def leveled(self, at: Iterate) -> Iterate:
        """Return the iterate with each altitude set to that at the end of the preceding window.

        Not at every step: such an altitude carries no information, but changes the cost.
        """
        row, leveled = self.problem.layout.vehicle.states.index("h"), []
        for shots, own in zip(self.shots, at.nodes, strict=True):
            ends, nodes = shots.simulate(at.z, own)[2], own.copy()
            nodes[row, 1:] = ends[row]
            leveled.append(nodes)
        return self.iterate(at.z, leveled)

    def simulated(self, at: Iterate) -> tuple[FloatArray, ...]:
        """Return the readings (n, n_y) of each piece."""
        return tuple(shots.simulate(at.z, own)[0] for shots, own in zip(self.shots, at.nodes, strict=True))

    def residuals(self, at: Iterate) -> list[FloatArray]:
        """Return measured less simulated (n, n_y) of each piece, NaN where nothing was measured."""
        out = []
        for piece, readings in zip(self.problem.pieces, self.simulated(at), strict=True):
            left = -residual(self.problem, readings, piece.measured)
            out.append(np.where(np.isfinite(piece.measured), left, np.nan))
        return out

    def linearize(self, at: Iterate) -> list[list[Shot]]:
        """Return the windows of every piece with their derivatives, residuals whitened."""
        out = []
        for shots, own, weights in zip(self.shots, at.nodes, self.problem.piece_weights, strict=True):
            whiten, found = weights.whiten, []
            for i, shot in enumerate(shots.linearize(at.z, own)):
                present = np.isfinite(shots.piece.measured[shots.edges[i] : shots.edges[i + 1]])
                each = (lanes_first(slopes) * present for slopes in (shot.by_unknown, shot.by_state))
                by_unknown, by_state = (np.moveaxis(whiten(one, present, one), 0, 2) for one in each)
                left = whiten(shot.residual, present)
                found.append(replace(shot, residual=left, by_unknown=by_unknown, by_state=by_state))
            out.append(found)
        return out

    def weigh(self, windows: Sequence[Shot]) -> list[Weighted]:
        """Return the whitened windows of a piece as rows of a least-squares problem."""
        out = []
        for shot in windows:
            weights = self.gap_weights if len(shot.gap) else np.empty(0)
            gap, column = weights * shot.gap, weights[:, None]
            slopes = column * shot.gap_by_unknown, column * shot.gap_by_state
            out.append(Weighted(shot.products, shot.by_state, gap, *slopes, weights))
        return out

    def moved(
        self, nodes: Sequence[FloatArray], pieces: Sequence[Reduced], step: FloatArray
    ) -> list[FloatArray]:
        """Return the initial states of the windows after a step (j,) of the search vector, by the eliminated equations."""
        rows = zip(self.shots, nodes, pieces, strict=True)
        return [s.perturbed(own, r.moves(step[s.entries]).T) if r.nodes else own for s, own, r in rows]

    def closed(self, at: Iterate, pieces: Sequence[Sequence[Weighted]]) -> Iterate:
        """Return the iterate with windows closed by one step of their states, with derivatives taken near by.

        A step along the linear model of the gaps reopens them by curvature, and their weight then rejects steps that improve
        the readings (the Maratos effect; Nocedal and Wright, *Numerical Optimization*, 2nd ed., section 15.4).
        """
        found = []
        for windows, (white, gaps) in zip(pieces, self.whitened(at.z, at.nodes), strict=True):
            ends = np.cumsum([len(w.by_state) for w in windows])[:-1]
            own = []
            for w, left, gap in zip(
                windows, np.split(white, ends), [*gaps, gaps[:0].reshape(-1)], strict=True
            ):
                states = lanes_first(w.by_state).reshape(-1, left.size)
                products = replace(w.products, state_slope=project(states, left.ravel()))
                own.append(replace(w, products=products, gap=gap))
            found.append(reduced(own, 0.0))
        return self.iterate(at.z, self.moved(at.nodes, found, np.zeros(len(at.z))))

    def reduce(
        self, at: Iterate, pieces: Sequence[Sequence[Weighted]], damping: float
    ) -> tuple[FloatArray, FloatArray, list[Reduced]]:
        """Return normal matrix (j, j) and gradient (j,) of half the cost, the states of the windows eliminated."""
        layout = self.problem.layout
        prior = layout.prior_jacobian(at.z)
        normal, gradient = prior.T @ prior, prior.T @ layout.prior_residuals(at.z[None, :])[0]
        found = [reduced(windows, damping) for windows in pieces]
        for shots, one in zip(self.shots, found, strict=False):
            one.add_to(normal, gradient, shots.entries)
        return normal, gradient, found

    def sensitivities(
        self, windows: Sequence[Shot], scales: FloatArray
    ) -> tuple[list[FloatArray], FloatArray]:
        """Return the derivatives (n, n_y, j) of each window's readings and (w - 1, e, j) of the gaps, states eliminated.

        The initial states of the windows take their optimum for each search vector.
        """
        follow = reduced(self.weigh(windows), 0.0).following(scales)
        readings = [w.by_unknown / scales + w.by_state @ own for w, own in zip(windows, follow, strict=True)]
        slopes = np.empty((len(windows) - 1, len(self.gap_weights), len(scales)))
        for i, w in enumerate(windows[:-1]):
            gap = w.gap_by_unknown / scales + w.gap_by_state @ follow[i] - follow[i + 1]
            slopes[i] = self.gap_weights[:, None] * gap
        return readings, slopes

    def evidence(self, at: Iterate) -> Evidence:
        """Return residuals and sensitivities of the search vector, the initial states of the windows unknown."""
        layout, model = self.problem.layout, window_model(self.problem.layout.vehicle)
        rows = layout.prior_jacobian(at.z) / layout.scales
        information, pieces = rows.T @ rows, []
        for shots, windows in zip(self.shots, self.linearize(at), strict=True):
            readings, gap_slopes = self.sensitivities(windows, layout.scales[shots.entries])
            jacobian = spread(np.concatenate(readings), shots.entries, len(at.z))
            slopes = spread(gap_slopes, shots.entries, len(at.z))
            rows = slopes.reshape(-1, len(layout.scales))
            information = information + rows.T @ rows
            left = -np.concatenate([shot.residual for shot in windows])
            residual = np.where(np.isfinite(shots.piece.measured), left, np.nan)
            piece = PieceEvidence(residual, jacobian, shots.piece.maneuver)
            if len(model.strictness) == 1:  # windows that need not meet
                gaps = np.array([-self.gap_weights * s.gap for s in windows[:-1]]).reshape(slopes.shape[:2])
                piece = replace(piece, edges=shots.edges, gaps=gaps, gap_jacobian=slopes)
            pieces.append(piece)
        return Evidence(unknowns_of(layout, at.z), tuple(pieces), information)

    def with_likeliest_wind_steps(self, at: Iterate) -> ShootingProblem:
        """Return the problem with the likeliest size of the steps of the wind from window to window, if there are any."""
        count = sum(shots.count - 1 for shots in self.shots)
        if not window_model(self.problem.layout.vehicle).winds or count < MIN_GAPS:
            return self
        problem, windows = self, self.linearize(at)
        for part in (*WIND_COMPONENTS, *WIND_COMPONENTS):
            found = minimize_scalar(
                lambda x, p, part: p.rescaled(part, x).wind_cost(at, windows, count),
                args=(problem, part), bounds=np.log(WIND_STEPS).tolist(), method="bounded", options={"xatol": 0.05},
            )  # fmt: skip
            problem = problem.rescaled(part, float(found.x))
        return problem

    def rescaled(self, part: Sequence[int], logarithm: float) -> ShootingProblem:
        """Return the problem with another scale of the gaps in some components."""
        scales = self.scales.copy()
        scales[list(part)] = float(np.exp(logarithm))
        return replace(self, scales=scales)

    def wind_cost(self, at: Iterate, linear: Sequence[Sequence[Shot]], gaps: int) -> float:
        """Return twice the negative logarithm of the likelihood, less what does not depend on the wind."""
        normal, gradient, _ = self.reduce(at, (), 0.0)
        cost = logdet = 0.0
        for shots, windows in zip(self.shots, linear, strict=True):
            weighted = self.weigh(windows)
            found = reduced(weighted, 0.0)
            cost += sum(float(w.gap @ w.gap) for w in weighted) - found.gain
            found.add_to(normal, gradient, shots.entries)
            logdet += found.logdet
        observed = np.diag(normal) > 0.0  # what no window observes has no part in it
        normal, gradient = normal[np.ix_(observed, observed)], gradient[observed]
        size = np.sqrt(np.diag(normal))
        values, vectors = np.linalg.eigh(normal / np.outer(size, size))
        kept = np.maximum(values, ROUNDING * values[-1])
        along = vectors.T @ (gradient / size)
        total = logdet + float(np.sum(np.log(kept))) + 2.0 * float(np.sum(np.log(size)))
        steps = 2.0 * gaps * float(np.sum(np.log(self.scales[-3:])))
        return cost - float(np.sum(along**2 / kept)) + total + steps
