"""What the fitted windows cannot determine: controls that do not move or move together, and forces without a known mass.

A control that a loop moves follows the motion, and what multiplies it cannot be separated from what multiplies the
motion. Pairs correlated above 0.9 are the field's usual warning; combinations show in the multiple correlation.

A flight with rotors shows accelerations. Where neither mass nor inertia nor any force is known beforehand, all of them may be
multiplied by one number and nothing that was measured changes. The mass is then fixed at the file's value, and what stands
beside it is a ratio.

References
----------
Klein and Morelli, "Aircraft System Identification", 2nd ed., section 5.1.5 (data collinearity).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.checks.rotors import rotor_notices
from stoop.problem import Misfit
from stoop.vehicle import Parameter, Vehicle
from stoop.vehicle.channels import AIR_FRAME, GROUND_FRAME
from stoop.vehicle.defaults import ROTOR_AERODYNAMICS, WIND_NUMBERS
from stoop.vehicle.schema import WIND

AXES: Final = (("V", "alpha", "q"), ("beta", "p", "r"))  #: motions that the terms of one plane multiply
CONSTANT: Final = 1e-6  #: rad rms, below which a deflection is constant but for rounding
CORRELATION_LIMIT: Final = 0.9  #: of two signals
MULTIPLE_LIMIT: Final = 0.98  #: multiple correlation of a control with everything else in its plane
LOW_AIRSPEED: Final = 0.5  #: of the reference airspeed, below which wings carry a quarter at most
MIN_RATIO: Final = 5.0  #: measurements per unknown below which a fit is next to interpolation
MASS: Final = "mass.mass"


def excitation_notices(problem: Misfit, z: FloatArray) -> list[Notice]:
    """Return notices of what the fitted windows cannot determine.

    The motion of the estimate z (D + E,) stands for the measured one: it has no noise and no holes.
    """
    vehicle = problem.layout.vehicle
    return [*too_few(problem), *(found for of in _OF_KIND[vehicle.frame] for found in of(problem, z))]


def _of_controls(problem: Misfit, z: FloatArray) -> Iterator[Notice]:
    """Yield which controls do not move, and which move with each other or with the motion."""
    simulated = [problem.outputs(z, i) for i in range(len(problem.pieces))]
    whole = np.concatenate([y - y.mean(axis=0) for y in simulated])
    motions, moving = dict(zip(problem.layout.vehicle.outputs, whole.T, strict=True)), dict[str, FloatArray]()
    for name, x in deflections(problem).items():
        if np.sqrt(np.mean(x**2)) < CONSTANT:
            yield notice("control-still", name)
        else:
            moving[name] = x
    yield from collinear(moving, motions)


def deflections(problem: Misfit) -> dict[str, FloatArray]:
    """Return the deflections (n,) of all controls over all pieces, rad, without the mean of each piece."""
    vehicle, parts = problem.layout.vehicle, []
    for piece in problem.pieces:
        rows = np.repeat(vehicle.parameter_rows(piece.changes), len(piece.time), axis=1)
        signals = [vehicle.commanded(name, rows, piece.inputs.T) for name in vehicle.controls]
        parts.append([x - np.mean(x) for x in signals])
    return dict(zip(vehicle.controls, map(np.concatenate, zip(*parts, strict=True)), strict=False))


def _low_airspeed(problem: Misfit, z: FloatArray) -> Iterator[Notice]:
    """Yield that wings hardly carry in the fitted windows, where aerodynamic coefficients are free."""
    vehicle = problem.layout.vehicle
    terms = {name for group in vehicle.terms.values() for name in group}
    free = sum(p.name in terms for p in problem.layout.parameters)
    fastest, columns = 0.0, [vehicle.outputs.index(name) for name in WIND]
    for i, piece in enumerate(problem.pieces if free else ()):
        rows, _ = problem.candidates(z[None, :], i)
        velocity = piece.whole[:, columns] - [float(rows[vehicle.rows[n], 0]) for n in WIND_NUMBERS]
        speed = np.linalg.norm(velocity[np.isfinite(velocity).all(axis=1)], axis=1)
        fastest = max(fastest, float(np.quantile(speed, 0.99)) if speed.size else np.inf)
    reference = vehicle.value("reference.airspeed") if free else 0.0
    if fastest < LOW_AIRSPEED * reference:
        share = (fastest / reference) ** 2
        yield notice("low-airspeed", airspeed=fastest, share=share, reference=reference, free=free)


_OF_KIND: Final = {
    AIR_FRAME: (_of_controls,),
    GROUND_FRAME: (lambda problem, _: rotor_notices(problem), _low_airspeed),
}


def too_few(problem: Misfit) -> list[Notice]:
    """Return that too few samples were measured for any error bar to hold."""
    measured = sum(int(np.isfinite(p.measured).sum()) for p in problem.pieces)
    unknowns = problem.dimension + problem.extra
    few = notice("too-few-samples", measurements=measured, unknowns=unknowns)
    return [few] if measured < MIN_RATIO * unknowns else []


def collinear(controls: Mapping[str, FloatArray], motions: Mapping[str, FloatArray]) -> Iterator[Notice]:
    """Yield which controls move with each other or with the motion.

    Deflections (n,) of controls, rad, and channels (n,) of the vehicle's outputs, SI, have no mean.
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
        for axis in () if alike else AXES:  # a combination of the other controls and the motions of one plane
            moving = tuple(name for name in axis if name in motions and motions[name] @ motions[name] > 0.0)
            others = [b for name, b in controls.items() if name != control]
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


def in_ratio(vehicle: Vehicle) -> tuple[Parameter, ...]:
    """Return the free numbers that are known in ratio to the mass only; none where something determines the mass."""
    if vehicle.file.propulsion is not None or any(vehicle.terms.values()):
        return ()
    forces = ROTOR_AERODYNAMICS - {"rotors.torque_ratio"} | {"rotors.inertia"}
    prefixes = ("body_drag.", "mass.inertia.")
    group = [p for p in vehicle.parameters if p.name in forces or p.name.startswith(prefixes)]
    known = any(p.value != 0.0 and (not p.free or p.prior is not None) for p in group)
    mass = vehicle.parameters[vehicle.rows[MASS]]
    if known or (mass.free and mass.prior is not None):
        return ()
    return tuple(p for p in group if p.free)


def with_mass_held(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with its mass fixed where it could be anything."""
    free = vehicle.parameters[vehicle.rows[MASS]].free and in_ratio(vehicle)
    return vehicle.with_numbers({MASS: {"free": False}}) if free else vehicle


def ratios(vehicle: Vehicle, estimates: dict[str, tuple[float, float]]) -> str:
    """Return in words the numbers per kg of mass for estimates and standard errors, SI; empty where the mass matters."""
    named = [p for p in in_ratio(vehicle) if p.name in estimates]
    if not named:
        return ""
    mass = vehicle.value(MASS)
    each = ", ".join(
        f"{p.name} {estimates[p.name][0] / mass:.4g} +/- {estimates[p.name][1] / mass:.2g} {p.unit}/kg"
        for p in named
    )
    return (
        "Only ratios to the mass are determined, for no mass, inertia or force is known beforehand: "
        f"{MASS} was held at {mass:g} kg. Per kg: {each}. "
        "Another mass multiplies all of them; weigh the vehicle and write mass.mass, or give inertia a prior."
    )
