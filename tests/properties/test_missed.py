"""Properties that no quick test held: each test kills a planted defect of `tests/mutants` that others missed."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import solve_continuous_lyapunov
from scipy.spatial.transform import Rotation
from scipy.stats import norm
from tornado.httputil import HTTPHeaders

from stoop.assessment.covariance import NEIGHBORS, window_scatter
from stoop.base.html import table
from stoop.base.robust import white_noise
from stoop.estimate.filter_gains import Gains
from stoop.estimate.filter_likelihood import Innovations
from stoop.flight.faults import Fault
from stoop.flight.flight import from_columns
from stoop.logs.blackbox_units import Settings, physical
from stoop.logs.netcdf import _unpacked
from stoop.problem.evidence import unknowns_of
from stoop.problem.layout import Layout
from stoop.problem.windows import spans
from stoop.reconstruction.compatibility import corrected_flight
from stoop.report.charts import correlation_map
from stoop.report.sheet import mathml
from stoop.simulation.linearize import LinearModel
from stoop.simulation.trim import Trim
from stoop.strategy.extensions import Trial
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop.vehicle.symbolic import forces, frames
from stoop.workflow import outputs
from stoop_analysis.frequency import with_inputs
from stoop_analysis.performance.polar import Polar
from stoop_analysis.propagation.wing_figures import full_deflection
from stoop_app.columns import edited, rows_of
from stoop_app.folder import VEHICLE, Project
from stoop_app.server import FILE_POLICY, Gate
from stoop_draft.checks.kinematics import Motion
from stoop_draft.checks.motors import rotor_edits
from stoop_draft.vehicle_draft.handbook import _drag
from stoop_export import jsbsim_model
from stoop_export.bullet_and_isaac import INTERVAL
from stoop_export.pyflyt import PyFlyt
from stoop_fleet.changes import Change, Readings, sizes
from stoop_plan.input_design.inputs import SHAPES, Frame
from stoop_studies.open_loop import _near
from stoop_tune import physical_formulas
from stoop_tune.margins import margins

PROPELLER = """
[propulsion]
kind = "propeller"
channel = "throttle"
speed_gain = 120.0
diameter = 0.6
CT0 = 0.1
inertia = 0.02

[ground_effect]
channel = "altitude"
lift = 0.4
"""


def twin_boom(more: str = "", density: str = "1.20165") -> Any:
    text = load_vehicle("twin-boom").text.replace("density = 1.20165", f"density = {density}")
    return parse_vehicle(text + more, "test")


def airplane() -> Any:
    head, rest = load_vehicle("twin-boom").text.split("[propulsion]")
    return parse_vehicle(head + PROPELLER + rest[rest.index("[aerodynamics") :], "test")


def numbers(vehicle: Any, expressions: Any) -> np.ndarray:
    known = {s: vehicle.value(s.name) for s in frames.Numbers(vehicle).symbols}
    return np.array([float(sp.sympify(one).xreplace(known)) for one in expressions])


def test_the_momentum_of_a_propeller_is_conserved() -> None:
    """The moment on the body is minus the rate of change of the angular momentum of the disc, which turns with it."""
    vehicle, omega = airplane(), np.array([0.3, -0.5, 0.7])
    air = frames.air((30.0, 0.0, 0.0))
    around = forces.Surroundings(frames.Numbers(vehicle), air, 1.2, tuple(omega), {}, {"throttle": 0.5})
    momentum = np.array([0.02 * 2.0 * math.pi * 60.0, 0.0, 0.0])
    np.testing.assert_allclose(numbers(vehicle, forces.propulsion(around).moment), -np.cross(omega, momentum))


def test_half_of_the_ground_effect_of_a_wing_is_left_at_a_sixteenth_of_its_span() -> None:
    """McCormick's factor (16 h / b)^2 / (1 + (16 h / b)^2)."""
    vehicle = airplane()
    span = vehicle.value("reference.span")
    gains = [forces.lift_gain(frames.Numbers(vehicle), {"altitude": h}) for h in (0.0, span / 16.0, span)]
    np.testing.assert_allclose(numbers(vehicle, gains), 1.0 + 0.4 * np.array([1.0, 0.5, 1.0 / 257.0]))


def test_the_covariance_of_scores_is_that_of_each_pair_of_windows() -> None:
    rng = np.random.default_rng(0)
    residuals, S = rng.standard_normal((7, 4)), rng.standard_normal((7, 4, 3))
    total = np.zeros((3, 3))
    for v, w in ((v, w) for v in range(7) for w in range(7) if abs(v - w) <= NEIGHBORS):
        first = range(max(0, v - w), 7 - max(0, w - v))
        scores = [np.outer(residuals[g] @ S[v], residuals[g + w - v] @ S[w]) for g in first]
        total += (1.0 - abs(v - w) / (NEIGHBORS + 1.0)) * np.sum(scores, axis=0)
    np.testing.assert_allclose(window_scatter(residuals, S), total / 7.0)


def test_the_information_about_a_standard_deviation_is_two_a_sample() -> None:
    """Fisher's information of a normal distribution about the logarithm of its standard deviation."""
    one, step = np.eye(2), 1e-6
    covariance = np.concatenate([one[None], np.exp(2.0 * step * one)[:, None] * one])[:, None]
    for samples in (1, 50):
        gains = Gains(np.zeros((1, 0, 3)), covariance, np.zeros(samples, dtype=np.int64))
        v = np.repeat(np.random.default_rng(1).standard_normal((1, samples, 2)), 3, axis=0)
        found = Innovations.of(v, gains, np.arange(2), np.full(2, step))
        np.testing.assert_allclose(found.spread_information, 2.0 * samples * one, rtol=1e-5)


def test_an_extension_falls_for_a_significantly_worse_prediction_only() -> None:
    test: Any = SimpleNamespace(name="n", line="l")
    # rise of the likelihood, gain ahead -> whether it is kept
    for row, kept in {(1.0, 1.0): True, (1.0, -1.0): True, (1.0, -3.0): False, (-1.0, 5.0): False}.items():
        assert (Trial(test, test, *row, 1.0).decided(True).code == "extension-kept") is kept, row
    assert Trial(test, test, 1.0, -9.0, 1.0).decided(False).code == "extension-kept-unchecked"


def test_colors_of_correlations_are_those_of_their_signs() -> None:
    drawn = str(correlation_map(["a", "b"], np.array([[1.0, -0.8], [-0.8, 1.0]])))
    assert ('class="below"' in drawn, 'class="above"' in drawn) == (True, False)


def test_text_within_formulas_and_tables_is_text() -> None:
    assert "<mo>&lt;</mo>" in mathml("a < b")
    page = table("<i>", ("<u>",), [("<b>&",)])
    assert not any(tag in page for tag in ("<i>", "<u>", "<b>"))
    assert "&lt;b&gt;&amp;" in page


def test_a_result_is_moved_into_place_after_what_it_describes(monkeypatch: Any, tmp_path: Any) -> None:
    model: Any = SimpleNamespace(
        attachments={"posterior.nc": b""}, vehicle=None, parameters={}, flights=(), evidence=b"x", files=(),
        traces=(), convergence=None, command="", result=None,
    )  # fmt: skip
    written: list[str] = []
    for name in ("with_values", "packed_curves", "to_json"):
        monkeypatch.setattr(outputs, name, lambda *_: "")
    monkeypatch.setattr("stoop.report.identification.render", lambda _: "")
    monkeypatch.setattr(outputs, "write_files", lambda folder, files, obsolete: written.extend(files))
    outputs.place_outputs(model, tmp_path)
    assert written[-1] == outputs.RESULT
    assert len(written) == 6


def test_an_estimate_at_its_bound_is_rounded_into_the_bounds() -> None:
    bound = 0.12345678906
    vehicle = load_vehicle("twin-boom").with_numbers({"Cm0": {"free": True, "bounds": (0.0, bound)}})
    text = outputs.with_values(vehicle, {"Cm0": bound})
    assert parse_vehicle(text, "test").value("Cm0") == bound


def test_windows_may_touch() -> None:
    flight = from_columns("one", np.arange(5.0), {"q": np.zeros(5)})
    assert spans(["3:4", "1:2", "2:3"], flight) == ((1.0, 2.0), (2.0, 3.0), (3.0, 4.0))


def test_the_best_glide_is_the_largest_ratio_of_a_polar() -> None:
    c = np.array([0.03, -0.02, 0.05])
    polar = Polar(*[None] * 3, ("c0", "c1", "c2"), c, np.eye(3) * 1e-9, *[np.zeros(3)] * 4)  # type: ignore[arg-type]
    CL = np.linspace(0.01, 3.0, 100_000)
    best, error = polar.summary["best glide"]
    assert best == pytest.approx(np.max(CL / (c[0] + c[1] * CL + c[2] * CL**2)), rel=1e-6)
    assert error > 0.0


def test_a_multisine_begins_and_ends_at_zero() -> None:
    family = SHAPES["multisine"](Frame({"elevator": 0.05, "rudder": 0.02}, {}, 12.0, 2.0, 0.1))
    for one in family.inputs(np.random.default_rng(3).uniform(size=family.dimension)):
        assert np.array(one["amplitudes"]) @ np.sin(one["phases"]) == pytest.approx(0.0, abs=1e-9)


def test_calibrated_readings_are_the_truth() -> None:
    """Readings are scale times truth plus bias; the vanes stand off the reference point and turn with the vehicle."""
    n, arm, bias, scale = 50, np.array([1.5, 0.3, -0.2]), 0.1, 1.25
    time = 0.01 * np.arange(n)
    omega = np.column_stack([np.sin(3.0 * time), 0.5 * np.cos(time), 0.2 * np.sin(2.0 * time)])
    at = np.array([20.0, 1.0, 2.0]) + np.cross(omega, arm)
    V = np.linalg.norm(at, axis=1)
    read = {"V": scale * V + bias, "alpha": np.arctan2(at[:, 2], at[:, 0]), "beta": np.arcsin(at[:, 1] / V)}
    flight = from_columns("f", time, read | dict(zip("pqr", omega.T, strict=True)))
    values = {"V.bias": bias, "V.scale": scale, **dict(zip(("vane.x", "vane.y", "vane.z"), arm, strict=True))}
    pieces = SimpleNamespace(flight=flight)
    made: Any = SimpleNamespace(pieces=pieces, values=values, identifiability=(), errors={})
    found = corrected_flight(made)
    np.testing.assert_allclose(found.column("V"), math.sqrt(405.0), rtol=1e-9)
    np.testing.assert_allclose(found.column("alpha"), math.atan2(2.0, 20.0), rtol=1e-9)


def test_jsbsim_has_the_density_of_the_standard_atmosphere() -> None:
    standard = twin_boom(density='"standard"')
    (factor,) = (float(one.text or "") for one in jsbsim_model.air_density(standard).iter("value"))
    assert 0.0023768924 * factor == pytest.approx(1.225, rel=1e-4)
    high: Any = SimpleNamespace(start={"h": 2000.0})  # ISA: 1.00649 kg/m3 at a geometric altitude of 2000 m
    assert Trim.density(high, standard) == pytest.approx(1.00655, rel=1e-4)


def test_a_phase_margin_is_the_least_turn_to_either_side() -> None:
    frequency = np.geomspace(0.1, 100.0, 400)
    for angle in (-170.0, 170.0, -120.0):
        loop = (5.0 / frequency) * np.exp(1j * np.radians(angle)) * np.ones((1, 1))
        assert np.degrees(margins(frequency, loop).phase[0]) == pytest.approx(180.0 - abs(angle), abs=1e-6)


def test_a_drift_begins_at_the_last_flight_before_it() -> None:
    times = np.array([0.0, 1.0, 3.0, 4.5, 5.0, 8.0])
    drift = 2.0 * np.maximum(times - times[2], 0.0)
    found = sizes(Readings.about_a_level(7.0 + drift, np.full(6, 0.1), times), "drift")[0][2]
    change = Change("drift", 3, 5, float(found), 0.1, 9.0)
    np.testing.assert_allclose(change.course(times), drift, atol=1e-9)


def test_a_gust_has_the_intensity_of_its_axis_and_begins_as_it_goes_on() -> None:
    """Variances of the shaping filters by Lyapunov's equation; the start has their covariance."""
    rows = "".join(f"{a} = {{ intensity = {s}.0, length = 30.0 }}\n" for s, a in enumerate("uvw", 1))
    vehicle = twin_boom(f"\n[turbulence]\n{rows}")
    n, names = frames.Numbers(vehicle), [s for a in "uvw" for s in frames.GUST_STATES[a]]
    states = {s: sp.Symbol(s) for s in names}
    noise = {frames.noise_input(a): sp.Symbol(f"w{a}") for a in "uvw"}
    rates = frames.gust_rates(n, states, noise)
    known = {s: vehicle.value(s.name) for s in n.symbols}
    jacobian = sp.Matrix([rates[s] for s in names]).jacobian([*states.values(), *noise.values()])
    A, B = np.split(np.array(jacobian.xreplace(known), dtype=float), [len(names)], axis=1)
    P = solve_continuous_lyapunov(A, -B @ B.T)
    C = np.array(sp.Matrix(frames.gust(n, states)).jacobian(list(states.values())), dtype=float)
    np.testing.assert_allclose(np.sqrt(np.diag(C @ P @ C.T)), [1.0, 2.0, 3.0], rtol=1e-9)
    for axis in "uvw":
        own = [names.index(s) for s in frames.GUST_STATES[axis]]
        columns = []
        for unit in np.eye(len(own)):
            rng: Any = SimpleNamespace(standard_normal=lambda n, e=unit: e if n == len(e) else np.zeros(n))
            start = vehicle.gust_start(rng)
            columns.append([start[s] for s in frames.GUST_STATES[axis]])
        root = np.array(columns).T
        np.testing.assert_allclose(root @ root.T, P[np.ix_(own, own)], rtol=1e-9)


def test_readings_of_a_mounted_instrument_are_those_of_its_axes() -> None:
    """Angles in the order of yaw, pitch and roll turn the body axes into those of the instrument."""
    angles, body = np.array([0.3, -0.2, 0.5]), np.array([1.0, -2.0, 3.0])
    vehicle = twin_boom(f"\n[sensors]\nimu_alignment = {angles.tolist()}\n")
    read = frames.along_imu(frames.Numbers(vehicle), tuple(body))
    turned = Rotation.from_euler("ZYX", angles[::-1]).inv().apply(body)
    np.testing.assert_allclose(numbers(vehicle, read), turned, rtol=1e-7)


def test_the_error_by_a_prior_alone_is_its_distance_from_the_estimate() -> None:
    vehicle = load_vehicle("twin-boom").with_numbers({"Cm0": {"free": True, "prior": 0.1, "mean": 0.3}})
    layout = Layout.of(vehicle, ())
    own = next(u for u in unknowns_of(layout, layout.start) if u.name == "Cm0")
    square = norm.expect(lambda x: (x - own.estimate) ** 2, loc=0.3, scale=0.1)
    assert own.prior_error == pytest.approx(math.sqrt(square), rel=1e-6)


def test_a_predicted_angle_is_moved_by_whole_turns_only() -> None:
    measured = np.array([[0.5, 0.5], [0.6, 0.6]])
    for turns, off in ((0.0, 2.0), (1.0, 2.0), (-2.0, -3.0)):
        predicted = measured + off + 2.0 * np.pi * turns
        found = _near(predicted, measured, [True, False])
        np.testing.assert_allclose(found[:, 0], measured[:, 0] + off)
        np.testing.assert_array_equal(found[:, 1], predicted[:, 1])


def test_the_power_of_level_flight_is_that_of_an_ideal_propeller() -> None:
    """Momentum theory: the disc of area A at V + v gives the thrust 2 rho A (V + v) v."""
    names = ("c0", "c1", "c2", "airspeed", "efficiency", "diameter")
    values, area, lift = np.array([0.03, -0.02, 0.05, 1.0, 0.7, math.log(0.4)]), 0.6, 25.0
    blocks: Any = SimpleNamespace(density=np.array([1.1]), lift=np.array([lift]))
    polar = Polar(blocks, area, 2.5, names, values, np.eye(6), *[np.zeros(1)] * 4)
    for V in (9.0, 20.0):
        pressure_area = 0.5 * 1.1 * V**2 * area
        CL = lift / pressure_area
        drag = pressure_area * (0.03 - 0.02 * CL + 0.05 * CL**2)
        v = 0.7 * float(polar.level_power(np.array([V]))[0][0]) / drag - V
        assert 2.0 * 1.1 * 0.25 * math.pi * 0.4**2 * (V + v) * v == pytest.approx(drag)


def test_full_deflection_is_counted_from_the_center_of_the_channel() -> None:
    vehicle = twin_boom(
        "\n[controls.aileron]\n[controls.rudder]\n[controls.elevator]\nmix = { servo_1 = 0.4, pwm_2 = -0.001 }\n"
        "center = { servo_1 = 0.1, pwm_2 = 1550.0 }\n"
    )
    found: Any = full_deflection(vehicle, vehicle.parameter_rows(), "elevator")
    assert found[0] == pytest.approx(0.4 * 0.9 + 0.001 * 450.0)


def test_a_rotor_that_turns_the_other_way_yaws_the_other_way() -> None:
    vehicle = load_vehicle("quad-x")
    area, inputs = vehicle.rotor_range, np.zeros(len(vehicle.inputs))
    inputs[area.columns] = 0.6
    moments = vehicle.rotor_effects({}, inputs, {})[:3]
    torque = moments - vehicle.rotor_effects({}, inputs, {"rotors.torque_ratio": 0.0})[:3]
    edits = rotor_edits(vehicle, torque, area.names)
    turned = {one.lines[0]: one.apply(moments) for one in edits if one.kind == "spin"}
    for k, rotor in enumerate(vehicle.file.rotor):
        expected = moments * np.where(np.arange(len(area.names)) == k, [[1.0], [1.0], [-1.0]], 1.0)
        np.testing.assert_allclose(turned[f"rotor.{rotor}"], expected, atol=1e-6 * np.abs(moments).max())


def test_a_vehicle_that_the_app_replaces_is_kept(tmp_path: Path) -> None:
    for text in ("old", "new"):
        Project(tmp_path).take_vehicle(text)
    assert {place.read_text("utf-8") for place in tmp_path.glob("vehicle-*.toml")} == {"old"}
    assert (tmp_path / VEHICLE).read_text("utf-8") == "new"


def test_pages_of_a_project_are_strangers_to_the_app() -> None:
    """A page that shared the origin of the app could steer it by the address, which holds the key."""
    assert FILE_POLICY.partition(";")[0].split() == ["sandbox", "allow-scripts", "allow-downloads"]
    gate = Gate(None, "key", 5010)
    hosts = ("127.0.0.1:5010", "127.0.0.1:5011", "127.0.0.1", "", "evil.example:5010")
    right, *wrong = (HTTPHeaders({"Host": host}) for host in hosts)
    assert gate.refusal("/key/page", right) == ""
    assert all(gate.refusal("/key/page", one) for one in wrong)
    assert gate.refusal("/other/page", right)


def test_edits_of_a_column_are_written_into_the_mapping() -> None:
    text = '[variables]\np = { column = "a", unit = "deg/s" }\n'
    columns = [{"column": "a", "stream": "f", "low": 0.0, "high": 1.0, "samples": [], "unit": ""}]
    (row,) = rows_of(text, columns)
    (again,) = rows_of(edited(text, [(row, {"offset": 2.0, "scale": -1.0, "unit": "rad/s"})]), columns)
    assert (again.offset, again.scale, again.unit) == (2.0, -1.0, "rad/s")


def test_positions_go_on_across_the_date_line() -> None:
    degrees = np.array([179.9999, -179.9999])
    raw = {"GPS_coord[0]": np.array([0, 0]), "GPS_coord[1]": np.round(degrees * 1e7).astype(np.int64)}
    columns = physical(raw, Settings({}), "gps")[0]
    np.testing.assert_allclose(columns["GPS_east"], [0.0, 22.239], atol=1e-2)


def test_rotors_damp_every_rotation() -> None:
    """What turns downward meets air from below: thrust grows with the inflow, and drag opposes the motion."""
    changes = {"rotors.inflow": {"value": 0.5}, "rotors.drag": {"value": 0.2}}
    vehicle = load_vehicle("quad-x").with_numbers(changes)
    n, air, spins = frames.Numbers(vehicle), frames.air((1.0, 0.0, 0.0)), dict.fromkeys(vehicle.rotors, 0.6)

    def moment(omega: Any) -> np.ndarray:
        around = forces.Surroundings(n, air, 1.225, tuple(omega), {}, {}, spins=spins)
        return numbers(vehicle, forces.rotors(around).moment)

    damping = [moment(omega)[axis] - moment(frames.ZERO)[axis] for axis, omega in enumerate(np.eye(3))]
    assert max(damping) < 0.0


def test_mixed_inputs_come_as_late_as_the_channels_that_are_mixed() -> None:
    model = LinearModel(
        ("p",), ("flap", "motor_1", "motor_2"), ("p",), np.eye(1), np.array([[1.0, 2.0, 3.0]]), np.eye(1),
        np.zeros((1, 3)), (), np.array([0.1, 0.02, 0.02]), np.zeros(1),
    )  # fmt: skip
    mixed = with_inputs(model, ("roll",), ("motor_1", "motor_2"), np.array([[1.0], [-1.0]]))
    assert mixed.inputs == ("flap", "roll")
    np.testing.assert_array_equal(mixed.B, [[1.0, -1.0]])
    np.testing.assert_array_equal(mixed.input_delays, [0.1, 0.02])


def test_momentum_drag_is_that_at_sea_level(monkeypatch: pytest.MonkeyPatch) -> None:
    """EKF2 multiplies EKF2_MCOEF by the root of the ratio of densities."""
    A = np.diag([-0.2, -0.4])[None]
    monkeypatch.setattr("stoop.extend.motion.linear_models", lambda *_: (("u", "v"), A))
    hover = SimpleNamespace(points=None, none=np.zeros(1))
    thin: Any = SimpleNamespace(vehicle=None, density_ratio=0.64, steady=lambda: hover)
    found = physical_formulas.momentum_drag(math.sqrt, thin)
    np.testing.assert_allclose(found * math.sqrt(0.64), 0.3)


def test_the_variance_of_white_noise_is_seen_beside_a_trend() -> None:
    x = 0.3 * np.random.default_rng(0).standard_normal(20_000) + np.linspace(0.0, 50.0, 20_000)
    assert white_noise(x) == pytest.approx(0.09, rel=0.05)


def test_packed_numbers_are_scaled_before_their_offset() -> None:
    """CF conventions, section 8.1: unpacked = packed * scale_factor + add_offset."""
    found = _unpacked(np.array([0, 2, -1], dtype=np.int16), np.int16(-1), None, 0.5, 10.0)
    np.testing.assert_array_equal(found, [10.0, 11.0, np.nan])


def test_the_drag_of_pyflyt_is_that_of_the_dynamic_pressure() -> None:
    """Quadratic drag b v^2 as rho / 2 C A v^2."""
    quad: Any = SimpleNamespace(
        constant=1e-5, turns=np.ones(4), torque=0.02, fastest=1000.0, mass=1.0, inertia=np.eye(3), lag=0.05,
        drag=np.full(3, 0.02), gravity=9.81, speed_gain=900.0, offset=50.0,
    )  # fmt: skip
    found = PyFlyt.parameters(PyFlyt.__new__(PyFlyt), quad)
    assert 0.5 * 1.225 * found["drag_coef_xyz"] == pytest.approx(0.02)


def test_what_rests_level_feels_no_acceleration() -> None:
    names = (*"pqr", "phi", "theta", "psi", "ax", "ay", "vn", "ve", "vd")
    data = {name: np.zeros(400) for name in names} | {"az": np.full(400, -9.80665)}
    found: Any = Motion(data, 50.0)({}, None)["force", "vd"]
    np.testing.assert_allclose(Motion(data, 50.0)._felt({})[:, 2], 0.0, atol=1e-9)
    assert np.nanmax(np.abs(found.left)) == pytest.approx(0.0, abs=1e-9)


def test_readings_at_a_lower_limit_are_lost_and_others_are_not() -> None:
    time, said = np.arange(6.0), SimpleNamespace(subject="q")
    x = np.array([-0.5, 0.3, -0.499, 0.2, -0.1, -0.5])
    fault: Any = Fault("clipped", "q", -0.5, 0.0, 5.0, said)  # type: ignore[arg-type]
    np.testing.assert_array_equal(np.isnan(Fault.removed(time, x, [fault])), x < -0.4)


def test_the_drag_of_a_draft_is_a_polar() -> None:
    """CD = CD0 + k CL^2 with CL = CL0 + a alpha: its slope and curvature by alpha are 2 k CL0 a and k a^2."""
    wing = SimpleNamespace(area=0.5, span=2.0, aspect_ratio=8.0, root_chord=0.25, taper=1.0, chord=0.25)
    body = SimpleNamespace(width=0.15, height=0.2, length=1.1)
    geometry: Any = SimpleNamespace(wing=wing, fuselage=body, tail=None, fin=None)
    slope, step = 4.5, 1e-3
    low, at, high = (_drag(geometry, 18.0, 0.4 + slope * da, slope) for da in (-step, 0.0, step))
    assert at["CDalpha"] == pytest.approx((high["CD0"] - low["CD0"]) / (2.0 * step), rel=1e-6)
    assert at["CDalpha2"] == pytest.approx((high["CDalpha"] - low["CDalpha"]) / (4.0 * step), rel=1e-6)


def test_ranges_for_training_hold_nineteen_draws_of_twenty() -> None:
    draws = np.linspace(0.0, 1.0, 10_001)
    low, high = np.percentile(draws, INTERVAL)
    assert np.mean((draws >= low) & (draws <= high)) == pytest.approx(0.95, abs=1e-3)


def test_curves_are_not_drawn_across_gaps() -> None:
    plots = pytest.importorskip("stoop_app.plots")
    drawn = plots._path([[1.0, 2.0, None, 3.0, 4.0], [5.0]], 1.0, 0.0, 1.0)
    assert "".join(c for c in drawn if c.isalpha()) == "MLMLM"
