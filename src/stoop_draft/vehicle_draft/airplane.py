"""The drafted file of an airplane, with or without rotors that lift."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from stoop import Flight, Notice
from stoop.extend.notices import notice
from stoop.extend.units import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from stoop.extend.vehicles import COEFFICIENTS, EQUATION_1, MOMENT_ARMS
from stoop.extend.vehicles import USUAL as ASSUMED
from stoop_draft.vehicle_draft import inertia, plausibility
from stoop_draft.vehicle_draft.apriori import Apriori
from stoop_draft.vehicle_draft.autopilot import Scale
from stoop_draft.vehicle_draft.controls import AXES, default_controls, find_controls, recorded
from stoop_draft.vehicle_draft.geometry import Geometry
from stoop_draft.vehicle_draft.handbook import with_curved_path
from stoop_draft.vehicle_draft.power import USUAL, Drive, find_drive, speed_gain
from stoop_draft.vehicle_draft.request import AERODYNAMICS, Evidence, Request
from stoop_draft.vehicle_draft.steady import steady_flight
from stoop_draft.vehicle_draft.tables import (
    MEANINGS,
    PRIORS,
    FileText,
    body_drag,
    plain,
    quantity,
    rotor_tables,
)

#: what stoop says of a vehicle that nobody has flown yet: CL of its working point
CONTROLS: Final = ("elevator", "aileron", "rudder")
CRUISE_LIFT: Final = 0.5
_PAIRS: Final = {
    "v-tail": "rudder",
    "flying-wing": "aileron",
}  #: template -> control that shares the elevator's servos
#: coefficient -> terms that eq. (1) lacks and flights show: standard deviation, and what they are
_MORE_TERMS: Final = {
    "CD": {
        "beta^2": (1.0, "by sideslip; zero where the force of a sideslip is across the body"),
        "elevator": (0.05, "by the elevator about its trim"),
    }
}
_RECONSTRUCTED: Final = "reconstructed"  #: source of alpha and beta without vanes


class Airplane(FileText):
    """An airplane, with or without rotors that lift."""

    def __init__(self, request: Request, seen: Evidence) -> None:
        super().__init__(request, seen)
        r = request
        self.geometry = r.geometry or Geometry.typical(
            self.template, self.mass, r.span or 0.0, r.chord, r.area
        )
        self.steady = steady_flight(seen.flights)
        flight = seen.flight
        rudder = any(surface.shares[2] for surface in seen.setup.surfaces)
        yaws = self.template != "flying-wing" or rudder or (flight is not None and recorded(flight, "rudder"))
        self.wanted = wanted = CONTROLS if yaws else CONTROLS[:2]
        self.controls = (
            default_controls(wanted) if flight is None else find_controls(flight, seen.setup, wanted)
        )
        wing = self.geometry.wing
        self.moments = inertia.of_airplane(self.template, self.mass, wing.span, wing.chord)
        self.airspeed, self.airspeed_source = self.steady.airspeed()
        self.alpha = self.steady.median("alpha")

    def text(self) -> str:
        """Return the file."""
        wing = self.geometry.wing
        self.head(f"span {wing.span:g} m, chord {wing.chord:.4g} m")
        # coefficients hold for stated moments: a flight shows their ratios, weakly, and xz as rolling turns the nose
        self.mass_table(self.moments, held=() if self.on_rotors else ("xx", "yy", "zz"))
        self._reference()
        self.environment()
        self._propulsion()
        self.controls_table(self.controls)
        self._rotors()
        self._sensors()
        self._aerodynamics()
        return self.sheet.text()

    def _rotors(self) -> None:
        if self.lift is None:
            return
        channels = [rotor.channel for rotor in self.lift.rotors]
        if not self.on_rotors:
            self.sheet.remark(
                f"Lifting rotors ({', '.join(channels)}) stand still in this log and are left out."
            )
            return
        rotor_tables(self.sheet, self.lift, self.mass, steady_flight(self.seen.flights, wings=False))
        down = 0.5 * SEA_LEVEL_DENSITY * USUAL.flat * self.geometry.wing.area
        body_drag(self.sheet, self.mass, down)

    def _reference(self) -> None:
        wing, sheet = self.geometry.wing, self.sheet
        sheet.table("reference")
        given = self.request.area is not None or self.request.geometry is not None
        sheet.entry("area", plain(wing.area), "m2, as given" if given else "m2, span times chord")
        sheet.entry("chord", plain(wing.chord), "m")
        sheet.entry("span", plain(wing.span), "m")
        if math.isfinite(self.airspeed):
            said = f"m/s, median of {self.steady.duration:.0f} s of steady flight ({self.airspeed_source})"
        else:
            self.airspeed = math.sqrt(
                2.0 * self.mass * STANDARD_GRAVITY / (SEA_LEVEL_DENSITY * wing.area * CRUISE_LIFT)
            )
            said = f"m/s, level flight at CL = {CRUISE_LIFT:g}: no log shows it"
        sheet.entry("airspeed", plain(self.airspeed), f"V*: {said}")
        if math.isfinite(self.alpha):
            said = f"alpha*: rad ({math.degrees(self.alpha):.1f} deg), median of the same flight"
            sheet.entry("alpha", plain(self.alpha), said)
        guess = ", ".join(plain(self.moments[axis].value) for axis in ("xx", "yy", "zz"))
        sheet.entry(
            "inertia",
            f"[{guess}]",
            "kg m2: Cl, Cm, Cn hold for these; times measured over these where you measure",
        )
        sheet.word(
            "rate_normalization", "actual", "rates are made dimensionless with the airspeed of the moment"
        )

    def _propulsion(self) -> None:
        sheet, flight = self.sheet, self.seen.flight
        if self.request.engine == "none":
            sheet.lines += ["", "# No propulsion, as given or as a glider has it."]
            return
        lifting = [rotor.channel for rotor in self.lift.rotors] if self.lift is not None else []
        drive = find_drive(flight, self.seen.setup, lifting) if flight is not None else None
        if drive is None and flight is not None:
            self._unlogged_thrust(flight)
            return
        drive = drive or Drive(
            f"motor_{len(lifting) + 1}" if lifting else "control_throttle", Scale(), "assumed"
        )
        sheet.table("propulsion")
        if drive.channel == "thrust":
            sheet.word("kind", "channel", "the log holds the thrust, N")
            sheet.entry("scale", quantity(1.0, 0.1), "how well that is known is not")
            return
        if self.request.engine == "jet":
            sheet.word("kind", "channel", "thrust in proportion to the command, without regard to airspeed")
            sheet.word("channel", drive.channel, drive.comment)
            thrust = USUAL.jet * self.mass * STANDARD_GRAVITY
            sheet.entry("scale", quantity(thrust, USUAL.spread * thrust), f"N, {USUAL.jet:g} of the weight")
            return
        self._propeller(drive)

    def _unlogged_thrust(self, flight: Flight) -> None:
        """Write a constant thrust where no channel drives a motor, but the specific force asks for one."""
        weight = self.mass * STANDARD_GRAVITY
        silent = any(flight.names & {"control_throttle", "throttle", "motor_1"})
        drag = weight / USUAL.lift_over_drag
        thrust = self.mass * self.steady.push_over_mass() + drag
        power = self.steady.median("voltage", 0.0) * self.steady.median("current", 0.0)
        if (silent and power < PRIORS.power * drag * self.airspeed) or not thrust > PRIORS.thrust * weight:
            self.sheet.lines += ["", "# No propulsion: no motor ran in this log."]
            return
        battery = f"; {power:.0f} W from the battery" if power > 0.0 else ""
        self.sheet.table("propulsion", f"no channel of the log shows the throttle{battery}")
        self.sheet.word("kind", "constant")
        said = (
            f"N, what steady flight needs at L/D = {USUAL.lift_over_drag:g}; map the throttle if there is one"
        )
        self.sheet.entry("thrust", quantity(thrust, USUAL.spread * thrust), said)

    def _propeller(self, drive: Drive) -> None:
        sheet = self.sheet
        diameter = USUAL.diameter * self.mass ** (1.0 / 3.0)
        gain, said = speed_gain(self.mass, diameter, drive, self.steady)
        if drive.channel.startswith("rotor_"):
            gain, said = 0.5 / math.pi, "rad/s to rev/s"
        sheet.word("kind", "propeller")
        sheet.word("channel", drive.channel, drive.comment)
        if drive.scale.zero:
            sheet.entry("idle", plain(drive.scale.zero), "of the channel")
        sheet.entry(
            "speed_gain",
            plain(gain / drive.scale.unit),
            f"rev/s per unit: {said}; a wrong one goes into CT0, CT1",
        )
        sheet.entry("diameter", plain(diameter), "m, usual for this mass: write your own")
        for name in ("CT0", "CT1", "CT2"):
            sheet.entry(name, quantity(*getattr(USUAL, name)), "usual of small propellers")
        if self.request.engine == "piston":
            inertia = ASSUMED.propeller_inertia * diameter**5
            said = "kg m2, usual of this diameter; negative where it turns counterclockwise from behind"
            sheet.entry("inertia", quantity(inertia, USUAL.spread * inertia), said)
        else:
            sheet.remark(
                "no angular momentum: its direction is not known. If you know it, add inertia, kg m2 (about 0.065 D^5),",
                "negative where it turns counterclockwise from behind; a fit tests whether the flight asks for it",
            )

    def _sensors(self) -> None:
        """Write errors that all maneuvers share, which no scatter shows: each scales or shifts every derivative.

        Reconstructed air data are those through air of the wind that was found, which a pitot does not know of.
        """
        flights, span = self.seen.flights, self.geometry.wing.span
        vanes, pitots = (any(_measured(f, channel) for f in flights) for channel in ("alpha", "V"))
        winds = [f.air for f in flights if f.air is not None and math.isfinite(f.air.wind_n_std)]
        winds = [] if vanes else winds
        errors = [max(a.wind_n_std for a in winds), max(a.wind_e_std for a in winds)] if winds else []
        self.sensor_places(PRIORS.lever * span, PRIORS.vane * span if vanes else None, errors)
        if pitots or (not winds and not self.captured and any("V" in f.names for f in flights)):
            self.sheet.table("sensors.V")
            self.sheet.entry("scale", quantity(1.0, PRIORS.pitot), "of a pitot")
        for channel in ("alpha", "beta") if winds else ():
            self.sheet.table(f"sensors.{channel}")
            angle = max(math.hypot(*errors) / self.airspeed, *(a.incidence_std for a in winds))
            self.sheet.entry("bias", quantity(0.0, angle), "rad: gusts, and the error of the wind")

    def _aerodynamics(self) -> None:
        sheet, own = self.sheet, self._derivatives()
        method = own["CLalpha"].source
        sheet.lines.append("")
        sheet.remark(
            f"Derivatives by {method}, with the standard deviation of these against flight results, and that of what is",
            "typical of the geometry rather than given. Terms of eq. (1): per rad, rates with b/2V and c/2V, about V*, alpha*.",
        )
        for coefficient in COEFFICIENTS:
            sheet.table(f"aerodynamics.{coefficient}")
            for name in (n for n in EQUATION_1[coefficient] if n in own):
                source = own[name].source
                said = [MEANINGS[name], *([] if source == method else [source])]
                sheet.entry(name, quantity(own[name].value, own[name].std), "; ".join(said))
            for term, (std, about) in _MORE_TERMS.get(coefficient, {}).items():
                if term not in AXES or term in self.controls.mixers:
                    sheet.entry(f"{coefficient}{term.replace('^', '')}", _term(term, std), about)
            pair = own.get(f"{coefficient}{_PAIRS.get(self.template, '')}")
            if coefficient in ("Cl", "Cn") and pair is not None and "elevator" in self.controls.mixers:
                text = _term("elevator", PRIORS.unequal * abs(pair.value))
                sheet.entry(
                    f"{coefficient}elevator", text, "of a left and a right surface that move unequally"
                )

    def _derivatives(self) -> dict[str, Apriori]:
        """Return the a priori derivatives; those of controls are less sure where the throw is assumed.

        Moments hold for an inertia that is itself a guess: an error of it is one of theirs.
        """
        speed, (density, _) = self.airspeed, self.steady.density()
        alpha = self.alpha if math.isfinite(self.alpha) else None
        pressure = 0.5 * density * speed**2 * self.geometry.wing.area
        lift = self.mass * self.steady.lift_over_mass() / pressure
        found = AERODYNAMICS[self.request.aerodynamics](self.geometry, speed, alpha, density, lift)
        found = with_curved_path(self.geometry, density, found)
        for name, one in found.items():
            if name[:2] in MOMENT_ARMS:
                about = self.moments[2 * MOMENT_ARMS[name[:2]][1]]
                one = replace(one, std=math.hypot(one.std, about.std / about.value * one.value))
                found[name] = one
            control = next((c for c in AXES if name.endswith(c)), None)
            mixer = self.controls.mixers.get(control or "")
            if control is None or mixer is None:
                continue
            spread = PRIORS.throw * abs(one.value) if mixer.gains else 0.0
            value, source = mixer.sign * one.value, one.source
            found[name] = Apriori(value, math.hypot(one.std, spread), source)
        out = {
            n: one for n, one in found.items() if not n.endswith(tuple(set(AXES) - set(self.controls.mixers)))
        }
        return out | self._trim(out)

    def _trim(self, found: Mapping[str, Apriori]) -> dict[str, Apriori]:
        """Return the coefficients at the working point, which balance the controls of steady flight."""
        out = {}
        for name, slope, control in (
            ("CL0", "CLelevator", "elevator"),
            ("Cm0", "Cmelevator", "elevator"),
            ("Cl0", "Claileron", "aileron"),
            ("Cn0", "Cnrudder", "rudder"),
        ):
            mixer, flight = self.controls.mixers.get(control), self.seen.flight
            if mixer is None or slope not in found or name not in found:
                continue
            level = 0.0  # median deflection in steady flight, rad
            if flight is not None:
                gains = mixer.gains or {control: 1.0}
                middles = {n: self.steady.median(n) - mixer.centers.get(n, 0.0) for n in gains}
                level = sum(gain * middles[n] for n, gain in gains.items())
                level = level if math.isfinite(level) else 0.0
            own, effect = found[name], found[slope]
            middle = PRIORS.middle if mixer.gains else 0.0
            std = math.sqrt(own.std**2 + (effect.std * level) ** 2 + (effect.value * middle) ** 2)
            said = f"balances the {control} at {level:.3f} rad" if level else own.source
            out[name] = Apriori(own.value - effect.value * level, std, said)
        return out

    def notices(self) -> list[Notice]:
        """Return what speaks against the draft."""
        found = [*plausibility.of_wing(self.geometry)]
        if self.seen.flights:
            found += plausibility.of_lift(self.mass, self.geometry.wing.area, self.steady)
        speeds = {f.name: steady_flight([f]).airspeed()[0] for f in self.seen.flights}
        found += plausibility.of_controls(self.controls, self.wanted, self.seen)
        found += plausibility.of_flights(self.controls.channels, speeds, self.seen)
        found += plausibility.of_excitation(self.seen)
        uses = tuple(dict.fromkeys(self.seen.setup.others.values()))  # of outputs that the draft leaves out
        return [*found, *([notice("draft-left-out", self.seen.setup.autopilot, uses=uses)] if uses else [])]


def _term(term: str, std: float) -> str:
    """Return a term that eq. (1) lacks, with its prior about zero, as a vehicle file has it."""
    return f'{{ term = "{term}", value = 0.0, prior = {plain(float(f"{std:.2g}"))} }}'


def _measured(flight: Flight, channel: str) -> bool:
    """Whether air data were recorded, and not reconstructed of velocity and wind."""
    source = flight.sources.get(channel)
    return source is not None and not source.derived and source.source != _RECONSTRUCTED
