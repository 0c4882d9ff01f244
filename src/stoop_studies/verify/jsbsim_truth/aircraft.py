"""Which stock aircraft are flown, where, how hard, and which terms their coefficients have there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

SURFACES: Final = {
    "elevator": "fcs/elevator-pos-rad",
    "aileron": "fcs/left-aileron-pos-rad",
    "rudder": "fcs/rudder-pos-rad",
}  #: the property that holds the deflection of each surface, rad


@dataclass(frozen=True)
class Stock:
    """A stock aircraft and its flight condition.

    Attributes
    ----------
    model : str
        Folder of JSBSim's data.
    title : str
    airspeed, alpha, altitude : m/s, rad, m
        Trimmed at that airspeed; the angle is where the terms count from, next to the trim's.
    amplitude : rad, by control
    throttle : 0 to 1; None with the engines off
    band : Hz, the highest frequency of the inputs
    added : text of the terms beside those of eq. (1), as in a vehicle file
    dropped : terms of eq. (1) that this aircraft is not given
    surfaces : property by control where it is not that of `SURFACES`
    words : what is to be minded, for the page
    """

    model: str
    title: str
    airspeed: float
    alpha: float
    altitude: float
    amplitude: Mapping[str, float]
    throttle: float | None = None
    band: float = 2.0
    added: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    dropped: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    surfaces: Mapping[str, str] = field(default_factory=lambda: SURFACES)
    words: str = ""


ABSOLUTE: Final = {"CDbetaabs": "abs(beta)", "CDelevator": "elevator"}  #: drag of slip and of the elevator
SLIP: Final = {
    "CL": {"CLpbeta": "p*beta"},
    "Cm": {"Cmpbeta": "p*beta"},
}  #: where the rate of the angle of attack counts: rolling in a slip changes the angle of attack

FLEET: Final = (
    Stock(
        model="c172p",
        title="Cessna 172P, engine off",
        airspeed=48.4,
        alpha=0.0262,
        altitude=1500.0,
        amplitude={"elevator": 0.04, "aileron": 0.06, "rudder": 0.08},
        added={
            **SLIP,
            "CD": {**ABSOLUTE, "CDbend1": "abs(alpha + 0.0087)", "CDbend2": "abs(alpha - 0.0087)"},
            "CQ": {"CQpalpha": "p*alpha", "CQralpha": "r*alpha"},
            "Cl": {"Clralpha": "r*alpha"},
        },
        dropped={"CD": ("CDalpha2",)},
        words="""\
Propeller at rest, descending. The crew puts the center of gravity beside the plane of symmetry, so all products of \
inertia count. Drag is a table with a row per degree and its slope has a step at each: two of them, half a degree below \
and above the angle of attack that terms count from, are flown through and stand for the square. Lift and pitching \
moment depend on the rate of the angle of attack.""",
    ),
    Stock(
        model="T37",
        title="Cessna T-37, engines at constant throttle",
        airspeed=78.0,
        alpha=0.079,
        altitude=3000.0,
        throttle=0.7,
        amplitude={"elevator": 0.03, "aileron": 0.08, "rudder": 0.08},
        added={**SLIP, "CD": ABSOLUTE},
        words="""\
A jet trainer, thrust above the center of gravity. Lift and pitching moment depend on the rate of the angle of attack.""",
    ),
    Stock(
        model="f16",
        title="F-16, flight control system off, engine at constant throttle",
        airspeed=165.0,
        alpha=0.0437,
        altitude=3000.0,
        throttle=0.6,
        amplitude={"elevator": 0.01, "aileron": 0.03, "rudder": 0.06},
        added={
            "CL": {"CLalphaelevator": "alpha*elevator"},
            "CD": {"CDelevator": "elevator", "CDq": "q", "CDalphaelevator": "alpha*elevator"},
            "CQ": {"CQaileron": "aileron", "CQpalpha": "p*alpha"},
            "Cl": {
                "Clbetaalpha": "beta*alpha",
                "Clpalpha": "p*alpha",
                "Clralpha": "r*alpha",
                "Claileronalpha": "aileron*alpha",
            },
            "Cn": {"Cnbetaalpha": "beta*alpha", "Cnpalpha": "p*alpha", "Cnaileronalpha": "aileron*alpha"},
            "Cm": {"Cmalphaelevator": "alpha*elevator"},
        },
        surfaces={**SURFACES, "aileron": "fcs/aileron-pos-rad"},
        words="""\
Tables of a wind tunnel; nothing depends on the rate of the angle of attack. Many slopes change with the angle of \
attack: products are among the terms.""",
    ),
)
