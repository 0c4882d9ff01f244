"""MATLAB functions, Simulink scripts and linear models, read back: MATLAB by an evaluator that knows assignments alone."""

import ast
import io
import json
import math
import operator
import re
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

from stoop.simulation import Trim, trim
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop_analysis.derivatives import ParameterCovariance
from stoop_export.matlab import StateSpace, equations, json_text, mat_bytes, matlab, state_space, variables
from stoop_studies.verify.export import load

FREE = """
name = "free"
mass = { mass = 1.0, inertia = { xx = 0.02, yy = 0.02, zz = 0.03 } }
rotors = { drive = "speed", T2 = 1e-5, inertia = 6e-5 }
rotor.one = { channel = "rotor_1", position = [0.0, 0.0, 0.0], spin = "ccw" }
"""
SIGMA = 0.1
FUNCTIONS = {"sqrt": math.sqrt, "atan2": math.atan2, "abs": abs, "atan": math.atan}
OPERATIONS: dict[type, Any] = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
                               ast.Div: operator.truediv, ast.Pow: operator.pow}  # fmt: skip


def arithmetic(node: ast.expr, known: dict[str, Any]) -> float:
    """Compute an expression; ``x(3)`` is an entry, ``sqrt(3)`` a function."""
    match node:
        case ast.Constant(value=int() | float() as value):
            return float(value)
        case ast.Name(id=name):
            return float(known[name])
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -arithmetic(operand, known)
        case ast.BinOp(left=left, op=op, right=right):
            return float(OPERATIONS[type(op)](arithmetic(left, known), arithmetic(right, known)))
        case ast.Call(func=ast.Name(id=name), args=[ast.Constant(value=int(i))]) if name in ("x", "u", "p"):
            return float(known[name][i - 1])
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return float(FUNCTIONS[name](*(arithmetic(a, known) for a in arguments)))
    raise AssertionError(ast.dump(node))


def run(text: str, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Run a generated function; in MATLAB ``-a^2`` and ``2^-1`` mean what they mean in Python."""
    known: dict[str, Any] = {"x": x, "u": u, "p": p}
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("%")]
    assert re.fullmatch(r"function \[dx, y\] = \w+_equations\(x, u, p\)", lines[0])
    assert lines[-1] == "end"
    for line in lines[1:-1]:
        target, expression = re.fullmatch(r"([\w() ]+?) = (.+);", line).groups()
        if sized := re.fullmatch(r"zeros\((\d+), 1\)", expression):
            known[target] = np.zeros(int(sized[1]))
            continue
        python = re.sub(r"\.([*/^])", r"\1", expression).replace("^", "**")
        value = arithmetic(ast.parse(python, mode="eval").body, known)
        if entry := re.fullmatch(r"(dx|y)\((\d+)\)", target):
            known[entry[1]][int(entry[2]) - 1] = value
        else:
            known[target] = value
    return known["dx"], known["y"]


def files(vehicle: Vehicle, point: Trim) -> Any:
    return matlab(vehicle, point, state_space(vehicle, point))


def check(vehicle: Vehicle, point: Trim, text: str) -> None:
    rows, random = vehicle.parameter_rows(point.changes), np.random.default_rng(5)
    steady = vehicle.initial_states(point.start, rows, point.inputs)[:, 0]
    for _ in range(3):
        x = steady + 0.05 * random.standard_normal(len(vehicle.states))
        u = point.inputs + 0.05 * random.standard_normal(len(vehicle.inputs))
        expected = vehicle.kernel().evaluate(rows, x[:, None], u[:, None])
        for ours, theirs in zip(run(text, x, u, rows[:, 0]), expected, strict=True):
            assert ours == pytest.approx(theirs[:, 0], rel=1e-10, abs=1e-11)


def test_the_function_computes_what_the_kernel_does(twin_boom: Vehicle, steady: Trim) -> None:
    check(twin_boom, steady, equations(twin_boom, "twin_boom"))
    crooked = load("crooked")  # uses every table
    check(crooked, trim(crooked, None, 200.0), equations(crooked, "crooked"))


def stepped(made: Any, s: np.ndarray, a: np.ndarray, b: np.ndarray, p: np.ndarray, h: float) -> np.ndarray:
    script, function = made.texts[f"{made.name}_fly.m"], made.texts[f"{made.name}_equations.m"]
    known: dict[str, Any] = {"s": s, "a": a, "b": b, "p": p, "h": h}
    known[f"{made.name}_equations"] = lambda *given: run(function, *given)[0]
    lines = re.findall(r"^    (k[1-4]|s) = (.*_equations.*|s \+ .*);", script, re.MULTILINE)
    assert [name for name, _ in lines] == ["k1", "k2", "k3", "k4", "s"]
    for name, expression in lines:
        known[name] = eval(expression, {}, known)  # noqa: S307 - our own
    return np.asarray(known["s"])


def test_the_script_steps_as_the_kernel_does(twin_boom: Vehicle, steady: Trim) -> None:
    made, rows, h = files(twin_boom, steady), twin_boom.parameter_rows(steady.changes), 0.05
    u = steady.inputs + 0.1 * np.random.default_rng(1).standard_normal((3, len(steady.inputs)))
    begin = twin_boom.initial_states(steady.start, rows, u[0])
    readings, s = twin_boom.kernel().trajectories(rows, begin, u, h)[0], begin[:, 0]
    for k in range(2):
        s = stepped(made, s, u[k], u[k + 1], rows[:, 0], h)
        found = run(made.texts[f"{made.name}_equations.m"], s, u[k + 1], rows[:, 0])[1]
        assert found == pytest.approx(readings[k + 1], rel=1e-10, abs=1e-12)


def test_it_flies_with_the_slopes_of_channels_that_spin_rotors_up(twin_boom: Vehicle) -> None:
    """They keep the angular momentum of a free body."""
    vehicle = parse_vehicle(FREE, "free")
    found = files(vehicle, Trim({"h": 100.0}, {}, {}, np.array([990.0, 0.0]), {}, 0.0))
    assert "u(2) rotor_1.slope, rad/s2" in found.texts["free_equations.m"]
    for line in ("slopes = diff(u(:, [1])) / h;  % of channels", "u(:, [2]) = slopes([1:end end], :);",
                 "    b([2]) = a([2]);", "    b([2]) = u(k + 1, [2])';"):  # fmt: skip
        assert line in found.texts["free_fly.m"]
    assert not any("slope" in text for text in files(twin_boom, trim(twin_boom)).texts.values())
    u, h = np.zeros((4, 2)), 0.01
    u[:, 0] = (990.0, 1010.0, 970.0, 1000.0)
    u[:, 1] = (np.diff(u[:, 0]) / h)[[0, 1, 2, 2]]
    p, s = vehicle.parameter_rows()[:, 0], vehicle.initial_states({}, vehicle.parameter_rows(), u[0])[:, 0]
    for k in range(3):
        s = stepped(found, s, u[k], np.array([u[k + 1, 0], u[k, 1]]), p, h)
        assert s[vehicle.states.index("r")] == pytest.approx(6e-5 / 0.03 * (u[k + 1, 0] - 990.0), abs=1e-12)


def test_scripts_name_files_that_are_written(twin_boom: Vehicle, steady: Trim) -> None:
    found = files(twin_boom, steady)
    written = {*(n.removesuffix(".m") for n in found.texts), f"{found.name}.mat"}
    for text in found.texts.values():
        assert "{" not in text
        assert set(re.findall(rf"\b{found.name}_(?!model)\w+", text)) <= written
    read = loadmat(io.BytesIO(mat_bytes(found.variables)), simplify_cells=True)
    assert set(re.findall(r"'(x0|u0|p)'", found.texts[f"{found.name}_simulink.m"])) <= set(read)
    assert list(read["state_names"]) == list(twin_boom.states)
    rows = twin_boom.parameter_rows(steady.changes)
    states = twin_boom.initial_states(steady.start, rows, steady.inputs)
    for name, values in {"p": rows, "x0": states, "u0": steady.inputs}.items():
        assert np.array_equal(np.ravel(read[name]), np.ravel(values)), name


@pytest.fixture(scope="module")
def linear(twin_boom: Vehicle, steady: Trim) -> StateSpace:
    return state_space(twin_boom, steady, ParameterCovariance(("Cmalpha", "Cmq"), np.diag([SIGMA**2, 0.0])))


def test_linear_models_read_back(linear: StateSpace) -> None:
    document, content = json.loads(json_text(linear)), mat_bytes(variables(linear))
    read, states = loadmat(io.BytesIO(content)), list(linear.model.states)
    assert content == mat_bytes(variables(linear)), "no date in it"
    for name in "ABCD":
        assert np.array_equal(np.array(document[name]), getattr(linear.model, name))
        assert np.array_equal(read[name], getattr(linear.model, name))
        assert np.array_equal(read[f"{name}_std"], linear.standard_errors[name])
    assert [s["name"] for s in document["states"]] == [str(c[0]) for c in read["states"][:, 0]] == states
    assert np.array_equal(read["x0"][:, 0], linear.x)
    assert [s["unit"] for s in document["inputs"]] == ["rad", "rad", "rad"]
    trim = {s["name"]: s["trim"] for part in ("states", "inputs", "outputs") for s in document[part]}
    assert (trim["V"], trim["elevator"]) == (35.0, linear.point.deflections["elevator"])
    assert trim["az"] == pytest.approx(-9.80665 * np.cos(trim["theta"]) * np.cos(trim["phi"]))
    assert document["parameters"]["propulsion.thrust"] == linear.point.changes["propulsion.thrust"]


def test_delays_are_those_that_matlab_takes(steady: Trim) -> None:
    text = builtin_vehicle("twin-boom").text
    late = "\n[controls.elevator]\ndelay = 0.1\n[controls.aileron]\n[controls.rudder]\n[sensors.q]\ndelay = 0.04\n"
    linear = state_space(parse_vehicle(text + late, "late.toml"), steady)
    read, document = loadmat(io.BytesIO(mat_bytes(variables(linear)))), json.loads(json_text(linear))
    assert document["standard_errors"] == {}, "without a covariance there are none"
    assert dict(zip(linear.model.inputs, read["InputDelay"][:, 0], strict=True))["elevator"] == 0.1
    assert {s["name"]: s["delay"] for s in document["outputs"] if s["delay"]} == {"q": 0.04}
    assert read["OutputDelay"][:, 0].tolist() == [s["delay"] for s in document["outputs"]]


def test_standard_errors_of_pitch_stiffness(linear: StateSpace) -> None:
    """d q' / d alpha grows by qbar S c / Iyy with Cmalpha, and nothing else does; the twin-boom has no Ixy, Iyz."""
    n, states, errors = linear.vehicle.value, linear.model.states, linear.standard_errors["A"].copy()
    pressure, pitch = 0.5 * n("environment.density") * 35.0**2, (states.index("q"), states.index("alpha"))
    moment = pressure * n("reference.area") * n("reference.chord") / n("mass.inertia.yy")
    assert errors[pitch] == pytest.approx(SIGMA * moment, rel=1e-6)
    errors[pitch] = errors[:, states.index("V")] = 0.0  # the pitching moment changes with speed too
    assert errors.max() < 1e-9


def test_what_the_data_cannot_tell_is_no_small_error(twin_boom: Vehicle, steady: Trim) -> None:
    """Of two parameters one has no variance: what it moves is unknown, what it does not move is as before."""
    names = ("Cmalpha", "CLq")
    both = state_space(twin_boom, steady, ParameterCovariance(names, np.diag([SIGMA**2, np.inf])))
    alone = state_space(twin_boom, steady, ParameterCovariance(names[:1], np.array([[SIGMA**2]])))
    errors, (row, column) = both.standard_errors["A"], map(both.model.states.index, ("alpha", "q"))
    assert np.isinf(errors[row, column])
    assert errors[column, row] == alone.standard_errors["A"][column, row] > 0.0
    assert json.loads(json_text(both))["standard_errors"]["A"][row][column] is None
    lost = state_space(twin_boom, steady, ParameterCovariance(names[1:], np.array([[np.inf]])))
    assert np.array_equal(np.isinf(lost.standard_errors["A"]), np.isinf(errors))


def test_states_of_rotors_have_their_own_units() -> None:
    point = Trim({"u": 0.0, "h": 0.0}, {}, {}, np.full(4, 0.6), {}, 0.0)
    found = state_space(builtin_vehicle("quad-x"), point)
    signals = {s["name"]: s for s in json.loads(json_text(found))["states"]}
    assert [signals[n]["unit"] for n in ("u", "p", "theta", "m1.lag")] == ["m/s", "rad/s", "rad", "1"]
    assert signals["m3.lag"]["trim"] == pytest.approx(0.6)
