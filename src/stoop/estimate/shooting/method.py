"""The method ``multiple-shooting``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Final

import numpy as np
from threadpoolctl import threadpool_limits

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.estimate.filter_error.paths import undelayed
from stoop.estimate.fit import MAX_ROUNDS, RESTS, UNRESTED, Fit, Options, pose, starts
from stoop.estimate.noise import effective_variance_of, first_variance, variance_of
from stoop.estimate.shooting.evidence import evidence
from stoop.estimate.shooting.first import is_poor, searched, windowed
from stoop.estimate.shooting.following import FollowingWindows
from stoop.estimate.shooting.search import LOOSE, STRICTNESS, End, Meeting, Place, scales_of, search
from stoop.estimate.shooting.states import measured_states
from stoop.estimate.shooting.wander import wandering
from stoop.estimate.shooting.windows import Shots, edges, residual
from stoop.flight import Flight
from stoop.optimize.minimize import Status
from stoop.problem import Misfit, Weights
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.simulate.delays import output_delays
from stoop.vehicle import Vehicle

DEFAULTS: Final = Options()
LENGTH: Final = 1.0  #: s of a window: no aircraft runs far in that
AGAIN: Final = 3000.0  #: trajectories of a search after steps from a fair start led nowhere
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
HOVERING: Final = (
    "Fitted by multiple shooting, in windows of {length:g} s that each begin in a state of their own: open loop a vehicle "
    "on rotors falls out of any longer record. Curves of the fitted maneuvers are those of the windows and begin anew "
    "at each. One steady wind per maneuver is estimated (the biases of vn, ve and vd); turbulence within a window is taken "
    "for noise, and the error bars are corrected for its color."
)
AFAR: Final = (
    "No start was near enough to step from, so {optimizer} searched windows that begin as measured "
    "({trajectories:.0f} trajectories) before multiple shooting refined what it found."
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
        """Fit windows, see :mod:`stoop.estimate.methods`."""
        problem, prepared = pose(vehicle, flights, windows, options)
        _check(problem)
        with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
            moved = replace(problem, pieces=tuple(undelayed(problem, piece) for piece in problem.pieces))
            if options.covariance is None:
                moved = moved.weighted(Weights.of(first_variance(moved)))
            shots = tuple(shots_of(moved, i, self.length) for i in range(len(moved.pieces)))
            meeting = Meeting(moved, shots, scales_of(moved))
            return self._fit(
                problem, prepared, meeting, options, _Afar(moved, shots, options, callback, state)
            )

    def _fit(
        self, problem: Misfit, prepared: Prepared, meeting: Meeting, options: Options, afar: _Afar
    ) -> Fit:
        """Step from the best start; search first where all are poor, or where the steps led nowhere."""
        nodes = tuple(
            np.pad(measured_states(shots), [(0, len(shots.blown)), (0, 0)]) for shots in meeting.shots
        )
        firsts = starts(meeting.problem)
        far = afar.outcome(firsts) if afar.wanted(firsts) else None
        begins = [np.concatenate([x, np.zeros(problem.extra)]) for x in firsts] if far is None else [far.z]
        found = self._from(meeting, nodes, begins, options, far)
        if far is None and found.status == "generations" and problem.layout.vehicle.hovers:
            far = afar.limited(AGAIN).outcome(firsts)
            again = self._from(meeting, nodes, [far.z], options, far)
            found = again if again.status == "converged" else found
        return self._found(problem, prepared, found, far)

    def _from(
        self,
        meeting: Meeting,
        nodes: tuple[FloatArray, ...],
        begins: Sequence[FloatArray],
        options: Options,
        far: optimize.Outcome | None,
    ) -> _Refined:
        place = min((meeting.place(z, nodes) for z in begins), key=lambda p: p.cost)
        if not np.isfinite(place.cost):
            raise IdentificationError(
                f"{meeting.problem.layout.vehicle.where}: not even windows of {self.length:g} s can be flown from the "
                "start; check values and units"
            )
        if far is not None and far.status == "interrupted":
            return _Refined(meeting, End(place, False, 0), 0, "interrupted", False)
        return _refined(meeting, place, options)

    def _found(
        self, problem: Misfit, prepared: Prepared, found: _Refined, far: optimize.Outcome | None
    ) -> Fit:
        place, status = found.end.place, found.status
        searched = 0.0 if far is None else far.trajectories
        many = searched + float(found.spent * (problem.dimension + problem.extra + 2))
        outcome = optimize.Outcome(
            place.z, place.cost, many, found.spent, status, ADVICE[status],
            np.empty((0, 2)) if far is None else far.history, None if far is None else far.state,
            "gauss-newton" if far is None else far.optimizer,
        )  # fmt: skip
        said = HOVERING if problem.layout.vehicle.hovers else STATEMENT
        statements = [said.format(length=self.length, gap=max(place.gap, 1e-15))]
        if far is not None:
            statements.append(AFAR.format(optimizer=far.optimizer, trajectories=searched))
        warnings = prepared.warnings + (() if found.rested or status == "interrupted" else (UNRESTED,))
        return Fit(
            problem,
            prepared,
            place.z,
            outcome,
            place.cost,
            many,
            warnings,
            statements=tuple(statements),
            noise=np.diag(_noise(found.meeting, place)),
            own_evidence=evidence(found.meeting, place),
            local_problem=partial(FollowingWindows.of, found.meeting, place),
            simulated=found.meeting.simulated(place),
        )


@dataclass(frozen=True, eq=False)
class _Refined:
    """Where the alternation of search and noise estimate ended."""

    meeting: Meeting
    end: End
    spent: int
    status: Status
    rested: bool


def _refined(meeting: Meeting, place: Place, options: Options) -> _Refined:
    """Alternate search and noise estimate until both rest."""
    schedule = LOOSE if meeting.problem.layout.vehicle.hovers else STRICTNESS
    meeting = replace(meeting, strictness=schedule[-1])
    spent, before, rested, interrupted = 0, np.inf, False, False
    end = End(place, False, 0)
    try:
        for _ in range(MAX_ROUNDS):
            end = search(meeting, end.place, schedule if np.isinf(before) else schedule[-1:])
            spent += end.iterations
            now = meeting.problem.weights.logdet
            rested = options.covariance is not None or abs(before - now) < RESTS * len(
                meeting.problem.weights.covariance
            )
            if rested:
                break
            before, meeting = now, meeting.weighted(Weights.of(_variance(meeting, end.place)))
            meeting = wandering(meeting, end.place)
            end = replace(end, place=meeting.place(end.place.z, end.place.nodes))
    except KeyboardInterrupt:
        interrupted = True
    status: Status = "interrupted" if interrupted else "converged" if end.converged else "generations"
    return _Refined(meeting, end, spent, status, rested)


@dataclass(frozen=True, eq=False)
class _Afar:
    """The search of vehicles that hover, for which starts may be far off."""

    problem: Misfit
    shots: tuple[Shots, ...]
    options: Options
    callback: Callable[[Any], None] | None
    state: Any

    def limited(self, budget: float) -> _Afar:
        """Return the same search with no more than a budget, trajectories."""
        return replace(self, options=replace(self.options, budget=min(budget, self.options.budget)))

    @cached_property
    def windowed(self) -> Misfit:
        return windowed(self.problem, self.shots)

    def wanted(self, starts: FloatArray) -> bool:
        """Tell whether to search before the first step."""
        return self.problem.layout.vehicle.hovers and (
            self.state is not None or is_poor(self.windowed, starts)
        )

    def outcome(self, starts: FloatArray) -> optimize.Outcome:
        """Return how the search ended, its vector that of the whole problem."""
        found = searched(self.windowed, starts, self.options, self.callback, self.state)
        if not np.isfinite(found.cost):
            raise IdentificationError(f"{self.problem.layout.vehicle.where}: {found.advice}")
        d, extra = self.problem.dimension, self.problem.extra - self.windowed.extra
        return replace(found, z=np.concatenate([found.z[:d], np.zeros(extra), found.z[d:]]))


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


fit = MultipleShooting()
