"""What a compatibility check has to say: which sensors are off, and which channels contradict each other."""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import DEGREE
from stoop.base.variables import VARIABLES
from stoop.reconstruct.equations import OUTPUTS
from stoop.reconstruct.estimate import Estimate, residuals
from stoop.reconstruct.unknowns import Unknown

SURE: Final = 3.0  #: standard errors
EVIDENT: Final = {
    "m/s2": 0.3, "rad/s": 0.01, "rad": 2.0 * DEGREE, "m/s": 1.0, "s": 0.03, "1": 0.05, "m": 0.3,
}  #: by unit: less is what good sensors do  # fmt: skip
ALLOWED: Final = {
    "V": 2.0, "airspeed_pitot": 2.0, "alpha": 3.0 * DEGREE, "beta": 3.0 * DEGREE,
    "phi": 2.0 * DEGREE, "theta": 2.0 * DEGREE, "psi": 4.0 * DEGREE,
    "vn": 0.7, "ve": 0.7, "vd": 0.7, "pn": 2.0, "pe": 2.0, "pd": 2.0,
}  #: rms that gusts and ordinary sensors leave  # fmt: skip
_WITH: Final = {
    **dict.fromkeys(
        ("phi", "theta", "psi"), "attitude and rates are inconsistent: check signs, axes and units of both"
    ),
    **dict.fromkeys(
        ("vn", "ve", "vd"),
        "velocity and accelerations are inconsistent: check frame, signs and units of both",
    ),
    **dict.fromkeys(
        ("pn", "pe", "pd"), "position and velocity are inconsistent: one of them jumps, or the axes differ"
    ),
    **dict.fromkeys(
        ("V", "airspeed_pitot", "alpha", "beta"),
        "air data and inertial data are inconsistent: strong gusts, or a faulty sensor",
    ),
}
NO_CALIBRATION: Final = (
    "as long as channels contradict each other, numbers of single sensors are no calibration, whatever their standard "
    "errors, and the corrected flight is not to be used: mend that first, or choose windows without it"
)
UNRESTED: Final = "the weights of the channels did not come to rest: take the standard errors as approximate"


def unexplained(found: Estimate) -> dict[str, tuple[float, float]]:
    """Return by channel (rms of measured minus reconstructed, rms movement within the pieces), SI."""
    errors = np.concatenate(residuals(found.problem, found.z))
    moved = np.concatenate([_movement(piece.measured) for piece in found.problem.pieces])
    return {
        name: (_rms(errors[:, i]), _rms(moved[:, i]))
        for i, name in enumerate(OUTPUTS)
        if np.isfinite(errors[:, i]).any()
    }


def _movement(measured: FloatArray) -> FloatArray:
    seen = np.isfinite(measured)
    mean = np.where(seen, measured, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    return np.asarray(measured - mean)


def _rms(values: FloatArray) -> float:
    seen = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(seen**2))) if seen.size else float("nan")


def warnings(found: Estimate) -> tuple[str, ...]:
    """Return what contradicts, the worst first, then which sensors are evidently off."""
    left = unexplained(found)
    over = {name: rms / ALLOWED[name] for name, (rms, _) in left.items() if rms > ALLOWED[name]}
    lines: dict[str, list[str]] = {}
    for name in sorted(over, key=lambda n: -over[n]):
        lines.setdefault(_WITH[name], []).append(
            f"{name} by {shown(left[name][0], VARIABLES[name].unit)} rms"
        )
    contradictions = [
        f"{why} ({', '.join(names)} within pieces of at most 10 s)" for why, names in lines.items()
    ]
    doubt = (NO_CALIBRATION,) if contradictions else ()
    rest = () if found.rested else (UNRESTED,)
    return (*contradictions, *doubt, *off(found), *rest)


def off(found: Estimate) -> list[str]:
    """Return a line for each sensor that is off by more than good sensors are, and surely so."""
    values, errors = found.values, found.errors
    judged = {one.name: one.identifiable for one in found.judged}
    return [
        f"{unknown.meaning}: {_pm(values[unknown.name], errors[unknown.name], unknown.unit)}"
        for unknown in found.problem.unknowns
        if judged[unknown.name]
        and not unknown.name.startswith("wind")
        and _evident(unknown, values[unknown.name], errors[unknown.name])
    ]


def _evident(unknown: Unknown, value: float, error: float) -> bool:
    return abs(value - unknown.mean) > max(EVIDENT[unknown.unit], SURE * error)


def air_data_agree(found: Estimate) -> tuple[str, ...]:
    """Hold the steady wind against that of the air data reconstruction, which saw the whole flight."""
    air, values, errors = found.prepared.flight.air, found.values, found.errors
    if air is None or "wind.n" not in values or not np.isfinite(air.wind_n):
        return ()
    apart = [
        (values["wind.n"] - air.wind_n) / np.hypot(errors["wind.n"], air.wind_n_std),
        (values["wind.e"] - air.wind_e) / np.hypot(errors["wind.e"], air.wind_e_std),
    ]
    worst = float(np.max(np.abs(apart)))
    verdict = "agrees with" if worst < SURE else "DISAGREES with"
    return (
        f"the wind here, north {values['wind.n']:.2f} and east {values['wind.e']:.2f} m/s, {verdict} that of the air "
        f"data reconstruction, {air.wind_n:.2f} and {air.wind_e:.2f} m/s ({worst:.1f} standard errors apart)",
    )


def shown(value: float, unit: str) -> str:
    """Return a value with its unit, angles in degrees."""
    factor, name = _display(unit)
    return f"{value / factor:.3g} {name}".strip()


def _pm(value: float, error: float, unit: str) -> str:
    factor, name = _display(unit)
    return f"{value / factor:.3g} +- {error / factor:.2g} {name}".strip()


def _display(unit: str) -> tuple[float, str]:
    if unit.startswith("rad"):
        return DEGREE, unit.replace("rad", "deg")
    return 1.0, "" if unit == "1" else unit
