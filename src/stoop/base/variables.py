"""The one registry of variables: name, unit, frame, sign, meaning.

Frames: "body" is forward-right-down at the center of gravity unless said otherwise, "ned" is
north-east-down, fixed to the ground. Everything is SI; angles are radians.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from stoop.base.text import nearest
from stoop.base.units import PULSE_FACTORS, UNITS
from stoop.errors import FlightError

Kind = Literal["measurement", "command"]


@dataclass(frozen=True)
class Variable:
    """One quantity that a flight may hold.

    Attributes
    ----------
    name : as in files, in `Flight.data` and in results
    unit : SI unit, as in `stoop.base.units.UNITS`
    frame : "body", "ned", "air", "surface" or "" where there is none
    sign : which way is positive
    meaning : in plain words
    kind : "command" is interpolated linearly, "measurement" smoothly where it was logged slowly
    """

    name: str
    unit: str
    frame: str
    sign: str
    meaning: str
    kind: Kind = "measurement"

    @property
    def units(self) -> dict[str, float]:
        """Units in which it may be recorded -> factor to the unit in which it is kept."""
        if self.name.startswith("pwm_"):
            return PULSE_FACTORS
        return {n: one.factor for n, one in UNITS.items() if one.kind == UNITS[self.unit].kind}


NUMBERED: Final[tuple[tuple[int, tuple[str, ...]], ...]] = (
    (16, ("servo_{n}", "1", "", "as the autopilot is set up; -1 to 1", "normalized command to servo {n}", "command")),
    (16, ("motor_{n}", "1", "", "more thrust; 0 to 1, or -1 to 1", "normalized command to motor {n}", "command")),
    (16, ("rotor_{n}", "rad/s", "", "as it turns to give thrust", "measured speed of rotor {n}")),
    (16, ("pwm_{n}", "us", "", "longer pulse", "pulse sent to output {n}", "command")),
)  #: how many (PX4 has 8 servos and 12 motors; no vehicle we know flies with more pulses), and the row of each  # fmt: skip


def _table() -> dict[str, Variable]:
    rows: list[tuple[str, ...]] = [
        ("V", "m/s", "air", "always positive", "speed of the center of gravity relative to the air"),
        ("alpha", "rad", "air", "nose above the airflow", "angle of attack, atan2(w, u)"),
        ("beta", "rad", "air", "airflow from the right", "sideslip angle, asin(v / V)"),
        ("p", "rad/s", "body", "right wing down", "roll rate"),
        ("q", "rad/s", "body", "nose up", "pitch rate"),
        ("r", "rad/s", "body", "nose right", "yaw rate"),
        ("phi", "rad", "ned to body", "right wing down, -pi to pi", "bank angle"),
        ("theta", "rad", "ned to body", "nose up, -pi/2 to pi/2", "pitch angle"),
        ("psi", "rad", "ned to body", "clockwise from north, above -pi up to pi", "heading"),
        ("ax", "m/s2", "body", "forward", "specific force at the accelerometer"),
        ("ay", "m/s2", "body", "right", "specific force at the accelerometer"),
        ("az", "m/s2", "body", "down; about -9.8 at rest", "specific force at the accelerometer"),
        ("p_dot", "rad/s2", "body", "right wing down", "roll acceleration"),
        ("q_dot", "rad/s2", "body", "nose up", "pitch acceleration"),
        ("r_dot", "rad/s2", "body", "nose right", "yaw acceleration"),
        ("q0", "1", "body to ned", "continuous, either sign", "attitude quaternion, scalar part"),
        ("q1", "1", "body to ned", "right wing down", "attitude quaternion, x"),
        ("q2", "1", "body to ned", "nose up", "attitude quaternion, y"),
        ("q3", "1", "body to ned", "nose right", "attitude quaternion, z"),
        ("vn", "m/s", "ned", "north", "velocity over ground"),
        ("ve", "m/s", "ned", "east", "velocity over ground"),
        ("vd", "m/s", "ned", "down", "velocity over ground"),
        ("vn_smooth", "m/s", "ned", "north", "velocity over ground, smoothed by the accelerometers"),
        ("ve_smooth", "m/s", "ned", "east", "velocity over ground, smoothed by the accelerometers"),
        ("vd_smooth", "m/s", "ned", "down", "velocity over ground, smoothed by the accelerometers"),
        ("pn", "m", "ned", "north", "position from the origin of the log"),
        ("pe", "m", "ned", "east", "position from the origin of the log"),
        ("pd", "m", "ned", "down", "position from the origin of the log"),
        ("an", "m/s2", "ned", "north", "acceleration over ground, without gravity"),
        ("ae", "m/s2", "ned", "east", "acceleration over ground, without gravity"),
        ("ad", "m/s2", "ned", "down", "acceleration over ground, without gravity"),
        ("altitude", "m", "", "up", "height above mean sea level"),
        ("height", "m", "", "up", "height of the center of gravity above the ground below"),
        ("airspeed_pitot", "m/s", "air", "forward", "true airspeed as the pitot reports it, uncorrected"),
        (
            "airspeed_equivalent",
            "m/s",
            "air",
            "forward",
            "equivalent airspeed as the pitot reports it, uncorrected",
        ),
        ("wind_n", "m/s", "ned", "blowing towards north", "wind as logged (estimate of the autopilot)"),
        ("wind_e", "m/s", "ned", "blowing towards east", "wind as logged (estimate of the autopilot)"),
        ("density", "kg/m3", "", "", "density of the air"),
        ("pressure", "Pa", "", "", "static pressure of the air"),
        ("temperature", "K", "", "", "temperature of the air"),
        ("voltage", "V", "", "", "voltage of the main battery"),
        ("current", "A", "", "out of the battery", "current of the main battery"),
        ("thrust", "N", "body", "forward", "thrust of all propellers together", "command"),
        ("throttle", "1", "", "more power; 0 to 1", "throttle", "command"),
        ("elevator", "rad", "surface", "trailing edge down, nose down", "elevator deflection", "command"),
        ("aileron", "rad", "surface", "right edge up, right wing down", "aileron deflection", "command"),
        ("rudder", "rad", "surface", "trailing edge left, nose left", "rudder deflection", "command"),
        ("flap", "rad", "surface", "trailing edge down", "flap deflection", "command"),
        ("control_roll", "1", "", "right wing down; -1 to 1", "normalized roll command", "command"),
        ("control_pitch", "1", "", "nose up; -1 to 1", "normalized pitch command", "command"),
        ("control_yaw", "1", "", "nose right; -1 to 1", "normalized yaw command", "command"),
        ("control_throttle", "1", "", "more power; 0 to 1", "normalized throttle command", "command"),
        ("injected", "1", "", "as the autopilot adds it", "excitation added by the autopilot", "command"),
    ]
    rows += [tuple(part.format(n=n) for part in row) for size, row in NUMBERED for n in range(1, size + 1)]
    return {row[0]: Variable(*row) for row in rows}  # type: ignore[arg-type]


VARIABLES: Final[dict[str, Variable]] = _table()

OUTPUTS: Final = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az")
"""The twelve channels of the output equation, in its order."""

QUATERNION: Final = ("q0", "q1", "q2", "q3")
EULER: Final = ("phi", "theta", "psi")
RATES: Final = ("p", "q", "r")
SPECIFIC_FORCE: Final = ("ax", "ay", "az")
VELOCITY: Final = ("vn", "ve", "vd")  #: over ground
POSITION: Final = ("pn", "pe", "pd")
WRAPPED: Final = frozenset({"phi", "psi"})  #: angles that live on a circle
#: axis -> rate that a control changes, and the controls with the sign of that
EFFECTS: Final = {
    "roll": ("p", (("aileron", 1.0), ("control_roll", 1.0))),
    "pitch": ("q", (("elevator", -1.0), ("control_pitch", 1.0))),
    "yaw": ("r", (("rudder", -1.0), ("control_yaw", 1.0))),
}


#: the variables that belong together, by what they are
FAMILIES: Final[dict[str, tuple[str, ...]]] = {
    "rates": RATES, "euler": EULER, "quaternion": QUATERNION, "specific force": SPECIFIC_FORCE, "velocity": VELOCITY,
    "position": POSITION, "circular": ("phi", "psi"),
    **{row[0][:-4]: tuple(row[0].format(n=n) for n in range(1, size + 1)) for size, row in NUMBERED},
}  # fmt: skip


def variable(name: str, place: str = "") -> Variable:
    """Look a variable up.

    Raises
    ------
    FlightError
        When there is none of that name; names the nearest ones.
    """
    if name in VARIABLES:
        return VARIABLES[name]
    head = f"{place}: " if place else ""
    raise FlightError(f"{head}there is no variable '{name}'; {nearest(name, VARIABLES)}")
