"""The least-squares problem of windows whose first states follow the search vector: for refits near an estimate.

The states that windows begin with follow parameters and nuisances as the linear model at the estimate has them (what
eliminating them by a Schur complement means), so residuals and gaps are functions of the search vector alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.shooting.condense import reduced
from stoop.estimate.shooting.search import Iterate, ShootingProblem, following
from stoop.estimate.shooting.windows import Shots, residual
from stoop.optimize import forward_jacobian
from stoop.problem import Misfit


@dataclass(frozen=True, eq=False)
class FollowingWindows:
    """Readings of windows and gaps between them as residuals; a :class:`stoop.optimize.Problem` with one rung.

    Attributes
    ----------
    problem : Misfit
        Layout, weights, priors and pieces, late readings moved.
    edges : tuple of tuple of int
        First sample of each window of each piece, then the number of samples.
    gap_weights : (e,)
        What a gap is multiplied with.
    center : (D + E,)
        The estimate.
    nodes : tuple of (n_x, w)
        States with which the windows of each piece begin at the estimate.
    follow : tuple of (w, e, D + E)
        How they move with the search vector.
    """

    problem: Misfit
    edges: tuple[tuple[int, ...], ...]
    gap_weights: FloatArray
    center: FloatArray
    nodes: tuple[FloatArray, ...]
    follow: tuple[FloatArray, ...]
    kind: str = "windows"
    prices: tuple[float, ...] = (1.0,)

    @classmethod
    def of(cls, problem: ShootingProblem, at: Iterate) -> FollowingWindows:
        """Return the problem about the iterate where a search ended."""
        ones, follow = np.ones(len(at.z)), []
        for windows in problem.linearize(at):
            nodes = reduced([problem.weigh(shot) for shot in windows], 0.0).nodes
            follow.append(np.stack(following(nodes, windows[0].by_state.shape[2], ones)))
        edges = tuple(shots.edges for shots in problem.shots)
        return cls(problem.problem, edges, problem.gap_weights, at.z, at.nodes, tuple(follow))

    @classmethod
    def restored(cls, problem: Misfit, arrays: Mapping[str, Any]) -> FollowingWindows:
        """Return the problem from its `arrays`."""
        each = range(len(problem.pieces))
        edges = tuple(tuple(arrays[f"edges.{i}"].tolist()) for i in each)
        nodes, follow = (tuple(arrays[f"{n}.{i}"] for i in each) for n in ("nodes", "follow"))
        return cls(problem, edges, arrays["gap_weights"], arrays["center"], nodes, follow)

    @property
    def arrays(self) -> dict[str, Any]:
        """What :meth:`restored` needs beside `problem`."""
        out: dict[str, Any] = {"gap_weights": self.gap_weights, "center": self.center}
        for i, (edges, nodes, follow) in enumerate(zip(self.edges, self.nodes, self.follow, strict=True)):
            out |= {f"edges.{i}": np.array(edges), f"nodes.{i}": nodes, f"follow.{i}": follow}
        return out

    @property
    def dimension(self) -> int:
        """Number of parameters."""
        return self.problem.dimension

    @property
    def extra(self) -> int:
        """Number of nuisances."""
        return self.problem.extra

    @cached_property
    def shots(self) -> tuple[Shots, ...]:
        """The windows of each piece."""
        return tuple(Shots(self.problem, i, edges) for i, edges in enumerate(self.edges))

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return whitened simulated minus measured readings, gaps, and the residuals of the priors, (B, n_r)."""
        rows = [self._rows(z) for z in Z]
        return np.concatenate([np.array(rows), self.problem.layout.prior_residuals(Z)], axis=1)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return costs (B,) with the nuisances at zero."""
        Z = np.concatenate([X, np.zeros((len(X), self.extra))], axis=1)
        return np.asarray(np.sum(self.residuals(Z, rung) ** 2, axis=1))

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Return the derivative of the residuals by forward differences, and the trajectories it took."""
        return forward_jacobian(self, z, rung, r)

    def reference(self, rung: int) -> float:
        """Return infinity: there is no trivial model to compare with."""
        return float(np.inf)

    def in_units(self, white: list[FloatArray]) -> list[FloatArray]:
        """Return whitened values (n, n_y) of each piece in the channels' units."""
        present = [np.isfinite(w) for w in white]
        colored = self.problem.weights.colored
        return [colored(np.where(seen, w, 0.0), seen) for w, seen in zip(white, present, strict=True)]

    def _rows(self, z: FloatArray) -> FloatArray:
        readings, gaps = [], []
        with np.errstate(over="ignore", invalid="ignore"):
            for shots, nodes, follow in zip(self.shots, self.nodes, self.follow, strict=True):
                measured = shots.piece.measured
                found, gap, _ = shots.simulate(z, shots.perturbed(nodes, (follow @ (z - self.center)).T))
                off = residual(self.problem, found, measured)
                readings.append(self.problem.weights.whiten(off, np.isfinite(measured)).ravel())
                gaps.append((gap * self.gap_weights).ravel())
        return np.concatenate([*readings, *gaps])
