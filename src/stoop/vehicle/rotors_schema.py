"""What a vehicle file may say about rotors and about the drag of the body that they carry."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from stoop.vehicle.quantity import Quantity
from stoop.vehicle.table import Name, Point, Table

MOST_ROTORS = 16  #: of one vehicle


class Rotors(Table):
    """What all rotors share; x is the normalized command or the speed of rotation, rad/s.

    x = gain (channel - idle) >= 0, times voltage / nominal_voltage where that is given, then the lag.
    Thrust = density/1.225 (T0 + T1 x + T2 x^2 - inflow x v_axial + translational v_inplane^2). With a radius, what the
    disc itself draws through joins v_axial.
    """

    drive: Literal["command", "speed"] = "command"  #: what x is: 1, or rad/s
    gain: Quantity = Quantity(value=1.0)  #: x per unit of the channel
    idle: Quantity = Quantity(value=0.0)  #: of the channel
    nominal_voltage: Quantity | None = None  #: V
    voltage_average: float | None = Field(
        default=None, gt=0.0, le=3600.0
    )  #: s, over which the voltage counts
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
            raise ValueError(f"{own} and torque_ratio both say the torque; remove one of them")
        if self.inertia is not None and self.drive != "speed":
            raise ValueError(
                'inertia needs the speed of rotation; write drive = "speed" and gain in rad/s per unit, or remove it'
            )
        return self


class Rotor(Table):
    """One rotor: what drives it, where it is, which way it turns."""

    channel: Name
    position: Point  #: m
    axis: Point | None = None  #: direction of its thrust, any length; up when absent
    spin: Literal["ccw", "cw"]  #: seen from the tip of the axis: from above for an axis that points up
    factor: Quantity | None = None  #: of all that the air does to it
    torque_factor: Quantity | None = None  #: of its torque alone


class BodyDrag(Table):
    """Force -(linear v + quadratic |v| v) and moment -(rotation omega), each per body axis."""

    linear: Point | None = None  #: N s/m
    quadratic: Point | None = None  #: N s2/m2
    rotation: Point | None = None  #: N m s
