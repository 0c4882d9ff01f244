"""A vehicle file as it is written: entries with a comment of what each is, where it is from, how sure; common tables.

Every kind of vehicle has the tables of mass and inertia, surfaces, rotors and sensors.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import tomlkit

from stoop.extend.files import toml
from stoop.extend.text import printable
from stoop.extend.vehicles import USUAL as ASSUMED
from stoop_draft.checks.lines import POSITION, SPECIFIC_FORCE
from stoop_draft.vehicle_draft.apriori import Apriori
from stoop_draft.vehicle_draft.controls import Controls, recorded
from stoop_draft.vehicle_draft.power import USUAL, Lift, hover_level, thrust_law
from stoop_draft.vehicle_draft.request import Evidence, Request
from stoop_draft.vehicle_draft.steady import Steady, steady_flight

CAPTURE_NOISE: Final = 0.002  #: m, usual of motion capture
WEIGHING: Final = 0.01  #: standard error of a mass as weighed, relative
MEANINGS: Final[Mapping[str, str]] = {
    "CL0": "lift at V* and alpha*", "CLalpha": "lift slope", "CLq": "lift by pitch rate", "CLV": "by airspeed",
    "CLelevator": "lift of the elevator",
    "CD0": "drag at V* and alpha*", "CDalpha": "slope of the drag", "CDalpha2": "its curvature", "CDV": "by airspeed",
    "CQ0": "asymmetry", "CQbeta": "side force by sideslip", "CQp": "by roll rate", "CQr": "by yaw rate",
    "CQrudder": "side force of the rudder", "CQV": "by airspeed",
    "Cl0": "asymmetry", "Clbeta": "dihedral effect", "Clp": "roll damping", "Clr": "roll by yaw rate",
    "Claileron": "roll of the ailerons", "Clrudder": "roll of the rudder",
    "Cm0": "pitching moment at V* and alpha*", "Cmalpha": "static stability in pitch", "Cmq": "pitch damping",
    "CmV": "by airspeed", "Cmelevator": "pitch of the elevator",
    "Cn0": "asymmetry", "Cnbeta": "directional stability", "Cnp": "yaw by roll rate", "Cnr": "yaw damping",
    "Cnaileron": "adverse yaw", "Cnrudder": "yaw of the rudder",
}  # fmt: skip  #: of the terms of eq. (1)


def plain(value: float) -> str:
    """Return a number with four digits, as TOML writes it."""
    text = f"{value + 0.0:.4g}"
    return text if any(c in text for c in ".e") else f"{text}.0"


def quantity(value: float, prior: float, free: bool = True) -> str:
    """Return a number with its prior as a vehicle file has it, free or held."""
    held = "" if free else ", free = false"
    return f"{{ value = {plain(value)}, prior = {plain(float(f'{prior:.2g}'))}{held} }}"


def known(one: Apriori, free: bool = True) -> str:
    """Return a number with its prior, free or held."""
    return quantity(one.value, one.std, free)


def mixture(gains: Mapping[str, float]) -> str:
    """Return channels and numbers as an inline table."""
    return (
        "{ "
        + ", ".join(f"{tomlkit.key(name).as_string()} = {plain(gain)}" for name, gain in gains.items())
        + " }"
    )


def point(parts: Sequence[str]) -> str:
    """Return three numbers as a list."""
    return f"[{', '.join(parts)}]"


@dataclass
class Sheet:
    """Lines of a file."""

    lines: list[str] = field(default_factory=list)

    def remark(self, *texts: str) -> None:
        """Add comments on lines of their own."""
        self.lines += [f"# {printable(text)}" for text in texts]

    def table(self, name: str, comment: str = "") -> None:
        """Begin a table."""
        tail = f" # {printable(comment)}" if comment else ""
        self.lines += ["", f"[{name}]{tail}"]

    def entry(self, key: str, value: str, comment: str = "") -> None:
        """Add a number or a list that is written as TOML."""
        tail = f" # {printable(comment)}" if comment else ""
        self.lines.append(f"{key} = {value}{tail}")

    def word(self, key: str, value: str, comment: str = "") -> None:
        """Add a text."""
        self.entry(key, toml.quoted(value), comment)

    def text(self) -> str:
        """Return the file."""
        return "\n".join([*self.lines, ""])


@dataclass(frozen=True)
class Priors:
    """Standard deviations of numbers that neither logs nor drawings give."""

    throw: float = 0.35  #: of the gain of a mixer over its value: full throws are 0.2 to 0.6 rad
    middle: float = 0.06  #: rad, of the middle of a surface whose deflection was not recorded
    lever: float = 0.03  #: of the span: distance of the accelerometers from the center of gravity
    frame: float = 0.1  #: of the largest distance between motors, likewise
    vane: float = 0.15  #: of the span, how far a vane may be ahead
    pitot: float = 0.05  #: of the airspeed: position error of a pitot that nobody calibrated
    unequal: float = 0.25  #: by which left and right of a pair of surfaces differ that are one elevator
    power: float = 0.3  #: electric, over that of the usual drag: less drives no propeller
    thrust: float = 0.05  #: of the weight; less is the error of accelerometers and attitude


PRIORS: Final = Priors()
LAG: Final = Apriori(ASSUMED.lag, ASSUMED.lag_std, "usual of hobby servos")
DELAY: Final = Apriori(ASSUMED.delay, ASSUMED.delay_std, "of autopilot and logger together")


class FileText:
    """The text of a file as it grows: what both kinds of vehicle share."""

    def __init__(self, request: Request, seen: Evidence) -> None:
        self.request, self.seen, self.sheet = request, seen, Sheet()
        self.template, self.mass = str(request.template), float(request.mass or 0.0)
        self.lift = seen.lift(self.template, request.span)

    @property
    def on_rotors(self) -> bool:
        """Whether there are rotors that lift, and a log, if there is one, shows that they turn."""
        flight, rotors = self.seen.flight, self.lift.rotors if self.lift is not None else ()
        return bool(rotors) and (flight is None or any(recorded(flight, rotor.channel) for rotor in rotors))

    def head(self, size: str) -> None:
        """Write what the file is."""
        logs = ", ".join(flight.name for flight in self.seen.flights) or "no log"
        autopilot = self.seen.setup.autopilot
        self.sheet.remark(
            f"Drafted by stoop vehicle new: template {self.template}, {self.mass:g} kg, {size}; log: {logs}"
            f"{f', parameters of {autopilot}' if autopilot else ''}.",
            "prior: standard deviation of what is known beforehand; what has one, and is free, is estimated.",
            "Correct what you know better.",
        )
        self.sheet.word("format", "stoop-vehicle/1")
        self.sheet.word("name", self.request.name or f"{self.template.capitalize()}, {self.mass:g} kg")

    def mass_table(self, moments: Mapping[str, Apriori], held: Collection[str] = ()) -> None:
        """Write mass and inertia, some of it held: its priors widen the error bars of what depends on it."""
        sheet = self.sheet
        sheet.table("mass")
        sheet.entry(
            "mass",
            quantity(self.mass, WEIGHING * self.mass, free=False),
            "kg, as given: forces are known per mass only",
        )
        sheet.table(
            "mass.inertia",
            "kg m2; a flight determines moments per inertia: a swing test is worth more than this guess",
        )
        for axis, moment in moments.items():
            sheet.entry(axis, known(moment, axis not in held), moment.source)

    def environment(self) -> None:
        """Write where the density of the air is from, where it is not the height of every log."""
        flights = self.seen.flights
        if flights and all(recorded(f, "density") for f in flights):
            self.sheet.table("environment")
            self.sheet.word("density", "log", "every log holds it")
        elif any("altitude" not in f.names or np.isnan(f.column("altitude")).all() for f in flights):
            self.sheet.table("environment")
            density, method = steady_flight(flights, wings=False).density()
            said = f"kg/m3, {method}: no altitude was recorded; write that of the place and day"
            self.sheet.entry("density", plain(density), said)

    def controls_table(self, controls: Controls) -> None:
        """Write the surfaces; one servo lag for all."""
        first = next(iter(controls.mixers), "")
        for control, mixer in controls.mixers.items():
            self.sheet.table(f"controls.{control}", _SIGNS[control] if mixer.sign > 0.0 else "")
            if mixer.gains:
                self.sheet.entry("mix", mixture(mixer.gains), f"rad per unit: {mixer.comment}")
            else:
                self.sheet.remark(mixer.comment)
            if mixer.centers:
                self.sheet.entry(
                    "center",
                    mixture(mixer.centers),
                    "us, from the parameters" if not controls.guessed else "",
                )
            if control == first:
                self.sheet.entry("lag", known(LAG), f"s, {LAG.source}")
                self.sheet.entry("delay", known(DELAY), f"s, {DELAY.source}")
            else:
                self.sheet.word("lag", f"=controls.{first}.lag", "the same kind of servo")
                self.sheet.word("delay", f"=controls.{first}.delay")

    def sensor_places(
        self, accelerometer: float, vane: float | None = None, wind: Sequence[float] = ()
    ) -> None:
        """Write how far, by standard deviations in m, accelerometers and a vane may be from the center of gravity.

        And how far, m/s north and east, the wind by which air data were reconstructed may be from the true one.

        What logs do not hold has no place.
        """
        places = dict[str, tuple[str, str]]()
        if not self.seen.flights or any(recorded(f, c) for f in self.seen.flights for c in SPECIFIC_FORCE):
            part, said = quantity(0.0, accelerometer), "m from the center of gravity: taken to be there"
            places["accelerometer_position"] = point([part, "0.0", part]), said
        if vane is not None:
            ahead = point([quantity(0.0, vane), "0.0", "0.0"])
            places["vane_position"] = ahead, "m: a vane ahead feels the pitch rate"
        if wind:
            error = point([*(quantity(0.0, std) for std in wind), "0.0"])
            places["wind_error"] = error, "m/s north and east, of the wind that was found"
        if places:
            self.sheet.table("sensors")
        for key, entry in places.items():
            self.sheet.entry(key, *entry)
        if self.captured:
            self._position()

    @property
    def captured(self) -> bool:
        """Whether the pose alone was recorded, in all flights."""
        flights = self.seen.flights
        return bool(flights) and all(any(s.derived for s in f.sources.values()) for f in flights)

    def _position(self) -> None:
        """Write that position is measured, in still air."""
        for i, channel in enumerate(POSITION):
            self.sheet.table(f"sensors.{channel}")
            said = (
                "m, of motion capture, in still air; remove sensors.pn, pe and pd where wind blows"
                if not i
                else ""
            )
            self.sheet.entry("sigma", plain(CAPTURE_NOISE), said)


_SIGNS: Final = {
    "elevator": "trailing edge down is positive, nose down",
    "aileron": "right wing down is positive",
    "rudder": "trailing edge left is positive, nose left",
}


def body_drag(sheet: Sheet, mass: float, down: float) -> None:
    """Write the drag of the body; `down` is that along z, N s2/m2."""
    sheet.table("body_drag")
    side = USUAL.body * mass
    parts = [quantity(x, x) for x in (side, side, down)]
    sheet.entry("quadratic", point(parts), "N s2/m2, usual for this size")


def rotor_tables(sheet: Sheet, lift: Lift, mass: float, steady: Steady) -> None:
    """Write the rotors: their common law, then position and spin of each."""
    level, said = hover_level(lift, steady)
    law = thrust_law(lift, mass, level)
    sheet.table("rotors")
    sheet.word("drive", "speed" if lift.speed else "command", "x in rad/s" if lift.speed else "x from 0 to 1")
    if lift.scale.unit != 1.0:
        where = "pulses of 1000 to 2000 us are assumed" if lift.guessed else "from the parameters"
        sheet.entry("gain", f"{1.0 / lift.scale.unit:.6g}", f"x per unit of the channel: {where}")
    if lift.scale.zero:
        sheet.entry("idle", plain(lift.scale.zero), "of the channel")
    voltage = steady.median("voltage")
    if not lift.speed and voltage > 1.0:
        sheet.entry("nominal_voltage", plain(voltage), "V, median in flight: x scales with the battery")
        sheet.entry(
            "voltage_average", plain(USUAL.voltage_average), "s: the sag under load is part of the thrust law"
        )
    for name, one in law.items():
        unit = _UNITS[name][lift.speed]
        at = f" (x = {level:.4g}, {said})" if "hover" in one.source else ""
        sheet.entry(name, known(one), f"{unit}: {one.source}{at}")
    sheet.remark(
        f"radius = {plain(0.5 * lift.diameter())} # m: write yours to add the induced velocity, for climbs and forward flight"
    )
    late = replace(DELAY, value=0.0) if lift.speed else DELAY
    sheet.entry("delay", known(late), f"s, {late.source}")
    heights = [rotor.position[2] for rotor in lift.rotors]
    alike = len(set(heights)) == 1  # in one plane, whose height is a guess
    for number, rotor in enumerate(lift.rotors, 1):
        comment = f"{lift.source}; m from the center of gravity, spin seen from above" if number == 1 else ""
        sheet.table(f"rotor.m{number}", comment)
        sheet.word("channel", rotor.channel)
        x, y, z = map(plain, rotor.position)
        if alike:
            free = quantity(heights[0], PRIORS.frame * lift.size())
            z = free if number == 1 else toml.quoted("=rotor.m1.position.z")
        sheet.entry("position", point([x, y, z]), "one height for all" * (alike and number == 1))
        if rotor.axis is not None:
            sheet.entry("axis", point([plain(x) for x in rotor.axis]))
        sheet.word("spin", rotor.spin)


_UNITS: Final = {
    "T1": ("N", "N s/rad"), "T2": ("N", "N s2/rad2"), "inflow": ("N s/m", "N s2/(m rad)"),
    "drag": ("N s/m", "N s2/(m rad)"), "torque_ratio": ("m", "m"), "lag": ("s", "s"),
}  # fmt: skip
