"""A vehicle as units of the Functional Mock-up Interface, versions 2.0.4 and 3.0.1, for co-simulation.

A unit holds the equations as C, printed from the expressions that the compiled kernel comes from, and their integration by
Runge-Kutta of order four with inputs that are linear over a step. It calls nothing but ``sqrt``, ``fabs`` and ``atan2``, so the
target needs neither Python nor stoop; where a compiler is found, the library of this platform is inside.

References
----------
Modelica Association, Functional Mock-up Interface Specification, 2.0.4 (2022), sections 2.2 and 4, and 3.0.1 (2023),
sections 2.4 and 4.
"""

from __future__ import annotations

import hashlib
import io
import math
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import sympy as sp

from stoop import Vehicle
from stoop.extend.errors import StoopError
from stoop.extend.motion import Trim
from stoop.extend.text import printable
from stoop.extend.vehicles import SymbolicEquations
from stoop_analysis.derivatives import ParameterCovariance
from stoop_export.matlab import identifier, unit

VERSIONS: Final = ("2.0", "3.0")
LARGEST_STEP: Final = 0.01  #: s, of the integration
DURATION: Final = 30.0  #: s, of the default experiment
COMPILE_SECONDS: Final = 300.0
TIME, STEP = "time", "solver.step"
_MACHINES: Final = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}
_SYSTEMS: Final = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}


@dataclass(frozen=True)
class Quantity:
    """One variable of a unit: its value reference is its place in the list."""

    name: str
    unit: str
    start: float
    causality: str  #: independent, parameter, input, output or local
    description: str = ""


@dataclass(frozen=True)
class Unit:
    """What both versions of a unit are made of.

    Attributes
    ----------
    name : of the model, an identifier of C
    title : of the vehicle
    quantities : in the order of their value references
    source : C of the equations and their integration
    """

    name: str
    title: str
    quantities: tuple[Quantity, ...]
    source: str

    @property
    def token(self) -> str:
        """Identifier of this very model, by which an importer checks that description and library belong together."""
        known = repr([(q.name, q.start) for q in self.quantities])
        return hashlib.sha256((self.source + known).encode()).hexdigest()[:32]


def make_unit(vehicle: Vehicle, point: Trim, known: ParameterCovariance | None = None) -> Unit:
    """Return the unit of a vehicle that starts from a steady flight; parameters are described by what is `known` of them.

    Inputs are the recorded channels as surfaces and rotors receive them, and their rates over a step, per s (zero for inputs
    that are held); outputs are the readings of the instruments, and the position of a vehicle with the full equations.
    """
    model, rows = vehicle.symbolic_model(), vehicle.parameter_rows(point.changes)
    states = vehicle.initial_states(point.start, rows, point.inputs)[:, 0].tolist()
    names, derivatives = list(vehicle.states), list(model.derivatives)
    position = _position(vehicle, dict(zip(vehicle.states, model.states, strict=True)))
    readings = vehicle.kernel().evaluate(rows, np.array(states)[:, None], point.inputs[:, None])[1]
    states, names = states + [0.0] * len(position), names + list(position)
    derivatives += position.values()
    channels = [n for n in vehicle.inputs if n != "none" and not n.endswith(".slope")]
    starts = dict(zip(vehicle.inputs, point.inputs.tolist(), strict=True))
    known = ParameterCovariance() if known is None else known
    errors = dict(zip(known.names, np.sqrt(np.abs(np.diag(known.covariance))).tolist(), strict=True))
    described = {
        n: f"standard error {x:.3g}" if math.isfinite(x) else "not identified by the flight"
        for n, x in errors.items()
    }
    used = set().union(*(sp.sympify(e).free_symbols for e in (*derivatives, *model.outputs)))
    numbers = [
        (symbol, Quantity(p.name, p.unit, value, "parameter", described.get(p.name, "")))
        for symbol, p, value in zip(model.parameters, vehicle.parameters, rows[:, 0].tolist(), strict=True)
        if symbol in used  # neither noise nor actuators nor what a reduced model leaves out
    ]
    quantities = [
        Quantity(TIME, "s", 0.0, "independent"),
        Quantity(STEP, "s", LARGEST_STEP, "parameter"),
        *(quantity for _, quantity in numbers),
        *(Quantity(f"start.{n}", _unit(n, vehicle), x, "parameter") for n, x in zip(names, states, strict=True)),
        *(Quantity(n, _unit(n, vehicle), starts[n], "input") for n in channels),
        *(Quantity(f"{n}.slope", f"{_unit(n, vehicle)}/s", 0.0, "input") for n in channels),
        *(Quantity(f"state.{n}", _unit(n, vehicle), x, "local") for n, x in zip(names, states, strict=True)),
        *(Quantity(n, _unit(n, vehicle), float(y), "output") for n, y in zip(vehicle.outputs, readings[:, 0], strict=True)),
        *(Quantity(n, "m", 0.0, "output") for n in position),
    ]  # fmt: skip
    at = {
        **{s: f"u[{channels.index(n)}]" for n, s in zip(vehicle.inputs, model.inputs, strict=True) if n in channels},
        **{
            s: f"r[{channels.index(n.removesuffix('.slope'))}]"
            for n, s in zip(vehicle.inputs, model.inputs, strict=True)
            if n.endswith(".slope")
        },
        **{s: f"x[{i}]" for i, s in enumerate(model.states)},
        **{s: f"p[{i}]" for i, (s, _) in enumerate(numbers)},
    }  # fmt: skip
    outputs = [*model.outputs, *(sp.Symbol(f"position {n}", real=True) for n in position)]
    at |= {s: f"x[{len(vehicle.states) + i}]" for i, s in enumerate(outputs[len(model.outputs) :])}
    sizes = {"NP": len(numbers), "NX": len(states), "NU": len(channels), "NY": len(outputs)}
    source = _equations(vehicle, at, derivatives, outputs, sizes)
    return Unit(identifier(vehicle.name), vehicle.name, _distinct(quantities), source)


def _unit(name: str, vehicle: Vehicle) -> str:
    return "m" if name in ("north", "east") else unit(name, vehicle)


def _position(vehicle: Vehicle, states: Mapping[str, Any]) -> dict[str, Any]:
    """Return the rates of the position, m/s, in the still air that the states are relative to."""
    if vehicle.reduce != "full" or vehicle.motion:
        return {}
    e = (states["e0"], states["e1"], states["e2"], states["e3"])
    north, east, _ = SymbolicEquations.over_ground(e, (states["u"], states["v"], states["w"]))
    return {"north": north, "east": east}


def _distinct(quantities: list[Quantity]) -> tuple[Quantity, ...]:
    """Return quantities with names of their own: a parameter named as a signal says that it is one."""
    signals = {q.name for q in quantities if q.causality != "parameter"}
    return tuple(
        replace(q, name=f"parameter.{q.name}") if q.causality == "parameter" and q.name in signals else q
        for q in quantities
    )


def _equations(
    vehicle: Vehicle,
    at: Mapping[Any, str],
    derivatives: list[Any],
    outputs: list[Any],
    sizes: Mapping[str, int],
) -> str:
    """Return the C of the equations; names are made here, no text of the vehicle file reaches it."""
    made = {symbol: sp.Symbol(f"s{i}", real=True) for i, symbol in enumerate(at)}
    places = {made[symbol]: place for symbol, place in at.items()}
    wanted = [sp.sympify(e).xreplace(made) for e in (*derivatives, *outputs)]
    steps, results = sp.cse(wanted, sp.numbered_symbols("t"), order="none")
    used = sorted(set().union(*(e.free_symbols for e in wanted)), key=str)
    lines = [f"    const double {s} = {places[s]};" for s in used]
    lines += [f"    const double {s} = {SymbolicEquations.text(e)};" for s, e in steps]
    count = len(derivatives)
    lines += [f"    dx[{i}] = {SymbolicEquations.text(e)};" for i, e in enumerate(results[:count])]
    lines += [f"    y[{i}] = {SymbolicEquations.text(e)};" for i, e in enumerate(results[count:])]
    head = [f"enum {{ {', '.join(f'{name} = {size}' for name, size in sizes.items())} }};"]
    signature = "static void equations(const double *x, const double *u, const double *r, const double *p, double *dx, double *y)"
    unused = "    (void)x; (void)u; (void)r; (void)p;"
    return "\n".join([*head, "", signature, "{", unused, *lines, "}", ""])


def unit_bytes(made: Unit, version: str, compiler: str | None = None) -> bytes:
    """Return a unit as a file, with the library of this platform if a compiler, by its path, is given.

    Raises
    ------
    StoopError
        The compiler fails.
    """
    templates = files("stoop_export") / "templates"
    model, interface = (
        (templates / f"{n}.c").read_text(encoding="utf-8") for n in ("fmi_model", f"fmi{version[0]}")
    )
    settable = [q for q in made.quantities if q.causality in ("independent", "parameter", "input")]
    defaults = ",\n    ".join(repr(q.start) for q in settable)
    model = model.replace("/* EQUATIONS */", made.source).replace("/* DEFAULTS */", f"\n    {defaults}\n")
    text = "\n".join([f'#define TOKEN "{made.token}"\n', model, interface])
    content = {"modelDescription.xml": description(made, version), f"sources/{made.name}.c": text.encode()}
    if version == "3.0":
        content["sources/buildDescription.xml"] = _build_description(made)
    if compiler is not None and (place := library_place(made, version)) is not None:
        content[place] = compiled(text, compiler)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():  # without the date, so that the same model gives the same bytes
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def find_compiler() -> str | None:
    """Return the path of the C compiler of this machine, if it has one."""
    return None if sys.platform == "win32" else shutil.which("cc")


def library_place(made: Unit, version: str) -> str | None:
    """Return where in a unit the library of this platform belongs; None for a platform that has no name there."""
    machine, system = _MACHINES.get(platform.machine().lower()), _SYSTEMS.get(sys.platform)
    if machine is None or system is None or (version == "2.0" and machine != "x86_64"):
        return None
    kind, ending = system
    folder = f"{machine}-{kind}" if version == "3.0" else f"{'win' if kind == 'windows' else kind}64"
    return f"binaries/{folder}/{made.name}{ending}"


def compiled(text: str, compiler: str) -> bytes:
    """Return the shared library of a source of C99."""
    with tempfile.TemporaryDirectory(prefix="stoop-fmu-") as folder:
        source, library = Path(folder) / "unit.c", Path(folder) / "unit.so"
        source.write_text(text, encoding="utf-8")
        command = [compiler, "-std=c99", "-O2", "-shared", "-fPIC", "-o", str(library), str(source), "-lm"]
        try:
            done = subprocess.run(  # noqa: S603 - a compiler of this machine, on text of our own
                command, capture_output=True, text=True, check=False, timeout=COMPILE_SECONDS
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise StoopError(f"{compiler}: cannot compile the unit: {printable(str(error))}") from None
        if done.returncode != 0 or not library.is_file():
            raise StoopError(f"{compiler}: cannot compile the unit: {printable(done.stderr)[:300]}")
        return library.read_bytes()


def description(made: Unit, version: str) -> bytes:
    """Return modelDescription.xml of a version."""
    three = version == "3.0"
    root = Element("fmiModelDescription", {"fmiVersion": version, "modelName": printable(made.title)})
    root.set("instantiationToken" if three else "guid", made.token)
    root.attrib |= {"generationTool": "stoop", "variableNamingConvention": "flat"}
    abilities = {"modelIdentifier": made.name, "canHandleVariableCommunicationStepSize": "true"}
    abilities |= {f"canGetAndSetFMU{'S' if three else 's'}tate": "true"}
    abilities |= {f"canSerializeFMU{'S' if three else 's'}tate": "true"}
    simulation = SubElement(root, "CoSimulation", abilities)
    if not three:
        simulation.set("canInterpolateInputs", "true")
        SubElement(SubElement(simulation, "SourceFiles"), "File", {"name": f"{made.name}.c"})
    units = SubElement(root, "UnitDefinitions")
    for name in sorted({q.unit for q in made.quantities}):
        SubElement(units, "Unit", {"name": name})
    experiment = {"startTime": "0", "stopTime": f"{DURATION:g}", "stepSize": f"{LARGEST_STEP:g}"}
    SubElement(root, "DefaultExperiment", experiment)
    variables = SubElement(root, "ModelVariables")
    for reference, quantity in enumerate(made.quantities):
        variables.append(_variable(quantity, reference, three))
    structure = SubElement(root, "ModelStructure")
    outputs = [i for i, q in enumerate(made.quantities) if q.causality == "output"]
    for tag in ("Output", "InitialUnknown"):
        parent = structure if three else SubElement(structure, f"{tag}s")
        for i in outputs:
            if three:
                SubElement(parent, tag, {"valueReference": str(i)})
            else:
                SubElement(parent, "Unknown", {"index": str(i + 1)})
    return _xml(root)


def _variable(quantity: Quantity, reference: int, three: bool) -> Element:
    out = Element("Float64" if three else "ScalarVariable", {"name": quantity.name})
    out.attrib |= {"valueReference": str(reference), "causality": quantity.causality}
    out.set("variability", "fixed" if quantity.causality == "parameter" else "continuous")
    if quantity.description:
        out.set("description", quantity.description)
    kind = out if three else SubElement(out, "Real")
    kind.set("unit", quantity.unit)
    if quantity.causality == "parameter":
        out.set("initial", "exact")
    elif quantity.causality in ("local", "output"):
        out.set("initial", "calculated")
    if quantity.causality in ("parameter", "input"):
        kind.set("start", repr(quantity.start))
    return out


def _build_description(made: Unit) -> bytes:
    root = Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = SubElement(root, "BuildConfiguration", {"modelIdentifier": made.name})
    sources = SubElement(build, "SourceFileSet", {"language": "C99"})
    SubElement(sources, "SourceFile", {"name": f"{made.name}.c"})
    return _xml(root)


def _xml(root: Element) -> bytes:
    ET.indent(root, " ")
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"
