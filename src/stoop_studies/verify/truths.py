"""The truth of the free numbers of a vehicle file that someone else wrote: other lengths, working point, gains and signs.

A flight determines a force over the mass and a moment over the inertia as functions of what was recorded. The true
derivatives are converted to the reference lengths, rate normalization, working point and deflections of the file at hand, so
that a wrong guess of a gain is no error of a derivative. Deflections of the file are compared with those that were commanded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.flight import Flight
from stoop.vehicle import Vehicle
from stoop.vehicle.defaults import MOMENT_ARMS
from stoop_studies.verify.instruments import GROUPS, Defect

#: moment coefficient -> reference length, and moment of inertia
MOMENTS: Final = {name: (length, 2 * axis) for name, (length, axis) in MOMENT_ARMS.items()}
RATES: Final = {"p": "span", "q": "chord", "r": "span"}
ROTORS: Final = ("T0", "T1", "T2", "inflow", "drag", "torque_ratio", "lag", "delay")
MIN_SWING: Final = 1e-3  #: rad; a surface of a file that moves less is none


@dataclass(frozen=True)
class Deflection:
    """What was commanded over what a file says: commanded = gain * file + offset, rad."""

    gain: float
    offset: float


def recorded_deflection(file: Vehicle, flight: Flight, control: str) -> FloatArray:
    """Return the deflection (n,) of a control, rad, that a file makes of the channels of a flight."""
    channels = np.array([
        flight.column(c) if c in flight.names else np.zeros(len(flight.time)) for c in file.inputs
    ])  # fmt: skip
    return file.commanded(control, np.repeat(file.parameter_rows(), channels.shape[1], axis=1), channels)


def deflections(
    file: Vehicle,
    flight: Flight,
    time: FloatArray,
    commands: Mapping[str, FloatArray],
    span: tuple[float, float],
) -> dict[str, Deflection]:
    """Compare the deflections of a file, by the channels of a flight, with those commanded at times (n,), s, within a span."""
    used, out = (flight.time > span[0]) & (flight.time < span[1]), {}
    for name in file.controls:
        if name not in commands:
            continue
        own = recorded_deflection(file, flight, name)[used]
        true = np.interp(flight.time[used], time, commands[name])
        known = np.isfinite(own)
        if np.ptp(own[known]) > MIN_SWING:
            gain, offset = np.polyfit(own[known], true[known], 1)
            out[name] = Deflection(float(gain), float(offset))
    return out


def aerodynamic(
    truth: Vehicle, file: Vehicle, moved: Mapping[str, Deflection], airspeed: float, held: bool
) -> dict[str, float]:
    """Return the true value of each aerodynamic term of a file.

    Parameters
    ----------
    moved : as of `deflections`
    airspeed : mean of the flight, m/s
    held : whether moments and forces count over the file's own inertia and mass where it holds them
    """
    ratio = {
        n: truth.value(f"reference.{n}") / file.value(f"reference.{n}") for n in ("area", "span", "chord")
    }
    shift = file.value("reference.alpha", 0.0) - truth.value("reference.alpha", 0.0)
    reference = file.file.reference
    actual = reference is not None and reference.rate_normalization == "actual"
    slower = 1.0 if actual else file.value("reference.airspeed") / airspeed
    known = {(c, text): truth.value(name) for c, group in truth.terms.items() for name, text in group.items()}
    free = {p.name for p in file.parameters if p.free}
    out = {}
    for coefficient, group in file.terms.items():
        size = ratio["area"] * _over(truth, file, "mass.mass", free, held)
        if coefficient in MOMENTS:
            length, axis = MOMENTS[coefficient]
            over = _over(truth, file, f"mass.inertia.{axis}", free, held)
            size = (
                ratio["area"]
                * ratio[length]
                * (_stated(file, axis) / truth.value(f"mass.inertia.{axis}") or over)
            )

        def true(text: str, coefficient: str = coefficient) -> float:
            return known.get((coefficient, text), 0.0)

        for name, text in group.items():
            value = true(text)
            if text == "1":
                value += true("alpha") * shift + true("alpha^2") * shift**2
                value += sum(true(c) * m.offset for c, m in moved.items())
            elif text == "alpha":
                value += 2.0 * true("alpha^2") * shift
            elif text in RATES:
                value *= ratio[RATES[text]] * slower
            elif text in file.controls:
                if text not in moved:
                    continue
                value *= moved[text].gain
            out[name] = value * size
    return out


def _stated(file: Vehicle, axis: str) -> float:
    """Return the moment of inertia for which the moment coefficients of a file hold; 0 where it states none."""
    return file.value(f"reference.inertia.{axis[0]}", 0.0)


def inertia_of(truth: Vehicle, file: Vehicle, name: str) -> float:
    """Return the moment of inertia for which the true value of a moment term of a file holds."""
    axis = MOMENTS[name[:2]][1]
    return _stated(file, axis) or truth.value(f"mass.inertia.{axis}")


def _over(truth: Vehicle, file: Vehicle, name: str, free: set[str], held: bool) -> float:
    """Return how much a wrong mass or inertia, as the file holds it, scales what is estimated."""
    return file.value(name) / truth.value(name) if held and name not in free else 1.0


def of_instruments(truth: Vehicle, file: Vehicle, defect: Defect, arm: FloatArray) -> dict[str, float]:
    """Return the true value of mass properties, lags and instruments; an ``arm`` (3,) is that of the accelerometer, m."""
    late = {channel: s for group, s in defect.delay.items() for channel in GROUPS[group]}
    out = {"mass.mass": truth.value("mass.mass")}
    out |= {
        f"mass.inertia.{a}": truth.value(f"mass.inertia.{a}", 0.0)
        for a in ("xx", "yy", "zz", "xz", "xy", "yz")
    }
    out |= {f"sensors.accelerometer_position.{a}": float(x) for a, x in zip("xyz", arm, strict=True)}
    for channel in file.outputs:
        out[f"sensors.{channel}.scale"] = defect.scale.get(channel, 1.0)
        out[f"sensors.{channel}.delay"] = late.get(channel, 0.0)
    for control in file.controls:
        if control in truth.controls:
            out[f"controls.{control}.lag"] = truth.value(f"controls.{control}.lag", 0.0)
            out[f"controls.{control}.delay"] = late.get(control, 0.0)
    return out


def rotors(truth: Vehicle, file: Vehicle) -> dict[str, float]:
    """Return the true value of the numbers of rotors and body drag, where both files have the same of them."""
    names = [f"rotors.{n}" for n in ROTORS] + [f"body_drag.quadratic.{a}" for a in "xyz"]
    powers = {f"rotors.T{k}" for k in range(3)}
    same = {n for n in powers if n in file.rows} >= {n for n in powers if n in truth.rows}
    drags = not any(f"body_drag.linear.{a}" in file.rows for a in "xyz")
    return {
        n: truth.value(n, 0.0)
        for n in names
        if n in file.rows and (same or n not in powers) and (drags or not n.startswith("body_drag"))
    }


def free_truths(
    truth: Vehicle, file: Vehicle, moved: Mapping[str, Deflection], airspeed: float, defect: Defect, arm: FloatArray,
    held: bool = False,
) -> dict[str, float]:  # fmt: skip
    """Return the true value of every free number of a file that has one, SI."""
    known = of_instruments(truth, file, defect, arm)
    if file.rotors and truth.rotors:
        known |= rotors(truth, file)
    if file.file.reference is not None and truth.file.reference is not None:
        known |= aerodynamic(truth, file, moved, airspeed, held)
    return {p.name: known[p.name] for p in file.parameters if p.free and p.name in known}


def relative_to_inertia(
    names: list[str],
    values: Mapping[str, float],
    covariance: FloatArray,
    order: tuple[str, ...],
    file: Vehicle,
) -> dict[str, tuple[float, float]]:
    """Return moment terms over the moment of inertia about their axis, with standard errors, per kg m2."""
    out = {}
    for coefficient, group in file.terms.items():
        if coefficient not in MOMENTS:
            continue
        inertia = f"mass.inertia.{MOMENTS[coefficient][1]}"
        stated = _stated(file, MOMENTS[coefficient][1])
        size = stated or values.get(inertia, file.value(inertia))
        for name in (n for n in group if n in names):
            gradient = np.zeros(len(order))
            gradient[order.index(name)] = 1.0 / size
            if inertia in order and not stated:
                gradient[order.index(inertia)] = -values[name] / size**2
            known = np.isfinite(np.diag(covariance)) | (gradient != 0.0)
            variance = gradient[known] @ covariance[np.ix_(known, known)] @ gradient[known]
            out[name] = (values[name] / size, float(np.sqrt(max(variance, 0.0))))
    return out
