"""The methods ``filter-error`` and ``filter-error-ekf``: start, ascent, and what the estimates rest on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
from threadpoolctl import threadpool_limits

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.estimate.filter_error.frozen import FrozenFilter
from stoop.estimate.filter_error.gains import Gain, Steady, Varying
from stoop.estimate.filter_error.likelihood import Likelihood
from stoop.estimate.filter_error.noise import Noise, first_guess
from stoop.estimate.filter_error.scoring import ITERATIONS, Ascent, Slope, ascend, slope
from stoop.estimate.fit import Fit, Options, pose, starts
from stoop.flight import Flight
from stoop.optimize.minimize import Status
from stoop.problem import Layout, Misfit, Nuisance
from stoop.problem.evidence import Evidence, PieceEvidence, Unknown, unknowns_of
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.simulate.delays import output_delays
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import GUST_STATES

DEFAULTS: Final = Options()
DISAGREED: Final = "From the file's values and from the regression ascents ended at different likelihoods; the better counts."
SHARES: Final = {
    "u": (1.0,),
    "v": (0.5**0.5, 0.5),
    "w": (0.5**0.5, 0.5),
}  #: of the intensity in each gust state
FIRST: Final = 1e-2  #: of -ln L that the first ascents leave; those that follow leave less
AGREE: Final = 0.1  #: of -ln L: two ascents that end so near each other found the same
ROUNDS: Final = 3  #: of linearization along the states that the filter finds
SETTLED: Final = 0.05  #: change of -ln L by another linearization that needs no further round
ADVICE: Final = {
    "converged": "",
    "generations": f"no maximum of the likelihood after {ITERATIONS} steps; begin nearer, fix what the data cannot tell",
    "interrupted": "stopped by the user",
}


@dataclass(frozen=True)
class FilterError:
    """Filter error with one kind of gain.

    Attributes
    ----------
    name : str
    gain : Gain
    """

    name: str
    gain: Gain

    def __call__(
        self,
        vehicle: Vehicle,
        flights: Mapping[str, Flight],
        windows: Sequence[Window],
        options: Options = DEFAULTS,
        callback: Callable[[Any], None] | None = None,
        state: Any = None,
    ) -> Fit:
        """Maximize the likelihood of the innovations, see :mod:`stoop.estimate.methods`."""
        with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
            return self._fit(vehicle, flights, windows, options)

    def _fit(
        self, vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window], options: Options
    ) -> Fit:
        problem, prepared = pose(vehicle, flights, windows, options)
        _check(problem)
        problem = with_gusts(problem)
        noise = Noise(vehicle, first_guess(vehicle, problem.pieces), _given(options))
        firsts = _first(problem, noise)
        ascents = [_ascent(Likelihood.of(problem, noise, self.gain, z), z) for z in firsts]
        likelihood, best, agreed = _settled(ascents)
        if not np.isfinite(best.cost):
            raise IdentificationError(
                f"{vehicle.where}: the filter diverges from every start; check values, bounds and units, or shorten the maneuver"
            )
        return _fit(self.name, problem, prepared, likelihood, best, agreed, len(ascents))


def _check(problem: Misfit) -> None:
    vehicle = problem.layout.vehicle
    late = {vehicle.parameters[row].name for _, row in output_delays(vehicle)}
    for p in problem.layout.parameters:
        if p.name in late:
            raise IdentificationError(
                f"{vehicle.where}: {p.name}: a filter takes readings as late as they are known to be; use --fix {p.name}"
            )


def _given(options: Options) -> FloatArray | None:
    given = options.covariance
    return None if given is None else np.diag(given) if given.ndim == 2 else given


def with_gusts(problem: Misfit) -> Misfit:
    """Return the problem with the gusts at the beginning of each piece among the nuisances."""
    vehicle = problem.layout.vehicle
    more = [
        Nuisance(name, piece.maneuver, i, 0.0, share * vehicle.value(f"turbulence.{axis}.intensity"))
        for i, piece in enumerate(problem.pieces)
        for axis in vehicle.gusts
        for name, share in zip(GUST_STATES[axis], SHARES[axis], strict=True)
    ]
    own = problem.layout.nuisances
    states, biases = [n for n in own if not n.is_bias], [n for n in own if n.is_bias]
    return replace(problem, layout=Layout(vehicle, problem.layout.parameters, (*states, *more, *biases)))


def _first(problem: Misfit, noise: Noise) -> list[FloatArray]:
    """Return where to begin: the file's own values, and the regression of accelerations where there is one."""
    rest = np.concatenate([np.zeros(problem.extra), noise.start])
    return [np.concatenate([x, rest]) for x in starts(problem)]


Climbed = tuple[Likelihood, Ascent]


def _ascent(likelihood: Likelihood, z: FloatArray) -> Climbed:
    """Climb from z, then once more with gains that suit where that led."""
    first = ascend(likelihood, z, FIRST)
    if first.interrupted or not np.isfinite(first.cost):
        return likelihood, first
    likelihood = likelihood.along(first.z)
    return likelihood, ascend(likelihood, first.z, FIRST)


def _settled(ascents: Sequence[Climbed]) -> tuple[Likelihood, Ascent, bool]:
    """Return the best ascent, its anchor where it ended, and whether another one came to the same."""
    order = sorted(ascents, key=lambda a: a[1].cost)
    likelihood, best = order[0]
    agreed = len(order) > 1 and 0.5 * (order[1][1].cost - best.cost) < AGREE
    for _ in range(ROUNDS):
        if best.interrupted or not np.isfinite(best.cost):
            break
        likelihood = likelihood.along(best.z)
        before, best = best.cost, ascend(likelihood, best.z)
        if 0.5 * abs(before - best.cost) < SETTLED:
            break
    return likelihood, best, agreed


def _fit(
    name: str,
    problem: Misfit,
    prepared: Prepared,
    likelihood: Likelihood,
    best: Ascent,
    agreed: bool,
    many: int,
) -> Fit:
    status: Status = "interrupted" if best.interrupted else "converged" if best.converged else "generations"
    known = likelihood.size - likelihood.noise.size
    at, tail = slope(likelihood, best.z), best.z[known:]
    runs = float(best.iterations * (likelihood.size + 2) * many)
    outcome = optimize.Outcome(
        best.z[:known],
        best.cost,
        runs,
        best.iterations,
        status,
        ADVICE[status],
        best.history,
        None,
        "scoring",
    )
    warnings = prepared.warnings
    if many > 1 and not agreed:
        warnings += (DISAGREED,)
    noise = np.diag(likelihood.noise.variances(tail[None, :])[0])
    noise[~np.isfinite(noise)] = np.nan
    return Fit(
        problem,
        prepared,
        best.z[:known],
        outcome,
        best.cost,
        runs,
        warnings,
        statements=_statements(likelihood, tail, at),
        noise=np.where(np.eye(len(noise)) > 0.0, noise, 0.0),
        own_evidence=_evidence(likelihood, best.z, at),
        local_problem=partial(FrozenFilter.of, likelihood, best.z),
    )


def _evidence(likelihood: Likelihood, z: FloatArray, at: Slope) -> Evidence:
    """Return innovations and sensitivities per SI unit (of logarithms, for the noise)."""
    noise, layout = likelihood.noise, likelihood.problem.layout
    scales = np.concatenate([layout.scales, np.ones(noise.size)])
    pieces, prior = [], likelihood.prior(z)[1]
    for piece, found in zip(likelihood.problem.pieces, at.pieces, strict=True):
        jacobian = np.zeros((*found.white.shape, likelihood.size))
        jacobian[:, :, found.entries] = -found.slopes
        residual = np.where(np.isfinite(piece.measured), found.white, np.nan)
        pieces.append(PieceEvidence(residual, jacobian / scales))
        prior[np.ix_(found.entries, found.entries)] += found.spread_information
    known = likelihood.size - noise.size
    intensities = [Unknown(f"noise {i}", "noise", float(x), 1.0) for i, x in enumerate(z[known:])]
    unknowns = (*unknowns_of(layout, z[:known]), *intensities)
    return Evidence(unknowns, tuple(pieces), prior / np.outer(scales, scales))


def _statements(likelihood: Likelihood, tail: FloatArray, at: Slope) -> tuple[str, ...]:
    """Say what the figures rest on."""
    lag = [float(np.mean(p.white[1:] * p.white[:-1]) / np.mean(p.white**2)) for p in at.pieces]
    said = [
        "Estimates are those of a filter that corrects the model as it flies (filter error); curves and figures are those "
        "of the model alone, from its initial state on, so that what gusts did to the flight shows in them as misfit.",
        f"Innovations of neighboring samples correlate by {np.mean(lag):.2f} (0: nothing is left to explain).",
    ]
    found = likelihood.noise.describe(tail)
    if found:
        listed = ", ".join(f"{s} {value:.3g}" for s, value in found.items())
        said.append(f"Process noise per root second, estimated: {listed} (m/s, rad/s).")
    return tuple(said)


steady = FilterError("filter-error", Steady())
varying = FilterError("filter-error-ekf", Varying())
