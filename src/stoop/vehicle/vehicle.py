"""A vehicle: its file, the numbers that can be estimated, and the layout of its equations."""

from __future__ import annotations

import functools
import hashlib
import json
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, SupportsIndex, overload

import numpy as np
from pydantic import BaseModel

from stoop.base.arrays import FloatArray
from stoop.base.html import table
from stoop.base.numbers import count, number
from stoop.base.text import nearest, printable, unknown_name
from stoop.base.variables import POSITION
from stoop.errors import VehicleError
from stoop.kernels import Kernel, SymbolicModel, load_kernel
from stoop.kernels.kernel import array_functions
from stoop.vehicle import channels, delays, rotor_channels, terms, trajectories
from stoop.vehicle.arrays import Equations
from stoop.vehicle.defaults import COEFFICIENTS, POSITIVE, bounds, free_by_default, unit
from stoop.vehicle.schema import CHANNELS, WIND, Quantity, Term, VehicleFile

_BIASES = frozenset(f"sensors.{channel}.bias" for channel in (*WIND, *CHANNELS, *POSITION))
#: absent from the structure where the file lacks them, as in kernels made before they were keys
_LATER = (
    "turbulence", "vn", "ve", "vd", "airspeed", "rotors", "rotor", "body_drag", "ground_effect", "rate_limit", "dead_zone",
    "imu_alignment", "inertia", "wind_error", "pn", "pe", "pd",
)  # fmt: skip
_NO_ROWS = ("name", "notes", "loadings", "sigma", "estimate_biases", "voltage_average")  #: of the kernel
#: beside all of symbolic/
_EQUATION_SOURCES = (
    "vehicle.py", "channels.py", "terms.py", "atmosphere.py", "schema.py", "defaults.py", "notation.py",
    "../base/atmosphere.py", "../base/numbers.py", "../base/units.py", "../base/variables.py",
)  # fmt: skip


@dataclass(frozen=True)
class _Reduction:
    """What a set of equations keeps."""

    states: tuple[str, ...]
    outputs: tuple[str, ...] | None  #: those of the frame when None
    identified: tuple[str, ...]  #: coefficients that are estimated
    coefficients: tuple[str, ...]
    gusts: tuple[str, ...]
    added: tuple[str, ...]  #: states that a filter corrects by adding
    rotated: tuple[str, ...]  #: angles that the equations integrate, about which a filter rotates
    #: channels of the states that are left out, and what stands for each as inputs
    held: Mapping[str, tuple[str, ...]]


_LONGITUDINAL = ("CL", "CD", "Cm")
_REDUCTIONS = {
    "full": _Reduction(
        channels.RIGID_STATES, None, COEFFICIENTS, COEFFICIENTS, ("u", "v", "w"), channels.RIGID_STATES[:6],
        ("phi", "theta", "psi"), {},
    ),
    "longitudinal": _Reduction(
        ("u", "w", "q", "e0", "e2", "h"), ("V", "alpha", "q", "theta", "ax", "az"), _LONGITUDINAL, _LONGITUDINAL,
        ("u", "w"), ("u", "w", "q"), ("theta",),
        {"beta": ("v",), "p": ("p",), "r": ("r",), "phi": ("sin_phi", "cos_phi")},
    ),
    "lateral": _Reduction(
        channels.RIGID_STATES, ("beta", "p", "r", "phi", "psi", "ay"), ("CQ", "Cl", "Cn"), COEFFICIENTS,
        ("v",), ("v", "p", "r"), ("phi", "psi"),
        {"V": ("u",), "alpha": ("w",), "q": ("q",), "theta": ("sin_theta", "cos_theta")},
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Parameter:
    """One number of the vehicle as the estimation sees it, SI."""

    name: str  #: an aerodynamic term's own (``CLalpha``), else the place in the file (``mass.inertia.xx``)
    value: float
    lower: float
    upper: float
    free: bool
    prior: float | None  #: standard deviation
    unit: str
    mean: float | None = None  #: of the prior; the value when absent

    @property
    def prior_mean(self) -> float:
        """Mean of the prior."""
        return self.value if self.mean is None else self.mean

    @property
    def by_factor(self) -> bool:
        """Whether the prior is normal in the logarithm: a positive number is known to a factor, as likely twice as half."""
        return self.name in POSITIVE and self.prior is not None and min(self.lower, self.prior_mean) > 0.0

    def prior_about(self, value: float) -> tuple[float, float]:
        """Return mean and standard deviation of the normal prior that pulls as this one does about a value."""
        mean, std = self.prior_mean, math.inf if self.prior is None else self.prior
        if not self.by_factor:
            return mean, std
        value = max(value, self.lower)
        return value * (1.0 - math.log(value / mean)), value * std / mean


class Parameters(tuple[Parameter, ...]):
    """Numbers of a vehicle in order, and by name: ``vehicle.parameters["Clp"].value``."""

    __slots__ = ()

    @overload
    def __getitem__(self, key: SupportsIndex | str) -> Parameter: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[Parameter, ...]: ...
    def __getitem__(self, key: SupportsIndex | slice | str) -> Parameter | tuple[Parameter, ...]:
        """Return a number by its name or place, or some by a slice."""
        if not isinstance(key, str):
            return super().__getitem__(key)
        found = next((p for p in self if p.name == key), None)
        if found is None:
            raise unknown_name(key, [p.name for p in self])
        return found

    def __repr__(self) -> str:
        """Return how many there are, and how many are free, on one line."""
        return f"<Parameters: {len(self)}, {sum(p.free for p in self)} of them free>"


def leaves(node: Any, path: str = "") -> Iterator[tuple[str, Quantity]]:
    """Yield name and quantity of every number of a file in the order of the schema; a term has its own name."""
    if isinstance(node, Quantity):
        yield path, node
    for name, child in _children(node, path):
        yield from leaves(child, name)


def _children(node: Any, path: str) -> list[tuple[str, Any]]:
    """Return names and parts of a table, a mapping or a point of the file."""
    prefix = f"{path}." if path else ""
    if isinstance(node, BaseModel) and not isinstance(node, Quantity):
        return [(prefix + name, getattr(node, name)) for name in type(node).model_fields]
    if isinstance(node, Mapping):
        return [(name if isinstance(part, Term) else prefix + name, part) for name, part in node.items()]
    if isinstance(node, tuple) and node and isinstance(node[0], Quantity):
        return [(prefix + axis, part) for axis, part in zip("xyz", node, strict=True)]
    return []


def _changed(node: Any, changes: Mapping[str, Mapping[str, Any]], path: str = "") -> Any:
    """Return a copy of a file with changed numbers."""
    if isinstance(node, Quantity):
        return node.model_copy(update=dict(changes[path])) if path in changes else node
    parts = [_changed(part, changes, name) for name, part in _children(node, path)]
    if isinstance(node, BaseModel):
        return node.model_copy(update=dict(zip(type(node).model_fields, parts, strict=True)))
    if isinstance(node, Mapping):
        return dict(zip(node, parts, strict=True))
    return tuple(parts) if parts else node


def _structure(node: Any) -> Any:
    """Return the file with every number replaced by its name: what decides the equations."""
    if isinstance(node, Term):
        return [node.term, node.tie]
    if isinstance(node, Quantity):
        return f"={node.tie}" if node.tie else "number"
    if isinstance(node, BaseModel):
        kept = [n for n in type(node).model_fields if n not in _NO_ROWS]
        return {n: _structure(v) for n in kept if (v := getattr(node, n)) or n not in _LATER}
    if isinstance(node, Mapping):
        return {n: _structure(v) for n, v in node.items()}
    return [_structure(v) for v in node] if isinstance(node, tuple) else node


@functools.cache
def equations_version() -> str:
    """Return a digest of the sources that decide the equations, for the keys of caches."""
    here = Path(__file__).parent
    sources = [*sorted((here / "symbolic").glob("*.py")), *(here / name for name in _EQUATION_SOURCES)]
    return hashlib.sha256(b"".join(p.read_bytes() for p in sources)).hexdigest()


@dataclass(frozen=True, repr=False)
class Vehicle:
    """A vehicle file with its numbers in one list."""

    file: VehicleFile
    #: the TOML as written, so that an identified vehicle keeps the user's comments
    text: str = field(repr=False)
    where: str  #: name of the file in messages
    #: channels of held states that a record supplies, among :attr:`held_channels`
    measured: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return name and size on one line."""
        free, biases = len(self.free_parameters), len(self.free_biases)
        held = len(self.parameters) - free - biases
        text = f"{count(free, 'free parameter')}, {biases} free sensor {'bias' if biases == 1 else 'biases'}, {held} held"
        return printable(f"<Vehicle {self.name}: {text}>")

    def _repr_html_(self) -> str:
        units = {"1": ""}
        rows = [
            (p.name, number(p.value), units.get(p.unit, p.unit), f"{number(p.lower)} … {number(p.upper)}")
            for p in self.parameters
            if p.free
        ]
        return table(repr(self).strip("<>"), ("free number", "value", "unit", "bounds"), rows)

    @property
    def name(self) -> str:
        """Name in the file."""
        return self.file.name

    @property
    def free_biases(self) -> tuple[Parameter, ...]:
        """Free biases of sensors: nuisances, estimated anew in every maneuver."""
        return tuple(p for p in self.parameters if p.free and p.name in _BIASES)

    @property
    def free_parameters(self) -> tuple[Parameter, ...]:
        """Free numbers less the biases of sensors."""
        return tuple(p for p in self.parameters if p.free and p.name not in _BIASES)

    @functools.cached_property
    def quantities(self) -> dict[str, Quantity]:
        """Every number of the file by name, those that are tied to another among them."""
        return dict(leaves(self.file))

    def keys_of(self, name: str) -> tuple[str, ...]:
        """Return where in a file a number of the vehicle stands."""
        owner = next((c for c in COEFFICIENTS if name in getattr(self.file.aerodynamics, c)), None)
        return tuple(name.split(".")) if owner is None else ("aerodynamics", owner, name)

    @functools.cached_property
    def parameters(self) -> Parameters:
        """Every number of the file that is not tied to another, in the order of the kernel's rows.

        A reduced model estimates its own coefficients; numbers that its equations do not contain are never free.
        """
        file, numbers = self.file, self.quantities
        estimated = {n for c in _REDUCTIONS[self.reduce].identified for n in getattr(file.aerodynamics, c)}
        absent = {n for c in COEFFICIENTS for n in getattr(file.aerodynamics, c) if c not in self.terms}
        # Numbers of gusts that the kept equations lack, unless a number of another gust is tied to them.
        known = {a: getattr(file.turbulence, a, None) for a in channels.GUST_STATES}
        gusts = {a: dict(leaves(gust, f"turbulence.{a}")) for a, gust in known.items()}
        used = {q.tie or name for a in self.gusts for name, q in gusts[a].items()}
        absent |= {name for found in gusts.values() for name in found} - used
        out = []
        for name, (low, high) in bounds(numbers).items():
            q = numbers[name]
            free = free_by_default(name, q, estimated) if q.free is None else q.free
            free = free and name not in absent
            symbol = unit(name, q, file.controls, self.drive)
            out.append(Parameter(name, q.value, low, high, free, q.prior, symbol, q.mean))
        return Parameters(out)

    @functools.cached_property
    def rows(self) -> dict[str, int]:
        """Row of each number in the kernel's parameter array; a tied number shares its target's row."""
        own = {p.name: i for i, p in enumerate(self.parameters)}
        ties = {name: q.tie for name, q in self.quantities.items() if q.tie is not None}
        for name, target in ties.items():
            if target not in own:
                fault = "itself tied" if target in ties else "not a number of this file"
                raise VehicleError(
                    f"{self.where}: {name}: tied to '{target}', which is {fault}; {nearest(target, own)}"
                )
        return own | {name: own[target] for name, target in ties.items()}

    @functools.cached_property
    def values(self) -> FloatArray:
        """Values of :attr:`parameters`, SI."""
        return np.array([p.value for p in self.parameters])

    def value(self, name: str, default: float | None = None) -> float:
        """Return one number by its name; `default`, if given, where the file has no such number."""
        if default is not None and name not in self.rows:
            return default
        return float(self.values[self.rows[name]])

    @property
    def reduce(self) -> str:
        """Equations that are kept: full, longitudinal or lateral."""
        return self.file.model.reduce

    @property
    def rotors(self) -> tuple[str, ...]:
        """Names of the rotors."""
        return tuple(self.file.rotor)

    @property
    def drive(self) -> str:
        """What x of the rotors is: "command" or "speed", rad/s; empty without rotors."""
        return "" if self.file.rotors is None else self.file.rotors.drive

    @property
    def frame(self) -> channels.Frame:
        """Frame of its observations: with rotors that of the ground."""
        return channels.GROUND_FRAME if self.file.rotor else channels.AIR_FRAME

    @property
    def positions(self) -> tuple[str, ...]:
        """States of the position, m, of a vehicle that motion capture observes; still air carries it nowhere."""
        return POSITION if self.file.sensors.pn is not None else ()

    @property
    def start_names(self) -> tuple[str, ...]:
        """Names of an initial state: velocity (through the air), rates, attitude, altitude, position."""
        return (*self.frame.start, *self.positions)

    @property
    def actual_rates(self) -> bool:
        """Whether rates are made dimensionless with the actual airspeed, not with V*."""
        reference = self.file.reference
        return reference is not None and reference.rate_normalization == "actual"

    @functools.cached_property
    def terms(self) -> dict[str, dict[str, str]]:
        """Term texts per kept coefficient and parameter."""
        kept = _REDUCTIONS[self.reduce].coefficients
        return {c: {n: t.term for n, t in getattr(self.file.aerodynamics, c).items()} for c in kept}

    @functools.cached_property
    def controls(self) -> tuple[str, ...]:
        """Control surfaces that the kept equations contain."""
        names = set(terms.STATE_VARIABLES) | set(self.file.controls)
        texts = [text for group in self.terms.values() for text in group.values()]
        used = frozenset().union(*(terms.variables(terms.parse(t, names, self.where)) for t in texts))
        return tuple(c for c in self.file.controls if c in used)

    def channels_of(self, control: str) -> tuple[str, ...]:
        """Return the recorded channels that a control is mixed from."""
        mix = self.file.controls[control].mix
        return tuple(mix) if mix is not None else (control,)

    @functools.cached_property
    def gusts(self) -> tuple[str, ...]:
        """Axes of the gusts in the kept equations."""
        met, axes = self.file.turbulence, _REDUCTIONS[self.reduce].gusts
        return tuple(a for a in axes if getattr(met, a, None) is not None)

    @functools.cached_property
    def inputs(self) -> tuple[str, ...]:
        """Inputs of the equations, in the order of the kernel: recorded channels, noise, slopes, measured motion.

        Noise that drives gusts is zero except in simulated turbulence. Without any recorded channel ``none``
        stands for them. Slopes are those of :attr:`sloped`; each is constant from a sample to the next.
        """
        noise, slopes = map(channels.noise_input, self.gusts), map(channels.slope_input, self.sloped)
        return (*(self.recorded or ("none",)), *noise, *slopes, *self.motion)

    @property
    def held_channels(self) -> tuple[str, ...]:
        """Channels of the states that a reduced model leaves out."""
        return tuple(_REDUCTIONS[self.reduce].held)

    @property
    def modeled_angles(self) -> tuple[str, ...]:
        """Angles of the attitude that the equations integrate; where motion is measured, the quaternion holds these only."""
        return _REDUCTIONS[self.reduce].rotated

    @functools.cached_property
    def motion(self) -> tuple[str, ...]:
        """Inputs that stand for held states: velocities, m/s, rates, rad/s, sine and cosine of an angle."""
        held = _REDUCTIONS[self.reduce].held
        return tuple(channels.motion_input(s) for c in self.measured for s in held[c])

    @functools.cached_property
    def sloped(self) -> tuple[str, ...]:
        """Recorded channels whose slopes are inputs: of rotors with inertia whose lag, which has the slope, is absent."""
        rotors = self.file.rotors
        if rotors is None or rotors.inertia is None or rotors.lag is not None:
            return ()
        voltage = ("voltage",) if rotors.nominal_voltage is not None else ()
        return tuple(dict.fromkeys((*(r.channel for r in self.file.rotor.values()), *voltage)))

    @functools.cached_property
    def recorded(self) -> tuple[str, ...]:
        """Recorded channels that drive the equations."""
        file = self.file
        channels = [channel for c in self.controls for channel in self.channels_of(c)]
        if file.propulsion is not None and file.propulsion.kind != "constant":
            channels.append(file.propulsion.channel)
        channels += [rotor.channel for rotor in file.rotor.values()]
        if file.rotors is not None and file.rotors.nominal_voltage is not None:
            channels.append("voltage")
        if file.environment.density == "log":
            channels.append("density")
        if file.ground_effect is not None:
            channels.append(file.ground_effect.channel)
        return tuple(dict.fromkeys(channels))

    @functools.cached_property
    def states(self) -> tuple[str, ...]:
        """States of the kernel: body velocity, rates, quaternion, altitude, position, lags of surfaces and rotors, gusts.

        The velocity is relative to the steady wind.
        """
        lags = [f"{c}.lag" for c in self.controls if self.file.controls[c].lag is not None]
        if self.file.rotors is not None and self.file.rotors.lag is not None:
            lags += [f"{r}.lag" for r in self.rotors]
        return (
            *(s for s in _REDUCTIONS[self.reduce].states if channels.motion_input(s) not in self.motion),
            *self.positions,
            *lags,
            *(s for axis in self.gusts for s in channels.GUST_STATES[axis]),
        )

    @functools.cached_property
    def moves(self) -> tuple[str, ...]:
        """Components of the error state of a filter: states, body-axes rotations, lags and gusts."""
        kept = _REDUCTIONS[self.reduce]
        rotations = (f"turn {angle}" for angle in kept.rotated)
        return (*kept.added, *rotations, *(s for s in self.states if s not in channels.RIGID_STATES))

    @property
    def outputs(self) -> tuple[str, ...]:
        """Observed channels, eq. (2), or those of a reduced model or of a vehicle with rotors."""
        return (*(_REDUCTIONS[self.reduce].outputs or self.frame.outputs), *self.positions)

    @functools.cached_property
    def structure(self) -> str:
        """What decides the equations, as text without the value of any number."""
        measured = [self.measured] if self.measured else []
        return json.dumps([_structure(self.file), equations_version(), *measured], sort_keys=False)

    def kernel(self) -> Kernel:
        """Return the compiled equations (SymPy is imported only when they are not in the cache)."""
        return load_kernel(self.structure, self.symbolic_model)

    def symbolic_model(self) -> SymbolicModel:
        """Return the equations in SymPy."""
        from stoop.vehicle.symbolic import build_model

        return build_model(self)

    def array_equations(self) -> Equations:
        """Return the equations as functions of arrays, which are not compiled."""
        return Equations(array_functions(self.structure, self.symbolic_model))

    def with_numbers(self, changes: Mapping[str, Mapping[str, Any]]) -> Vehicle:
        """Return the vehicle with fields of some numbers, none of them tied, replaced: ``{"CLalpha": {"value": 5.0}}``."""
        known = self.quantities
        for name in changes:
            if name not in known:
                raise VehicleError(f"{self.where}: no number is called '{name}'; {nearest(name, known)}")
            if known[name].tie is not None:
                raise VehicleError(
                    f"{self.where}: {name}: tied to '{known[name].tie}'; change that one instead"
                )
        return replace(self, file=_changed(self.file, changes))

    def without_positions(self) -> Vehicle:
        """Return the vehicle out of the room in which motion capture measures its position."""
        sensors = self.file.sensors.model_copy(update=dict.fromkeys(self.positions))
        return replace(self, file=self.file.model_copy(update={"sensors": sensors}))

    def reduced(self, reduce: str) -> Vehicle:
        """Return the longitudinal or lateral vehicle of the same file."""
        model = self.file.model.model_copy(update={"reduce": reduce})
        return replace(self, file=self.file.model_copy(update={"model": model}), measured=())

    def coupled_to(self, measured: Collection[str]) -> Vehicle:
        """Return the vehicle with held states taken from channels of a record, among :attr:`held_channels`; none: constant."""
        return replace(self, measured=tuple(c for c in self.held_channels if c in measured))

    parameter_rows = channels.parameter_rows
    initial_states = channels.initial_states
    commanded = channels.commanded
    mixed_inputs = channels.mixed_inputs
    mixing = channels.mixing
    channel_gains = channels.channel_gains
    neutral_inputs = channels.neutral_inputs
    model_inputs = channels.model_inputs
    model_mixing = channels.model_mixing
    inertia_tensor = channels.inertia_tensor
    rotor_range = functools.cached_property(rotor_channels.rotor_range)
    accelerations = rotor_channels.accelerations
    rotor_effects = rotor_channels.rotor_effects
    rotor_allocation = rotor_channels.rotor_allocation
    input_delays = delays.input_delays
    actuators = delays.actuators
    held_numbers = delays.held_numbers
    late_inputs = delays.late_inputs
    late_outputs = delays.late_outputs
    gust_start = trajectories.gust_start
    states_along = trajectories.states_along
    readings_along = trajectories.readings_along
    next_states = trajectories.next_states
