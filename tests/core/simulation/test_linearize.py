"""Linear models against central differences of the compiled equations, and against what textbooks say."""

import math
from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import StateSpace

from stoop.errors import SimulationError
from stoop.simulation import LinearModel, Trim, linearize, trim
from stoop.simulation.fly import simulate
from stoop.simulation.linearize import left_out, modes_of, pade
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.load import parse_vehicle


def states_of(rates: np.ndarray, x: np.ndarray, vehicle: Vehicle, names: tuple[str, ...]) -> np.ndarray:
    """Turn the rates of the kernel's states into those of airspeed and angles, by their plain formulas."""
    d = dict(zip(vehicle.states, rates, strict=True))
    s = dict.fromkeys(("u", "v", "w", "p", "q", "r", "e0", "e1", "e2", "e3"), 0.0)
    s |= dict(zip(vehicle.states, x, strict=True))
    u, v, w, p, q, r = (s[k] for k in "uvwpqr")
    ud, vd, wd = (d.get(k, 0.0) for k in "uvw")
    V = math.sqrt(u * u + v * v + w * w)
    down = (2 * (s["e1"] * s["e3"] - s["e0"] * s["e2"]), 2 * (s["e2"] * s["e3"] + s["e0"] * s["e1"]))
    cos_theta = math.sqrt(1 - down[0] ** 2)
    sin_phi = down[1] / cos_theta
    cos_phi = math.sqrt(1 - sin_phi**2)
    tan_theta = -down[0] / cos_theta
    Vd = (u * ud + v * vd + w * wd) / V
    table = {
        "V": Vd, "alpha": (u * wd - w * ud) / (u * u + w * w), "beta": (V * vd - v * Vd) / (V * math.sqrt(u * u + w * w)),
        "p": d.get("p", 0.0), "q": d.get("q", 0.0), "r": d.get("r", 0.0), "h": d.get("h", 0.0),
        "phi": p + (q * sin_phi + r * cos_phi) * tan_theta, "theta": q * cos_phi - r * sin_phi,
        "psi": (q * sin_phi + r * cos_phi) / cos_theta,
    }  # fmt: skip
    return np.array([table[n] if n in table else d[n] for n in names])


def nearby(vehicle: Vehicle, point: Trim, model: LinearModel, dx: np.ndarray, du: np.ndarray) -> np.ndarray:
    """Return the rates of the linear model's states, and readings, of the nonlinear equations nearby."""
    moved = dict(zip(model.states, dx, strict=True))
    start = {k: v + moved.get(k, 0.0) for k, v in {**dict.fromkeys(model.states, 0.0), **point.start}.items()}
    wanted = dict(zip(model.inputs, du, strict=True))
    deflections = {c: point.deflections[c] + wanted[c] for c in vehicle.controls}
    inputs = vehicle.mixed_inputs(deflections, point.inputs)
    for name in set(model.inputs) - set(vehicle.controls):
        inputs[vehicle.inputs.index(name)] += wanted[name]
    rows = vehicle.parameter_rows(point.changes)
    x = vehicle.initial_states(start, rows, point.inputs)
    d, y = vehicle.kernel().evaluate(rows, x, inputs[:, None])
    return np.concatenate([states_of(d[:, 0], x[:, 0], vehicle, model.states), y[:, 0]])


@pytest.mark.parametrize(
    "of", [*(f"twin_boom {m}" for m in ("longitudinal", "lateral", "full")), "v_tail full"]
)
def test_derivatives_equal_central_differences(of, request):
    name, reduce = of.split()
    vehicle: Vehicle = request.getfixturevalue(name).reduced(reduce)
    point = trim(vehicle)
    model = linearize(vehicle, point)
    n, h = len(model.states), 1e-5
    exact = np.block([[model.A, model.B], [model.C, model.D]])
    assert exact.shape == (n + len(vehicle.outputs), n + len(model.inputs))
    steps = h * np.eye(len(exact.T))
    for label, column, step in zip((*model.states, *model.inputs), exact.T, steps, strict=True):
        ahead, behind = (nearby(vehicle, point, model, s[:n], s[n:]) for s in (step, -step))
        slope = (ahead - behind) / (2 * h)
        near = 2e-6 * max(1.0, np.abs(slope).max())
        np.testing.assert_allclose(column, slope, rtol=1e-6, atol=near, err_msg=label)


def test_longitudinal_derivatives_by_hand(twin_boom: Vehicle) -> None:
    """Level flight, alpha* = 0: Etkin and Reid, Dynamics of Flight, 3rd ed., section 4.9, in wind axes."""
    v = twin_boom.reduced("longitudinal")
    point = trim(v)
    model = linearize(v, point)
    at = {n: i for i, n in enumerate(model.states)}
    n = {p.name: p.value for p in v.parameters} | point.changes
    V, alpha, T = 35.0, point.start["alpha"], n["propulsion.thrust"]
    qS = 0.5 * n["environment.density"] * V**2 * n["reference.area"]
    mass, c, Iyy, g = n["mass.mass"], n["reference.chord"], n["mass.inertia.yy"], 9.80665
    CL = n["CL0"] + n["CLalpha"] * alpha + n["CLelevator"] * point.deflections["elevator"]
    CD = n["CD0"] + n["CDalpha"] * alpha
    assert qS * CL + T * math.sin(alpha) == pytest.approx(mass * g, rel=1e-9)
    expected = {
        ("V", "V"): -2 * qS * CD / (mass * V), ("V", "theta"): -g, ("theta", "q"): 1.0,
        ("V", "alpha"): -(qS * n["CDalpha"] + T * math.sin(alpha)) / mass + g,
        ("alpha", "V"): -(2 * qS * CL / V) / (mass * V),  # weight balances lift and thrust
        ("alpha", "alpha"): -(qS * n["CLalpha"] + T * math.cos(alpha)) / (mass * V),
        ("alpha", "q"): 1 - qS * n["CLq"] * c / (2 * V) / (mass * V),
        ("q", "alpha"): qS * c * n["Cmalpha"] / Iyy, ("q", "q"): qS * c * n["Cmq"] * c / (2 * V) / Iyy,
        ("h", "theta"): V, ("h", "alpha"): -V,
    }  # fmt: skip
    for (row, column), value in expected.items():
        assert model.A[at[row], at[column]] == pytest.approx(value, rel=1e-9, abs=1e-12), (row, column)
    elevator = model.B[:, model.inputs.index("elevator")]
    assert elevator[at["q"]] == pytest.approx(qS * c * n["Cmelevator"] / Iyy, rel=1e-9)
    assert elevator[at["alpha"]] == pytest.approx(-qS * n["CLelevator"] / (mass * V), rel=1e-9)


def test_modes_of_the_papers_aircraft(twin_boom: Vehicle) -> None:
    """Short period by two states; at this small static margin the phugoid is slower than Lanchester's, pi sqrt(2) V / g."""
    v = twin_boom.reduced("longitudinal")
    model = linearize(v, trim(v))
    short, slow = ({m.name: m for m in model.modes}[name] for name in ("short period", "phugoid"))
    assert (short.frequency, short.damping) == (pytest.approx(5.1, abs=0.06), pytest.approx(0.50, abs=0.02))
    pick = [model.states.index(s) for s in ("alpha", "q")]
    A = model.A[np.ix_(pick, pick)]  # two states suffice: omega^2 = Z_alpha M_q - M_alpha Z_q
    assert math.sqrt(np.linalg.det(A)) == pytest.approx(short.frequency, rel=0.01)
    assert -np.trace(A) / 2 == pytest.approx(short.damping * short.frequency, rel=0.01)
    assert 2 * math.pi / slow.eigenvalue.imag == pytest.approx(17.88, abs=0.02)  # s; Lanchester: 15.9


def test_modes_are_named_and_complete(twin_boom: Vehicle) -> None:
    full = {m.name: m for m in linearize(twin_boom, trim(twin_boom)).modes}
    assert sorted(full) == ["Dutch roll", "phugoid", "roll", "short period", "spiral"]
    for reduce in ("longitudinal", "lateral"):
        part = twin_boom.reduced(reduce)
        for mode in linearize(part, trim(part)).modes:
            assert mode.eigenvalue == pytest.approx(full[mode.name].eigenvalue, rel=2e-3), mode.name


def test_a_chain_of_integrators_has_modes() -> None:
    """Thrust turns, turning tilts, tilt accelerates: without drag nothing comes back, and eigenvectors coincide."""
    A = np.zeros((4, 4))
    A[0, 2], A[2, 3] = -9.81, 1.0  # u' = -g theta, theta' = q
    found = modes_of(A, ("u", "w", "theta", "q"))
    assert [m.eigenvalue for m in found] == [0.0] * 4
    assert sorted(m.name for m in found) == ["heave", "pitch", "pitch", "pitch"]


def test_delays_in_series_with_the_matrices_give_the_simulated_response() -> None:
    """What MATLAB's ss does with InputDelay and OutputDelay, marched by matrix exponentials, against stoop's simulation."""
    text = builtin_vehicle("twin-boom").text
    late = "\n[controls.elevator]\ndelay = 0.1\n[controls.aileron]\n[controls.rudder]\n[sensors.q]\ndelay = 0.04\n"
    vehicle = parse_vehicle(text + late, "late.toml")
    (found,) = left_out(vehicle)
    assert found.code == "linear-model-without-delays"
    assert found.values["numbers"] == ("controls.elevator.delay = 0.1 s", "sensors.q.delay = 0.04 s")
    point = trim(vehicle)
    model, dt = linearize(vehicle, point), 0.01
    assert dict(zip(model.inputs, model.input_delays, strict=True))["elevator"] == 0.1
    assert np.flatnonzero(model.output_delays).tolist() == [model.outputs.index("q")]
    time = np.arange(0.0, 3.0, dt)
    pulse = 1e-3 * np.exp(-0.5 * ((time - 0.8) / 0.2) ** 2)
    j, i = model.inputs.index("elevator"), model.outputs.index("q")
    count = len(model.states)
    step = expm(dt * np.block([[model.A, model.B[:, [j]]], [np.zeros((1, count + 1))]]))
    x, q = np.zeros(count), []
    for u in np.interp(time + 0.5 * dt - model.input_delays[j], time, pulse):
        q.append(float(model.C[i] @ x))
        x = step[:count, :count] @ x + step[:count, count] * u
    delivered = np.interp(time - model.output_delays[i], time, q)
    commands = {"elevator": point.deflections["elevator"] + pulse}
    flown = simulate(vehicle, commands, time, noise=False).column("q")
    assert np.max(np.abs(flown - delivered)) < 0.01 * np.max(np.abs(flown))
    undelayed = np.max(np.abs(flown - np.interp(time + 0.1, time, delivered)))
    assert undelayed > 0.2 * np.max(np.abs(flown)), "the test sees a delay that is left out"


def test_moments_of_surfaces_are_those_of_the_full_equations_about_the_axes_that_are_left(twin_boom):
    for reduce, kept in (("longitudinal", [0.0, 1.0, 0.0]), ("lateral", [1.0, 0.0, 1.0])):
        some = twin_boom.reduced(reduce)
        for surface in some.controls:
            whole = trim(twin_boom).surface_moments(twin_boom, surface)
            assert np.allclose(trim(some).surface_moments(some, surface), whole * kept, rtol=1e-6, atol=1e-6)


FREQUENCIES = np.array([0.3, 1.0, 3.0, 8.0])


@pytest.fixture(scope="module")
def model() -> LinearModel:
    vehicle = builtin_vehicle("twin-boom")
    return linearize(vehicle, trim(vehicle))


@pytest.fixture(scope="module")
def late(model: LinearModel) -> LinearModel:
    of_outputs = np.full(len(model.outputs), 0.02)
    return replace(model, input_delays=np.array([0.1, 0.0, 0.05]), output_delays=of_outputs)


def transfer(of: Any) -> np.ndarray:
    """Return the outputs (n_w, n_y, n_u) of matrices for unit inputs."""
    one = np.eye(len(of.A))
    return np.array([of.C @ np.linalg.solve(1j * w * one - of.A, of.B) + of.D for w in FREQUENCIES])


def response(model: LinearModel) -> np.ndarray:
    s = 1j * FREQUENCIES
    ahead, after = np.exp(-s[:, None] * model.input_delays), np.exp(-s[:, None] * model.output_delays)
    return np.asarray(after[:, :, None] * transfer(model) * ahead[:, None, :])


def test_delays_are_in_series(model: LinearModel, late: LinearModel) -> None:
    ours, plain = response(late), model.to_scipy()
    assert isinstance(plain, StateSpace)
    assert np.array_equal(transfer(plain), transfer(model))
    assert transfer(late.to_scipy(4)) == pytest.approx(ours, rel=1e-5, abs=1e-7 * np.abs(ours).max())
    with pytest.raises(SimulationError, match=r"delays of up to 0.1 s: give pade=N"):
        late.to_scipy()
    assert late.to_scipy(pade=0).A.shape == late.A.shape


def test_control_has_the_names_and_the_responses(late: LinearModel) -> None:
    system = late.to_control(pade=4)
    assert (system.input_labels, system.output_labels) == (list(late.inputs), list(late.outputs))
    assert [n for n in system.state_labels if "delay" not in n] == list(late.states)
    ours, theirs = response(late), np.array([system(1j * w) for w in FREQUENCIES])
    assert theirs == pytest.approx(ours, rel=1e-5, abs=1e-7 * np.abs(ours).max())


def test_the_approximation_is_that_of_python_control() -> None:
    ours, theirs = control.StateSpace(*pade(0.2, 3)), control.TransferFunction(*control.pade(0.2, 3))
    assert ours(1j * FREQUENCIES) == pytest.approx(theirs(1j * FREQUENCIES), rel=1e-9)
