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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from stoop import Notice, Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.fits import Estimate, Piece, Result, observation_model
from stoop.extend.motion import commanded, parameter_rows
from stoop.extend.notices import notice
from stoop.extend.vehicles import MOMENT_ARMS, terms

MIN_VARIATION: Final = 0.1  #: of the coefficient's own variation, that a term must reach to show itself
TIED: Final = 0.95  #: correlation from which two regressors cannot be distinguished
#: rad: a 3-2-1-1 of unit step T holds half of its greatest power or more from 0.3 / T to 2.6 / T rad/s; with this over
#: the natural frequency as its step that frequency lies in the upper half of the band
STEP_ANGLE: Final = 1.6
AXES: Final = {"pitch": ("Cm", "elevator"), "roll": ("Cl", "aileron"), "yaw": ("Cn", "rudder")}
_ROTORS: Final = {
    **dict.fromkeys(("T0", "T1", "T2", "gain", "idle"), "advice-thrust"),
    **dict.fromkeys(("drag", "translational", "linear", "quadratic"), "advice-body-drag"),
    **dict.fromkeys(("Q0", "Q1", "Q2", "torque_ratio", "torque_factor"), "advice-torque"),
    **dict.fromkeys(("lag", "delay", "inertia"), "advice-motor-lag"),
    **dict.fromkeys(("factor", "x", "y", "z"), "advice-rotor"),
    "inflow": "advice-inflow",
    "rotation": "advice-rotation",
}  #: numbers of rotors and of body drag, by the last part of the name -> code of the notice


@dataclass(frozen=True, eq=False)
class Term:
    """A term of one aerodynamic coefficient as it was flown."""

    name: str
    coefficient: str
    variables: frozenset[str]  #: what it is made of: alpha, beta, p, q, r, V, and controls
    value: float  #: its parameter's estimate
    flown: FloatArray  #: what the parameter multiplies, over all fitted samples (n,)

    @property
    def nonlinear(self) -> bool:
        """Whether it is no single variable: a power, or a product of several."""
        return len(self.variables) > 1 or any(c in self.name[len(self.coefficient) :] for c in "23456")

    def __str__(self) -> str:
        """Return what it is made of."""
        names = " and ".join(sorted(self.variables))
        return f"the term {self.name} ({names})" if names and self.nonlinear else names or "the constant"


@dataclass(frozen=True, eq=False)
class FlownModel:
    """What advice needs to know of vehicle and flight."""

    terms: Mapping[str, Term]  #: by parameter
    pitch: str = ""  #: the control that does most about the axis; empty where there is none
    roll: str = ""
    yaw: str = ""
    power: str = ""
    frequencies: Mapping[str, float] = field(default_factory=dict)  #: of modes by name, natural, rad/s

    @property
    def controls(self) -> set[str]:
        """The controls that there are."""
        return {self.pitch, self.roll, self.yaw, self.power} - {""}

    @property
    def sizes(self) -> dict[str, float]:
        """The value of each parameter at which its effect (rms) would be the largest on its force or moment, SI."""
        rms = {t.name: float(np.sqrt(np.mean(t.flown**2))) for t in self.terms.values()}
        largest: dict[str, float] = {}
        for t in self.terms.values():
            largest[t.coefficient] = max(largest.get(t.coefficient, 0.0), abs(t.value) * rms[t.name])
        return {
            t.name: largest[t.coefficient] / rms[t.name] for t in self.terms.values() if rms[t.name] > 0.0
        }

    def advice(self, name: str, stand_ins: Sequence[str]) -> tuple[Notice, ...]:
        """Return what to fly, or to measure, for one parameter.

        `stand_ins` are strongly correlated with it, or change with it along a direction that the data do not see.
        """
        term = self.terms.get(name)
        if term is None:
            return (_of_vehicle(name, self),)
        shared = [p for p in stand_ins if p not in self.terms and not p.startswith("sensors.")]
        # a flight shows moments over one inertia, forces over none
        _, axis = MOMENT_ARMS.get(term.coefficient, ("", ""))
        shared = [n for n in shared if ".inertia." not in n or n == f"mass.inertia.{2 * axis}"]
        inertia = tuple(n for n in shared if ".inertia." in n)
        mates = [t for t in self.terms.values() if t.coefficient == term.coefficient]
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
            maneuver = _excitation(variables, term.nonlinear, self)
            out.append(
                notice(code, f"{str(term)[0].upper()}{str(term)[1:]}", amount=spread, maneuver=maneuver)
            )
        elif tied := _tied(term, self):
            maneuver = _separation(term, tied, self)
            out.append(notice("advice-tied", str(term), other=str(tied), maneuver=maneuver))
        elif not shared:  # else numbers stand in for it that are measured on the ground
            out.append(notice("advice-several", maneuver=_excitation(term.variables, term.nonlinear, self)))
        if shared:
            code = "advice-ratio-to-inertia" if inertia else "advice-shared"
            out.append(notice(code, " and ".join(inertia or shared)))
        return tuple(out)


def _tied(term: Term, flown: FlownModel) -> Term | None:
    """Return the other term of the same coefficient that could stand in best for this one.

    All of them together where no single one is: then the one with the greatest share is named.
    """
    mates = [t for t in flown.terms.values() if t.coefficient == term.coefficient and t.name != term.name]
    moving = [t for t in mates if np.std(t.flown) > 0.0]
    if not moving or np.std(term.flown) == 0.0:
        return None
    alone = np.array([abs(float(np.corrcoef(term.flown, t.flown)[0, 1])) for t in moving])
    table = np.column_stack([(t.flown - t.flown.mean()) / np.std(t.flown) for t in moving])
    series = (term.flown - term.flown.mean()) / np.std(term.flown)
    shares = np.linalg.lstsq(table, series, rcond=1e-9)[0]
    if max(alone) < TIED and float(np.std(table @ shares)) < TIED:
        return None
    return moving[int(np.argmax(alone if max(alone) >= TIED else np.abs(shares)))]


def _separation(term: Term, tied: Term, flown: FlownModel) -> Notice:
    """Return what makes two terms vary in different ways."""
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


def flown_model(result: Result, fit: Estimate) -> FlownModel:
    """Return the terms as the model flew them, and the controls and modes of the vehicle."""
    vehicle, layout = fit.problem.layout.vehicle, fit.problem.layout
    every = [mode for condition in result.modes for mode in condition.modes]
    frequencies = {mode.name: mode.frequency.estimate for mode in reversed(every)}
    if not observation_model(vehicle).open_loop:  # terms are compared along one simulation
        return FlownModel({}, frequencies=frequencies)
    free = {p.name for p in layout.parameters}
    columns = [_columns(vehicle, fit, i, piece) for i, piece in enumerate(fit.problem.pieces)]
    known = set(terms.STATE_VARIABLES) | set(vehicle.file.controls)
    found = {}
    for coefficient, texts in vehicle.terms.items():
        for name, text in texts.items():
            tree = terms.parse(text, known, vehicle.where)
            series = [np.broadcast_to(terms.convert(tree, c), len(c["V"])) for c in columns]
            value = fit.estimates[name] if name in free else vehicle.value(name)
            flown = np.concatenate(series).astype(np.float64)
            found[name] = Term(name, coefficient, terms.variables(tree), value, flown)
    axes = {}  # the control that does most about each; the usual one where the model is without that axis
    for axis, (coefficient, usual) in AXES.items():
        of_axis = [t for t in found.values() if t.coefficient == coefficient and len(t.variables) == 1]
        power = {c: abs(t.value) for t in of_axis for c in t.variables if c in vehicle.file.controls}
        fallback = usual if usual in vehicle.file.controls else ""
        axes[axis] = max(power, key=lambda c: power[c]) if power else fallback
    propulsion = vehicle.file.propulsion
    throttle = "" if propulsion is None or propulsion.kind == "constant" else propulsion.channel
    return FlownModel(found, power=throttle, frequencies=frequencies, **axes)


def _columns(vehicle: Vehicle, fit: Estimate, index: int, piece: Piece) -> dict[str, FloatArray]:
    """Return what terms are made of, (n,) each, along one piece as the model flew it."""
    read = dict(zip(vehicle.outputs, fit.readings[index].T, strict=True))
    still = np.zeros(len(piece.time))
    rows = parameter_rows(vehicle, piece.changes)
    motion = {c: np.nan_to_num(read.get(c, still)) for c in ("V", "alpha", "beta", "p", "q", "r")}
    if "V" not in read:
        motion["V"] = np.full(len(piece.time), float(piece.start.get("V", 1.0)))
    actual = vehicle.actual_rates
    rates = (motion["p"], motion["q"], motion["r"])
    made = terms.values(vehicle.value, actual, motion["V"], motion["alpha"], motion["beta"], rates)
    every = np.repeat(rows, len(piece.time), axis=1)
    return made | {c: commanded(vehicle, c, every, piece.inputs.T) for c in vehicle.controls}
