"""What a column may hold, by its name alone: which variable, in which unit."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, TypeAlias

from stoop.base.units import KINDS
from stoop.base.variables import VARIABLES

UNITS: Final[dict[str, str]] = {
    "rad": "rad", "rads": "rad", "radian": "rad", "radians": "rad", "deg": "deg", "degs": "deg", "degree": "deg",
    "degrees": "deg", "°": "deg", "cdeg": "cdeg", "rad/s": "rad/s", "rad/sec": "rad/s", "rps": "rad/s", "radps": "rad/s",
    "rad_s": "rad/s", "rads-1": "rad/s", "rad.s-1": "rad/s", "rad s-1": "rad/s", "deg/s": "deg/s", "deg/sec": "deg/s",
    "dps": "deg/s", "degps": "deg/s", "deg_s": "deg/s", "°/s": "deg/s", "mdps": "mdeg/s", "rpm": "rpm", "rev/min": "rpm",
    "rad/s/s": "rad/s2", "rad/s2": "rad/s2", "rad/s^2": "rad/s2", "deg/s/s": "deg/s2", "deg/s2": "deg/s2",
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "mm": "mm", "cm": "cm", "km": "km", "ft": "ft", "feet": "ft",
    "m/s": "m/s", "mps": "m/s", "m_s": "m/s", "ms-1": "m/s", "m.s-1": "m/s", "m s-1": "m/s", "m/sec": "m/s",
    "km/h": "km/h", "kmh": "km/h", "kph": "km/h", "kt": "kt", "kts": "kt", "kn": "kt", "knots": "kt", "ft/s": "ft/s",
    "fps": "ft/s", "cm/s": "cm/s", "mm/s": "mm/s", "m/s2": "m/s2", "m/s^2": "m/s2", "m/s²": "m/s2", "m/s/s": "m/s2",
    "mss": "m/s2", "mps2": "m/s2", "m_s2": "m/s2", "ms2": "m/s2", "ms-2": "m/s2", "m s-2": "m/s2", "m.s-2": "m/s2",
    "ft/s2": "ft/s2", "g": "g", "gs": "g", "mg": "mg", "s": "s", "sec": "s", "ms": "ms", "us": "us", "µs": "us",
    "ns": "ns", "n": "N", "lbf": "lbf", "kg/m3": "kg/m3", "kg/m^3": "kg/m3", "pa": "Pa", "hpa": "hPa", "kpa": "kPa",
    "mbar": "mbar", "k": "K", "degc": "degC", "°c": "degC", "celsius": "degC", "c": "degC", "v": "V", "volt": "V",
    "volts": "V", "mv": "mV", "a": "A", "amp": "A", "amps": "A", "ma": "mA", "%": "percent", "pct": "percent",
    "percent": "percent", "norm": "1", "-": "1", "1": "1", "pwm": "pwm", "usec": "us",
}  #: as files and people write them -> as stoop does  # fmt: skip

LONGEST_NAME: Final = (
    200  #: letters; no name that tells anything is longer, and matching takes the square of it
)
_LONGEST: Final = sorted(
    map(re.escape, UNITS.keys() - {"1", "-"}), key=len, reverse=True
)  #: motor_1 is a number
_SUFFIX: Final = re.compile(rf"[_ .]({'|'.join(_LONGEST)})(\[\d+\])?$", re.IGNORECASE)
_BRACKETS: Final = re.compile(r"\s*[(\[]\s*([^)\]]*?)\s*[)\]]\s*$")
_ASKED: Final = re.compile(
    r"\b(des|desired|sp|setpoint|target|ref|reference|demand|dem|nav|raw|err|error|bias|std|var|cov)\b"
    r"|delta (?:heading|q|v|x|z|angle)"
)  #: what was asked for, or left over: not what was measured
_AXES: Final = (("x", "0", "r(?:oll)?", "1"), ("y", "1", "p(?:itch)?", "2"), ("z", "2", "y(?:aw)?", "3"))


@dataclass(frozen=True)
class Guess:
    """What a name says.

    Attributes
    ----------
    variable : name in the registry
    unit : as the name tells it; empty when it does not
    scale : -1 where the name says that it counts the other way
    doubt : why this may be wrong; empty when the name is plain
    """

    variable: str
    unit: str
    scale: float = 1.0
    doubt: str = ""


def recognized(column: str, stated: str = "") -> Guess | None:
    """Return what a column holds by its name, or None.

    Parameters
    ----------
    column : its name
    stated : unit that the file states
    """
    if len(column) > LONGEST_NAME:
        return None
    bare, unit = without_unit(column)
    unit = UNITS.get(stated.strip().lower(), "") or unit
    found = _by_words(_words(bare)) or (_by_words(_words(column)) if len(unit) == 1 else None)
    if found is None:
        return None
    variable, scale, doubt = found
    if unit == "rpm" and variable.startswith("motor_"):
        variable = variable.replace("motor", "rotor")
    kind, known = KINDS[unit or "1"], KINDS[VARIABLES[variable].unit]
    if (kind, known) == ("an angle", "a rate of turn"):
        unit, kind = f"{unit}/s", known  # written short, as gyro_rad is
    return Guess(variable, unit, scale, doubt) if kind in (known, KINDS["1"]) else None


def _by_words(text: str) -> tuple[str, float, str] | None:
    if _ASKED.search(text):
        return None
    for variable, pattern, scale, doubt in _RULES:
        found = pattern.search(text)
        if found is not None:
            number = next((int(n) for n in found.groups() if n is not None and n.isdecimal()), None)
            name = _numbered(variable, number, text)
            return None if name is None else (name, scale, doubt)
    return None


def _numbered(variable: str, number: int | None, text: str) -> str | None:
    """Put the number in; elements of arrays count from zero, numbers in a name from one."""
    if "{n}" not in variable:
        return variable
    first = 1 if " at " in text or number == 0 else 0
    name = variable.format(n=(number or 0) + first)
    return name if number is not None and name in VARIABLES else None


def without_unit(column: str) -> tuple[str, str]:
    """Split a unit off a name, whether in brackets or as an ending; the unit is empty when there is none."""
    if len(column) > LONGEST_NAME:
        return column, ""
    found = _BRACKETS.search(column)
    if found and found.group(1).lower() in UNITS and not found.group(1).isdigit():
        return column[: found.start()], UNITS[found.group(1).lower()]
    found = _SUFFIX.search(column)
    if found and found.start() > 0:
        return column[: found.start()] + (found.group(2) or ""), UNITS[found.group(1).lower()]
    return column, ""


def _words(name: str) -> str:
    """Return a name as plain words: small letters, numbers apart, elements of arrays as `at N`."""
    text = re.sub(r"\[(\d+)\]", r" at \1 ", name)
    text = re.sub(r"([a-z])([A-Z])", r"\1 \2", text)
    text = re.sub(r"([A-Za-z])(\d)", r"\1 \2", text)
    text = re.sub(r"(\d)([A-Za-z])", r"\1 \2", text)
    return " ".join(re.findall(r"[a-z]+|\d+", text.lower()))


_Rule: TypeAlias = tuple[str, re.Pattern[str], float, str]


def _rule(variable: str, words: str, scale: float = 1.0, doubt: str = "", *, alone: bool = False) -> _Rule:
    """Match the last words of a name, or with `alone` the whole of it."""
    start = "^" if alone else "(?:^| )"
    return variable, re.compile(f"{start}(?:{words})$"), scale, doubt


def _triple(variables: tuple[str, str, str], what: str, doubt: str = "") -> list[_Rule]:
    rules = []
    for variable, (letter, index, turn, _) in zip(variables, _AXES, strict=True):
        rules.append(_rule(variable, rf"(?:{what})(?: xyz)? ?(?:{letter}|{turn}|at {index})", doubt=doubt))
        rules.append(_rule(variable, rf"(?:{letter}|{turn}) (?:{what})", doubt=doubt))
    return rules


_TURN: Final = "gyro|gyr|gyroscope|omega|w|angular velocity|ang vel|angular rate|body ?rate|rates?"
_GROUND: Final = "unsure: whether x is north and z down, or they are along the body"
_G: Final = "unsure: a gyro by its name, or gravity"
_RULES: Final = [
    _rule("q0", r"(?:q|quat|quaternion|att q|orientation) ?(?:w|at 0|0)"),
    _rule("q1", r"(?:q|quat|quaternion|orientation) ?(?:x|at 1|1)"),
    _rule("q2", r"(?:q|quat|quaternion|orientation) ?(?:y|at 2|2)"),
    _rule("q3", r"(?:q|quat|quaternion|orientation) ?(?:z|at 3|3)"),
    *_triple(("p_dot", "q_dot", "r_dot"), "angular acceleration|ang acc|gyro dot|omega dot"),
    _rule("p_dot", "p dot|pdot"), _rule("q_dot", "q dot|qdot"), _rule("r_dot", "r dot|rdot"),
    *_triple(("p", "q", "r"), _TURN),
    _rule("p", "g ?x", doubt=_G, alone=True), _rule("q", "g ?y", doubt=_G, alone=True), _rule("r", "g ?z", doubt=_G, alone=True),
    _rule("p", "p", alone=True), _rule("q", "q", alone=True), _rule("r", "r", alone=True),
    _rule("p", "roll ?rate|rollspeed|roll speed|rate roll|phi ?dot|rollrate"),
    _rule("q", "pitch ?rate|pitchspeed|pitch speed|rate pitch|pitchrate"),
    _rule("r", "yaw ?rate|yawspeed|yaw speed|rate yaw|yawrate"),
    *_triple(("ax", "ay", "az"), "a|acc|accel|acceleration|accelerometer|linear acceleration|lin acc|f|specific force"),
    _rule("az", "nz|n z", -1.0, "unsure: a load factor counts up"),
    _rule("vn", "v ?n", alone=True), _rule("ve", "v ?e", alone=True), _rule("vd", "v ?d", alone=True),
    _rule("vn", "vel n|v north|velocity north|north velocity|vel north|speed north|velocity n"),
    _rule("ve", "vel e|v east|velocity east|east velocity|vel east|speed east|velocity e"),
    _rule("vd", "vel d|v down|velocity down|down velocity|vel down|speed down|velocity d"),
    _rule("vd", "climb|climb rate|vario|v up|vertical speed", -1.0),
    *_triple(("vn", "ve", "vd"), "v|vel|velocity", _GROUND),
    _rule("pn", "p ?n", alone=True), _rule("pe", "p ?e", alone=True), _rule("pd", "p ?d", alone=True),
    _rule("pn", "pos n|position north|north|pos north"), _rule("pe", "pos e|position east|east|pos east"),
    _rule("pd", "pos d|position down|down|pos down"),
    *_triple(("pn", "pe", "pd"), "pos|position|local position", _GROUND),
    _rule("pn", "x", doubt=_GROUND, alone=True), _rule("pe", "y", doubt=_GROUND, alone=True),
    _rule("pd", "z", doubt=_GROUND, alone=True),
    *_triple(("phi", "theta", "psi"), "euler|euler angles?|rpy|attitude"),
    _rule("alpha", "alpha|aoa|angle of attack"), _rule("beta", "beta|ssa|aos|sideslip|angle of sideslip"),
    _rule("phi", "phi|roll|roll angle|bank|bank angle"), _rule("theta", "theta|pitch|pitch angle"),
    _rule("psi", "psi|yaw|heading|hdg|yaw angle|course"),
    _rule("wind_n", "wind n|wind north|windspeed north"), _rule("wind_e", "wind e|wind east|windspeed east"),
    _rule("V", "v ?t|tas|true ?airspeed|true speed|v true|v tas"), _rule("V", "v", alone=True),
    _rule("airspeed_equivalent", "ias|cas|eas|(?:indicated|calibrated|equivalent) (?:airspeed|air speed)"),
    _rule("airspeed_pitot", "airspeed|air speed|pitot|aspd|arspd"),
    _rule("altitude", "h", alone=True), _rule("altitude", "alt|altitude|height|h msl|alt msl|altitude msl|amsl"),
    _rule("density", "rho|density|air density"), _rule("pressure", "pressure|baro|static pressure|p static|press|baro pressure"),
    _rule("temperature", "oat|temperature|temp|air temperature"),
    _rule("rotor_{n}", r"(?:rpm|rotors?|rotor speed|motor rpm|motor speed|esc rpm|propeller|prop) ?(?:at )?(\d+)"),
    _rule("rotor_{n}", r"(?:esc|motor|rotor|m) ?(?:at )?(\d+) (?:esc )?(?:rpm|speed|omega)"),
    _rule("rotor_{n}", r"esc ?(?:at )?(\d+)"),
    _rule("voltage", "voltage|battery|batt|vbat|v bat|volt|batt?(?:ery)? ?(?:voltage|volt|v)|vbatt"),
    _rule("current", "current|ibat|curr|batt?(?:ery)? ?(?:current|curr|i)|amps?"),
    _rule("pwm_{n}", r"(?:pwm|rcou c|servo out|pwm out|rc out|rcout|outputs?|out|ch|chan|channel|c) ?(?:at )?(\d+)"),
    _rule("motor_{n}", r"(?:motors?|motor cmd|motor m|m|mot|motor command|u motor|thrust cmd) ?(?:at )?(\d+)"),
    _rule("servo_{n}", r"(?:servos?|servo cmd|srv) ?(?:at )?(\d+)"),
    _rule("elevator", "de", alone=True), _rule("aileron", "da", alone=True), _rule("rudder", "dr", alone=True),
    _rule("flap", "df", alone=True), _rule("throttle", "dt", alone=True),
    _rule("elevator", "elevator|elev|delta e|elevator deflection|d elev"),
    _rule("aileron", "aileron|ail|delta a|aileron deflection|d ail"),
    _rule("rudder", "rudder|rudd|rud|delta r|rudder deflection|d rud"),
    _rule("flap", "flaps?|delta f"), _rule("throttle", "throttle|thr|delta t|power lever"),
    _rule("thrust", "thrust|thrust force"),
]  # fmt: skip
