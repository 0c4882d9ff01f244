"""The method ``multiple-shooting``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from stoop import optimize
from stoop.cost import Misfit, Weights
from stoop.errors import IdentificationError
from stoop.flight import Flight
from stoop.identify.filter_error.paths import filled, undelayed, unwrapped
from stoop.identify.fit import MAX_ROUNDS, RESTS, UNRESTED, Evidence, Fit, Options, pose, starts
from stoop.identify.noise import effective_variance_of, first_variance, variance_of
from stoop.identify.prepare import Prepared
from stoop.identify.shooting.search import STRICTNESS, End, Meeting, Place, search
from stoop.identify.shooting.windows import Shots, edges, residual
from stoop.identify.shooting.windows import Window as WindowSlopes
from stoop.identify.windows import Window
from stoop.optimize.minimize import Status
from stoop.simulate import START_NAMES, initial_states, parameter_rows
from stoop.simulate.delays import output_delays
from stoop.vehicle import Vehicle

FloatArray = NDArray[np.float64]
DEFAULTS: Final = Options()
LENGTH: Final = 1.0  #: s of a window: no aircraft runs far in that
SMOOTH: Final = 0.1  #: s over which readings are averaged where a window begins
ADVICE: Final = {
    "converged": "",
    "generations": "the windows do not meet at an optimum; begin nearer, or fix what the data cannot tell",
    "interrupted": "stopped by the user",
}
STATEMENT: Final = (
    "Fitted by multiple shooting, in windows of {length:g} s that meet: curves of the fitted maneuvers are those of the "
    "windows, one flight to within {gap:.0e} of what the sensors tell. Open loop from its first sample an unstable "
    "vehicle leaves them."
)


@dataclass(frozen=True)
class MultipleShooting:
    """Multiple shooting.

    Attributes
    ----------
    length : float, s
        Of a window.
    """

    length: float = LENGTH

    def __call__(
        self,
        vehicle: Vehicle,
        flights: Mapping[str, Flight],
        windows: Sequence[Window],
        options: Options = DEFAULTS,
        callback: Callable[[Any], None] | None = None,
        state: Any = None,
    ) -> Fit:
        """Fit windows that meet, see :mod:`stoop.identify.methods`."""
        problem, prepared = pose(vehicle, flights, windows, options)
        _check(problem)
        with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
            return self._fit(problem, prepared, options)

    def _fit(self, problem: Misfit, prepared: Prepared, options: Options) -> Fit:
        moved = replace(problem, pieces=tuple(undelayed(problem, piece) for piece in problem.pieces))
        if options.covariance is None:
            moved = moved.weighted(Weights.of(first_variance(moved)))
        meeting = Meeting(moved, tuple(shots_of(moved, i, self.length) for i in range(len(moved.pieces))))
        nodes = [measured_states(shots) for shots in meeting.shots]
        firsts = [np.concatenate([x, np.zeros(problem.extra)]) for x in starts(moved)]
        begins = [meeting.place(z, nodes) for z in firsts]
        place = min(begins, key=lambda p: p.cost)
        if not np.isfinite(place.cost):
            raise IdentificationError(
                f"{problem.layout.vehicle.where}: not even windows of {self.length:g} s can be flown from the start; "
                "check values and units"
            )
        return self._refined(problem, prepared, meeting, place, options)

    def _refined(
        self, problem: Misfit, prepared: Prepared, meeting: Meeting, place: Place, options: Options
    ) -> Fit:
        """Alternate search and noise estimate until both rest."""
        spent, before, rested, interrupted = 0, np.inf, False, False
        end = End(place, False, 0)
        try:
            for _ in range(MAX_ROUNDS):
                end = search(meeting, end.place, STRICTNESS if np.isinf(before) else STRICTNESS[-1:])
                spent += end.iterations
                now = meeting.problem.weights.logdet
                rested = options.covariance is not None or abs(before - now) < RESTS * len(
                    meeting.problem.weights.covariance
                )
                if rested:
                    break
                before, meeting = now, meeting.weighted(Weights.of(_variance(meeting, end.place)))
                end = replace(end, place=meeting.place(end.place.z, end.place.nodes))
        except KeyboardInterrupt:
            interrupted = True
        status: Status = "interrupted" if interrupted else "converged" if end.converged else "generations"
        return self._found(problem, prepared, meeting, end, spent, status, rested)

    def _found(
        self,
        problem: Misfit,
        prepared: Prepared,
        meeting: Meeting,
        end: End,
        spent: int,
        status: Status,
        rested: bool,
    ) -> Fit:
        place, many = end.place, float(spent * (problem.dimension + problem.extra + 2))
        outcome = optimize.Outcome(
            place.z, place.cost, many, spent, status, ADVICE[status], np.empty((0, 2)), None, "gauss-newton"
        )
        noise = np.diag(_noise(meeting, place))
        warnings = prepared.warnings + (() if rested or status == "interrupted" else (UNRESTED,))
        return Fit(
            problem,
            prepared,
            place.z,
            outcome,
            place.cost,
            many,
            warnings,
            statements=(STATEMENT.format(length=self.length, gap=max(place.gap, 1e-15)),),
            noise=noise,
            evidence=_evidence(meeting, place),
            simulated=meeting.simulated(place),
        )


def _check(problem: Misfit) -> None:
    vehicle = problem.layout.vehicle
    late = {vehicle.parameters[row].name for _, row in output_delays(vehicle)}
    for p in problem.layout.parameters:
        if p.name in late:
            raise IdentificationError(
                f"{vehicle.where}: {p.name}: windows take the delay of a sensor as it is known to be; use --fix {p.name}"
            )


def shots_of(problem: Misfit, index: int, length: float) -> Shots:
    """Return the windows, about so many seconds long, of one piece."""
    piece = problem.pieces[index]
    return Shots(problem, index, edges(len(piece.time), max(2, round(length / piece.dt))))


def measured_states(shots: Shots) -> FloatArray:
    """Return the states (n_x, w) that were measured where the windows begin."""
    piece, vehicle = shots.piece, shots.problem.layout.vehicle
    width = max(1, round(SMOOTH / piece.dt))
    at = np.array(shots.edges[:-1])
    start: dict[str, FloatArray] = {n: np.full(len(at), piece.start.get(n, 0.0)) for n in START_NAMES}
    for i, channel in enumerate(vehicle.outputs):
        column = piece.measured[:, i]
        if channel in start and np.isfinite(column).any():
            smooth = np.pad(filled(unwrapped(column)), width, mode="edge")
            start[channel] = np.array([smooth[a : a + 2 * width + 1].mean() for a in at])
    rows = parameter_rows(vehicle, piece.changes)
    states = [
        initial_states(vehicle, {n: v[w] for n, v in start.items()}, rows, piece.inputs[a])
        for w, a in enumerate(at)
    ]
    return np.concatenate(states, axis=1)


def _residuals(meeting: Meeting, place: Place) -> list[FloatArray]:
    """Return measured less simulated (n, n_y) of each piece, NaN where nothing was measured."""
    pairs = zip(meeting.shots, meeting.simulated(place), strict=True)
    found = [(s.piece.measured, residual(meeting.problem, y, s.piece.measured)) for s, y in pairs]
    return [np.where(np.isfinite(z), -r, np.nan) for z, r in found]


def _variance(meeting: Meeting, place: Place) -> FloatArray:
    return effective_variance_of(meeting.problem, _residuals(meeting, place))


def _noise(meeting: Meeting, place: Place) -> FloatArray:
    residuals = _residuals(meeting, place)
    seen = np.any([np.isfinite(r).any(axis=0) for r in residuals], axis=0)
    return np.where(seen, variance_of(meeting.problem, residuals), np.nan)


def _evidence(meeting: Meeting, place: Place) -> Evidence:
    """Return residuals and sensitivities per SI unit, of search vector and windows' states; that they meet is known."""
    layout, linear = meeting.problem.layout, meeting.linear(place)
    many, first = len(layout.vehicle.moves), len(place.z)
    size = first + many * sum(len(windows) - 1 for windows in linear)
    information = np.zeros((size, size))
    prior = layout.prior_jacobian() / layout.scales
    information[:first, :first] = prior.T @ prior
    residuals, jacobians = [], []
    for shots, windows in zip(meeting.shots, linear, strict=True):
        blocks = []
        for w, window in enumerate(windows):
            own, after = slice(first, first + many), slice(first + many, first + 2 * many)
            wide = np.zeros((*window.residual.shape, size))
            wide[:, :, : len(place.z)] = window.by_unknown / layout.scales
            if w > 0:
                wide[:, :, own] = window.by_state
            if w + 1 < len(windows):
                information += _met(meeting, window, own if w > 0 else None, after if w > 0 else own, size)
            first += many if w > 0 else 0
            blocks.append(wide)
        residual = -np.concatenate([window.residual for window in windows])
        residuals.append(np.where(np.isfinite(shots.piece.measured), residual, np.nan))
        jacobians.append(np.concatenate(blocks))
    return Evidence(tuple(residuals), tuple(jacobians), information)


def _met(meeting: Meeting, window: WindowSlopes, own: slice | None, after: slice, size: int) -> FloatArray:
    """Return what the meeting of a window with the next one says of all unknowns (size, size)."""
    layout = meeting.problem.layout
    rows = np.zeros((len(window.gap), size))
    rows[:, : window.gap_by_unknown.shape[1]] = window.gap_by_unknown / layout.scales
    if own is not None:
        rows[:, own] = window.gap_by_state
    rows[:, after] = -np.eye(len(window.gap))
    rows *= meeting.closeness[:, None]
    information: FloatArray = rows.T @ rows
    return information


fit = MultipleShooting()
