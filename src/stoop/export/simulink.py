"""A vehicle for MATLAB and Simulink: its equations as one function, a script that flies it, one that builds a model.

The function is printed from the same SymPy equations that the compiled kernel comes from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import sympy as sp
from sympy.printing.octave import OctaveCodePrinter

from stoop.errors import one_line
from stoop.export.record import identifier
from stoop.export.state_space import StateSpace, cells, numbers, unit
from stoop.export.state_space import variables as linear_variables
from stoop.simulate import Trim, initial_states, parameter_rows
from stoop.vehicle import Vehicle
from stoop.vehicle.symbolic import build_model
from stoop.vehicle.vehicle import slope_input


class _Printer(OctaveCodePrinter):  # type: ignore[misc]
    """Prints floating-point numbers with all their digits."""

    def _print_Float(self, expr: Any) -> str:
        return repr(float(expr))


_PRINTER: Final = _Printer({"inline": True})


@dataclass(frozen=True)
class Matlab:
    """What is written: files by name; ``.m`` files are text, the ``.mat`` file holds variables."""

    name: str
    texts: Mapping[str, str]
    variables: Mapping[str, Any]


def matlab(vehicle: Vehicle, point: Trim, linear: StateSpace) -> Matlab:
    """Return the files of a vehicle that flies from a steady flight."""
    name = identifier(vehicle.name)
    texts = {
        f"{name}_equations.m": equations(vehicle, name),
        f"{name}_fly.m": _flight(vehicle, name),
        f"{name}_simulink.m": _SIMULINK.format(name=name),
    }
    return Matlab(name, texts, _variables(vehicle, point, linear))


def _variables(vehicle: Vehicle, point: Trim, linear: StateSpace) -> dict[str, Any]:
    rows = parameter_rows(vehicle, point.changes)
    parameters = numbers(vehicle, point)
    return {
        "p": np.array(list(parameters.values()))[:, None],
        "parameter_names": cells(parameters),
        "x0": initial_states(vehicle, point.start, rows, point.inputs),
        "u0": point.inputs[:, None],
        "state_names": cells(vehicle.states),
        "input_names": cells(vehicle.inputs),
        "output_names": cells(vehicle.outputs),
        "linear": {k: v for k, v in linear_variables(linear).items() if not k.startswith("parameter")},
    }


def equations(vehicle: Vehicle, name: str) -> str:
    """Return a MATLAB function ``[dx, y] = NAME_equations(x, u, p)``; one statement a line, no loops or branches."""
    model = build_model(vehicle)
    table: dict[Any, Any] = {}
    lines = _heading(vehicle, name)
    groups = (("x", model.states), ("u", model.inputs), ("p", model.parameters))
    wanted = [sp.sympify(e) for e in (*model.derivatives, *model.outputs)]
    used = set().union(*(e.free_symbols for e in wanted))
    for letter, symbols in groups:
        for i, symbol in enumerate(symbols, 1):
            table[symbol] = sp.Symbol(f"{letter}{i}", real=True)
            if symbol in used:
                lines.append(f"{letter}{i} = {letter}({i});")
    steps, results = sp.cse([e.xreplace(table) for e in wanted], sp.numbered_symbols("t"), order="none")
    lines += [f"{symbol} = {_PRINTER.doprint(e)};" for symbol, e in steps]
    lines += _results("dx", results[: len(model.states)]) + _results("y", results[len(model.states) :])
    return "\n".join([*lines, "end", ""])


def _results(letter: str, expressions: Sequence[Any]) -> list[str]:
    lines = [f"{letter} = zeros({len(expressions)}, 1);"]
    return lines + [f"{letter}({i}) = {_PRINTER.doprint(e)};" for i, e in enumerate(expressions, 1)]


def _heading(vehicle: Vehicle, name: str) -> list[str]:
    def listed(letter: str, names: Sequence[str]) -> list[str]:
        return [f"%   {letter}({i}) {n}, {state_unit(n, vehicle)}" for i, n in enumerate(names, 1)]

    return [
        f"function [dx, y] = {name}_equations(x, u, p)",
        f"% Equations of motion and instruments of {one_line(vehicle.name)}, made by stoop export.",
        "% SI units and radians; body axes forward, right, down; e0..e3 quaternion, body to Earth.",
        *listed("x", vehicle.states),
        *listed("u", vehicle.inputs),
        *listed("y", vehicle.outputs),
        f"% p: the numbers of the vehicle, as in {name}.mat",
    ]


def state_unit(name: str, vehicle: Vehicle) -> str:
    """Return the unit of a state of the equations, an input or an output."""
    return "1" if name in ("e0", "e1", "e2", "e3", "none") else unit(name, vehicle)


def _flight(vehicle: Vehicle, name: str) -> str:
    """Return the script that flies; slopes of channels are its own work."""
    if not vehicle.sloped:
        return _FLY.format(name=name, slopes="", hold="", turn="")
    to, of = (
        " ".join(str(1 + vehicle.inputs.index(n)) for n in names)
        for names in (map(slope_input, vehicle.sloped), vehicle.sloped)
    )
    return _FLY.format(
        name=name,
        slopes=f"slopes = diff(u(:, [{of}])) / h;  % of channels that spin rotors up, held between samples\n"
        f"u(:, [{to}]) = slopes([1:end end], :);\n",
        hold=f"    b([{to}]) = a([{to}]);\n",
        turn=f"    b([{to}]) = u(k + 1, [{to}])';\n",
    )


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
