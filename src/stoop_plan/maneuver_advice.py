"""Which maneuver would make a parameter identifiable that this flight does not determine.

A term of the aerodynamic model is identifiable beside the others when what it multiplies varies enough, and in another
way than what they multiply. Both are computed from the motion flown; the variables that lack it lead to the control that
excites them.

References
----------
R. V. Jategaonkar, *Flight Vehicle System Identification: A Time-Domain Methodology*, 2nd ed., AIAA, 2015, chapter 2 (inputs
and maneuvers).
V. Klein and E. A. Morelli, *Aircraft System Identification*, 2nd ed., 2016, chapter 9 (experiment design).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop import Notice
from stoop.extend.fits import FlownModel
from stoop.extend.notices import notice
from stoop.extend.vehicles import MOMENT_ARMS

MIN_VARIATION: Final = 0.1  #: of the coefficient's own variation, that a term must reach to show itself
TIED: Final = 0.95  #: correlation from which two regressors cannot be distinguished
#: rad: a 3-2-1-1 of unit step T holds half of its greatest power or more from 0.3 / T to 2.6 / T rad/s; with this over
#: the natural frequency as its step that frequency lies in the upper half of the band
STEP_ANGLE: Final = 1.6
_ROTORS: Final = {
    **dict.fromkeys(("T0", "T1", "T2", "gain", "idle"), "advice-thrust"),
    **dict.fromkeys(("drag", "translational", "linear", "quadratic"), "advice-body-drag"),
    **dict.fromkeys(("Q0", "Q1", "Q2", "torque_ratio", "torque_factor"), "advice-torque"),
    **dict.fromkeys(("lag", "delay", "inertia"), "advice-motor-lag"),
    **dict.fromkeys(("factor", "x", "y", "z"), "advice-rotor"),
    "inflow": "advice-inflow",
    "rotation": "advice-rotation",
}  #: numbers of rotors and of body drag, by the last part of the name -> code of the notice


def advice(flown: FlownModel, name: str, stand_ins: Sequence[str]) -> tuple[Notice, ...]:
    """Return what to fly, or to measure, for one parameter.

    `stand_ins` are strongly correlated with it, or change with it along a direction that the data do not see.
    """
    term = flown.terms.get(name)
    if term is None:
        return (_of_vehicle(name, flown),)
    shared = [p for p in stand_ins if p not in flown.terms and not p.startswith("sensors.")]
    # a flight shows moments over one inertia, forces over none
    _, axis = MOMENT_ARMS.get(term.coefficient, ("", ""))
    shared = [n for n in shared if ".inertia." not in n or n == f"mass.inertia.{2 * axis}"]
    inertia = tuple(n for n in shared if ".inertia." in n)
    mates = [t for t in flown.terms.values() if t.coefficient == term.coefficient]
    whole = sum((t.value * (t.flown - t.flown.mean()) for t in mates), np.zeros(len(term.flown)))
    largest = max([float(np.std(t.value * t.flown)) for t in mates] + [float(np.std(whole))])
    own, spread, out = float(np.std(term.value * term.flown)), float(np.std(term.flown)), []
    if not term.variables:
        out.append(notice("advice-constant"))
    elif own < MIN_VARIATION * largest or spread == 0.0:  # it varies too little beside the others
        variables, code = term.variables, "advice-still"
        if variables == {"V"}:
            code = "advice-still-airspeed"
        elif len(variables) == 1 and not term.nonlinear and not variables & {"p", "q", "r"}:
            code = "advice-still-angle"
        maneuver = _excitation(variables, term.nonlinear, flown)
        out.append(notice(code, f"{str(term)[0].upper()}{str(term)[1:]}", amount=spread, maneuver=maneuver))
    elif tied := flown.terms.get(_tied(name, flown)):
        maneuver = _separation(name, tied.name, flown)
        out.append(notice("advice-tied", str(term), other=str(tied), maneuver=maneuver))
    elif not shared:  # else numbers stand in for it that are measured on the ground
        out.append(notice("advice-several", maneuver=_excitation(term.variables, term.nonlinear, flown)))
    if shared:
        code = "advice-ratio-to-inertia" if inertia else "advice-shared"
        out.append(notice(code, " and ".join(inertia or shared)))
    return tuple(out)


def _tied(name: str, flown: FlownModel) -> str:
    """Return the other term of the same coefficient that could stand in best for this one, if any.

    All of them together where no single one is: then the one with the greatest share is named.
    """
    term = flown.terms[name]
    mates = [t for t in flown.terms.values() if t.coefficient == term.coefficient and t.name != name]
    moving = [t for t in mates if np.std(t.flown) > 0.0]
    if not moving or np.std(term.flown) == 0.0:
        return ""
    alone = np.array([abs(float(np.corrcoef(term.flown, t.flown)[0, 1])) for t in moving])
    table = np.column_stack([(t.flown - t.flown.mean()) / np.std(t.flown) for t in moving])
    series = (term.flown - term.flown.mean()) / np.std(term.flown)
    shares = np.linalg.lstsq(table, series, rcond=1e-9)[0]
    if max(alone) < TIED and float(np.std(table @ shares)) < TIED:
        return ""
    return moving[int(np.argmax(alone if max(alone) >= TIED else np.abs(shares)))].name


def _separation(name: str, other: str, flown: FlownModel) -> Notice:
    """Return what makes two terms vary in different ways."""
    term, tied = flown.terms[name], flown.terms[other]
    own, both, controls = term.variables, term.variables | tied.variables, flown.controls
    several = sorted(both & controls) if len(both & controls) > 1 else []
    if several or {"p", "r"} <= both or both <= {"p", "r", "beta", flown.roll, flown.yaw}:
        apart = several or [c for c in (flown.roll, flown.yaw) if c] or ["the controls"]
        return notice("fly-separate-inputs", controls=tuple(apart))
    if "V" in both:
        return _excitation(frozenset("V"), False, flown)
    if both & controls and not own <= controls:
        return _excitation(own - controls, False, flown)
    if own & controls:
        return notice("fly-own-inputs", controls=tuple(sorted(own & controls)))
    return _excitation(own, term.nonlinear, flown)


def _excitation(variables: frozenset[str], nonlinear: bool, flown: FlownModel) -> Notice:
    """Return what excites the variables of a term."""
    if nonlinear:
        wide = sorted(variables & {"alpha", "beta"}) or sorted(variables)
        code = "fly-range"
        if "beta" in variables:
            code = "fly-lateral-range" if "alpha" in variables else "fly-sideslips"
        return notice(code, variables=tuple(wide))
    if "V" in variables:
        return notice("fly-power-steps", flown.power) if flown.power else notice("fly-speed-changes")
    if own := tuple(sorted(variables & flown.controls)):
        return notice("fly-larger-inputs", controls=own)
    # rates and flow angles about one axis, with the step of the input where the mode is known
    if not variables & {"beta", "p", "r"} or variables & {"alpha", "q"}:
        mode, code, control = "short period", "fly-short-period", flown.pitch or "pitch control"
    elif "p" in variables:
        mode, code, control = "roll", "fly-roll", flown.roll or "roll control"
    else:
        mode, code, control = "Dutch roll", "fly-dutch-roll", flown.yaw or "yaw control"
    frequency = flown.frequencies.get(mode, np.nan)
    step = notice("fly-unit-step", seconds=STEP_ANGLE / frequency) if frequency > 0.0 else ""
    return notice(code, control, step=step)


def _of_vehicle(name: str, flown: FlownModel) -> Notice:
    """Return what to do about a number that is no aerodynamic term."""
    parts, code = name.split("."), "advice-ground"
    if parts[0] in ("rotors", "rotor", "body_drag"):
        last = parts[-1] if parts[-1] not in ("x", "y", "z") or parts[0] == "rotor" else parts[-2]
        code = _ROTORS.get(last, code)
    elif ".inertia." in name or name.startswith("mass"):
        code = "advice-inertia"
    elif parts[0] in ("propulsion", "controls", "sensors"):
        code = f"advice-{parts[0]}"
    return notice(code, parts[1] if len(parts) > 1 else name, power=flown.power or "power")
