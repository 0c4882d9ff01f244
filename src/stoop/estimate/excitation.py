"""Whether the fitted windows excite the aircraft: controls that hardly move, move together, or follow its motion.

A control that a loop moves follows the motion, and what multiplies it cannot be told from what multiplies the
motion. Pairs correlated above 0.9 are the field's usual warning; combinations are told by the multiple correlation.

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
from stoop.base.units import DEGREE
from stoop.estimate.rotors_seen import rotor_warnings
from stoop.problem import Misfit
from stoop.simulate import parameter_rows
from stoop.simulate.initial import commanded
from stoop.vehicle.schema import WIND
from stoop.vehicle.vehicle import WIND_NUMBERS

AXES: Final = (("V", "alpha", "q"), ("beta", "p", "r"))  #: motions that the terms of one plane multiply
STILL: Final = 0.2 * DEGREE  #: rad rms of a deflection, below which it is no input
TOGETHER: Final = 0.9  #: correlation of two
COMBINED: Final = 0.98  #: multiple correlation of a control with everything else in its plane
HOVERING: Final = 0.5  #: of the reference airspeed, below which wings carry a quarter at most
FEW: Final = 5.0  #: measurements per unknown below which a fit is next to interpolation


def excitation_warnings(problem: Misfit, z: FloatArray, recorded_rate: float = np.inf) -> list[str]:
    """Return in words what the fitted windows cannot tell, whatever is fitted.

    Parameters
    ----------
    problem : Misfit
    z : (D + E,), the estimate, whose motion stands for the measured one: it has no noise and no holes
    recorded_rate : Hz, at which the slowest of the compared channels was logged
    """
    if problem.layout.vehicle.hovers:
        return [*_few(problem, recorded_rate), *rotor_warnings(problem), *_slow(problem, z)]
    if not problem.layout.vehicle.controls:
        return []
    deflections, motions = _signals(problem, z)
    still = [name for name, x in deflections.items() if _rms(x) < STILL]
    moving = {name: x for name, x in deflections.items() if name not in still}
    lines = [
        f"{name} hardly moves in the fitted windows ({_rms(deflections[name]) / DEGREE:.2f} deg rms): what multiplies it, "
        "and the damping of its axis, cannot be told; fit a window in which it is moved."
        for name in still
    ]
    return [*_few(problem, recorded_rate), *lines, *collinear(moving, motions)]


def _slow(problem: Misfit, z: FloatArray) -> list[str]:
    """Tell that wings hardly carry in the fitted windows, where numbers of theirs are free."""
    vehicle = problem.layout.vehicle
    terms = {name for group in vehicle.terms.values() for name in group}
    free = sum(p.name in terms for p in problem.layout.parameters)
    fast = max(_fastest(problem, z, i) for i in range(len(problem.pieces)))
    if not free or not fast < HOVERING * vehicle.value("reference.airspeed"):
        return []
    at = vehicle.value("reference.airspeed")
    return [
        f"The fitted windows are flown at up to {fast:.1f} m/s through the air, where wings feel {(fast / at) ** 2:.0%} of the "
        f"pressure at reference.airspeed ({at:g} m/s): a hover tells little of aerodynamic coefficients, {free} of which are "
        "free. Hold them (--fix NAME, or free = false in the file), or fit windows of forward flight, too."
    ]


def _fastest(problem: Misfit, z: FloatArray, index: int) -> float:
    """Return the speed through the air that a piece stays below in 99 % of its time, m/s; the wind is the estimate's."""
    vehicle, piece = problem.layout.vehicle, problem.pieces[index]
    rows, _ = problem.candidates(z[None, :], index)
    wind = [float(rows[vehicle.rows[name], 0]) for name in WIND_NUMBERS]
    velocity = piece.measured[:, [vehicle.outputs.index(name) for name in WIND]] - wind
    seen = np.isfinite(velocity).all(axis=1)
    return float(np.quantile(np.linalg.norm(velocity[seen], axis=1), 0.99)) if seen.any() else np.inf


def _signals(problem: Misfit, z: FloatArray) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return deflections and motions (n,) over all pieces, each less its mean within the piece."""
    vehicle = problem.layout.vehicle
    controls: dict[str, list[FloatArray]] = {name: [] for name in vehicle.controls}
    motions: dict[str, list[FloatArray]] = {name: [] for name in vehicle.outputs}
    for i, piece in enumerate(problem.pieces):
        rows = np.repeat(parameter_rows(vehicle, piece.changes), len(piece.time), axis=1)
        for name in controls:
            controls[name].append(_centered(commanded(vehicle, name, rows, piece.inputs.T)))
        for name, column in zip(vehicle.outputs, problem.outputs(z, i).T, strict=True):
            motions[name].append(_centered(column))
    return _joined(controls), _joined(motions)


def _centered(x: FloatArray) -> FloatArray:
    return np.asarray(x - np.mean(x))


def _joined(parts: Mapping[str, list[FloatArray]]) -> dict[str, FloatArray]:
    return {name: np.concatenate(x) for name, x in parts.items()}


def _rms(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def too_few(problem: Misfit, recorded_rate: float) -> bool:
    """Whether there is hardly more to fit to than there is to fit: no error bar holds then."""
    measured, unknown = _counts(problem, recorded_rate)
    return measured < FEW * unknown


def _few(problem: Misfit, recorded_rate: float) -> Iterator[str]:
    """Tell when there is hardly more to fit to than there is to fit."""
    measured, unknown = _counts(problem, recorded_rate)
    if too_few(problem, recorded_rate):
        yield (
            f"Too few samples: {measured:.0f} measurements for {unknown} unknowns (initial states and biases counted), so no "
            "error bar holds; fit longer or more windows, or fix what is known."
        )


def _counts(problem: Misfit, recorded_rate: float) -> tuple[float, int]:
    """Return how many measurements and unknowns there are; what was interpolated does not count."""
    measured = 0.0
    for piece in problem.pieces:
        share = min(1.0, recorded_rate * piece.dt)
        measured += share * float(np.isfinite(piece.measured).sum())
    return measured, problem.dimension + problem.extra


def collinear(controls: Mapping[str, FloatArray], motions: Mapping[str, FloatArray]) -> Iterator[str]:
    """Tell, by names, which controls move with each other or with the motion.

    Parameters
    ----------
    controls : mapping
        Control -> deflection (n,), rad, less its mean.
    motions : mapping
        Channel of the vehicle's outputs -> (n,), SI, less its mean.
    """
    for a, b in combinations(controls, 2):
        alike = _correlation(controls[a], controls[b])
        if abs(alike) > TOGETHER:
            yield (
                f"{a} and {b} move together (correlation {alike:.2f}): what multiplies one is hard to tell from what "
                "multiplies the other; move them one after the other."
            )
    for control, x in controls.items():
        told = False
        for name in (n for axis in AXES for n in axis if n in motions):
            alike = _correlation(x, motions[name])
            if abs(alike) > TOGETHER:
                told = True
                yield (
                    f"{control} and {name} move together (correlation {alike:.2f}), as in a closed loop: what multiplies "
                    f"{control} is hard to tell from what multiplies {name}; excite with the loop open, or with inputs "
                    "that the loop does not make."
                )
        if not told:
            yield from _combined(control, x, [b for n, b in controls.items() if n != control], motions)


def _combined(
    control: str, x: FloatArray, others: Sequence[FloatArray], motions: Mapping[str, FloatArray]
) -> Iterator[str]:
    """Tell when a control is what the other controls and the motions of one plane make together."""
    for axis in AXES:
        there = [name for name in axis if name in motions and _rms(motions[name]) > 0.0]
        regressors = (
            np.column_stack([*(motions[name] for name in there), *others]) if there else np.empty((0, 0))
        )
        if regressors.size and _multiple(x, regressors) > COMBINED:
            yield (
                f"{control} is nearly a combination of {', '.join(there)} and the other controls (multiple correlation "
                f"{_multiple(x, regressors):.3f}), as feedback makes it: their coefficients are hard to tell apart."
            )


def _multiple(x: FloatArray, regressors: FloatArray) -> float:
    left = x - regressors @ np.linalg.lstsq(regressors, x, rcond=None)[0]
    return float(np.sqrt(max(0.0, 1.0 - float(left @ left) / float(x @ x))))


def _correlation(a: FloatArray, b: FloatArray) -> float:
    power = float(a @ a) * float(b @ b)
    return float(a @ b) / float(np.sqrt(power)) if power > 0.0 else 0.0
