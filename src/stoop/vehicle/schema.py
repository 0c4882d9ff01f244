"""What a vehicle file may say: one pydantic model per table.

Lengths in m, masses in kg, angles in rad; body axes forward-right-down from an origin of the file's own
choice (the nose, the wing's leading edge, the centre of gravity itself).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from stoop.vehicle.quantity import Number, Quantity, Switch
from stoop.vehicle.rotors_schema import MOST_ROTORS, BodyDrag, Rotor, Rotors
from stoop.vehicle.table import Name, Point, Table

CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az")
WIND = ("vn", "ve", "vd")  #: velocity over ground, north, east, down
GROUND = (*WIND, *CHANNELS[3:])  #: what a vehicle with rotors is observed by


class Inertia(Table):
    """Moments and products of inertia about the centre of gravity, kg m2 (Ixz = integral of x z dm)."""

    xx: Quantity
    yy: Quantity
    zz: Quantity
    xz: Quantity | None = None
    xy: Quantity | None = None
    yz: Quantity | None = None


class Mass(Table):
    """Mass properties."""

    mass: Quantity  #: kg
    inertia: Inertia
    center_of_gravity: Point | None = None  #: m


class Reference(Table):
    """Reference geometry and the working point of the aerodynamic model."""

    area: Quantity  #: m2
    chord: Quantity  #: m
    span: Quantity  #: m
    airspeed: Quantity  #: V*, m/s
    alpha: Quantity = Quantity(value=0.0)  #: alpha*, rad
    moment_point: Point | None = None  #: m; the centre of gravity when absent
    rate_normalization: Literal["reference", "actual"] = "reference"  #: qc/2V* (the paper) or qc/2V


class Environment(Table):
    """Where it flies."""

    gravity: Quantity = Quantity(value=9.80665)  #: m/s2
    density: Quantity | Literal["standard", "log"] = "standard"  #: kg/m3

    @field_validator("density", mode="before")
    @classmethod
    def _words(cls, data: Any) -> Any:
        if isinstance(data, str) and data not in ("standard", "log") and not data.startswith("="):
            raise ValueError('write a number in kg/m3, "standard" or "log"')
        return data


class Term(Quantity):
    """One aerodynamic term: its coefficient and what the coefficient multiplies."""

    term: str


class Aerodynamics(Table):
    """Terms per coefficient; with ``default = true`` those of eq. (1) are there unless set to false."""

    default: Switch = True
    CL: dict[Name, Term] = Field(default_factory=dict)
    CD: dict[Name, Term] = Field(default_factory=dict)
    CQ: dict[Name, Term] = Field(default_factory=dict)
    Cl: dict[Name, Term] = Field(default_factory=dict)
    Cm: dict[Name, Term] = Field(default_factory=dict)
    Cn: dict[Name, Term] = Field(default_factory=dict)


class ConstantThrust(Table):
    """A thrust that does not change."""

    kind: Literal["constant"]
    thrust: Quantity  #: N
    position: Point | None = None  #: a point of the thrust line, m
    pitch: Quantity | None = None  #: inclination of the thrust line, nose up positive, rad


class ThrustChannel(Table):
    """A thrust that the flight holds as a channel, times a factor."""

    kind: Literal["channel"]
    channel: Name = "thrust"
    scale: Quantity = Quantity(value=1.0)
    position: Point | None = None
    pitch: Quantity | None = None


class Propeller(Table):
    """T = rho D^4 (CT0 n^2 + CT1 n V/D + CT2 (V/D)^2), n = speed_gain (channel - idle) >= 0 in rev/s."""

    kind: Literal["propeller"]
    channel: Name
    idle: Quantity = Quantity(value=0.0)
    speed_gain: Quantity
    diameter: Quantity
    CT0: Quantity
    CT1: Quantity | None = None
    CT2: Quantity | None = None
    position: Point | None = None
    pitch: Quantity | None = None


Propulsion = Annotated[ConstantThrust | ThrustChannel | Propeller, Field(discriminator="kind")]


class Control(Table):
    """A control surface: deflection = offset + sum of gain * (channel - center), then delay and lag.

    ``mix`` takes recorded channels (PWM or normalized commands) to the deflection in rad, so V-tail, elevon
    and flaperon mixers are sums of several channels. Without ``mix`` the flight holds the deflection itself.
    """

    mix: dict[Name, Quantity] | None = None  #: rad per unit of the channel
    center: dict[Name, Quantity] = Field(default_factory=dict)
    offset: Quantity | None = None  #: rad
    lag: Quantity | None = None  #: s, first order
    delay: Quantity | None = None  #: s

    @model_validator(mode="after")
    def _centers(self) -> Control:
        stray = set(self.center) - set(self.mix or {})
        if stray:
            raise ValueError(f"center names {sorted(stray)[0]}, which is not in mix")
        return self


class Sensor(Table):
    """What an instrument makes of the truth: scale * truth + bias, late by delay."""

    bias: Quantity = Quantity(value=0.0)
    scale: Quantity | None = None
    delay: Quantity | None = None  #: s
    sigma: Annotated[Number, Field(gt=0.0)] = 1.0  #: noise, the channel's unit


class Sensors(Table):
    """Instruments and where they sit."""

    V: Sensor = Sensor()
    alpha: Sensor = Sensor()
    beta: Sensor = Sensor()
    p: Sensor = Sensor()
    q: Sensor = Sensor()
    r: Sensor = Sensor()
    phi: Sensor = Sensor()
    theta: Sensor = Sensor()
    psi: Sensor = Sensor()
    ax: Sensor = Sensor()
    ay: Sensor = Sensor()
    az: Sensor = Sensor()
    estimate_biases: Switch = True  #: whether rate and acceleration biases are free unless said otherwise
    accelerometer_position: Point | None = None  #: m
    vane_position: Point | None = None  #: m
    vn: Sensor | None = None  #: of vehicles with rotors; the bias is the wind
    ve: Sensor | None = None
    vd: Sensor | None = None


class Gust(Table):
    """A Dryden gust along one axis (MIL-F-8785C)."""

    intensity: Quantity  #: sigma, root mean square, m/s
    length: Quantity  #: scale length L, m


class Turbulence(Table):
    """Gusts along the body axes, of vehicles with rotors north, east and down; an axis that is left out is calm."""

    u: Gust | None = None
    v: Gust | None = None
    w: Gust | None = None
    airspeed: Quantity | None = None  #: at which the gusts pass, m/s; V* when absent


class GroundEffect(Table):
    """Lift and thrust near the ground, by a recorded height z above it.

    Thrust of each rotor times 1 + rotor (R/4)^2 / (z^2 + (R/4)^2): Cheeseman and Bennett to first order where
    rotor = 1. CL times 1 + lift / (1 + (16 z/b)^2): McCormick's ground influence on the trailing vortices, b the span.
    """

    channel: Name = "height"  #: m
    rotor: Quantity | None = None
    lift: Quantity | None = None
    radius: Quantity | None = None  #: R of a rotor, m; that of [rotors] when absent

    @model_validator(mode="after")
    def _effect(self) -> GroundEffect:
        if self.rotor is None and self.lift is None:
            raise ValueError("there is no effect; write rotor = 1.0 for rotors, or lift = 0.1 for a wing")
        return self


class Model(Table):
    """Which equations are kept."""

    reduce: Literal["full", "longitudinal", "lateral"] = "full"


class VehicleFile(Table):
    """The whole file."""

    format: Literal["stoop-vehicle/1"] = "stoop-vehicle/1"
    name: str = Field(max_length=200)
    notes: tuple[str, ...] = ()
    model: Model = Model()
    mass: Mass
    reference: Reference | None = None  #: only a vehicle with rotors goes without
    environment: Environment = Environment()
    aerodynamics: Aerodynamics = Aerodynamics()
    propulsion: Propulsion | None = None
    controls: dict[Name, Control] = Field(default_factory=dict)
    sensors: Sensors = Sensors()
    turbulence: Turbulence | None = None
    loadings: dict[Name, dict[str, Number]] = Field(default_factory=dict)  #: what differs per maneuver
    rotors: Rotors | None = None
    rotor: Annotated[dict[Name, Rotor], Field(max_length=MOST_ROTORS)] = Field(default_factory=dict)
    body_drag: BodyDrag | None = None
    ground_effect: GroundEffect | None = None

    @model_validator(mode="after")
    def _complete(self) -> VehicleFile:
        if self.reference is None and not self.rotor:
            raise ValueError("reference: missing; add it")
        if self.rotor and self.rotors is None:
            raise ValueError("rotors: missing; add it with T2, the thrust of one rotor at full command, N")
        if self.rotors is not None and not self.rotor:
            raise ValueError("rotor: missing; add a table for each rotor, e.g. [rotor.m1]")
        near = self.ground_effect
        if near is not None and near.lift is not None and self.reference is None:
            raise ValueError("ground_effect.lift: needs the span of a wing; add [reference], or remove it")
        if near is not None and near.rotor is not None:
            radius = near.radius or (self.rotors and self.rotors.radius)
            if not radius:
                raise ValueError("ground_effect.radius: missing; add it, the radius of a rotor in m")
        return self
