"""Multiple shooting: short windows with initial states of their own and continuity constraints between them.

The open-loop simulation of an unstable vehicle diverges from a wrong initial state, and in the long run also from the right
one, so that output error has no useful gradient. Over a window of a second the divergence is small. Each window has an initial
state of its own, which begins as measured. The weight of the continuity constraints increases step by step; with continuous
windows the estimate is that of output error.

Gauss-Newton alternates with noise-covariance estimation. If Gauss-Newton converges from no start of a vehicle with rotors, an
optimizer first searches with windows that begin as measured: each is then a piece of its own, so that even a wrong candidate
can be simulated to its end.

References
----------
H. G. Bock, "Recent advances in parameter identification techniques for ordinary differential equations", in
P. Deuflhard and E. Hairer (eds.), *Numerical Treatment of Inverse Problems in Differential and Integral Equations*,
Birkhaeuser, 1983, pp. 95-121.
R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., AIAA, 2015, section 9 (unstable aircraft).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, ClassVar, Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray, IntArray
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.estimate import iterates
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import ALTERNATION, Callback, Fitter, Options, State, starts
from stoop.estimate.geodesic_step import Step, bent
from stoop.estimate.linearization import aligned, as_recorded
from stoop.estimate.noise import first_variance, noise_covariance
from stoop.estimate.noise_model import NoiseModel, with_noise
from stoop.estimate.refit_problem import RefitProblem
from stoop.estimate.response import ExtendedModel, Responses, whitened
from stoop.estimate.shooting_problem import Iterate, ShootingProblem, Weighted, reduced, spread
from stoop.estimate.shooting_windows import WINDOW_LENGTH, Shots, window_model
from stoop.optimize.levenberg_marquardt import (
    ADVICE,
    Damping,
    Ending,
    StagedModel,
    Stages,
    StagesState,
    TenfoldDamping,
    Trial,
    levenberg_marquardt,
)
from stoop.optimize.minimize import Status
from stoop.optimize.normal_equations import TallMatrix, solve_damped
from stoop.problem import Layout, Misfit, Weights
from stoop.problem.archive import PIECE_TUPLES
from stoop.problem.evidence import Evidence
from stoop.problem.prepare import Prepared
from stoop.results.decisions import DecisionRecord

#: least predicted reduction of half the cost
TOLERANCE: Final = 1e-4
#: likewise, while the noise is not known: it moves the optimum by more than that is short of it
FIRST_TOLERANCE: Final = 1.0
#: of the gain that is predicted; where a step gains less, it is bent, too
STRAIGHT: Final = 0.5
#: accepted steps that together gain no more than the tolerance, after which a search ends
CRAWL: Final = 10
MIN_DAMPING: Final = 1e-10
DAMPING: Final = partial(TenfoldDamping, 1e-4, growth=8.0, acceleration=1.0, smallest=MIN_DAMPING)
#: largest number of rounds of increasing weights; three are usual
JOINING_STEPS: Final = 10
#: trajectories of a search after Gauss-Newton from a fair start did not converge
SECOND_BUDGET: Final = 3000.0
#: of the cost of constant readings: a start that is no better is none
POOR: Final = 0.7


class GaussNewtonModel(StagedModel):
    """The windows of a problem about an iterate, their states eliminated; parameters stay in the unit box."""

    def __init__(
        self, problem: ShootingProblem, at: Iterate, held: bool = False, tolerance: float = TOLERANCE
    ) -> None:
        self.problem, self.at, self.cost, self.tolerance = problem, at, at.cost, tolerance
        self.held = held  #: the parameters; initial states and biases are free then
        self.readings = sum(int(np.isfinite(s.piece.measured).sum()) for s in problem.shots)
        self.before = np.full(CRAWL, np.inf)  #: costs before the last steps

    @property
    def point(self) -> FloatArray:
        """The search vector, then the initial states of the windows."""
        return np.concatenate([self.at.z, *(own.ravel() for own in self.at.nodes)])

    @property
    def memory(self) -> FloatArray:
        """Costs before the last steps."""
        return self.before

    def recall(self, memory: FloatArray) -> None:
        """Take over the costs before the last steps of a saved search; states of release 0.1 have none."""
        self.before = memory if memory.size else self.before

    def go_to(self, point: FloatArray) -> None:
        """Simulate the windows of a point."""
        sizes = [len(self.at.z), *(own.size for own in self.at.nodes)]
        z, *nodes = np.split(point, np.cumsum(sizes)[:-1])
        each = zip(nodes, self.at.nodes, strict=True)
        self.at = self.problem.iterate(z, [new.reshape(own.shape) for new, own in each])
        self.cost, self.current = self.at.cost, False

    def linearize(self) -> None:
        """Compute the derivatives of every window."""
        self.linear = self.problem.linearize(self.at)
        self.windows: list[list[Weighted]] = [self.problem.weigh(shots) for shots in self.linear]
        self.current = self.exact = True

    def stopped(self, damping: Damping) -> Ending | None:
        """Show the windows as they are; see :class:`StagedModel`."""
        problem = self.problem
        iterates.show(problem.problem, self.at.z, self.cost, lambda: problem.simulated(self.at))
        ending = super().stopped(damping)
        return "stalled" if self.before[0] - self.cost < self.least else ending

    @property
    def least(self) -> float:
        """Least reduction of half the cost that counts: the tolerance once the residuals are as large as their weights say."""
        return self.tolerance * max(1.0, self.cost / self.readings)

    @property
    def optimal(self) -> bool:
        """Whether the predicted gain is below the tolerance."""
        if self.current:  # an optimum was looked for when the derivatives were taken
            return False
        self.linearize()
        return 0.5 * self.step(MIN_DAMPING).gain < self.least

    def step(self, damping: float) -> Step:
        """Return the damped step of the search vector and of the eliminated states."""
        normal, gradient, found = self.problem.reduce(self.at, self.windows, damping)
        d = self.problem.problem.dimension
        x, slope = self.at.z[:d], gradient[:d]
        at_bound = np.zeros(len(gradient), dtype=np.bool_)
        at_bound[:d] = self.held | ((x <= 0.0) & (slope > 0.0)) | ((x >= 1.0) & (slope < 0.0))
        free = np.flatnonzero(~at_bound)
        step = np.zeros_like(gradient)
        step[free] = solve_damped(normal[np.ix_(free, free)], -gradient[free], damping)
        gain = sum(r.gain for r in found) - float(gradient @ step)
        return Step(step, found, normal, free, damping, gain)

    def evaluate(self, step: Step) -> Trial:
        """Simulate the windows after the step, and after one that is bent where it gains little."""
        z, d = self.at.z + step.z, self.problem.problem.dimension
        z[:d] = np.clip(z[:d], 0.0, 1.0)
        nodes = self.problem.moved(self.at.nodes, step.windows, z - self.at.z)
        there = self.problem.iterate(z, nodes)
        if self.problem.strictness > 1.0 and np.isfinite(there.cost):
            closer = self.problem.closed(there, self.windows)
            there = min(there, closer, key=lambda at: at.cost)
        if self.cost - there.cost < STRAIGHT * step.gain:
            with np.errstate(over="ignore", invalid="ignore"):  # a step that diverges is a value
                curved = bent(self.problem, self.at, self.linear, self.windows, step)
            there = min(there, curved, key=lambda at: at.cost)
        return Trial(there, there.cost, 0.0)

    def accept(self, trial: Trial, ratio: float) -> None:
        """Go there."""
        self.before = np.append(self.before[1:], self.cost)
        self.at, self.cost, self.current = trial.point, trial.cost, False


@dataclass(frozen=True, eq=False)
class Refined:
    """Result of the alternation of Gauss-Newton and noise estimation."""

    problem: ShootingProblem
    at: Iterate
    iterations: int
    status: Status
    noise_converged: bool = False
    #: None before it is estimated, or where it is given
    noise: NoiseModel | None = None


def refined(
    problem: ShootingProblem,
    begins: Sequence[FloatArray],
    options: Options,
    stages: Stages,
    interrupted: bool = False,
) -> Refined:
    """Alternate Gauss-Newton, with increasing weights of the gaps, and noise-covariance estimation until both converge.

    It begins at the best of several vectors (D + E,), and returns that one after an interrupted search.
    """
    vehicle = problem.problem.layout.vehicle
    schedule = window_model(vehicle).strictness

    own = [[shots.measured_nodes(z) for shots in problem.shots] for z in begins]
    at = min((problem.iterate(z, nodes) for z, nodes in zip(begins, own, strict=True)), key=lambda p: p.cost)
    if not np.isfinite(at.cost):
        length = problem.shots[0].edges[1] * problem.problem.pieces[0].dt
        raise IdentificationError(
            f"{vehicle.where}: not even windows of {length:.2g} s can be flown from the start; check values and units"
        )
    try:
        joined = as_one_flight(problem, at, schedule)
    except KeyboardInterrupt:
        joined, interrupted = at, True
    if not interrupted and joined.cost < POOR * problem.problem.reference(len(problem.problem.prices) - 1):
        # without continuity constraints the search can leave a good starting point
        at, schedule = joined, schedule[-1:]
    iterations, before, recorded, noise = 0, np.inf, problem.problem, None
    status: Status = "interrupted" if interrupted else "stalled"
    noise_converged, given = False, options.covariance is not None
    tolerance = TOLERANCE if given else FIRST_TOLERANCE
    problem = replace(problem, strictness=schedule[-1])
    end = at
    try:
        for _ in range(0 if interrupted else ALTERNATION.rounds):
            for strictness in schedule if np.isinf(before) else schedule[-1:]:
                stricter = replace(problem, strictness=strictness)
                model = GaussNewtonModel(stricter, stricter.leveled(at), tolerance=tolerance)
                status = stages.search(model, DAMPING())
                steps = len(stages.stages[-1].costs) - 1
                at, iterations = model.at, iterations + steps + (status == "stalled")
                if status in ("generations", "budget"):
                    break
            if status in ("generations", "budget"):
                end = problem.iterate(at.z, at.nodes)
                break
            end = at
            recorded, held = aligned(recorded, at.z), problem.problem
            settled = all(a.moved == b.moved for a, b in zip(recorded.pieces, held.pieces, strict=True))
            noise_converged = settled and (given or abs(ALTERNATION.fall(before, held)) < 1.0)
            if noise_converged:
                if tolerance == TOLERANCE:
                    break
                tolerance = TOLERANCE  # once more, to the end
                continue
            shifted = recorded
            if not given:
                flown = problem, at
                residuals = partial(lambda problem, at, own: problem.of_problem(own).residuals(at), *flown)
                noise, shifted = with_noise(recorded, residuals, noise, options.treatment)
            before, problem = held.noise_logdet, problem.of_problem(shifted)
            problem = problem.with_likeliest_wind_steps(at)
            end = at = problem.iterate(at.z, at.nodes)
    except KeyboardInterrupt:
        status = "interrupted"
    return Refined(problem, end, iterations, status, noise_converged, noise)


def as_one_flight(problem: ShootingProblem, at: Iterate, schedule: Sequence[float]) -> Iterate:
    """Return the iterate with increasing weights of the gaps, the parameters held."""
    for strictness in schedule:
        stricter = replace(problem, strictness=strictness)
        model = GaussNewtonModel(stricter, stricter.leveled(at), held=True)
        model.watch = lambda damping: None
        levenberg_marquardt(model, DAMPING(), max_steps=JOINING_STEPS)
        at = model.at
    return at


def windowed_problem(shooting: ShootingProblem) -> Misfit:
    """Return the least-squares problem in which every window is a piece that begins as measured, for a global search.

    Its unknowns are the free parameters and the biases; initial states are not among them.
    """
    problem, pieces = shooting.problem, []
    biases = tuple(n for n in problem.layout.nuisances if n.is_bias)
    layout = Layout(problem.layout.vehicle, problem.layout.parameters, biases)
    for shots in shooting.shots:
        states = shots.measured_starts()
        for w, (a, b) in enumerate(pairwise(shots.edges)):
            start = {name: float(values[w]) for name, values in states.items()}
            pieces.append(shots.piece.part(a, b, start))
    return Misfit(layout, tuple(pieces), problem.weights, (tuple(len(p.time) for p in pieces),))


@dataclass(frozen=True, eq=False)
class LinearizedNodes(RefitProblem):
    """Readings of windows and gaps between them as residuals, functions of the search vector alone.

    The initial states of the windows are linear functions of parameters and nuisances, by the linear model at the estimate. With
    strict continuity, a Gauss-Newton step of these states alone removes the gaps that the curvature causes.
    """

    kind: ClassVar = "windows"
    #: layout, weights, priors and pieces, late readings moved ahead
    problem: Misfit
    #: first sample of each window, then the number of samples
    edges: tuple[tuple[int, ...], ...]
    #: (e,), weights of a gap
    gap_weights: FloatArray
    #: (D + E,), the estimate
    center: FloatArray
    #: (n_x, w), states with which the windows of each piece begin there
    nodes: tuple[FloatArray, ...]
    #: (w, e, D + E), how they change with the search vector
    follow: tuple[FloatArray, ...]
    #: whether windows are continuous, so that states must be accurate to the second order
    strict: bool = False

    @classmethod
    def of(cls, problem: ShootingProblem, at: Iterate) -> LinearizedNodes:
        """Return the problem about the iterate where a search ended."""
        edges, follow = tuple(shots.edges for shots in problem.shots), []
        for shots, windows in zip(problem.shots, problem.linearize(at), strict=True):
            own = reduced(problem.weigh(windows), 0.0).following(np.ones(len(shots.entries)))
            follow.append(spread(np.stack(own), shots.entries, len(at.z)))
        strict = problem.strictness > 1.0
        return cls(problem.problem, edges, problem.gap_weights, at.z, at.nodes, tuple(follow), strict)

    @classmethod
    def restored(cls, problem: Misfit, arrays: Mapping[str, Any]) -> LinearizedNodes:
        """Return the problem from its `arrays`."""
        each = range(len(problem.pieces))
        edges = tuple(tuple(arrays[f"edges.{i}"].tolist()) for i in each)
        nodes, follow = (tuple(arrays[f"{n}.{i}"] for i in each) for n in ("nodes", "follow"))
        center, strict = arrays["center"], bool(arrays["strict"])
        return cls(problem, edges, arrays["gap_weights"], center, nodes, follow, strict)

    @property
    def arrays(self) -> dict[str, Any]:
        """Arrays that :meth:`restored` takes beside `problem`."""
        out: dict[str, Any] = {"gap_weights": self.gap_weights, "center": self.center}
        out["strict"] = np.array(self.strict)
        for i, (edges, nodes, follow) in enumerate(zip(self.edges, self.nodes, self.follow, strict=True)):
            out |= {f"edges.{i}": np.array(edges), f"nodes.{i}": nodes, f"follow.{i}": follow}
        return out

    @property
    def windows(self) -> tuple[tuple[int, ...], ...]:
        """First sample of each window of each piece, then the number of samples."""
        return self.edges

    @property
    def gaps(self) -> int:
        """Number of residuals of the gap between two windows."""
        return len(self.gap_weights)

    @cached_property
    def shots(self) -> tuple[Shots, ...]:
        """The windows of each piece."""
        return tuple(Shots(self.problem, i, edges) for i, edges in enumerate(self.edges))

    @cached_property
    def _shooting(self) -> ShootingProblem:
        return ShootingProblem(self.problem, self.shots, 1.0 / self.gap_weights, 1.0)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return whitened simulated minus measured readings, gaps, and the residuals of the priors, (B, n_r)."""
        rows = []
        for z in Z:
            pieces = zip(*self._shooting.whitened(z, self._nodes(z)), strict=True)
            rows.append(np.concatenate([part.ravel() for parts in pieces for part in parts]))
        return np.concatenate([np.array(rows), self.problem.layout.prior_residuals(Z)], axis=1)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[TallMatrix, float]:
        """Return the derivative of the residuals, states of windows included, and the trajectories used."""
        at = Iterate(z, tuple(self._nodes(z)), 0.0, 0.0)
        readings, gaps = list[tuple[IntArray, FloatArray]](), list[tuple[IntArray, FloatArray]]()
        for shots, windows in zip(self.shots, self._shooting.linearize(at), strict=True):
            j = len(shots.entries)
            by_window, slopes = self._shooting.sensitivities(windows, np.ones(j))
            for parts, one in ((readings, np.concatenate(by_window)), (gaps, slopes)):
                parts.append((shots.entries, np.ascontiguousarray(one.reshape(-1, j).T)))
        return TallMatrix.stacked([*readings, *gaps, *self.problem.prior_parts(z)], len(z)), float(len(z))

    def responses(self, z: FloatArray) -> Responses:
        """Return the responses of readings and gaps to extensions of the vehicle at z (D + E,), states of windows eliminated."""
        model, nodes = ExtendedModel.of(self.problem.layout.vehicle), self._nodes(z)
        pieces, gaps, ones = [], [], np.ones(len(model.extensions))
        linear = self._shooting.linearize(Iterate(z, tuple(nodes), 0.0, 0.0))
        each = zip(self.shots, nodes, linear, self.problem.piece_weights, strict=True)
        for shots, own, windows, weights in each:
            readings, slopes = shots.responses(model, z, own)
            white = whitened(weights, readings, np.isfinite(shots.piece.measured))
            by_window, ends = np.split(white, shots.edges[1:-1]), [*slopes, slopes[:0].reshape(0, len(ones))]
            parts = zip(windows, by_window, ends, strict=True)
            changed = [replace(w, by_unknown=by, gap_by_unknown=gap) for w, by, gap in parts]
            found = self._shooting.sensitivities(changed, ones)
            pieces.append(np.concatenate(found[0]))
            gaps.append(found[1])
        return Responses(model.extensions, tuple(pieces), () if self.strict else tuple(gaps))

    def in_units(self, white: Sequence[FloatArray]) -> list[FloatArray]:
        """Return whitened values (n, n_y) of each piece in the channels' units."""
        present = [np.isfinite(w) for w in white]
        each = zip(self.problem.piece_weights, white, present, strict=True)
        return [weights.colored(np.where(there, w, 0.0), there) for weights, w, there in each]

    def _nodes(self, z: FloatArray) -> list[FloatArray]:
        """Return the initial states of the windows of each piece at a search vector."""
        rows, step = zip(self.shots, self.nodes, self.follow, strict=True), z - self.center
        found = [shots.perturbed(nodes, (follow @ step).T) for shots, nodes, follow in rows]
        if not self.strict or not (z - self.center).any():
            return found
        out = []
        linear = self._shooting.linearize(Iterate(z, tuple(found), 0.0, 0.0))
        for shots, nodes, windows in zip(self.shots, found, linear, strict=True):
            left = reduced(self._shooting.weigh(windows), 0.0)
            moves = left.moves(np.zeros(len(shots.entries))).T if left.nodes else None
            out.append(nodes if moves is None else shots.perturbed(nodes, moves))
        return out


@dataclass(frozen=True, eq=False)
class ShootingEstimate(Estimate):
    """Estimate by windows with states of their own."""

    refits: ClassVar = LinearizedNodes
    #: with the final weights, late readings moved ahead
    shooting: ShootingProblem
    #: search vector and states at the optimum
    optimum: Iterate

    def own_state(self) -> dict[str, Any]:
        """Return windows, their states, and the readings and weights that they are fitted to."""
        shooting, at = self.shooting, self.optimum
        out: dict[str, Any] = {
            "scales": shooting.scales,
            "strictness": np.array(shooting.strictness),
            "iterate": np.array([at.cost, at.gap]),
            "shooting.covariance": shooting.problem.weights.covariance,
            "shooting.root": shooting.problem.weights.root,
        }
        rows = zip(shooting.problem.pieces, shooting.shots, at.nodes, strict=True)
        for i, (piece, shots, nodes) in enumerate(rows):
            out |= {f"edges.{i}": np.array(shots.edges), f"nodes.{i}": nodes, f"aligned.{i}": piece.measured}
            out |= {f"{name}.{i}": np.array(getattr(piece, name)) for name in PIECE_TUPLES}
        return out

    @classmethod
    def own_fields(cls, problem: Misfit, z: FloatArray, arrays: Mapping[str, Any]) -> dict[str, Any]:
        """Return windows and states."""
        pieces = tuple(
            replace(
                piece,
                measured=arrays[f"aligned.{i}"],
                moved=tuple(arrays[f"moved.{i}"].tolist()),
                relative_noise=tuple(arrays[f"relative_noise.{i}"].tolist()),
            )
            for i, piece in enumerate(problem.pieces)
        )
        weights = Weights(arrays["shooting.covariance"], arrays["shooting.root"])
        aligned = replace(problem, pieces=pieces, weights=weights)
        each = range(len(pieces))
        shots = tuple(Shots(aligned, i, tuple(arrays[f"edges.{i}"].tolist())) for i in each)
        shooting = ShootingProblem(aligned, shots, arrays["scales"], float(arrays["strictness"]))
        cost, gap = arrays["iterate"].tolist()
        nodes = tuple(arrays[f"nodes.{i}"] for i in each)
        return {"shooting": shooting, "optimum": Iterate(z, nodes, cost, gap)}

    @property
    def weighted_problem(self) -> Misfit:
        """The problem of the windows."""
        return self.shooting.problem

    @cached_property
    def evidence(self) -> Evidence:
        """Residuals and sensitivities of the windows, their initial states unknown."""
        return self.shooting.evidence(self.optimum)

    @cached_property
    def refit_problem(self) -> LinearizedNodes:
        """Readings and gaps of the windows as functions of the search vector."""
        return LinearizedNodes.of(self.shooting, self.optimum)

    @cached_property
    def readings(self) -> tuple[FloatArray, ...]:
        """Readings (n, n_y) of the windows of each piece."""
        return tuple(map(as_recorded, self.shooting.problem.pieces, self.shooting.simulated(self.optimum)))

    @cached_property
    def measurement_noise(self) -> FloatArray:
        """Covariance (n_y, n_y) of the residuals; NaN for a channel that was never measured."""
        return noise_covariance(self.shooting.problem, self.shooting.residuals(self.optimum))

    def reading_slopes(self, index: int) -> FloatArray:
        """Return the derivatives (n, n_y, k) of the readings of a piece, NaN where nothing was measured."""
        own, weights = self.evidence.pieces[index], self.shooting.problem.piece_weights[index]
        columns = [weights.colored(one, own.present) for one in np.moveaxis(own.jacobian, 2, 0)]
        return np.where(own.present[:, :, None], np.stack(columns, axis=2), np.nan)


@dataclass(frozen=True)
class MultipleShooting(Fitter[ShootingEstimate]):
    """Multiple shooting in windows of a length, s."""

    length: float = WINDOW_LENGTH

    def search(
        self, problem: Misfit, prepared: Prepared, options: Options, callback: Callback, state: State
    ) -> ShootingEstimate:
        """Fit windows by Gauss-Newton, after a global search where no start is near enough."""
        shifted, model = aligned(problem, problem.layout.start), window_model(problem.layout.vehicle)
        if options.covariance is None:
            shifted = shifted.weighted(Weights.of(first_variance(shifted)))
        shooting, guesses = ShootingProblem.of(shifted, self.length), starts(shifted, options.start)
        price = float(problem.dimension + problem.extra + 2)
        stages = Stages("gauss-newton", price, options.generations, options.budget, callback, state)
        padded, start = list(np.pad(guesses, [(0, 0), (0, problem.extra)])), None

        def global_search(budget: float) -> optimize.Outcome:
            """Return the outcome of a global search, with the vector of the whole problem."""
            limited, shown = replace(options, budget=budget), iterates.shown(windowed, stages.started)
            found = limited.minimized(windowed, guesses, 0.0, shown, stages.start)
            stages.start = found.state
            d, extra = problem.dimension, problem.extra - windowed.extra
            return replace(found, z=np.concatenate([found.z[:d], np.zeros(extra), found.z[d:]]))

        if model.global_start:  # where no start explains more than constant readings do
            windowed = windowed_problem(shooting)
            poor = POOR * windowed.reference(0)
            begun = state is not None and not isinstance(state, StagesState)
            if begun or not float(np.min(windowed.costs(guesses, 0))) < poor:
                start = global_search(options.budget)
        cut = start is not None and start.status == "interrupted"
        found = refined(shooting, padded if start is None else [start.z], options, stages, cut)
        if start is None and found.status == "stalled" and model.global_start:
            start = global_search(min(SECOND_BUDGET, options.budget - stages.spent[1]))
            again = refined(shooting, [start.z], options, stages, start.status == "interrupted")
            if again.status in ("converged", "interrupted"):
                found = again if again.status == "converged" else replace(found, status="interrupted")
        return self._estimate(problem, prepared, found, start, stages.state)

    def _estimate(
        self,
        problem: Misfit,
        prepared: Prepared,
        found: Refined,
        start: optimize.Outcome | None,
        state: State,
    ) -> ShootingEstimate:
        at, status, windowed = found.at, found.status, found.problem
        many = float(found.iterations * (problem.dimension + problem.extra + 2))
        code = window_model(problem.layout.vehicle).notice
        notices = [notice(code, length=self.length, gap=max(at.gap, 1e-15))]
        advice = ADVICE[status]
        if advice and windowed.strictness > 1.0:  # where windows are to meet
            advice = f"{advice}; {windowed.worst_gap(at)}"
        history, optimizer = np.empty((0, 2)), "gauss-newton"
        if start is not None:
            searched, optimizer = start.trajectories, start.optimizer
            many, history = searched + many, start.history
            notices.append(notice("global-start", optimizer=optimizer, trajectories=searched))
        taken: tuple[DecisionRecord, ...] = ()
        if found.noise is not None:
            of_noise, taken = found.noise.findings(problem, [str(w) for w in prepared.windows])
            notices += of_noise
        if not found.noise_converged and status != "interrupted":
            notices.append(notice("noise-not-converged"))
        ended = status, advice, history, state, optimizer
        outcome = optimize.Outcome(at.z, at.cost, many, found.iterations, *ended)
        common = (problem, prepared, at.z, outcome, at.cost, many, tuple(notices))
        return ShootingEstimate(*common, windowed, at, decisions=taken)


fit = MultipleShooting()
