"""Vehicle files: one pydantic model per table.

Lengths in m, masses in kg, angles in rad; body axes forward-right-down from an origin of the file's own choice (the
nose, the leading edge of the wing, the center of gravity).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

from stoop.base.numbers import MAX_NUMBER

CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az")
WIND = ("vn", "ve", "vd")  #: velocity over ground, north, east, down
GUESS = 0.3  #: standard deviation of a guess, in parts of the value

Switch = Annotated[bool, Field(strict=True)]  #: true or false, not "no" or 0


def _within_range(value: float) -> float:
    """Return a number, zero for one so small that its inverse is out of range."""
    if abs(value) > MAX_NUMBER:
        raise ValueError(f"{value:g} is out of range (1e30); write it in SI units")
    return value if abs(value) >= 1.0 / MAX_NUMBER else 0.0


#: no text, no true or false, no nan
Number = Annotated[float, Field(strict=True, allow_inf_nan=False), AfterValidator(_within_range)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=40)]


class Table(BaseModel):
    """A table of the file: no unknown keys, immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Quantity(BaseModel):
    """One number: ``0.3``, a tie ``"=other.number"``, or a table with bounds, freedom and prior."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    value: Number = 0.0  #: SI units and radians
    bounds: tuple[Number, Number] | None = None  #: of the estimate
    free: Switch | None = None  #: true to estimate, false to fix; when absent by prior and kind of number
    #: standard deviation around the value; "guess": `GUESS`
    prior: Annotated[Number, Field(gt=0.0)] | None = None
    mean: Number | None = None  #: that the prior is about; the value when absent
    tie: str | None = None  #: name of the number that this one equals

    @property
    def prior_mean(self) -> float:
        """Mean of the prior."""
        return self.value if self.mean is None else self.mean

    @model_validator(mode="before")
    @classmethod
    def _short_forms(cls, data: Any) -> Any:
        if isinstance(data, bool):
            raise ValueError("write a number here, not true or false")
        if isinstance(data, int | float):
            return {"value": data}
        if isinstance(data, str):
            return {"tie": tied(data)}
        if not isinstance(data, dict | Quantity):
            raise ValueError(
                'write a number, "=name", or a table such as { value = 0.3, bounds = [0.1, 0.5] }'
            )
        if isinstance(data, dict) and data.get("prior") == "guess":
            value = data.get("value", 0.0)
            if not isinstance(value, int | float) or isinstance(value, bool) or not value:
                raise ValueError('prior = "guess" needs a value other than zero; write prior = SIGMA instead')
            return {**data, "prior": GUESS * abs(value)}
        return data

    @model_validator(mode="after")
    def _consistent(self) -> Quantity:
        others = self.model_fields_set & {"value", "bounds", "free", "prior", "mean"}
        if self.tie is not None and others:
            raise ValueError(f"a tied number takes all from '{self.tie}'; remove {min(others)}")
        if self.mean is not None and self.prior is None:
            raise ValueError("mean is that of a prior; add prior = SIGMA, or remove mean")
        if self.bounds is not None:
            low, high = self.bounds
            if not low < high:
                raise ValueError(
                    f"bounds [{low:g}, {high:g}] are reversed or empty; write the lower one first"
                )
            if not low <= self.value <= high:
                raise ValueError(
                    f"value {self.value:g} lies outside its bounds [{low:g}, {high:g}]; widen them"
                )
        return self


def tied(text: str) -> str:
    """Return the name in a tie ``"=name"``."""
    if not text.startswith("=") or not text[1:].strip():
        raise ValueError('write a number, or "=name" to tie it to another number')
    return text[1:].strip()


Point = tuple[Quantity, Quantity, Quantity]


class Inertia(Table):
    """Moments and products of inertia about the center of gravity, kg m2 (Ixz = integral of x z dm)."""

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
    moment_point: Point | None = None  #: m; the center of gravity when absent
    #: moments of inertia (roll, pitch, yaw) for which the moment coefficients hold, kg m2; those of [mass] when absent
    inertia: Point | None = None
    rate_normalization: Literal["reference", "actual"] = "actual"  #: qc/2V* (the paper) or qc/2V


class Environment(Table):
    """Gravity and air density."""

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
    """Terms per coefficient; with ``default = true`` those of eq. (1) are included unless set to false."""

    default: Switch = True
    CL: dict[Name, Term] = Field(default_factory=dict)
    CD: dict[Name, Term] = Field(default_factory=dict)
    CQ: dict[Name, Term] = Field(default_factory=dict)
    Cl: dict[Name, Term] = Field(default_factory=dict)
    Cm: dict[Name, Term] = Field(default_factory=dict)
    Cn: dict[Name, Term] = Field(default_factory=dict)


class ConstantThrust(Table):
    """A constant thrust."""

    kind: Literal["constant"]
    thrust: Quantity  #: N
    position: Point | None = None  #: a point of the thrust line, m
    pitch: Quantity | None = None  #: inclination of the thrust line, nose up positive, rad


class ThrustChannel(Table):
    """A thrust that is a channel of the flight, times a factor."""

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
    #: about the thrust line, kg m2; negative where it turns counterclockwise from behind
    inertia: Quantity | None = None
    position: Point | None = None
    pitch: Quantity | None = None


Propulsion = Annotated[ConstantThrust | ThrustChannel | Propeller, Field(discriminator="kind")]


class Control(Table):
    """A control surface: deflection = offset + sum of gain * (channel - center), then lag.

    ``mix`` takes recorded channels (PWM or normalized commands) to the deflection in rad, so V-tail, elevon and
    flaperon mixers are sums of several channels. Without ``mix`` the channel is the deflection itself. Each channel
    passes the dead zone, the rate limit and the delay of its servo first.
    """

    mix: dict[Name, Quantity] | None = None  #: rad per unit of the channel
    center: dict[Name, Quantity] = Field(default_factory=dict)
    offset: Quantity | None = None  #: rad
    lag: Quantity | None = None  #: s, first order
    delay: Quantity | None = None  #: s
    rate_limit: Quantity | None = None  #: of the servo, rad/s of the deflection
    dead_zone: Quantity | None = None  #: of the servo, rad: change of the command that its reversal takes

    @model_validator(mode="after")
    def _centers(self) -> Control:
        unknown = set(self.center) - set(self.mix or {})
        if unknown:
            raise ValueError(f"center names {min(unknown)}, which is not in mix")
        return self


class Sensor(Table):
    """An instrument: reading = scale * truth + bias, late by delay."""

    bias: Quantity = Quantity(value=0.0)
    scale: Quantity | None = None
    delay: Quantity | None = None  #: s
    sigma: Annotated[Number, Field(gt=0.0)] = 1.0  #: noise, the channel's unit


class Sensors(Table):
    """Instruments and their positions."""

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
    estimate_biases: Switch = True  #: whether rate and acceleration biases are free by default
    accelerometer_position: Point | None = None  #: m
    vane_position: Point | None = None  #: m
    #: roll, pitch, yaw of the inertial unit's axes against those of the body, rad
    imu_alignment: Point | None = None
    #: m/s, north, east and down: of the wind by which flow angles were reconstructed, and the airspeed without a scale
    wind_error: Point | None = None
    vn: Sensor | None = None  #: of vehicles with rotors; the bias is the wind
    ve: Sensor | None = None
    vd: Sensor | None = None
    #: north, east and down, by motion capture in still air: one brings the others
    pn: Sensor | None = None
    pe: Sensor | None = None
    pd: Sensor | None = None


class Gust(Table):
    """A Dryden gust along one axis (MIL-F-8785C)."""

    intensity: Quantity  #: sigma, root mean square, m/s
    length: Quantity  #: scale length L, m


class Turbulence(Table):
    """Gusts along the body axes, of vehicles with rotors north, east and down; an absent axis is calm."""

    u: Gust | None = None
    v: Gust | None = None
    w: Gust | None = None
    airspeed: Quantity | None = None  #: at which the gusts pass, m/s; V* when absent


class Rotors(Table):
    """What all rotors share; x is the normalized command or the speed of rotation, rad/s.

    x = gain (channel - idle) >= 0, times voltage / nominal_voltage where that is given, then the lag.
    Thrust = density/1.225 (T0 + T1 x + T2 x^2 - inflow x v_axial + translational v_inplane^2). With a radius, the
    induced velocity of the disc adds to v_axial.
    """

    drive: Literal["command", "speed"] = "command"  #: what x is: 1, or rad/s
    gain: Quantity = Quantity(value=1.0)  #: x per unit of the channel
    idle: Quantity = Quantity(value=0.0)  #: of the channel
    nominal_voltage: Quantity | None = None  #: V
    #: s, of the voltage that counts
    voltage_average: Annotated[float, Field(gt=0.0, le=3600.0)] | None = None
    lag: Quantity | None = None  #: s, first order
    delay: Quantity | None = None  #: s, of the recorded channels
    T0: Quantity | None = None  #: N
    T1: Quantity | None = None  #: N per unit of x
    T2: Quantity | None = None  #: N per unit of x squared
    inflow: Quantity | None = None  #: N s/m per unit of x
    translational: Quantity | None = None  #: N s2/m2
    radius: Quantity | None = None  #: of the disc, m
    drag: Quantity | None = None  #: N s/m per unit of x, in the plane of the disc
    drag_inflow: Quantity | None = None  #: N s2/m2, in the plane of the disc
    Q0: Quantity | None = None  #: N m
    Q1: Quantity | None = None  #: N m per unit of x
    Q2: Quantity | None = None  #: N m per unit of x squared
    torque_ratio: Quantity | None = None  #: torque over thrust, m
    inertia: Quantity | None = None  #: of one rotor about its axis, kg m2

    @model_validator(mode="after")
    def _consistent(self) -> Rotors:
        if self.T0 is None and self.T1 is None and self.T2 is None:
            raise ValueError("there is no thrust; write T2 (and T1, T0), e.g. T2 = 30.0")
        own = next((q for q in ("Q0", "Q1", "Q2") if getattr(self, q) is not None), None)
        if own is not None and self.torque_ratio is not None:
            raise ValueError(f"{own} and torque_ratio both give the torque; remove one of them")
        if self.inertia is not None and self.drive != "speed":
            raise ValueError(
                'inertia needs the speed of rotation; write drive = "speed" and gain in rad/s per unit, or remove it'
            )
        return self


class Rotor(Table):
    """One rotor: its channel, position, axis and sense of rotation."""

    channel: Name
    position: Point  #: m
    axis: Point | None = None  #: direction of its thrust, any length; up when absent
    spin: Literal["ccw", "cw"]  #: seen from the tip of the axis: from above for an axis that points up
    factor: Quantity | None = None  #: of all its aerodynamic loads
    torque_factor: Quantity | None = None  #: of its torque alone


class BodyDrag(Table):
    """Force -(linear v + quadratic |v| v) and moment -(rotation omega), each per body axis."""

    linear: Point | None = None  #: N s/m
    quadratic: Point | None = None  #: N s2/m2
    rotation: Point | None = None  #: N m s


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
    """Equations of motion that are kept."""

    reduce: Literal["full", "longitudinal", "lateral"] = "full"


class VehicleFile(Table):
    """The whole file."""

    format: Literal["stoop-vehicle/1"] = "stoop-vehicle/1"
    name: str = Field(max_length=200)
    notes: tuple[str, ...] = ()
    model: Model = Model()
    mass: Mass
    reference: Reference | None = None  #: only a vehicle with rotors can omit it
    environment: Environment = Environment()
    aerodynamics: Aerodynamics = Aerodynamics()
    propulsion: Propulsion | None = None
    controls: dict[Name, Control] = Field(default_factory=dict)
    sensors: Sensors = Sensors()
    turbulence: Turbulence | None = None
    #: numbers that differ per maneuver
    loadings: Annotated[dict[Name, dict[str, Number]], Field(max_length=64)] = Field(default_factory=dict)
    rotors: Rotors | None = None
    rotor: Annotated[dict[Name, Rotor], Field(max_length=16)] = Field(default_factory=dict)
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
