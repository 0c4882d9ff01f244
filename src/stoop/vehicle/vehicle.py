"""A vehicle: what we believe it is, and the numbers in that belief that can be estimated."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from stoop.base.arrays import FloatArray
from stoop.base.html import table
from stoop.base.numbers import number
from stoop.base.text import nearest
from stoop.errors import VehicleError
from stoop.kernels import Kernel, load_kernel
from stoop.vehicle import rotor_numbers, terms
from stoop.vehicle.defaults import COEFFICIENTS, default_bounds
from stoop.vehicle.quantity import Parameter, Quantity
from stoop.vehicle.schema import CHANNELS, GROUND, WIND, Term, VehicleFile

RIGID_STATES = ("u", "v", "w", "p", "q", "r", "e0", "e1", "e2", "e3", "h")
_REDUCED_STATES = {
    "full": RIGID_STATES,
    "longitudinal": ("u", "w", "q", "e0", "e2", "h"),
    "lateral": RIGID_STATES,
}
_REDUCED_OUTPUTS = {
    "full": CHANNELS,
    "longitudinal": ("V", "alpha", "q", "theta", "ax", "az"),
    "lateral": ("beta", "p", "r", "phi", "psi", "ay"),
}
_ESTIMATED = {"full": COEFFICIENTS, "longitudinal": ("CL", "CD", "Cm"), "lateral": ("CQ", "Cl", "Cn")}
_KEPT_COEFFICIENTS = {"full": COEFFICIENTS, "longitudinal": ("CL", "CD", "Cm"), "lateral": COEFFICIENTS}
GUST_STATES = {
    "u": ("gust.u",),
    "v": ("gust.v.fast", "gust.v.slow"),
    "w": ("gust.w.fast", "gust.w.slow"),
}  #: of the Dryden filters, m/s
_KEPT_GUSTS = {"full": ("u", "v", "w"), "longitudinal": ("u", "w"), "lateral": ("v",)}
_ADDED = {
    "full": ("u", "v", "w", "p", "q", "r"),
    "longitudinal": ("u", "w", "q"),
    "lateral": ("v", "p", "r"),
}  #: states that a filter corrects by adding
_TURNED = {"full": ("phi", "theta", "psi"), "longitudinal": ("theta",), "lateral": ("phi", "psi")}
AIR_START = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h")  #: m/s, rad, rad/s, m
GROUND_START = ("u", "v", "w", *AIR_START[3:])  #: likewise, of a vehicle with rotors
_LATER = ("turbulence", "vn", "ve", "vd", "airspeed", "rotors", "rotor", "body_drag", "ground_effect")
BIASED_BY_DEFAULT = ("p", "q", "r", "ax", "ay", "az")
GROUND_EFFECTS = ("ground_effect.rotor", "ground_effect.lift")
WIND_NUMBERS = tuple(f"sensors.{c}.bias" for c in WIND)  #: the steady wind, m/s north, east, down
_UNITS = {
    "mass": "kg", "xx": "kg m2", "yy": "kg m2", "zz": "kg m2", "xz": "kg m2", "xy": "kg m2", "yz": "kg m2",
    "area": "m2", "chord": "m", "span": "m", "airspeed": "m/s", "alpha": "rad", "gravity": "m/s2",
    "density": "kg/m3", "thrust": "N", "diameter": "m", "lag": "s", "delay": "s", "offset": "rad",
    "x": "m", "y": "m", "z": "m", "pitch": "rad", "speed_gain": "rev/s per unit", "intensity": "m/s",
    "length": "m", "radius": "m",
}  # fmt: skip
_NO_ROWS = ("name", "notes", "loadings", "sigma", "estimate_biases", "voltage_average")  #: of the kernel
_EQUATION_SOURCES = (  #: beside all of symbolic/
    "vehicle.py", "terms.py", "atmosphere.py", "schema.py", "defaults.py", "quantity.py", "rotors_schema.py",
    "rotor_numbers.py", "table.py", "notation.py",
)  # fmt: skip
_CHANNEL_UNITS = {
    **dict.fromkeys(("V", "vn", "ve", "vd"), "m/s"), **dict.fromkeys(("p", "q", "r"), "rad/s"),
    **dict.fromkeys(("ax", "ay", "az"), "m/s2"),
}  # fmt: skip


def noise_input(axis: str) -> str:
    """Return the name of the white noise (unit intensity) that drives the gust along a body axis."""
    return f"gust.{axis}.noise"


def slope_input(channel: str) -> str:
    """Return the name of the slope of a recorded channel, per s."""
    return f"{channel}.slope"


def _join(prefix: str, name: str) -> str:
    return f"{prefix}.{name}" if prefix else name


def leaves(node: Any, path: str = "") -> Iterator[tuple[str, Quantity]]:
    """Walk over every number of a file in the order of the schema; a term goes by its own name."""
    if isinstance(node, Quantity):
        yield path, node
    elif isinstance(node, BaseModel):
        for name in type(node).model_fields:
            yield from leaves(getattr(node, name), _join(path, name))
    elif isinstance(node, Mapping):
        for name, value in node.items():
            yield from leaves(value, name if isinstance(value, Term) else _join(path, name))
    elif isinstance(node, tuple) and node and isinstance(node[0], Quantity):
        for axis, value in zip("xyz", node, strict=True):
            yield from leaves(value, _join(path, axis))


def _structure(node: Any, path: str = "") -> Any:
    """Return the file with every number replaced by its name: what decides the equations."""
    if isinstance(node, Term):
        return [node.term, node.tie]
    if isinstance(node, Quantity):
        return f"={node.tie}" if node.tie else "number"
    if isinstance(node, BaseModel):
        kept = [n for n in type(node).model_fields if n not in _NO_ROWS]
        absent = {n for n in kept if n in _LATER and not getattr(node, n)}  # as before there was any
        return {n: _structure(getattr(node, n)) for n in kept if n not in absent}
    if isinstance(node, Mapping):
        return {n: _structure(v) for n, v in node.items()}
    return [_structure(v) for v in node] if isinstance(node, tuple) else node


def _unit(name: str, quantity: Quantity, controls: Iterable[str], drive: str) -> str:
    if isinstance(quantity, Term):
        return terms.unit(quantity.term, controls)
    head, _, last = name.rpartition(".")
    if name.startswith(rotor_numbers.PLACES):
        return rotor_numbers.unit(name, drive)
    if last == "bias":
        return _CHANNEL_UNITS.get(head.rpartition(".")[2], "rad")
    if head.endswith(".mix"):
        return "rad per unit"
    return _UNITS.get(last, "1")


def _bounds(name: str, q: Quantity) -> tuple[float, float]:
    if q.bounds is not None:
        return q.bounds
    if isinstance(q, Term):
        return default_bounds(name, q.value)
    if q.prior is not None:
        return q.value - 5.0 * q.prior, q.value + 5.0 * q.prior
    if name in GROUND_EFFECTS:
        return min(-1.0, 2.0 * q.value), max(4.0, 2.0 * q.value)
    return tuple(sorted((0.5 * q.value, 1.5 * q.value)))  # type: ignore[return-value]


def _is_free(name: str, q: Quantity, biases: bool, estimated: Container[str]) -> bool:
    if q.free is not None:
        return q.free
    if name in WIND_NUMBERS or name in GROUND_EFFECTS or rotor_numbers.free_by_default(name):
        return True
    return name in estimated or (biases and name in {f"sensors.{c}.bias" for c in BIASED_BY_DEFAULT})


@functools.cache
def _equations_version() -> str:
    here = Path(__file__).parent
    sources = [*sorted((here / "symbolic").glob("*.py")), *(here / name for name in _EQUATION_SOURCES)]
    return hashlib.sha256(b"".join(p.read_bytes() for p in sources)).hexdigest()


@dataclass(frozen=True, repr=False)
class Vehicle:
    """A vehicle file with its numbers flattened.

    Attributes
    ----------
    file : VehicleFile
    text : str
        The TOML as written, so that an identified vehicle keeps the user's comments.
    where : str
        How messages name the file.
    """

    file: VehicleFile
    text: str = field(repr=False)
    where: str

    def __repr__(self) -> str:
        """Return name and size on one line."""
        free = sum(p.free for p in self.parameters)
        return f"<Vehicle {self.name}: {free} of {len(self.parameters)} numbers free>"

    def _repr_html_(self) -> str:
        rows = [
            (
                p.name,
                number(p.value),
                "" if p.unit == "1" else p.unit,
                f"{number(p.lower)} … {number(p.upper)}",
            )
            for p in self.parameters
            if p.free
        ]
        return table(repr(self).strip("<>"), ("free number", "value", "unit", "bounds"), rows)

    @property
    def name(self) -> str:
        """What the user calls it."""
        return self.file.name

    @functools.cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every number of the file that is not tied to another, in the order of the kernel's rows.

        A reduced model estimates its own coefficients; what its equations do not contain is never free.
        """
        controls = tuple(self.file.controls)
        own = {n for c in _ESTIMATED[self.reduce] for n in getattr(self.file.aerodynamics, c)}
        dropped = {n for c in COEFFICIENTS for n in getattr(self.file.aerodynamics, c) if c not in self.terms}
        dropped |= self._calm
        drive = self.file.rotors.drive if self.file.rotors is not None else ""
        boxes = rotor_numbers.boxes(dict(leaves(self.file)))
        out = []
        for name, q in leaves(self.file):
            if q.tie is not None:
                continue
            low, high = boxes[name] if name in boxes and q.bounds is None else _bounds(name, q)
            free = _is_free(name, q, self.file.sensors.estimate_biases, own) and name not in dropped
            out.append(Parameter(name, q.value, low, high, free, q.prior, _unit(name, q, controls, drive)))
        return tuple(out)

    @functools.cached_property
    def rows(self) -> dict[str, int]:
        """Row of each number in the kernel's parameter array; a tied number shares its target's row."""
        own = {p.name: i for i, p in enumerate(self.parameters)}
        ties = {name: q.tie for name, q in leaves(self.file) if q.tie is not None}
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

    def value(self, name: str) -> float:
        """Return one number by its name."""
        return float(self.values[self.rows[name]])

    @property
    def reduce(self) -> str:
        """Which equations are kept: full, longitudinal or lateral."""
        return self.file.model.reduce

    @property
    def has_rotors(self) -> bool:
        """Whether it has rotors: it is then observed by its velocity over ground, and may stand still."""
        return bool(self.file.rotor)

    @property
    def rotors(self) -> tuple[str, ...]:
        """Names of the rotors."""
        return tuple(self.file.rotor)

    @property
    def start_names(self) -> tuple[str, ...]:
        """What an initial state is named by: velocity (through the air), rates, attitude, altitude."""
        return GROUND_START if self.has_rotors else AIR_START

    @property
    def actual_rates(self) -> bool:
        """Whether rates are made dimensionless with the actual airspeed, not with V*."""
        reference = self.file.reference
        return reference is not None and reference.rate_normalization == "actual"

    @functools.cached_property
    def terms(self) -> dict[str, dict[str, str]]:
        """Term texts per kept coefficient and parameter."""
        kept = _KEPT_COEFFICIENTS[self.reduce]
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
        """Body axes along which the air moves, of those that the kept equations have."""
        table = self.file.turbulence
        return tuple(
            a for a in _KEPT_GUSTS[self.reduce] if table is not None and getattr(table, a) is not None
        )

    @property
    def _calm(self) -> set[str]:
        """Numbers of gusts that the kept equations do not have, also not through a tie."""
        numbers = {
            axis: leaves(getattr(self.file.turbulence, axis, None), f"turbulence.{axis}") for axis in "uvw"
        }
        named = {axis: dict(found) for axis, found in numbers.items()}
        used = {name for axis in self.gusts for name, q in named[axis].items() if q.tie is None}
        used |= {q.tie for axis in self.gusts for q in named[axis].values() if q.tie is not None}
        return {name for found in named.values() for name in found} - used

    @functools.cached_property
    def inputs(self) -> tuple[str, ...]:
        """All that drives the equations, in the order of the kernel's inputs: recorded channels, noise, slopes.

        Noise that drives gusts is zero except in simulated turbulence. Without any recorded channel ``none``
        stands for them. Slopes are those of :attr:`sloped`; each is held from a sample to the next.
        """
        noise, slopes = map(noise_input, self.gusts), map(slope_input, self.sloped)
        return (*(self.recorded or ("none",)), *noise, *slopes)

    @functools.cached_property
    def sloped(self) -> tuple[str, ...]:
        """Recorded channels whose slopes drive the equations: of rotors that have inertia, and no lag that knows it."""
        rotors = self.file.rotors
        if rotors is None or rotors.inertia is None or rotors.lag is not None:
            return ()
        voltage = ("voltage",) if rotors.nominal_voltage is not None else ()
        return tuple(dict.fromkeys((*(r.channel for r in self.file.rotor.values()), *voltage)))

    @functools.cached_property
    def recorded(self) -> tuple[str, ...]:
        """Recorded channels that drive the equations."""
        channels = [channel for c in self.controls for channel in self.channels_of(c)]
        propulsion = self.file.propulsion
        if propulsion is not None and propulsion.kind != "constant":
            channels.append(propulsion.channel)
        channels += [rotor.channel for rotor in self.file.rotor.values()]
        if self.file.rotors is not None and self.file.rotors.nominal_voltage is not None:
            channels.append("voltage")
        if self.file.environment.density == "log":
            channels.append("density")
        if self.file.ground_effect is not None:
            channels.append(self.file.ground_effect.channel)
        return tuple(dict.fromkeys(channels))

    @functools.cached_property
    def states(self) -> tuple[str, ...]:
        """States of the kernel: body velocity, rates, quaternion, altitude, lags of surfaces and rotors, gusts.

        The velocity is relative to the steady wind.
        """
        lags = [f"{c}.lag" for c in self.controls if self.file.controls[c].lag is not None]
        if self.file.rotors is not None and self.file.rotors.lag is not None:
            lags += [f"{r}.lag" for r in self.rotors]
        return (*_REDUCED_STATES[self.reduce], *lags, *(s for axis in self.gusts for s in GUST_STATES[axis]))

    @functools.cached_property
    def moves(self) -> tuple[str, ...]:
        """Numbers of a small move of the state, as a filter makes it: states, body-axes rotations, lags and gusts."""
        turned = (f"turn {angle}" for angle in _TURNED[self.reduce])
        return (*_ADDED[self.reduce], *turned, *(s for s in self.states if s not in RIGID_STATES))

    @property
    def outputs(self) -> tuple[str, ...]:
        """Observed channels, eq. (2), or those that a reduced model or a vehicle with rotors has."""
        if self.has_rotors:
            return GROUND
        return _REDUCED_OUTPUTS[self.reduce]

    @functools.cached_property
    def structure(self) -> str:
        """What decides the equations, as text; no value of a number enters."""
        return json.dumps([_structure(self.file), _equations_version()], sort_keys=False)

    def kernel(self) -> Kernel:
        """Return the compiled equations (SymPy is imported only when they are not in the cache)."""

        def build() -> Any:
            from stoop.vehicle.symbolic import build_model

            return build_model(self)

        return load_kernel(self.structure, build)

    def with_numbers(self, changes: Mapping[str, Mapping[str, Any]]) -> Vehicle:
        """Return the vehicle with fields of some numbers replaced, e.g. ``{"CLalpha": {"value": 5.0}}``.

        Raises
        ------
        VehicleError
            A name that the vehicle does not have, or of a number that is tied to another.
        """
        known = dict(leaves(self.file))
        for name in changes:
            if name not in known:
                raise VehicleError(f"{self.where}: no number is called '{name}'; {nearest(name, known)}")
            if known[name].tie is not None:
                raise VehicleError(
                    f"{self.where}: {name}: tied to '{known[name].tie}'; change that one instead"
                )
        return replace(self, file=_changed(self.file, changes))

    def reduced(self, reduce: str) -> Vehicle:
        """Return the longitudinal or lateral vehicle that the same file describes."""
        model = self.file.model.model_copy(update={"reduce": reduce})
        return replace(self, file=self.file.model_copy(update={"model": model}))


def _changed(node: Any, changes: Mapping[str, Mapping[str, Any]], path: str = "") -> Any:
    """Copy a file with changed numbers, walking as :func:`leaves` does."""
    if isinstance(node, Quantity):
        return node.model_copy(update=dict(changes[path])) if path in changes else node
    if isinstance(node, BaseModel):
        new = {n: _changed(getattr(node, n), changes, _join(path, n)) for n in type(node).model_fields}
        return node.model_copy(update=new)
    if isinstance(node, Mapping):
        return {
            n: _changed(v, changes, n if isinstance(v, Term) else _join(path, n)) for n, v in node.items()
        }
    if isinstance(node, tuple) and node and isinstance(node[0], Quantity):
        return tuple(_changed(v, changes, _join(path, a)) for a, v in zip("xyz", node, strict=True))
    return node
