"""What the equations of a vehicle may lack: a catalogue of extensions, each with the lines that write it into the file.

An extension changes nothing at its null value. Those that are numbers of the file stand, all at their null values, in one
extended vehicle; delays and lags change the signals that go into the equations or come out of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import tomlkit

from stoop.base.variables import EULER, VARIABLES
from stoop.vehicle import terms
from stoop.vehicle.defaults import EQUATION_1, rotor_size, unit
from stoop.vehicle.document import inline, with_entries
from stoop.vehicle.schema import WIND, Propeller, Quantity, Term
from stoop.vehicle.usual import USUAL
from stoop.vehicle.vehicle import Vehicle

Entries = Mapping[tuple[str, ...], Any]  #: keys of the file -> what stands there
UNTESTED: Final = ("reference.", "environment.", "turbulence.", "ground_effect.", "mass.center_of_gravity.")
INERTIAL: Final = ("p", "q", "r", "ax", "ay", "az")
MEASURED: Final = ("V", "alpha", "beta", *INERTIAL)  #: whose scale is tested; an attitude has none
TOGETHER: Final = {
    "V": ("V",), "alpha": ("alpha",), "beta": ("beta",), "inertial": INERTIAL, "attitude": EULER, "velocity": WIND,
}  #: channels that come late together  # fmt: skip
LONGITUDINAL: Final = ("1", "alpha", "q", "V", "alpha^2", "alpha*q", "beta^2", "alpha*V", "beta", "p", "r")
LATERAL: Final = ("1", "beta", "p", "r", "V", "alpha*beta", "alpha*p", "alpha*r", "beta^3", "alpha", "q")
UPWARD: Final = (0.0, 0.0, -1.0)  #: axis of a rotor without one
LOADS: Final = ("T0", "T1", "T2", "inflow", "translational", "drag", "drag_inflow")  #: of rotors
TORQUES: Final = ("torque_ratio", "Q0", "Q1", "Q2")  #: any of which gives a rotor its torque


@dataclass(frozen=True)
class Probe:
    """Change from the null value with which the equations are probed, and how far from it a value is believed."""

    step: float
    reach: float

    def times(self, size: float) -> Probe:
        """Return the probe of a number of another size."""
        return Probe(self.step * size, self.reach * size)


DELAY: Final = Probe(0.02, 0.5)  #: s
SHARE: Final = Probe(0.01, 1.0)  #: of the size of a number
SCALE: Final = Probe(0.01, 0.5)
POSITION: Final = Probe(0.01, 2.0)  #: m
ANGLE: Final = Probe(0.01, 0.35)  #: rad
DEAD_ZONE: Final = Probe(0.02, 0.5)  #: rad
SLOWNESS: Final = Probe(0.5, 20.0)  #: s/rad, of a limit of 2 rad/s
LARGE: Final = 1e6  #: rad/s, of a rate limit that limits nothing
BIAS: Final = Probe(0.1, 1e3)  #: of a sensor's noise
KNOWN: Final = 2.0  #: standard deviations of a held number, within which nothing contradicts it
TERM: Final = Probe(1e-3, 1e3)


@dataclass(frozen=True)
class Extension:
    """One thing that a model may lack."""

    name: str  #: of the number in the file, such as "controls.aileron.lag"
    kind: str  #: "term", "number", "delay", "lag", "scale", ...
    unit: str
    null: float  #: value that changes nothing
    probe: Probe
    entries: Callable[[Any], Entries]  #: number or table of fields -> what to write
    numbers: tuple[str, ...] = ()  #: of the extended vehicle that take the value
    inputs: tuple[str, ...] = ()  #: recorded channels that come late
    readings: tuple[str, ...] = ()  #: observed channels that come late
    #: whether it is probed by its reciprocal: a rate limit changes nothing where it is infinite
    reciprocal: bool = False
    known: float = 0.0  #: change that what is known of a held number allows

    @property
    def step(self) -> float:
        """Change with which the equations are probed."""
        return self.probe.step

    @property
    def positive(self) -> bool:
        """Whether only a positive change makes sense: nothing comes early."""
        return bool(self.inputs or self.readings or self.reciprocal or self.kind == "dead_zone")

    def believes(self, change: float) -> bool:
        """Whether a change from the null value makes sense, and is none that what is known of a held number allows."""
        least = 0.0 if self.positive else -self.probe.reach
        return abs(change) >= self.known and least < change < self.probe.reach

    def value(self, change: float) -> float:
        """Return the number of the file at a change from the null value."""
        return (1.0 / change if change else LARGE) if self.reciprocal else self.null + change

    def free_entries(self, change: float) -> Entries:
        """Return what to write so that a change is estimated, which begins at a value."""
        reach = min(5.0 * max(abs(change), self.step), self.probe.reach)
        low = 0.2 * change if self.positive else change - reach
        ends = sorted(self.value(x) for x in (low, change + reach))
        numbers = [float(f"{x:.3g}") for x in (self.value(change), *ends)]
        return self.entries({"value": numbers[0], "free": True, "bounds": numbers[1:]})

    def line(self, change: float) -> str:
        """Return what to write for a change from the null value, in one line."""
        return _written(self.entries(float(f"{self.value(change):.3g}")))


def _written(entries: Entries) -> str:
    """Return entries in one line."""
    parts = []
    for keys, entry in entries.items():
        item = inline(entry) if isinstance(entry, Mapping) else tomlkit.item(entry)
        parts.append(f"[{'.'.join(keys[:-1])}] {keys[-1]} = {item.as_string()}")
    return "; ".join(parts)


def with_free_number(vehicle: Vehicle, name: str) -> tuple[Vehicle, str] | None:
    """Return the vehicle with a number that its file lacks, free, and the line that writes it.

    Lags and delays of what commands move have their usual values with priors; others begin at what changes nothing, within what
    is believed. None where the catalogue has no such number, or it changes nothing at no finite value.
    """
    one = next((e for e in catalogue(vehicle) if e.name == name and not e.reciprocal), None)
    if one is None or one.kind == "number":
        return None
    fields: dict[str, Any] = {"value": one.null, "free": True}
    if one.inputs:
        usual = (USUAL.lag, USUAL.lag_std) if one.kind == "lag" else (USUAL.delay, USUAL.delay_std)
        fields = dict(zip(("value", "prior"), usual, strict=True))
    elif one.kind != "term":
        reach = one.probe.reach
        fields["bounds"] = [one.null - (0.0 if one.positive else reach), one.null + reach]
    entries = one.entries(fields)
    return with_entries(vehicle, entries), _written(entries)


def catalogue(vehicle: Vehicle) -> tuple[Extension, ...]:
    """Return every extension of a vehicle."""
    parts = (_controls, _masses, _thrust, _sensors, _terms, _rotors, _fixed)
    return tuple(one for part in parts for one in part(vehicle))


def extended(vehicle: Vehicle) -> tuple[Vehicle, tuple[Extension, ...]]:
    """Return a vehicle with every extension at its null value, and the extensions."""
    extensions = catalogue(vehicle)
    known, entries = set(vehicle.quantities), dict[tuple[str, ...], Any]()
    for one in extensions:
        if not known.issuperset(one.numbers):
            entries |= one.entries(one.null)
            known.update(one.numbers)
    return with_entries(vehicle, entries), extensions


def _plain(*keys: str) -> Callable[[Any], Entries]:
    return lambda entry: {keys: entry}


def _tied(*places: tuple[str, ...]) -> Callable[[Any], Entries]:
    """Return entries of which all but the first are tied to it."""
    first = "=" + ".".join(places[0])
    return lambda entry: {places[0]: entry, **dict.fromkeys(places[1:], first)}


def _points(
    keys: tuple[str, ...], kind: str, symbol: str, origin: Sequence[float], probe: Probe
) -> Iterator[Extension]:
    """Yield the coordinates of a point that the file lacks."""

    def written(axis: int) -> Callable[[Any], Entries]:
        def entries(entry: Any) -> Entries:
            shown = inline(entry) if isinstance(entry, Mapping) else entry
            return {keys: [shown if i == axis else x for i, x in enumerate(origin)]}

        return entries

    for axis, x in enumerate(origin):
        name = ".".join((*keys, "xyz"[axis]))
        yield Extension(name, kind, symbol, x, probe, written(axis), (name,))


def _controls(vehicle: Vehicle) -> Iterator[Extension]:
    """Yield gain, rate limit and dead zone of each control; lag and delay of each, and of all alike."""
    present = set(vehicle.quantities)
    for control in vehicle.controls:
        if vehicle.file.controls[control].mix is None:
            name = f"controls.{control}.mix.{control}"
            yield Extension(name, "gain", "1", 1.0, SCALE, _plain(*name.split(".")), (name,))
        name = f"controls.{control}.dead_zone"
        if name not in present:
            yield Extension(name, "dead_zone", "rad", 0.0, DEAD_ZONE, _plain(*name.split(".")), (name,))
        name = f"controls.{control}.rate_limit"
        if name not in present:
            entries = _plain(*name.split("."))
            yield Extension(name, "rate_limit", "rad/s", LARGE, SLOWNESS, entries, (name,), reciprocal=True)
    groups = [*((c,) for c in vehicle.controls), *([vehicle.controls] if len(vehicle.controls) > 1 else [])]
    for group in groups:
        channels = tuple(dict.fromkeys(channel for c in group for channel in vehicle.channels_of(c)))
        sharing = {c for c in vehicle.controls if set(vehicle.channels_of(c)) & set(channels)}
        for kind in ("lag", "delay"):
            names = [f"controls.{c}.{kind}" for c in group]
            if not present & set(names) and (kind == "lag" or sharing == set(group)):
                places = [("controls", c, kind) for c in group]
                name = names[0] if len(group) == 1 else f"controls.{kind}"
                yield Extension(name, kind, "s", 0.0, DELAY, _tied(*places), inputs=channels)


def _masses(vehicle: Vehicle) -> Iterator[Extension]:
    """Yield the products of inertia that the file lacks."""
    size = min(vehicle.value(f"mass.inertia.{axes}") for axes in ("xx", "yy", "zz"))
    for axes in ("xz", "xy", "yz"):
        if (name := f"mass.inertia.{axes}") not in vehicle.rows:
            entries = _plain("mass", "inertia", axes)
            yield Extension(name, "inertia", "kg m2", 0.0, SHARE.times(0.5 * size), entries, (name,))


def _thrust(vehicle: Vehicle) -> Iterator[Extension]:
    """Yield inclination and offset of the line of thrust, and the moment of inertia of a propeller."""
    propulsion = vehicle.file.propulsion
    if propulsion is None:
        return
    if propulsion.pitch is None:
        name = "propulsion.pitch"
        yield Extension(name, "thrust", "rad", 0.0, ANGLE, _plain("propulsion", "pitch"), (name,))
    if propulsion.position is None:
        _, *across = _points(("propulsion", "position"), "thrust", "m", _center(vehicle), POSITION)
        yield from across
    if isinstance(propulsion, Propeller) and propulsion.inertia is None:
        name, size = "propulsion.inertia", USUAL.propeller_inertia * vehicle.value("propulsion.diameter") ** 5
        probe = Probe(0.1, 10.0).times(size)
        yield Extension(name, "inertia", "kg m2", 0.0, probe, _plain("propulsion", "inertia"), (name,))


def _center(vehicle: Vehicle) -> tuple[float, ...]:
    return tuple(vehicle.value(f"mass.center_of_gravity.{axis}", 0.0) for axis in "xyz")


def _sensors(vehicle: Vehicle) -> Iterator[Extension]:
    """Yield scales, biases, delays, positions and alignment of the instruments."""
    outputs, free = vehicle.outputs, {p.name for p in vehicle.parameters if p.free}
    sensors = {c: getattr(vehicle.file.sensors, c) for c in outputs}
    for c, own in sensors.items():
        if own.scale is None and c in MEASURED:
            name = f"sensors.{c}.scale"
            yield Extension(name, "scale", "1", 1.0, SCALE, _plain("sensors", c, "scale"), (name,))
        name = f"sensors.{c}.bias"
        if c not in WIND and name not in free:
            probe, entries = BIAS.times(own.sigma), _plain("sensors", c, "bias")
            yield Extension(name, "bias", VARIABLES[c].unit, vehicle.value(name), probe, entries, (name,))
    for label, group in TOGETHER.items():
        late = [c for c in group if c in outputs]
        if late and all(sensors[c].delay is None for c in late):
            name = f"sensors.{late[0] if len(late) == 1 else label}.delay"
            places = [("sensors", c, "delay") for c in late]
            yield Extension(name, "delay", "s", 0.0, DELAY, _tied(*places), readings=tuple(late))
    if vehicle.file.sensors.accelerometer_position is None:
        yield from _points(("sensors", "accelerometer_position"), "position", "m", _center(vehicle), POSITION)
    if vehicle.file.sensors.vane_position is None and "alpha" in outputs:
        yield from _points(("sensors", "vane_position"), "position", "m", _center(vehicle), POSITION)
    if vehicle.file.sensors.imu_alignment is None:
        yield from _points(("sensors", "imu_alignment"), "alignment", "rad", (0.0, 0.0, 0.0), ANGLE)


def _terms(vehicle: Vehicle) -> Iterator[Extension]:
    """Yield the terms of a standard list, and those of every control, that a coefficient lacks."""
    if vehicle.file.reference is None:
        return
    controls, taken = vehicle.controls, set(vehicle.quantities)
    for coefficient, own in vehicle.terms.items():
        longitudinal = coefficient in ("CL", "CD", "Cm")
        present = {terms.written(text) for text in own.values()}
        texts = [*(LONGITUDINAL if longitudinal else LATERAL), *controls, *(f"alpha*{c}" for c in controls)]
        texts += [f"{c}^2" for c in controls] if longitudinal else []
        for text in (text for text in texts if terms.written(text) not in present):
            rows = EQUATION_1[coefficient].items()
            known = {term: name for name, (term, _, _) in rows if name not in taken}
            name = known.get(text) or terms.parameter_name(coefficient, text, taken)
            taken.add(name)
            entries = _term(coefficient, name, text)
            yield Extension(name, "term", terms.unit(text, controls), 0.0, TERM, entries, (name,))


def _term(coefficient: str, name: str, text: str) -> Callable[[Any], Entries]:
    keys = ("aerodynamics", coefficient, name)
    return lambda entry: {keys: {"term": text, **(entry if isinstance(entry, Mapping) else {"value": entry})}}


def _rotors(vehicle: Vehicle) -> Iterator[Extension]:
    """Yield lag and delay of the motors, and loads of rotors and body that the file lacks."""
    rotors, body = vehicle.file.rotors, vehicle.file.body_drag
    if rotors is None:
        return
    channels = tuple(dict.fromkeys(r.channel for r in vehicle.file.rotor.values()))
    for kind in ("lag", "delay"):
        if getattr(rotors, kind) is None:
            yield Extension(f"rotors.{kind}", kind, "s", 0.0, DELAY, _plain("rotors", kind), inputs=channels)
    numbers, absent = vehicle.quantities, [kind for kind in LOADS if getattr(rotors, kind) is None]
    absent += [] if any(getattr(rotors, kind) is not None for kind in TORQUES) else [TORQUES[0]]
    for kind in absent:
        name, probe = f"rotors.{kind}", SHARE.times(rotor_size(kind, numbers))
        symbol = unit(name, Quantity(), (), vehicle.drive)
        yield Extension(name, "rotor", symbol, 0.0, probe, _plain("rotors", kind), (name,))
    yield from _single_rotors(vehicle)
    for kind in ("linear", "quadratic"):
        if body is None or getattr(body, kind) is None:
            probe = SHARE.times(rotor_size(kind, numbers))
            symbol = unit(f"body_drag.{kind}", Quantity(), (), "")
            yield from _points(("body_drag", kind), "drag", symbol, (0.0, 0.0, 0.0), probe)


def _single_rotors(vehicle: Vehicle) -> Iterator[Extension]:
    """Yield the share of its loads that each rotor gives, and each group of rotors with the same axis if there are several."""
    rotors = {name: rotor for name, rotor in vehicle.file.rotor.items() if rotor.factor is None}
    groups: list[tuple[str, ...]] = [(name,) for name in rotors] if len(vehicle.rotors) > 1 else []
    by_axis: dict[tuple[float, ...], list[str]] = {}
    for name in rotors:
        axis = tuple(vehicle.value(f"rotor.{name}.axis.{c}", d) for c, d in zip("xyz", UPWARD, strict=True))
        by_axis.setdefault(axis, []).append(name)
    if len(by_axis) > 1:
        groups += [tuple(names) for names in by_axis.values() if len(names) > 1]
    for group in groups:
        numbers = tuple(f"rotor.{name}.factor" for name in group)
        entries = _tied(*(("rotor", name, "factor") for name in group))
        yield Extension(f"rotor.{'+'.join(group)}.factor", "scale", "1", 1.0, SCALE, entries, numbers)


def _fixed(vehicle: Vehicle) -> Iterator[Extension]:
    """Yield the numbers of the file that are not estimated."""
    numbers = vehicle.quantities
    for p in vehicle.parameters:
        skipped = p.free or p.name.startswith(UNTESTED) or p.name.endswith(".bias")
        if not skipped and (p.value != 0.0 or isinstance(numbers[p.name], Term)):
            probe, entries = SHARE.times(abs(p.value) or 1.0), _plain(*vehicle.keys_of(p.name))
            known = KNOWN * (p.prior or 0.0)
            yield Extension(p.name, "number", p.unit, p.value, probe, entries, (p.name,), known=known)
