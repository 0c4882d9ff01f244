"""Formulas of parameters of an autopilot that are physics, as the firmware defines them.

Each row of :data:`TABLE` is a parameter of a firmware and its formula in numbers, steady flights and linear models of a vehicle,
evaluated in lanes that differ in their numbers. A formula says by a StoopError why the vehicle does not tell the parameter.

References
----------
.. [1] PX4-Autopilot, src/modules/ekf2/EKF/aid_sources/drag/drag_fusion.cpp
.. [2] ArduPilot, libraries/AP_NavEKF3/AP_NavEKF3_AirDataFusion.cpp (FuseDragForces)
.. [3] PX4-Autopilot, src/lib/mixer_module/functions/FunctionMotors.hpp
.. [4] ArduPilot, libraries/AP_Motors/AP_Motors_Thrust_Linearization.cpp, AP_MotorsMulticopter.cpp
.. [5] PX4-Autopilot, src/modules/fw_rate_control/FixedwingRateControl.cpp
.. [6] PX4-Autopilot, src/lib/fw_performance_model/PerformanceModel.cpp, and the parameters of FW TECS
.. [7] ArduPilot, libraries/AP_TECS/AP_TECS.cpp, ArduPlane/Parameters.cpp, ArduPlane/Attitude.cpp
.. [8] PX4-Autopilot, src/modules/airspeed_selector; ArduPilot, libraries/AP_Airspeed/AP_Airspeed.cpp
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np

from stoop import Vehicle, trim
from stoop.extend import motion
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop.extend.flights import RECONSTRUCTED
from stoop.extend.units import SEA_LEVEL_DENSITY
from stoop.extend.verbs import hook
from stoop_analysis.propagation.wing_figures import Domain
from stoop_tune.control_laws import ardupilot, px4
from stoop_tune.control_laws.mixing import thrust_of
from stoop_tune.control_laws.parameters import Parameters
from stoop_tune.control_laws.rate_law import AXES

COMMANDS: Final = 21  #: of a thrust curve
CURVE: Final = 3  #: of them, least that its square needs
NOT_POSITIVE: Final = 0.0013  #: share of draws, of a normal distribution three standard errors above zero
Altitude = Callable[[float], float]  #: a factor by the ratio of the density to that at sea level
Names = tuple[tuple[str, float], ...]  #: of an airspeed: newest first, and its unit, m/s


@dataclass(frozen=True, eq=False)
class Flights:
    """Steady flights, one a lane."""

    points: motion.Trims
    climb: FloatArray  #: sine of the flight-path angle (B,)
    none: FloatArray  #: (B,) zero, NaN where there is none


@dataclass(frozen=True, eq=False)
class Candidates:
    """A vehicle at its estimates and at draws of its numbers, B lanes."""

    vehicle: Vehicle
    parameters: Mapping[str, float]  #: of the autopilot
    domain: Domain
    streams: frozenset[str]  #: of the log, that the airspeed is from
    numbers: Mapping[str, FloatArray]
    count: int
    reading: float = 1.0  #: of the pitot over the airspeed of the model
    known: dict[tuple[float | None, float | None], Flights] = field(default_factory=dict, init=False)

    def number(self, name: str) -> FloatArray:
        """Return a number of the vehicle (B,)."""
        if name not in self.vehicle.rows:
            raise StoopError(f"the vehicle file has no {name}")
        return np.asarray(self.numbers.get(name, np.full(self.count, self.vehicle.value(name))))

    @property
    def density_ratio(self) -> float:
        """Density in the fitted flight over that at sea level."""
        return self.domain.density / SEA_LEVEL_DENSITY

    def steady(self, speed: float | None = None, throttle: float | None = None) -> Flights:
        """Return steady flights in still air: hover, level at an airspeed, or at a throttle that does not hold the height."""
        if (speed, throttle) not in self.known:
            self.known[speed, throttle] = self._steady(speed, throttle)
        return self.known[speed, throttle]

    def _steady(self, speed: float | None, throttle: float | None) -> Flights:
        at = self.domain
        point = trim(self.vehicle, speed, at.altitude, density=at.density, wind=(0.0, 0.0, 0.0))
        if point.solution is None:
            raise StoopError("there is no steady flight")
        known, x = point.solution
        rows = known.at.vehicle.parameter_rows({**self.numbers, **known.numbers}, self.count)
        flight = replace(known, rows=rows)
        if throttle is not None and isinstance(flight, motion.OnWings):
            quiet = known.at.quiet.copy()
            if throttle:
                quiet[self.vehicle.inputs.index(self.throttle)] = throttle
            free = replace(flight, at=replace(known.at, quiet=quiet), powered=False)
            x = x[[name in free.unknowns for name in flight.unknowns]]
            flight = free
        found, solved = flight.solve(np.repeat(x[:, None], self.count, axis=1))
        points = flight.trims(found)
        climb = flight.balance(points)[1] if isinstance(flight, motion.OnWings) else np.zeros(self.count)
        return Flights(points, climb, np.where(solved, 0.0, np.nan))

    def airspeed(self, names: Names) -> float:
        """Return a true airspeed, m/s, of the parameters, where the vehicle was flown."""
        known = [(name, unit) for name, unit in names if self.parameters.get(name, 0.0) > 0.0]
        if not known:
            raise StoopError(f"the parameters have no {names[0][0]}")
        name, unit = known[0]
        true = unit * self.parameters[name] / math.sqrt(self.domain.density / SEA_LEVEL_DENSITY)
        speed, (low, high) = true / self.reading, self.domain.airspeed
        if not low <= speed <= high:
            raise StoopError(
                f"{name} is a true airspeed of {speed:.4g} m/s, flown was {low:.4g} to {high:.4g} m/s"
            )
        return speed

    @property
    def throttle(self) -> str:
        """The channel of the throttle from 0 to 1."""
        power = self.vehicle.file.propulsion
        channel = power.channel if power is not None and power.kind == "propeller" else ""
        if channel.partition("_")[0] not in {"throttle", "control", "motor"}:
            raise StoopError("the thrust is not modeled over a throttle from 0 to 1")
        return channel

    def require_pitot(self) -> None:
        """Refuse a scale of V that is no reading of the pitot."""
        if RECONSTRUCTED in self.streams:
            raise StoopError("V was reconstructed, not read from the pitot alone")

    def channel(self, points: motion.Trims, name: str) -> FloatArray:
        """Return a recorded channel of flights (B,)."""
        if name not in self.vehicle.inputs:
            raise StoopError(f"the model is not moved by {name}")
        return np.asarray(points.inputs[self.vehicle.inputs.index(name)])


Formula = Callable[[Candidates], FloatArray]


@dataclass(frozen=True)
class Row:
    """A parameter of a firmware: what it is in terms of the vehicle."""

    name: str
    unit: str
    formula: Formula  #: its values (B,); a StoopError says why there are none
    range: tuple[float, float] = (-math.inf, math.inf)  #: that the firmware takes
    whole: bool = False  #: an integer
    #: thrust curve and pitot change the gain of the rate loops, for which the gains of the same file are not made
    written: bool = True


def ballistic_coefficient(axis: str, own: Altitude, c: Candidates) -> FloatArray:
    """Mass over drag area: EKF subtracts rho / 2 V V_axis / coefficient; the body's drag is quadratic |V_axis| V_axis / mass."""
    drag = c.number(f"body_drag.quadratic.{axis}")
    if np.mean(drag[1:] <= 0.0) > NOT_POSITIVE:
        raise StoopError("the drag of the body is not three standard errors above zero")
    density = SEA_LEVEL_DENSITY * own(c.density_ratio)
    with np.errstate(divide="ignore"):
        return np.where(drag > 0.0, 0.5 * density * c.number("mass.mass") / drag, np.nan)


def momentum_drag(own: Altitude, c: Candidates) -> FloatArray:
    """Decrease of the velocity per s over the velocity, along x and y about hover, at sea level."""
    hover = c.steady()
    names, A, *_ = motion.linear_models(c.vehicle, hover.points)
    along, across = (A[:, i, i] for i in (names.index("u"), names.index("v")))
    return np.asarray(-0.5 * (along + across) / own(c.density_ratio) + hover.none)


@dataclass(frozen=True)
class Motors:
    """How a firmware commands motors: from channels to commands from 0 to 1, and the curve behind them."""

    command: Callable[[Mapping[str, float], str, FloatArray], FloatArray]
    curve: tuple[str, float]  #: parameter and its default
    compensated_by: tuple[str, ...] = ()  #: parameters that switch on a compensation of the battery's voltage

    def commands(self, c: Candidates, channel: FloatArray) -> FloatArray:
        """Return commands from 0 to 1 for a channel of the rotors."""
        on = [name for name in self.compensated_by if c.parameters.get(name, 0.0) > 0.0]
        if on:
            raise StoopError(f"thrust is compensated for the battery ({on[0]})")
        kind = next(iter(c.vehicle.file.rotor.values())).channel.partition("_")[0]
        return self.command(c.parameters, kind, channel)

    def hover(self, c: Candidates) -> FloatArray:
        """Thrust setpoint in hover: curve of the command, the mean of the motors, by the curve that flew."""
        hover, curve = c.steady(), Parameters(c.parameters, "autopilot").number(*self.curve, -1.0)
        commands = self.commands(c, hover.points.inputs[c.vehicle.rotor_range.columns])
        return np.asarray(thrust_of(curve, commands).mean(axis=0) + hover.none)

    def expo(self, c: Candidates) -> FloatArray:
        """Share F of the square for which thrust is straight over the setpoint F c^2 + (1 - F) c, by least squares."""
        hover, area = c.steady(), c.vehicle.rotor_range
        channel = np.linspace(float(area.idle[0]), float(area.full.min()), COMMANDS)
        command = self.commands(c, channel)
        inside = (command >= 0.0) & (command <= 1.0)
        if np.count_nonzero(inside) < CURVE:
            raise StoopError("the channels of the rotors are not pulses of this range")
        lift = []
        for x in channel[inside]:
            inputs = hover.points.inputs.copy()
            inputs[area.columns] = x
            sink = c.vehicle.accelerations({"h": c.domain.altitude}, inputs, hover.points.rows, ("w",))[0]
            lift.append(c.number("environment.gravity") - sink)
        square, linear, _ = np.polyfit(command[inside], np.array(lift), 2)
        return np.asarray(square / (linear + square) + hover.none)


def pitch_offset(names: Names, unit: float, c: Candidates) -> FloatArray:
    """Pitch angle of level flight, deg over the unit of the parameter."""
    level = c.steady(c.airspeed(names))
    return np.asarray(np.degrees(level.points.start["theta"]) / unit + level.none)


def level_throttle(names: Names, unit: float, own: Altitude, c: Candidates) -> FloatArray:
    """Throttle of level flight; the speed of a propeller grows with the true airspeed."""
    level = c.steady(c.airspeed(names))
    return np.asarray(c.channel(level.points, c.throttle) * own(c.density_ratio) / unit + level.none)


def surface_trim(names: Names, axis: str, c: Candidates) -> FloatArray:
    """Command about an axis in level flight; where outputs move the surfaces, it is the sum of their parts of it."""
    level = c.steady(c.airspeed(names))
    surfaces = hook("read_setup", "stoop tune", object)(c.parameters).surfaces
    if f"control_{axis}" in c.vehicle.inputs or not surfaces:
        return np.asarray(c.channel(level.points, f"control_{axis}") + level.none)
    total = level.none
    for surface in surfaces:
        servo, *others = surface.channels
        channel = next((n for n in (servo, *others) if n in c.vehicle.inputs), servo)
        scale, center = surface.channels[channel], int(servo.rpartition("_")[2]) - 1
        output = (c.channel(level.points, channel) - scale.zero) / scale.unit
        output = output - c.parameters.get(f"CA_SV_CS{center}_TRIM", 0.0)
        total = total + surface.shares[AXES.index(axis)] * output
    return np.asarray(total)


def climb_rate(
    names: Names, throttle: tuple[str, float, float], own: Altitude, sign: float, c: Candidates
) -> FloatArray:
    """Climb rate at the throttle of a parameter (name, default, unit), m/s; the sink rate by the other sign."""
    name, default, unit = throttle
    speed = c.airspeed(names)
    flights = c.steady(speed, unit * c.parameters.get(name, default))
    return np.asarray(sign * speed * flights.climb * own(c.density_ratio) + flights.none)


def pitot_scale(c: Candidates) -> FloatArray:
    """Calibrated over indicated airspeed; `airspeed_validated` is scaled by what flew, `airspeed` is not."""
    c.require_pitot()
    flown = c.parameters["ASPD_SCALE_1"] if any("validated" in one for one in c.streams) else 1.0
    return flown / c.number("sensors.V.scale")


def pitot_ratio(c: Candidates) -> FloatArray:
    """Twice the pressure difference over density and square of the airspeed: readings grow by its root."""
    c.require_pitot()
    return np.asarray(c.parameters["ARSPD_RATIO"] / c.number("sensors.V.scale") ** 2)


def _unscaled(_: float) -> float:
    return 1.0


def _eas2tas_root(ratio: float) -> float:
    """Root of true over equivalent airspeed, by which ArduPilot multiplies density and momentum drag [2]_."""
    return float(ratio**-0.25)


PX4_MOTORS: Final = Motors(px4.motor_command, ("THR_MDL_FAC", 0.0))
COPTER_MOTORS: Final = Motors(
    ardupilot.motor_command, ("MOT_THST_EXPO", 0.65), ("MOT_BAT_VOLT_MAX", "MOT_BAT_V_MAX")
)
PX4_TRIM: Final[Names] = (("FW_AIRSPD_TRIM", 1.0),)
PX4_SLOW: Final[Names] = (("FW_AIRSPD_MIN", 1.0),)
PX4_FAST: Final[Names] = (("FW_AIRSPD_MAX", 1.0),)
CRUISE: Final[Names] = (("AIRSPEED_CRUISE", 1.0), ("TRIM_ARSPD_CM", 0.01))
SHARE: Final = (0.0, 1.0)
#: of ballistic coefficient and momentum drag, below which both filters ignore them
HEAVY: Final = (1.0, math.inf)
MOVING: Final = (0.001, math.inf)
#: firmware -> its parameters
TABLE: Final[Mapping[str, tuple[Row, ...]]] = {
    "PX4 multicopter": (
        *(Row(f"EKF2_BCOEF_{a.upper()}", "kg/m2", partial(ballistic_coefficient, a, float), HEAVY) for a in "xy"),
        Row("EKF2_MCOEF", "1/s", partial(momentum_drag, math.sqrt), MOVING),
        Row("MPC_THR_HOVER", "1", PX4_MOTORS.hover, SHARE),
        Row("THR_MDL_FAC", "1", PX4_MOTORS.expo, SHARE, written=False),
    ),
    "ArduCopter": (
        *(Row(f"EK3_DRAG_BCOEF_{a.upper()}", "kg/m2", partial(ballistic_coefficient, a, _eas2tas_root), HEAVY)
          for a in "xy"),
        Row("EK3_DRAG_MCOEF", "1/s", partial(momentum_drag, _eas2tas_root), MOVING),
        Row("MOT_THST_HOVER", "1", COPTER_MOTORS.hover, SHARE),
        Row("MOT_THST_EXPO", "1", COPTER_MOTORS.expo, (-1.0, 1.0), written=False),
    ),
    "PX4 fixed wing": (
        Row("FW_PSP_OFF", "deg", partial(pitch_offset, PX4_TRIM, 1.0)),
        *(Row(name, "1", partial(level_throttle, at, 1.0, math.sqrt), SHARE)
          for name, at in (("FW_THR_TRIM", PX4_TRIM), ("FW_THR_ASPD_MIN", PX4_SLOW), ("FW_THR_ASPD_MAX", PX4_FAST))),
        *(Row(f"TRIM_{a.upper()}", "1", partial(surface_trim, PX4_TRIM, a), (-0.5, 0.5)) for a in AXES),
        Row("FW_T_CLMB_MAX", "m/s", partial(climb_rate, PX4_TRIM, ("FW_THR_MAX", 1.0, 1.0), _unscaled, 1.0), MOVING),
        Row("FW_T_SINK_MIN", "m/s", partial(climb_rate, PX4_TRIM, ("FW_THR_MIN", 0.0, 1.0), math.sqrt, -1.0), MOVING),
        Row("ASPD_SCALE_1", "1", pitot_scale, (0.5, 2.0), written=False),
    ),
    "ArduPlane": (
        Row("PTCH_TRIM_DEG", "deg", partial(pitch_offset, CRUISE, 1.0)),
        Row("TRIM_PITCH_CD", "0.01 deg", partial(pitch_offset, CRUISE, 0.01), whole=True),
        Row("TRIM_THROTTLE", "%", partial(level_throttle, CRUISE, 0.01, _unscaled), (0.0, 100.0), whole=True),
        Row("TECS_CLMB_MAX", "m/s", partial(climb_rate, CRUISE, ("THR_MAX", 75.0, 0.01), _unscaled, 1.0), MOVING),
        Row("TECS_SINK_MIN", "m/s", partial(climb_rate, CRUISE, ("THR_MIN", 0.0, 0.01), _unscaled, -1.0), MOVING),
        Row("ARSPD_RATIO", "1", pitot_ratio, (0.5, 5.0), written=False),
    ),
}  # fmt: skip
