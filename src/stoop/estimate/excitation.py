"""Whether the fitted windows excite the vehicle: controls that hardly move, move together, or follow its motion.

A control that a loop moves follows the motion, and what multiplies it cannot be told from what multiplies the
motion. Pairs correlated above 0.9 are the field's usual warning; combinations show in the multiple correlation.

References
----------
Klein and Morelli, "Aircraft System Identification", 2nd ed., section 5.1.5 (data collinearity).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.units import DEGREE
from stoop.checks.rotor_windows import rotor_notices
from stoop.problem import Misfit
from stoop.simulation import parameter_rows
from stoop.simulation.initial import commanded
from stoop.vehicle.defaults import WIND_NUMBERS
from stoop.vehicle.schema import WIND

AXES: Final = (("V", "alpha", "q"), ("beta", "p", "r"))  #: motions that the terms of one plane multiply
MIN_DEFLECTION: Final = 0.2 * DEGREE  #: rad rms, below which a deflection is no input
CORRELATION_LIMIT: Final = 0.9  #: of two signals
MULTIPLE_LIMIT: Final = 0.98  #: multiple correlation of a control with everything else in its plane
LOW_AIRSPEED: Final = 0.5  #: of the reference airspeed, below which wings carry a quarter at most
MIN_RATIO: Final = 5.0  #: measurements per unknown below which a fit is next to interpolation


def excitation_notices(problem: Misfit, z: FloatArray, recorded_rate: float = np.inf) -> list[Notice]:
    """Return what the fitted windows cannot tell, whatever is fitted.

    Parameters
    ----------
    problem : Misfit
    z : (D + E,), the estimate, whose motion stands for the measured one: it has no noise and no holes
    recorded_rate : Hz, at which the slowest of the compared channels was logged
    """
    vehicle = problem.layout.vehicle
    measured, unknowns = _counts(problem, recorded_rate)
    few = [notice("too-few-samples", measurements=measured, unknowns=unknowns)]
    out = few if too_few(problem, recorded_rate) else []
    if vehicle.rotors:
        return [*out, *rotor_notices(problem), *_low_airspeed(problem, z)]
    if not vehicle.controls:
        return []
    deflections, motions = _signals(problem, z)
    for name, x in list(deflections.items()):
        if _rms(x) < MIN_DEFLECTION:
            out.append(notice("control-still", name, rms=_rms(deflections.pop(name))))
    return [*out, *collinear(deflections, motions)]


def _low_airspeed(problem: Misfit, z: FloatArray) -> Iterator[Notice]:
    """Yield that wings hardly carry in the fitted windows, where aerodynamic coefficients are free."""
    vehicle = problem.layout.vehicle
    terms = {name for group in vehicle.terms.values() for name in group}
    free = sum(p.name in terms for p in problem.layout.parameters)
    if not free:
        return
    fastest, columns = 0.0, [vehicle.outputs.index(name) for name in WIND]
    for i, piece in enumerate(problem.pieces):
        rows, _ = problem.candidates(z[None, :], i)
        velocity = piece.measured[:, columns] - [float(rows[vehicle.rows[n], 0]) for n in WIND_NUMBERS]
        speed = np.linalg.norm(velocity[np.isfinite(velocity).all(axis=1)], axis=1)
        fastest = max(fastest, float(np.quantile(speed, 0.99)) if speed.size else np.inf)
    reference = vehicle.value("reference.airspeed")
    if fastest < LOW_AIRSPEED * reference:
        share = (fastest / reference) ** 2
        yield notice("low-airspeed", airspeed=fastest, share=share, reference=reference, free=free)


def _signals(problem: Misfit, z: FloatArray) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return deflections and motions (n,) over all pieces, each less its mean within the piece."""
    vehicle = problem.layout.vehicle
    controls: dict[str, list[FloatArray]] = {name: [] for name in vehicle.controls}
    motions: dict[str, list[FloatArray]] = {name: [] for name in vehicle.outputs}
    for i, piece in enumerate(problem.pieces):
        rows = np.repeat(parameter_rows(vehicle, piece.changes), len(piece.time), axis=1)
        for name, parts in controls.items():
            x = commanded(vehicle, name, rows, piece.inputs.T)
            parts.append(np.asarray(x - np.mean(x)))
        for name, column in zip(vehicle.outputs, problem.outputs(z, i).T, strict=True):
            motions[name].append(np.asarray(column - np.mean(column)))
    joined = [{name: np.concatenate(x) for name, x in parts.items()} for parts in (controls, motions)]
    return joined[0], joined[1]


def _rms(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def too_few(problem: Misfit, recorded_rate: float) -> bool:
    """Whether there is hardly more to fit to than there is to fit: no error bar holds then."""
    measured, unknowns = _counts(problem, recorded_rate)
    return measured < MIN_RATIO * unknowns


def _counts(problem: Misfit, recorded_rate: float) -> tuple[float, int]:
    """Return how many measurements and unknowns there are; what was interpolated does not count."""
    measured = 0.0
    for piece in problem.pieces:
        measured += min(1.0, recorded_rate * piece.dt) * float(np.isfinite(piece.measured).sum())
    return measured, problem.dimension + problem.extra


def collinear(controls: Mapping[str, FloatArray], motions: Mapping[str, FloatArray]) -> Iterator[Notice]:
    """Yield which controls move with each other or with the motion.

    Parameters
    ----------
    controls : mapping
        Control -> deflection (n,), rad, less its mean.
    motions : mapping
        Channel of the vehicle's outputs -> (n,), SI, less its mean.
    """
    for a, b in combinations(controls, 2):
        r = _correlation(controls[a], controls[b])
        if abs(r) > CORRELATION_LIMIT:
            yield notice("controls-correlated", a, other=b, correlation=r)
    for control, x in controls.items():
        pairs = {n: _correlation(x, motions[n]) for axis in AXES for n in axis if n in motions}
        alike = {n: r for n, r in pairs.items() if abs(r) > CORRELATION_LIMIT}
        for name, r in alike.items():
            yield notice("control-follows-motion", control, other=name, correlation=r)
        if not alike:
            others = [b for n, b in controls.items() if n != control]
            yield from _combined(control, x, others, motions)


def _combined(
    control: str, x: FloatArray, others: Sequence[FloatArray], motions: Mapping[str, FloatArray]
) -> Iterator[Notice]:
    """Yield when a control is a combination of the other controls and the motions of one plane."""
    for axis in AXES:
        moving = tuple(name for name in axis if name in motions and _rms(motions[name]) > 0.0)
        if not moving:
            continue
        regressors = np.column_stack([*(motions[name] for name in moving), *others])
        left = x - regressors @ np.linalg.lstsq(regressors, x, rcond=None)[0]
        multiple = float(np.sqrt(max(0.0, 1.0 - float(left @ left) / float(x @ x))))
        if multiple > MULTIPLE_LIMIT:
            yield notice("control-combination", control, motions=moving, correlation=multiple)


def _correlation(a: FloatArray, b: FloatArray) -> float:
    power = float(a @ a) * float(b @ b)
    return float(a @ b) / float(np.sqrt(power)) if power > 0.0 else 0.0
