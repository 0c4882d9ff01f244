"""What speaks against a draft: dimensions that contradict each other, a template or a mass that does not fit the log."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from stoop import Notice
from stoop.extend.notices import notice
from stoop.extend.units import STANDARD_GRAVITY
from stoop_draft.vehicle_draft.controls import AXES, Controls
from stoop_draft.vehicle_draft.geometry import WINGED, Geometry
from stoop_draft.vehicle_draft.power import Lift, running_rotors
from stoop_draft.vehicle_draft.request import MASS_BY_FRAME, ROTORCRAFT, Evidence
from stoop_draft.vehicle_draft.steady import STEADY, Steady, turning


@dataclass(frozen=True)
class Range:
    """Lowest and highest usual value."""

    low: float
    high: float

    def __contains__(self, value: object) -> bool:
        return isinstance(value, float) and self.low <= value <= self.high


LIFT: Final = Range(0.1, 1.6)  #: CL in steady flight: a wing without flaps stalls at 1.2 to 1.6
#: between those at which drag is least and power is least, with some room
USUAL_LIFT: Final = Range(0.25, 1.1)
ASPECT: Final = Range(2.0, 40.0)
WING_LOADING: Final = Range(1.0, 120.0)  #: kg/m2: an indoor model to a small jet
DISC_LOADING: Final = Range(22.0, 250.0)  #: N/m2, of the rotors that hover


def of_wing(geometry: Geometry) -> list[Notice]:
    """Return what is unusual about a wing and its mass."""
    wing, out = geometry.wing, []
    if (ratio := wing.span**2 / wing.area) not in ASPECT:
        values = {"span": wing.span, "area": wing.area, "ratio": ratio, **vars(ASPECT)}
        out.append(notice("draft-aspect-ratio", "reference.area", **values))
    if (loading := geometry.mass / wing.area) not in WING_LOADING:
        values = {"mass": geometry.mass, "area": wing.area, "loading": loading, **vars(WING_LOADING)}
        out.append(notice("draft-wing-loading", "mass.mass", **values))
    return out


def of_lift(mass: float, area: float, steady: Steady) -> list[Notice]:
    """Return whether mass, area and airspeed go together: the lift coefficient of steady flight is one that a wing has."""
    (speed, _), (density, _) = steady.airspeed(), steady.density()
    if not math.isfinite(speed):
        return []
    pressure = 0.5 * density * speed**2
    lift = mass * steady.lift_over_mass() / (pressure * area)
    if lift in USUAL_LIFT or not lift > 0.0:
        return []
    code, limits = ("draft-lift-unusual", USUAL_LIFT) if lift in LIFT else ("draft-lift", LIFT)
    force = pressure * area / STANDARD_GRAVITY
    masses = {"least": limits.low * force, "most": limits.high * force}
    values = {"mass": mass, "area": area, "airspeed": speed, "lift": lift, **vars(limits)}
    return [notice(code, "mass.mass", **values, **masses)]


def of_rotors(mass: float, lift: Lift) -> list[Notice]:
    """Return whether mass and size of the frame go together."""
    disc = len(lift.rotors) * math.pi / 4.0 * lift.diameter() ** 2
    loading = mass * STANDARD_GRAVITY / disc
    if loading in DISC_LOADING:
        least, most = (share * lift.size() ** 2 for share in MASS_BY_FRAME)
        values = {"mass": mass, "size": lift.size(), "least": least, "most": most}
        return [] if least <= mass <= most else [notice("draft-mass-unusual", "mass.mass", **values)]
    masses = {
        "least": DISC_LOADING.low * disc / STANDARD_GRAVITY,
        "most": DISC_LOADING.high * disc / STANDARD_GRAVITY,
    }
    return [notice("draft-disc-loading", "mass.mass", mass=mass, size=lift.size(), loading=loading, **masses)]


def of_template(template: str, given: bool, known: Evidence) -> list[Notice]:
    """Return which surfaces and motors of the log contradict a template, or that the log does not show its kind."""
    flight, setup, out = known.flight, known.setup, list[Notice]()
    if flight is None:
        return []
    fitting = setup.tail()
    if not given and template in WINGED and not fitting:
        out.append(notice("draft-template-assumed", template, flight=flight.name))
    names = tuple(dict.fromkeys(surface.name for surface in setup.surfaces))
    tails = {
        "conventional": ("conventional", "glider", "quadplane"),
        "v-tail": ("v-tail", "glider", "quadplane"),
    }
    if fitting and template in WINGED and template not in tails.get(fitting, (fitting, "quadplane")):
        out.append(notice("draft-surfaces", template, surfaces=names, fitting=fitting))
    expected = ROTORCRAFT.get(template)
    for one in known.flights:
        named = tuple(f"motor_{m.number}" for m in setup.rotors) if one is flight else ()
        motors, carried = tuple(running_rotors(one)[0]) or named, one.carried_by_rotors()
        if expected is not None and motors and len(motors) != expected and len(motors) > 2:
            out.append(
                notice("draft-motors", template, expected=expected, count=len(motors), channels=motors)
            )
        elif expected is not None and not motors and not carried:
            out.append(notice("draft-no-rotors", template, flight=one.name, count=expected))
        if expected is None and template != "quadplane" and len(motors) > 3 and carried:
            out.append(notice("draft-hovers", template, flight=one.name, count=len(motors), channels=motors))
    return out


def of_controls(controls: Controls, wanted: Sequence[str], known: Evidence) -> list[Notice]:
    """Return what the log says against the drafted controls: none, guesses, or one that turns the wrong way."""
    flight = known.flight
    if flight is None:
        return []
    out = []
    lacking = tuple(name for name in wanted if name not in controls.mixers)
    if lacking:
        out.append(notice("draft-no-control", flight.name, controls=lacking))
    if "rudder" not in wanted and {"control_roll", "control_yaw"} <= flight.names:
        roll, yaw = (abs(turning(flight, flight.column(f"control_{axis}"), "r")) for axis in ("roll", "yaw"))
        if yaw > max(roll, STEADY.correlation):  # more than the adverse yaw of what rolls it
            out.append(notice("draft-rudder", flight.name, correlation=yaw))
    if controls.guessed:
        out.append(notice("draft-mixers-guessed", flight.name, controls=tuple(controls.mixers)))
    for control, mixer in controls.mixers.items():
        _, _, rate, sign = AXES[control]
        seen = sign * mixer.sign * turning(flight, mixer.deflection(flight, control), rate)
        if seen < -STEADY.correlation:
            out.append(notice("draft-control-sign", f"controls.{control}", rate=rate, correlation=seen))
    return out


def of_excitation(known: Evidence) -> list[Notice]:
    """Return which axes no maneuver moves; `stoop maneuvers` judges this with the vehicle."""
    if not known.flights:
        return []
    moved = {m.axis for flight in known.flights for m in flight.find_maneuvers()}
    still = tuple(axis for axis in ("roll", "pitch", "yaw") if axis not in moved)
    return [notice("draft-not-excited", known.flights[0].name, axes=still)] if still else []


def of_flights(channels: Sequence[str], airspeeds: Mapping[str, float], known: Evidence) -> list[Notice]:
    """Return which logs are hardly of the vehicle of the first one: they lack its inputs, or fly at another speed."""
    out = []
    for flight in known.flights:
        lacking = tuple(name for name in channels if name not in flight.names)
        if lacking:
            out.append(notice("draft-other-inputs", flight.name, channels=lacking))
    known_speeds = {name: v for name, v in airspeeds.items() if math.isfinite(v)}
    if len(known_speeds) > 1:
        (slow, low), *_, (fast, high) = sorted((v, name) for name, v in known_speeds.items())
        if fast > 2.0 * slow:
            out.append(notice("draft-other-speed", high, speed=fast, other=low, slow=slow))
    return out
