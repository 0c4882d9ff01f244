"""Which maneuver would tell a parameter that this flight does not tell.

A term of the aerodynamic model is told apart from the others when what it multiplies varies enough, and in another
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

from stoop.base.arrays import FloatArray
from stoop.base.units import DEGREE
from stoop.estimate.fit import Fit
from stoop.problem import Piece
from stoop.results.result import Result
from stoop.simulate import parameter_rows
from stoop.simulate.initial import commanded
from stoop.vehicle import Vehicle, terms

STILL: Final = 0.1  #: of the coefficient's own variation, that a term must reach to show itself
TIED: Final = 0.95  #: correlation from which two regressors are tied
#: rad: a 3-2-1-1 of unit step T holds half of its greatest power or more from 0.3 / T to 2.6 / T rad/s; with this over
#: the natural frequency as its step that frequency lies in the upper half of the band
STEP_ANGLE: Final = 1.6
ANGLES: Final = ("alpha", "beta")
AXES: Final = {"pitch": ("Cm", "elevator"), "roll": ("Cl", "aileron"), "yaw": ("Cn", "rudder")}
GROUND: Final = "Measure it on the ground, and fix it or narrow its prior."


@dataclass(frozen=True, eq=False)
class Term:
    """A term of one aerodynamic coefficient as it was flown.

    Attributes
    ----------
    name, coefficient : str
    variables : frozenset of str
        What it is made of: alpha, beta, p, q, r, V, and controls.
    value : float
        Its parameter's estimate.
    flown : (n,)
        What the parameter multiplies, over all fitted samples.
    """

    name: str
    coefficient: str
    variables: frozenset[str]
    value: float
    flown: FloatArray


@dataclass(frozen=True, eq=False)
class FlownModel:
    """What advice needs to know of vehicle and flight.

    Attributes
    ----------
    terms : mapping of str to Term
        By parameter.
    pitch, roll, yaw, power : str
        Names of the controls that do most about each axis; empty where there is none.
    frequencies : mapping of str to float
        Natural frequency of modes by name, rad/s.
    """

    terms: Mapping[str, Term]
    pitch: str = ""
    roll: str = ""
    yaw: str = ""
    power: str = ""
    frequencies: Mapping[str, float] = field(default_factory=dict)


def advice(name: str, stand_ins: Sequence[str], flown: FlownModel) -> str:
    """Return what to fly, or to measure, for one parameter.

    Parameters
    ----------
    name : str
    stand_ins : sequence of str
        Parameters strongly correlated with it, or moving with it along a direction that the data do not see.
    flown : FlownModel
    """
    term = flown.terms.get(name)
    if term is None:
        return _of_vehicle(name, flown)
    shared = [p for p in stand_ins if p not in flown.terms and not p.startswith("sensors.")]
    said = [_of_term(term, flown, told=bool(shared)), _shared(shared) if shared else ""]
    return " ".join(sentence for sentence in said if sentence)


def _of_term(term: Term, flown: FlownModel, told: bool) -> str:
    """Return what to fly for a term; nothing where only numbers that are `told` apart on the ground stand in for it."""
    if not term.variables:
        return "A constant is told by steady flight at several conditions."
    if _still(term, flown):
        begin = f"{_what(term)} varies by {_amount(term)} only (rms): {_excitation(term, flown)}."
        return begin[0].upper() + begin[1:]
    tied = _tied(term, flown)
    if tied:
        return _separate(term, tied, flown)
    return "" if told else f"Several others together stand in for it: {_excitation(term, flown)}."


def _still(term: Term, flown: FlownModel) -> bool:
    """Whether a term varies too little beside the other terms of its coefficient."""
    mates = [t for t in flown.terms.values() if t.coefficient == term.coefficient]
    whole = sum((t.value * (t.flown - t.flown.mean()) for t in mates), np.zeros(len(term.flown)))
    largest = max([float(np.std(t.value * t.flown)) for t in mates] + [float(np.std(whole))])
    return float(np.std(term.value * term.flown)) < STILL * largest or float(np.std(term.flown)) == 0.0


def _tied(term: Term, flown: FlownModel) -> list[Term]:
    """Return the other terms of the same coefficient that could stand in for this one, the strongest first.

    All of them together where no single one is: then the one with the greatest share is named.
    """
    mates = [t for t in flown.terms.values() if t.coefficient == term.coefficient and t.name != term.name]
    moving = [t for t in mates if np.std(t.flown) > 0.0]
    if not moving or np.std(term.flown) == 0.0:
        return []
    alone = [abs(float(np.corrcoef(term.flown, t.flown)[0, 1])) for t in moving]
    table = np.column_stack([(t.flown - t.flown.mean()) / np.std(t.flown) for t in moving])
    series = (term.flown - term.flown.mean()) / np.std(term.flown)
    shares = np.linalg.lstsq(table, series, rcond=1e-9)[0]
    together = float(np.std(table @ shares))
    if max(alone) < TIED and together < TIED:
        return []
    order = np.argsort(-(np.array(alone) if max(alone) >= TIED else np.abs(shares)), kind="stable")
    return [moving[i] for i in order[:2]]


def _separate(term: Term, tied: Sequence[Term], flown: FlownModel) -> str:
    mine, other = term.variables, tied[0].variables
    begin = f"In this flight {_what(term)} moves with {_what(tied[0])}"
    controls = {flown.pitch, flown.roll, flown.yaw, flown.power} - {""}
    moved = (mine | other) & controls
    if (
        {"p", "r"} <= mine | other
        or len(moved) > 1
        or mine | other <= {"p", "r", "beta", flown.roll, flown.yaw}
    ):
        both = [c for c in (flown.roll, flown.yaw) if c] if not len(moved) > 1 else sorted(moved)
        return f"{begin}: move {' and '.join(both) or 'the controls'} at separate times, a doublet or 3-2-1-1 each."
    if "V" in mine | other:
        return f"{begin}: {_speed(flown)}."
    if moved and not mine <= controls:
        return f"{begin}: {_quick(flown, term)}."
    if mine & controls:
        own = " and ".join(sorted(mine & controls))
        return f"{begin}: switch feedback off, or add inputs of its own on {own} to what the controller commands."
    return f"{begin}: {_excitation(term, flown)}."


def _excitation(term: Term, flown: FlownModel) -> str:
    """Return what excites the variables of a term."""
    variables = term.variables
    if _nonlinear(term):
        wide = " and ".join(sorted(variables & {"alpha", "beta"})) or " and ".join(sorted(variables))
        return f"cover a wider range of {wide} ({_range_maneuver(variables)})"
    if "V" in variables:
        return _speed(flown)
    own = sorted(variables & ({flown.pitch, flown.roll, flown.yaw, flown.power} - {""}))
    if own:
        return f"larger or more inputs of {' and '.join(own)}"
    return _quick(flown, term)


def _quick(flown: FlownModel, term: Term) -> str:
    """Return the input that excites rates and flow angles about one axis."""
    lateral = bool(term.variables & {"beta", "p", "r"}) and not term.variables & {"alpha", "q"}
    if not lateral:
        pitch, step = flown.pitch or "pitch control", _step(flown, "short period")
        return f"fly a 3-2-1-1 with {pitch}{step}, whose quick reversals part rate, angle and deflection"
    if "p" in term.variables:
        return f"fly a bank-to-bank or doublets with {flown.roll or 'roll control'}{_step(flown, 'roll')}"
    return f"fly a 3-2-1-1 or doublet with {flown.yaw or 'yaw control'}{_step(flown, 'Dutch roll')}"


def _step(flown: FlownModel, mode: str) -> str:
    frequency = flown.frequencies.get(mode, np.nan)
    return f", unit step about {STEP_ANGLE / frequency:.2g} s" if frequency > 0.0 else ""


def _speed(flown: FlownModel) -> str:
    power = f"{flown.power} steps" if flown.power else "speed changes"
    return (
        f"let the airspeed change: {power}, the same maneuver at two airspeeds, or half a minute of phugoid"
    )


def _range_maneuver(variables: frozenset[str]) -> str:
    if "beta" in variables and "alpha" not in variables:
        return "steady sideslips to both sides"
    if "beta" in variables:
        return "lateral maneuvers at several angles of attack"
    return "pull-ups and push-overs, or the same maneuver at several airspeeds"


def _nonlinear(term: Term) -> bool:
    """Whether a term is no single variable: a power, or a product of several."""
    return len(term.variables) > 1 or any(mark in term.name[len(term.coefficient) :] for mark in "23456")


def _shared(names: Sequence[str]) -> str:
    if any(".inertia." in n for n in names):
        which = " and ".join(n for n in names if ".inertia." in n)
        return f"It is known only in ratio to {which}: measure that on the ground (swing test), and fix it or narrow its prior."
    return f"It also trades off against {' and '.join(names)}: measure that on its own, or narrow its prior."


def _of_vehicle(name: str, flown: FlownModel) -> str:
    """Return what to do about a number that is no aerodynamic term."""
    head = name.split(".")[0]
    if head in ("rotors", "rotor", "body_drag"):
        return _of_rotors(name)
    if ".inertia." in name or name.startswith("mass"):
        return "Maneuvers see moments only in ratio to inertia: weigh and swing the aircraft, and fix it or narrow its prior."
    if head == "propulsion":
        return f"Steps of {flown.power or 'power'} at several airspeeds tell thrust from drag; a static test narrows the prior."
    if head == "controls":
        control = name.split(".")[1]
        return f"Sharp-edged inputs of {control} (doublets), and a measurement of its travel and speed on the ground, tell it."
    if head == "sensors":
        return (
            "A calibration, or straight flight at several speeds and headings, tells an instrument's error."
        )
    return GROUND


_TELLING: Final = {
    "T0 T1 T2 gain idle": "Steps of thrust (heave) between half and full power tell the polynomial's shape.",
    "inflow": "Climbs and descents at several speeds tell it from thrust.",
    "drag translational linear quadratic": "Flight at several airspeeds, forward, sideways and vertical, tells it.",
    "Q0 Q1 Q2 torque_ratio torque_factor": "Yaw doublets, sharp-edged, tell torque.",
    "lag delay inertia": "Sharp-edged inputs (doublets of 0.1 to 0.2 s) logged at 100 Hz or more tell it.",
    "factor x y z": (
        "Steady hover beside doublets of roll and pitch tells it from the others' and from the center of gravity."
    ),
    "rotation": "Roll, pitch and yaw doublets of different lengths tell it from inertia.",
}  #: numbers of rotors and of body drag, by the last part of the name
_ROTORS: Final = {name: said for names, said in _TELLING.items() for name in names.split()}


def _of_rotors(name: str) -> str:
    """Return what to fly for a number of rotors or of body drag."""
    parts = name.split(".")
    last = parts[-1] if parts[-1] not in ("x", "y", "z") or parts[0] == "rotor" else parts[-2]
    return _ROTORS.get(last, GROUND)


def _what(term: Term) -> str:
    if not term.variables:
        return "the constant"
    names = " and ".join(sorted(term.variables))
    return f"the term {term.name} ({names})" if _nonlinear(term) else names


def _amount(term: Term) -> str:
    spread = float(np.std(term.flown))
    single = next(iter(term.variables)) if len(term.variables) == 1 else ""
    if single and not _nonlinear(term) and single not in ("p", "q", "r", "V"):
        return f"{spread / DEGREE:.2g} deg"
    return f"{100.0 * spread:.2g} %" if single == "V" else f"{spread:.2g}"


def flown_model(result: Result, fit: Fit) -> FlownModel:
    """Return the terms as the model flew them, and the controls and modes of the vehicle."""
    vehicle, layout = fit.problem.layout.vehicle, fit.problem.layout
    if vehicle.hovers:
        return FlownModel({}, frequencies=_frequencies(result))
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
    axes = {axis: _strongest(found, vehicle, *of) for axis, of in AXES.items()}
    return FlownModel(found, power=_power(vehicle), frequencies=_frequencies(result), **axes)


def _columns(vehicle: Vehicle, fit: Fit, index: int, piece: Piece) -> dict[str, FloatArray]:
    """Return what terms are made of, (n,) each, along one piece as the model flew it."""
    read = dict(zip(vehicle.outputs, fit.problem.outputs(fit.z, index).T, strict=True))
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


def _strongest(found: Mapping[str, Term], vehicle: Vehicle, coefficient: str, usual: str) -> str:
    """Return the control that does most about an axis; the usual one where the model is without that axis."""
    of_axis = [t for t in found.values() if t.coefficient == coefficient and len(t.variables) == 1]
    power = {c: abs(t.value) for t in of_axis for c in t.variables if c in vehicle.file.controls}
    if power:
        return max(power, key=lambda c: power[c])
    return usual if usual in vehicle.file.controls else ""


def _power(vehicle: Vehicle) -> str:
    propulsion = vehicle.file.propulsion
    return "" if propulsion is None or propulsion.kind == "constant" else propulsion.channel


def _frequencies(result: Result) -> dict[str, float]:
    every = [mode for condition in result.modes for mode in condition.modes]
    return {mode.name: mode.frequency.estimate for mode in reversed(every)}
