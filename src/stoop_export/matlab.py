"""A vehicle as a linear model (JSON of format ``stoop-state-space/1``, MATLAB 5 ``.mat``) and for MATLAB and Simulink.

For MATLAB the equations are one function, printed from the same SymPy equations that the compiled kernel comes from, with a
script that flies it, and one that builds a Simulink model.
"""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from sympy.printing.octave import OctaveCodePrinter

from stoop import Vehicle, linearize
from stoop.extend import motion
from stoop.extend.arrays import FloatArray
from stoop.extend.notices import notice
from stoop.extend.text import printable, without_rounding
from stoop_analysis.derivatives import ParameterCovariance
from stoop_export.exporter import Exported, Exporter, encoded
from stoop_export.jsbsim_flight import file_name

FORMAT: Final = "stoop-state-space/1"
MATRICES: Final = ("A", "B", "C", "D")
_UNITS: Final = {
    **dict.fromkeys(("V", "u", "v", "w"), "m/s"), **dict.fromkeys(("p", "q", "r"), "rad/s"), "h": "m",
    **dict.fromkeys(("ax", "ay", "az"), "m/s2"), **dict.fromkeys(("e0", "e1", "e2", "e3", "none"), "1"),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class StateSpace:
    """A linear model with its steady flight.

    Attributes
    ----------
    vehicle : Vehicle
    point : Trim
    model : LinearModel
    x, u, y : (n_x,), (n_u,), (n_y,)
        The steady flight that the model's deviations are from, SI and rad.
    standard_errors : mapping of str to array
        Of the entries of A, B, C, D, first order in the parameters' covariance, at a fixed steady flight; infinite
        for an entry that depends on a parameter which the data do not determine; empty where no covariance is known.
    """

    vehicle: Vehicle
    point: motion.Trim
    model: motion.LinearModel
    x: FloatArray
    u: FloatArray
    y: FloatArray
    standard_errors: Mapping[str, FloatArray] = field(default_factory=dict)


def state_space(vehicle: Vehicle, point: motion.Trim, known: ParameterCovariance | None = None) -> StateSpace:
    """Linearize a vehicle about a steady flight."""
    model = linearize(vehicle, point)
    rows = vehicle.parameter_rows(point.changes)
    states = vehicle.initial_states(point.start, rows, point.inputs)
    _, readings = vehicle.kernel().evaluate(rows, states, point.inputs[:, None])
    surfaces = {c: float(vehicle.commanded(c, rows, point.inputs)[0]) for c in vehicle.controls}
    begin = point.start | {
        n: x for n, x in zip(vehicle.states, states[:, 0], strict=True) if n.endswith(".lag")
    }
    channels = dict(zip(vehicle.inputs, point.inputs.tolist(), strict=True)) | surfaces
    x = np.array([begin.get(n, 0.0) for n in model.states])
    u = np.array([channels[n] for n in model.inputs])
    errors = {} if known is None else standard_errors(vehicle, point, known)
    x, u, y = (without_rounding(values, 1.0) for values in (x, u, readings[:, 0]))
    return StateSpace(vehicle, point, model, x, u, y, errors)


def standard_errors(
    vehicle: Vehicle, point: motion.Trim, known: ParameterCovariance
) -> dict[str, FloatArray]:
    """Return the standard error of every entry: the square root of diag(J S J') with J by central differences.

    A parameter without a finite variance is unknown, and so is every entry that depends on it by more than the
    rounding of the others, 1e-7 of the largest derivative. Steps are 1e-3 standard errors, or 1e-4 of the value.
    """

    def slopes(name: str, step: float) -> list[FloatArray]:
        shifted = [{name: {"value": vehicle.value(name) + s}} for s in (step, -step)]
        up, down = (linearize(vehicle.with_numbers(change), point) for change in shifted)
        return [(getattr(up, m) - getattr(down, m)) / (2.0 * step) for m in MATRICES]

    variances = np.diag(known.covariance)
    certain = [i for i, s in enumerate(variances) if np.isfinite(s) and s > 0.0]
    unknown = [known.names[i] for i, s in enumerate(variances) if not np.isfinite(s)]
    first = [slopes(known.names[i], 1e-3 * math.sqrt(variances[i])) for i in certain]
    others = [slopes(name, 1e-4 * (abs(vehicle.value(name)) or 1.0)) for name in unknown]
    covariance = known.covariance[np.ix_(certain, certain)]
    out = {}
    for k, name in enumerate(MATRICES):
        shape = others[0][k].shape if others else ()
        J = np.stack([s[k] for s in first], axis=-1) if first else np.zeros((*shape, 0))
        variance = np.einsum("...i,ij,...j->...", J, covariance, J)
        depends = [np.abs(s[k]) > 1e-7 * np.max(np.abs(s[k]), initial=0.0) for s in others]
        lost = np.any(depends, axis=0) if others else False
        out[name] = np.where(lost, np.inf, np.sqrt(np.maximum(variance, 0.0)))
    return out if first or others else {}


def unit(name: str, vehicle: Vehicle) -> str:
    """Return the unit of a state, input or output; what is neither a variable nor of a rotor is an angle."""
    from stoop.extend.variables import VARIABLES

    if name in _UNITS:
        return _UNITS[name]
    if name.endswith(".slope"):
        own = unit(name.removesuffix(".slope"), vehicle)
        return f"{own}2" if own.endswith("/s") else f"{own}/s"
    if name.removesuffix(".lag") in vehicle.rotors:
        return "rad/s" if vehicle.drive == "speed" else "1"
    return VARIABLES[name].unit if name in VARIABLES else "rad"


def numbers(vehicle: Vehicle, point: motion.Trim) -> dict[str, float]:
    """Return every number of the vehicle as it is flown, by name."""
    own = dict(zip((p.name for p in vehicle.parameters), vehicle.values.tolist(), strict=True))
    return own | {n: float(v) for n, v in point.changes.items()}


def json_text(found: StateSpace) -> str:
    """Return the model as JSON, SI and rad; numbers carry all their digits, and what does not exist is null."""
    model, vehicle = found.model, found.vehicle

    def signals(names: tuple[str, ...], values: FloatArray) -> list[dict[str, Any]]:
        rows = zip(names, values.tolist(), strict=True)
        return [{"name": n, "unit": unit(n, vehicle), "trim": v} for n, v in rows]

    def late(names: tuple[str, ...], values: FloatArray, delays: FloatArray) -> list[dict[str, Any]]:
        return [one | {"delay": s} for one, s in zip(signals(names, values), delays.tolist(), strict=True)]

    def finite(node: Any) -> Any:
        if isinstance(node, Mapping):
            return {k: finite(v) for k, v in node.items()}
        if isinstance(node, list):
            return [finite(v) for v in node]
        return None if isinstance(node, float) and not math.isfinite(node) else node

    content = {
        "format": FORMAT,
        "vehicle": vehicle.name,
        "reduce": vehicle.reduce,
        "equations": "x' = A (x - x0) + B (u - u0), y - y0 = C (x - x0) + D (u - u0), inputs and outputs late by their delays, s",
        "states": signals(model.states, found.x),
        "inputs": late(model.inputs, found.u, model.input_delays),
        "outputs": late(model.outputs, found.y, model.output_delays),
        **{m: getattr(model, m).tolist() for m in MATRICES},
        "standard_errors": {m: e.tolist() for m, e in found.standard_errors.items()},
        "trim": {"altitude": found.point.start.get("h", 0.0), "residual": found.point.residual},
        "parameters": numbers(vehicle, found.point),
    }
    return json.dumps(finite(content), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def variables(found: StateSpace) -> dict[str, Any]:
    """Return the content of the ``.mat`` file: matrices, steady flight, and names as cells of text."""
    model = found.model
    parameters = numbers(found.vehicle, found.point)
    return {
        **{m: getattr(model, m) for m in MATRICES},
        **{f"{m}_std": e for m, e in found.standard_errors.items()},
        "x0": found.x[:, None],
        "u0": found.u[:, None],
        "y0": found.y[:, None],
        "states": _cells(model.states),
        "inputs": _cells(model.inputs),
        "outputs": _cells(model.outputs),
        "InputDelay": model.input_delays[:, None],  # as the function ss of MATLAB calls them, s
        "OutputDelay": model.output_delays[:, None],
        "parameter_names": _cells(parameters),
        "parameters": np.array(list(parameters.values()))[:, None],
    }


def _cells(words: Any) -> NDArray[np.object_]:
    """Return a column of text cells."""
    out = np.empty((len(words), 1), dtype=object)
    out[:, 0] = list(words)
    return out


def mat_bytes(variables: Mapping[str, Any]) -> bytes:
    """Return a MATLAB 5 file; the same numbers give the same bytes, so no date stands in its header."""
    from scipy.io import savemat

    stream: Any = io.BytesIO()  # SciPy's types know of files with a name only
    savemat(stream, dict(variables), format="5", oned_as="column")
    content: bytes = stream.getvalue()
    return b"MATLAB 5.0 MAT-file, made by stoop export".ljust(116) + content[116:]


class _Printer(OctaveCodePrinter):  # type: ignore[misc]
    def _print_Float(self, expr: Any) -> str:  # with all digits
        return repr(float(expr))


_PRINTER: Final = _Printer({"inline": True})


@dataclass(frozen=True)
class Matlab:
    """Files for MATLAB by name; ``.m`` files are text, the ``.mat`` file holds variables."""

    name: str
    texts: Mapping[str, str]
    variables: Mapping[str, Any]


def matlab(vehicle: Vehicle, point: motion.Trim, linear: StateSpace) -> Matlab:
    """Return the files of a vehicle that flies from a steady flight."""
    name = identifier(vehicle.name)
    slopes = hold = turn = ""
    if vehicle.sloped:  # slopes of channels are computed by the script
        sources = list(vehicle.sloped), [f"{name}.slope" for name in vehicle.sloped]
        of, to = (" ".join(str(1 + vehicle.inputs.index(n)) for n in names) for names in sources)
        slopes = (
            f"slopes = diff(u(:, [{of}])) / h;  % of channels that spin rotors up, held between samples\n"
            f"u(:, [{to}]) = slopes([1:end end], :);\n"
        )
        hold = f"    b([{to}]) = a([{to}]);\n"
        turn = f"    b([{to}]) = u(k + 1, [{to}])';\n"
    texts = {
        f"{name}_equations.m": equations(vehicle, name),
        f"{name}_fly.m": _FLY.format(name=name, slopes=slopes, hold=hold, turn=turn),
        f"{name}_simulink.m": _SIMULINK.format(name=name),
    }
    parameters, rows = numbers(vehicle, point), vehicle.parameter_rows(point.changes)
    content = {
        "p": np.array(list(parameters.values()))[:, None],
        "parameter_names": _cells(parameters),
        "x0": vehicle.initial_states(point.start, rows, point.inputs),
        "u0": point.inputs[:, None],
        "state_names": _cells(vehicle.states),
        "input_names": _cells(vehicle.inputs),
        "output_names": _cells(vehicle.outputs),
        "linear": {k: v for k, v in variables(linear).items() if not k.startswith("parameter")},
    }
    return Matlab(name, texts, content)


def identifier(name: str) -> str:
    """Return a name that a MATLAB function may have."""
    out = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_").lower()[:40].strip("_")
    return out if out[:1].isalpha() else f"vehicle_{out}".strip("_")


def equations(vehicle: Vehicle, name: str) -> str:
    """Return a MATLAB function ``[dx, y] = NAME_equations(x, u, p)``; one statement a line, no loops or branches."""

    def signals(letter: str, names: Sequence[str]) -> list[str]:
        return [f"%   {letter}({i}) {n}, {unit(n, vehicle)}" for i, n in enumerate(names, 1)]

    lines = [
        f"function [dx, y] = {name}_equations(x, u, p)",
        f"% Equations of motion and instruments of {printable(vehicle.name)}, made by stoop export.",
        "% SI units and radians; body axes forward, right, down; e0..e3 quaternion, body to Earth.",
        *signals("x", vehicle.states),
        *signals("u", vehicle.inputs),
        *signals("y", vehicle.outputs),
        f"% p: the numbers of the vehicle, as in {name}.mat",
    ]
    model = vehicle.symbolic_model()
    table: dict[Any, Any] = {}
    wanted = [sp.sympify(e) for e in (*model.derivatives, *model.outputs)]
    used = set().union(*(e.free_symbols for e in wanted))
    for letter, symbols in (("x", model.states), ("u", model.inputs), ("p", model.parameters)):
        for i, symbol in enumerate(symbols, 1):
            table[symbol] = sp.Symbol(f"{letter}{i}", real=True)
            if symbol in used:
                lines.append(f"{letter}{i} = {letter}({i});")
    steps, results = sp.cse([e.xreplace(table) for e in wanted], sp.numbered_symbols("t"), order="none")
    lines += [f"{symbol} = {_PRINTER.doprint(e)};" for symbol, e in steps]
    count = len(model.states)
    for letter, expressions in (("dx", results[:count]), ("y", results[count:])):
        lines.append(f"{letter} = zeros({len(expressions)}, 1);")
        lines += [f"{letter}({i}) = {_PRINTER.doprint(e)};" for i, e in enumerate(expressions, 1)]
    return "\n".join([*lines, "end", ""])


_FLY: Final = """\
function [y, x] = {name}_fly(time, u, x0, p)
% Fly given inputs from a given start by Runge-Kutta of order four, inputs linear between samples.
%   time (n, 1) s, uniform;  u (n, n_u);  x0 (n_x, 1);  p from {name}.mat
%   y (n, n_y), x (n, n_x)
% Example, ten seconds of the steady flight:
%   m = load('{name}.mat');  t = (0:0.01:10)';
%   y = {name}_fly(t, repmat(m.u0', numel(t), 1), m.x0, m.p);
n = numel(time);
h = time(2) - time(1);
{slopes}x = zeros(n, numel(x0));
x(1, :) = x0(:)';
[~, first] = {name}_equations(x0, u(1, :)', p);
y = zeros(n, numel(first));
y(1, :) = first';
for k = 1:n - 1
    s = x(k, :)';
    a = u(k, :)';
    b = u(k + 1, :)';
{hold}    k1 = {name}_equations(s, a, p);
    k2 = {name}_equations(s + h / 2 * k1, (a + b) / 2, p);
    k3 = {name}_equations(s + h / 2 * k2, (a + b) / 2, p);
    k4 = {name}_equations(s + h * k3, b, p);
    s = s + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    x(k + 1, :) = s';
{turn}    [~, reading] = {name}_equations(s, b, p);
    y(k + 1, :) = reading';
end
end
"""

_SIMULINK: Final = """\
% Build the Simulink model {name}_model: inputs u, an integrator of the state from x0, outputs y.
% Needs Simulink. The equations stand in a MATLAB Function block; x0 and p come from {name}.mat.
load('{name}.mat', 'x0', 'u0', 'p');
model = '{name}_model';
new_system(model);
open_system(model);
block = [model '/equations'];
add_block('simulink/User-Defined Functions/MATLAB Function', block);
chart = find(sfroot, '-isa', 'Stateflow.EMChart', 'Path', block);
chart.Script = fileread('{name}_equations.m');
data = find(chart, '-isa', 'Stateflow.Data', 'Name', 'p');
data.Scope = 'Parameter';
add_block('simulink/Sources/In1', [model '/u']);
add_block('simulink/Continuous/Integrator', [model '/state'], 'InitialCondition', 'x0');
add_block('simulink/Sinks/Out1', [model '/y']);
add_line(model, 'state/1', 'equations/1');
add_line(model, 'u/1', 'equations/2');
add_line(model, 'equations/1', 'state/1');
add_line(model, 'equations/2', 'y/1');
set_param([model '/u'], 'PortDimensions', num2str(numel(u0)));
set_param(model, 'SolverType', 'Fixed-step', 'Solver', 'ode4', 'FixedStep', '0.01');
save_system(model);
"""


class LinearExporter(Exporter):
    """An export that holds the linear model about the steady flight."""

    @cached_property
    def linear(self) -> StateSpace:
        """The linear model, with standard errors."""
        return state_space(self.vehicle, self.point, self.model.covariance)

    def lacks(self) -> list[str]:
        """Return what a linear model cannot express."""
        return [str(one) for one in motion.LinearModel.left_out(self.vehicle)]


class StateSpaceFiles(LinearExporter):
    """A, B, C, D as JSON and as ``.mat``."""

    def files(self) -> Exported:
        """Return both files."""
        name = file_name(self.vehicle.name)
        files = {
            f"{name}.json": json_text(self.linear).encode("utf-8"),
            f"{name}.mat": mat_bytes(variables(self.linear)),
        }
        return Exported(files, f"{name}.json")


class Simulink(LinearExporter):
    """MATLAB functions, the script that builds a Simulink model, and the numbers."""

    def files(self) -> Exported:
        """Return functions, script and numbers."""
        made = matlab(self.vehicle, self.point, self.linear)
        files = encoded(made.texts) | {f"{made.name}.mat": mat_bytes(made.variables)}
        return Exported(files, f"{made.name}_simulink.m")

    def lacks(self) -> list[str]:
        """Return what the functions and the linear model cannot express."""
        sloped = tuple(f"{name}.slope" for name in self.vehicle.sloped)
        notes = [notice("functions-without-actuators", numbers=self.actuators)] if self.actuators else []
        notes += [notice("slopes-of-channels", channels=sloped)] if sloped else []
        return [*map(str, notes), *super().lacks()]
