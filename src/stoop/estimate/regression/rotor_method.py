"""The method ``equation-error`` of vehicles with rotors."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.estimate.fit import Fit
from stoop.estimate.noise import variance_of
from stoop.estimate.regression.accelerations import LEAST, MOMENTS, Unknowns, fitted
from stoop.estimate.regression.domain import Time
from stoop.estimate.regression.estimate import boxed
from stoop.estimate.regression.least_squares import Solved
from stoop.estimate.shooting.windows import WINDOW_LENGTH, outputs_by_window
from stoop.optimize.minimize import Status
from stoop.problem import Misfit, on_circle
from stoop.problem.prepare import Prepared

HOW: Final = (
    "Angular accelerations and specific force were measured sample by sample, and the free numbers fitted to them by least "
    "squares on smoothed samples, commands taken through the delay and lag of the rotors. Noise of velocities, angles and "
    "rates in the equations biases the estimates, and the error bars do not know of it; multiple shooting does not have this "
    f"bias. Curves are predictions over windows of {WINDOW_LENGTH:g} s that each begin as measured."
)
EXPLAINED: Final = "Share of each acceleration's motion that the equations explain: {shares}."
LITTLE: Final = (
    "{name} acceleration: the equations explain {share:.0%} of its motion; what rests on it is doubtful"
)
LEFT_OUT: Final = (
    "{names}: the recorded commands explain less than {least:.0%} of the angular acceleration, so it was left out: it would "
    "teach only how noise attenuates. Log the motors as fast as the autopilot commands them to fit moments too."
)
FAIR: Final = 0.5  #: of the motion explained


def of_rotors(problem: Misfit, prepared: Prepared, name: str) -> Fit:
    """Fit all free numbers, and the biases and winds, to measured accelerations.

    Raises
    ------
    IdentificationError
        Nowhere was the motion measured whole.
    """
    layout = problem.layout
    found = fitted(layout, problem.pieces, Time(), boxed(layout.parameters))
    if found is None:
        raise IdentificationError(
            f"{layout.vehicle.where}: no regression is possible: velocity over ground, rates, attitude and accelerations must "
            "be measured together for some seconds; use --method multiple-shooting"
        )
    unknowns, solved = found
    z = _vector(problem, unknowns, solved)
    simulated = _simulated(problem, unknowns, solved)
    outputs = layout.vehicle.outputs
    residuals = [on_circle(p.measured - y, outputs) for p, y in zip(problem.pieces, simulated, strict=True)]
    seen = np.any([np.isfinite(r).any(axis=0) for r in residuals], axis=0)
    status: Status = "converged"
    outcome = optimize.Outcome(z, 0.0, 0.0, 0, status, "", np.empty((0, 2)), None, name)
    covariance, white = (_spread(unknowns, c, len(z)) for c in (solved.covariance, solved.white))
    warnings = [LITTLE.format(name=n, share=max(s, 0.0)) for n, s in solved.r2.items() if s < FAIR]
    left = [n for n in MOMENTS if n not in solved.r2]
    warnings += [LEFT_OUT.format(names=", ".join(left), least=LEAST)] if left else []
    shares = ", ".join(f"{n} {100.0 * s:.1f} %" for n, s in solved.r2.items())
    return Fit(
        problem,
        prepared,
        z,
        outcome,
        0.0,
        0.0,
        (
            *(notice("untyped-fit-note", text=text) for text in (HOW, EXPLAINED.format(shares=shares))),
            *(notice("untyped-warning", text=text) for text in warnings),
        ),
        noise=np.diag(np.where(seen, variance_of(problem, residuals), np.nan)),
        covariance=covariance,
        white=white,
        simulated=tuple(simulated),
    )


def _vector(problem: Misfit, unknowns: Unknowns, solved: Solved) -> FloatArray:
    """Return the search vector; initial states stay as they were guessed."""
    layout, d = problem.layout, problem.dimension
    z = np.zeros(d + problem.extra)
    z[:d] = (solved.values[:d] - layout.lower) / layout.width
    for j, n in enumerate(layout.nuisances):
        if n in unknowns.biases:
            z[d + j] = (solved.values[d + unknowns.biases.index(n)] - n.center) / n.scale
    return z


def _spread(unknowns: Unknowns, covariance: FloatArray, size: int) -> FloatArray:
    """Return the covariance (size, size) of the vector: infinite where no row tells, zero for initial states."""
    d = unknowns.layout.dimension
    own = covariance.copy()
    untold = np.flatnonzero(np.isnan(np.diag(own)))
    own[untold, :] = own[:, untold] = 0.0
    own[untold, untold] = np.inf
    biases = [d + j for j, n in enumerate(unknowns.layout.nuisances) if n in unknowns.biases]
    places = np.array([*range(d), *biases], dtype=np.intp)
    out = np.zeros((size, size))
    out[np.ix_(places, places)] = own
    return out


def _simulated(problem: Misfit, unknowns: Unknowns, solved: Solved) -> list[FloatArray]:
    """Return readings (n, n_y) of each piece, begun anew window by window."""
    layout, d = problem.layout, problem.dimension
    numbers = {p.name: {"value": float(v)} for p, v in zip(layout.parameters, solved.values[:d], strict=True)}
    vehicle = layout.vehicle.with_numbers(numbers)
    pieces = []
    for piece in problem.pieces:
        pairs = zip(unknowns.biases, solved.values[d:], strict=True)
        biases = {n.name: float(v) for n, v in pairs if n.maneuver == piece.maneuver}
        pieces.append(replace(piece, changes={**piece.changes, **biases}))
    held = replace(layout, vehicle=vehicle, parameters=(), nuisances=())
    flown = replace(problem, layout=held, pieces=tuple(pieces))
    return [outputs_by_window(flown, i) for i in range(len(pieces))]
