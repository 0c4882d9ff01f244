"""Gauss-Newton on windows that do not meet yet: a step fits the readings and closes the gaps at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.estimate.shooting.condense import Reduced, Weighted, reduced
from stoop.estimate.shooting.windows import Shots, Window, residual
from stoop.optimize.normal_equations import solve_damped
from stoop.problem import Misfit, Weights
from stoop.simulate import parameter_rows
from stoop.simulate.initial import commanded
from stoop.vehicle.schema import WIND

ITERATIONS: Final = 60
LEFT: Final = 1e-4  #: of half the cost that is left to gain
FLATTEST: Final = 1e-10
LOST: Final = 1e8
STRICTNESS: Final = (1.0, 10.0, 100.0, 1e3, 1e4)  #: gaps count so many times their scale, one after the other
LOOSE: Final = (
    1.0,
)  #: of vehicles that hover: what a gust does within a window is not carried into the next
_SCALES: Final = {"u": 1.0, "v": 1.0, "w": 1.0, "p": 0.1, "q": 0.1, "r": 0.1}  #: of a gap: m/s, rad/s
_SCALE: Final = 0.05  #: rad
_GUST: Final = 1.0  #: m/s
_HOVERING: Final = {
    "u": 2.0,
    "v": 2.0,
    "w": 2.0,
    "p": 0.5,
    "q": 0.5,
    "r": 0.5,
}  #: likewise, of vehicles that hover
_TURN: Final = 0.2  #: rad, likewise
WANDERS: Final = 0.2  #: m/s from one window to the next, before it is estimated
_SPIN: Final = 1e-3  #: of a rotor's largest x: no gust moves that


@dataclass(frozen=True, eq=False)
class Place:
    """Where a search is.

    Attributes
    ----------
    z : (D + E,)
    nodes : tuple of (n_x, w) or, with winds, (n_x + 3, w)
        States that the windows of each piece begin with.
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
class Meeting:
    """The least-squares problem of all windows of all pieces.

    Attributes
    ----------
    problem : Misfit
    shots : tuple of Shots
        One per piece.
    scales : (e,)
        Of a gap, see :func:`scales_of`.
    strictness : float
        A gap counts so many times its scale.
    """

    problem: Misfit
    shots: tuple[Shots, ...]
    scales: FloatArray
    strictness: float = STRICTNESS[-1]

    def weighted(self, weights: Weights) -> Meeting:
        """Return the same windows with another Q."""
        problem = self.problem.weighted(weights)
        return replace(self, problem=problem, shots=tuple(replace(s, problem=problem) for s in self.shots))

    @cached_property
    def closeness(self) -> FloatArray:
        """What a gap (e,) is multiplied with."""
        return self.strictness / self.scales

    def place(self, z: FloatArray, nodes: Sequence[FloatArray]) -> Place:
        """Fly all windows."""
        total = float(np.sum(self.problem.layout.prior_residuals(z[None, :]) ** 2))
        worst = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for shots, own in zip(self.shots, nodes, strict=True):
                readings, gaps, _ = shots.flown(z, own)
                off = residual(self.problem, readings, shots.piece.measured)
                total += float(
                    np.sum(self.problem.weights.whiten(off, np.isfinite(shots.piece.measured)) ** 2)
                )
                total += float(np.sum((gaps * self.closeness) ** 2))
                worst = max(worst, float(np.max(np.abs(gaps * self.closeness), initial=0.0)))
        return Place(z, tuple(nodes), total if np.isfinite(total) else np.inf, worst / self.strictness)

    def leveled(self, place: Place) -> Place:
        """Return the place with altitudes taken from where the window before ended.

        Not at every step: an altitude that follows its window says nothing of its own, but moves the cost.
        """
        pairs = zip(self.shots, place.nodes, strict=True)
        return self.place(place.z, [self._level(own, shots.flown(place.z, own)[2]) for shots, own in pairs])

    def simulated(self, place: Place) -> tuple[FloatArray, ...]:
        """Return the readings (n, n_y) of each piece."""
        pairs = zip(self.shots, place.nodes, strict=True)
        return tuple(shots.flown(place.z, own)[0] for shots, own in pairs)

    def linear(self, place: Place) -> list[list[Window]]:
        """Return the windows of every piece with their derivatives, residuals whitened."""
        pairs = zip(self.shots, place.nodes, strict=True)
        return [
            [self._whitened(w, shots, i) for i, w in enumerate(shots.differentiated(place.z, own))]
            for shots, own in pairs
        ]

    def _whitened(self, window: Window, shots: Shots, index: int) -> Window:
        measured = shots.piece.measured[shots.edges[index] : shots.edges[index + 1]]
        seen, whiten = np.isfinite(measured), self.problem.weights.whiten

        def turned(slopes: FloatArray) -> FloatArray:
            return np.moveaxis(whiten(np.moveaxis(slopes, 2, 0) * seen, seen), 0, 2)

        return replace(
            window,
            residual=whiten(window.residual, seen),
            by_unknown=turned(window.by_unknown),
            by_state=turned(window.by_state),
        )

    def weigh(self, window: Window) -> Weighted:
        """Return a whitened window as rows of a least-squares problem."""
        close = self.closeness if len(window.gap) else np.empty(0)
        return Weighted(
            window.residual.ravel(),
            _rows(window.by_unknown),
            _rows(window.by_state),
            close * window.gap,
            close[:, None] * window.gap_by_unknown,
            close[:, None] * window.gap_by_state,
            close,
        )

    def _level(self, nodes: FloatArray, ends: FloatArray) -> FloatArray:
        row = self.problem.layout.vehicle.states.index("h")
        out = nodes.copy()
        out[row, 1:] = ends[row]
        return out


def _rows(slopes: FloatArray) -> FloatArray:
    return np.ascontiguousarray(slopes.reshape(-1, slopes.shape[2]).T)


def scales_of(problem: Misfit) -> FloatArray:
    """Return the size (e,) of a gap that counts as one standard deviation at strictness one."""
    vehicle = problem.layout.vehicle
    own, turn = (_HOVERING, _TURN) if vehicle.hovers else (_SCALES, _SCALE)
    usual = [_GUST if n.startswith("gust.") else own.get(n, turn) for n in vehicle.moves]
    spins = {f"{rotor}.lag": _SPIN * largest_spin(problem, rotor) for rotor in vehicle.rotors}
    winds = [WANDERS] * len(WIND) if vehicle.hovers else []
    return np.array([*(spins.get(n, size) for n, size in zip(vehicle.moves, usual, strict=True)), *winds])


def largest_spin(problem: Misfit, rotor: str) -> float:
    """Return the largest x that a rotor is commanded to in the fitted windows; one where it is never on."""
    vehicle = problem.layout.vehicle
    rows = parameter_rows(vehicle)
    most = [
        np.max(commanded(vehicle, rotor, np.repeat(rows, len(p.inputs), axis=1), p.inputs.T))
        for p in problem.pieces
    ]
    return float(np.nanmax(most)) or 1.0


@dataclass(frozen=True, eq=False)
class End:
    """Where a search ended."""

    place: Place
    converged: bool
    iterations: int


def search(meeting: Meeting, place: Place, strictness: Sequence[float] = STRICTNESS) -> End:
    """Search with gaps that count ever more."""
    spent, end = 0, End(place, False, 0)
    for strict in strictness:
        stricter = replace(meeting, strictness=strict)
        end = _descend(stricter, stricter.leveled(end.place))
        spent += end.iterations
    return End(end.place, end.converged, spent)


def _descend(meeting: Meeting, place: Place) -> End:
    """Step until nothing is left to gain."""
    damping = 1e-4
    for i in range(ITERATIONS):
        if not np.isfinite(place.cost):
            return End(place, False, i)
        pieces = [[meeting.weigh(w) for w in windows] for windows in meeting.linear(place)]
        if 0.5 * _step(meeting, place, pieces, FLATTEST)[2] < LEFT:
            return End(place, True, i)
        after = None
        while after is None and damping < LOST:
            step, moves, _ = _step(meeting, place, pieces, damping)
            after = _better(meeting, place, step, moves)
            damping = max(damping / 10.0, 1e-10) if after is not None else damping * 8.0
        if after is None:
            return End(place, False, i + 1)
        place = after
    return End(place, False, ITERATIONS)


def _step(
    meeting: Meeting, place: Place, pieces: Sequence[Sequence[Weighted]], damping: float
) -> tuple[FloatArray, list[Reduced], float]:
    """Return the step of the search vector, what makes the windows follow, and what both take off the cost."""
    layout = meeting.problem.layout
    prior = layout.prior_jacobian()
    normal, gradient = prior.T @ prior, prior.T @ layout.prior_residuals(place.z[None, :])[0]
    found = [reduced(windows, damping) for windows in pieces]
    normal = normal + sum(r.normal for r in found)
    gradient = gradient + sum(r.gradient for r in found)
    free = _free(meeting, place, gradient)
    step = np.zeros_like(gradient)
    step[free] = solve_damped(normal[np.ix_(free, free)], -gradient[free], damping)
    return step, found, sum(r.gain for r in found) - float(gradient @ step)


def _free(meeting: Meeting, place: Place, gradient: FloatArray) -> NDArray[np.intp]:
    """Return the unknowns that no bound holds."""
    d = meeting.problem.dimension
    held = np.zeros(len(gradient), dtype=np.bool_)
    held[:d] = ((place.z[:d] <= 0.0) & (gradient[:d] > 0.0)) | ((place.z[:d] >= 1.0) & (gradient[:d] < 0.0))
    return np.flatnonzero(~held)


def _better(meeting: Meeting, place: Place, step: FloatArray, found: Sequence[Reduced]) -> Place | None:
    """Return the place after a step, if it costs less."""
    d = meeting.problem.dimension
    z = place.z + step
    z[:d] = np.clip(z[:d], 0.0, 1.0)
    nodes = [
        shots.moved(own, r.moves(z - place.z).T) if r.nodes else own
        for shots, own, r in zip(meeting.shots, place.nodes, found, strict=True)
    ]
    after = meeting.place(z, nodes)
    return after if after.cost < place.cost else None
