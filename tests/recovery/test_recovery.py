"""Known truth, seeded noise, wrong start: every estimate within three of its standard errors.

Those come from the Jacobian at the optimum, nuisances included. The noise is white and its covariance estimated, so they
should be exact: pooled over seeds, squares of (estimate - truth) / standard error must average one.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.fits import deviations, fit_by
from helpers.flown import maneuver

import stoop
from stoop import Flight, Options, Vehicle, load_vehicle, simulate_flight, trim
from stoop.errors import IdentificationError, VehicleError
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import fit
from stoop.flight import from_columns
from stoop.problem.windows import Window
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_text
from stoop_plan.input_design.windows import find_windows

TEXT = builtin_text("twin-boom")
#: truths that the paper's Table 1 leaves out
LEFT_OUT = {"CLV": 0.05, "CDV": 0.02, "CDalpha2": 1.2, "CmV": 0.03}
JOINT = (
    ("elevator", "3-2-1-1", 1.0, 0.3, 0.12), ("aileron", "doublet", 8.0, 0.5, 0.10), ("elevator", "doublet", 12.0, 2.5, 0.06),
    ("rudder", "doublet", 20.0, 0.7, 0.15), ("rudder", "2-1-1", 26.0, 0.6, 0.12), ("aileron", "2-1-1", 31.0, 0.5, 0.10),
    ("elevator", "doublet", 36.0, 0.4, 0.10), ("elevator", "doublet", 40.0, 2.5, -0.06),
    ("aileron", "doublet", 50.0, 0.5, -0.1), ("rudder", "doublet", 53.0, 0.5, -0.15),
)  # fmt: skip
PITCH = (
    ("elevator", "3-2-1-1", 1.0, 0.3, 0.12), ("elevator", "doublet", 5.0, 1.5, 0.05), ("elevator", "doublet", 12.0, 0.3, 0.1),
)  # fmt: skip
ROLL = (("aileron", "doublet", 1.0, 0.6, 0.1), ("rudder", "2-1-1", 5.0, 0.6, 0.15))
BOUNDS = {"CLalpha": (2.0, 8.0), "Cmalpha": (-4.0, 0.0), "Cmq": (-90.0, -10.0), "Cmelevator": (-2.0, 0.0)}
TWO = [Window("a", 0.0, 16.0), Window("b", 0.0, 16.0)]


def held(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with the thrust that its trim needs: that is what will be flown."""
    thrust = trim(vehicle).thrust["propulsion.thrust"]
    return vehicle.with_numbers({"propulsion.thrust": {"value": float(thrust)}})


def spoiled(vehicle: Vehicle, seed: int, reach: float = 0.4) -> Vehicle:
    rng = np.random.default_rng(1000 + seed)
    free = [p for p in vehicle.parameters if p.free and not p.name.endswith(".bias")]
    wrong = {p.name: np.clip(p.value * rng.uniform(1 - reach, 1 + reach), p.lower, p.upper) for p in free}
    return vehicle.with_numbers({name: {"value": float(x)} for name, x in wrong.items()})


def freed(vehicle: Vehicle, numbers: Mapping[str, tuple[float, float]]) -> Vehicle:
    closed = vehicle.with_numbers({p.name: {"free": False} for p in vehicle.parameters if "." not in p.name})
    return closed.with_numbers({name: {"free": True, "bounds": bounds} for name, bounds in numbers.items()})


def scores(found: Estimate, truth: Vehicle) -> dict[str, float]:
    problem, rung = found.problem, len(found.problem.prices) - 1
    J = problem.jacobian(found.z, rung, problem.residuals(found.z[None, :], rung)[0])[0].dense()
    sigma = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))[: problem.dimension] * problem.layout.width
    known = {p.name: p.value for p in truth.parameters}
    return {n: (v - known[n]) / s for (n, v), s in zip(found.estimates.items(), sigma, strict=True)}


def recover(truth: Vehicle, start: Vehicle, flown: Maneuver, seed: int) -> Estimate:
    flight = simulate_flight(truth, flown, seed=seed, name="sim")
    return fit(start, {"sim": flight}, [Window("sim", 0.0, flown.duration)], Options(seed=seed))


@pytest.fixture(scope="module")
def aircraft() -> Vehicle:
    vehicle = parse_vehicle(TEXT, "twin-boom")
    return held(vehicle.with_numbers({name: {"value": value} for name, value in LEFT_OUT.items()}))


@pytest.fixture(scope="module")
def pitching(aircraft: Vehicle) -> tuple[Vehicle, Flight]:
    vehicle = aircraft.reduced("longitudinal")
    return vehicle, simulate_flight(vehicle, maneuver(16.0, *PITCH), seed=8, name="sim")


def test_all_32_parameters_of_eq_1(aircraft: Vehicle) -> None:
    found = recover(aircraft, spoiled(aircraft, 4), maneuver(60.0, *JOINT), 4)
    z = scores(found, aircraft)
    assert (len(z), found.outcome.status) == (32, "converged")
    assert {name: v for name, v in z.items() if abs(v) > 3.0} == {}
    assert sum(v * v for v in z.values()) < 62.5, "chi square of 32, 99.9 %"


def test_standard_errors_are_exact_over_seeds(aircraft: Vehicle) -> None:
    """16 flights, 512 estimates: one in 20 beyond two standard errors, one in 370 beyond three."""
    flown = maneuver(60.0, *JOINT)
    fits = (recover(aircraft, spoiled(aircraft, seed), flown, seed) for seed in range(16))
    z = np.array([list(scores(found, aircraft).values()) for found in fits])
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.15)
    assert 0.025 < np.mean(np.abs(z) > 2.0) < 0.07
    assert np.mean(np.abs(z) > 3.0) < 0.01
    assert np.abs(np.mean(z, axis=0)).max() < 3.5 / np.sqrt(16), "none is biased"


def test_separate_maneuvers_have_their_own_starts_and_biases(aircraft: Vehicle) -> None:
    flights = {}
    for i, (name, flown, q, az) in enumerate((("a", PITCH, 0.012, -0.1), ("b", ROLL, -0.008, 0.15))):
        biased = aircraft.with_numbers({"sensors.q.bias": {"value": q}, "sensors.az.bias": {"value": az}})
        flights[name] = simulate_flight(biased, maneuver(16.0, *flown), seed=i, name=name)
    few = {
        "CLalpha", "Cmalpha", "Cmq", "Cmelevator", "CL0", "Cm0", "Clp", "Claileron", "Clbeta", "Cnbeta", "Cnr", "Cnrudder",
        "CQbeta",
    }  # fmt: skip
    coefficients = [p.name for p in aircraft.parameters if "." not in p.name]
    start = aircraft.with_numbers({name: {"free": name in few} for name in coefficients})
    found = fit(spoiled(start, 3), flights, TWO, Options(seed=3))
    assert max(map(abs, scores(found, aircraft).values())) < 3.0
    each = zip(found.problem.layout.nuisances, found.z[found.problem.dimension :], strict=True)
    biases = {(n.name, n.maneuver): n.center + n.scale * z for n, z in each if n.is_bias}
    assert [biases["sensors.q.bias", m] for m in (0, 1)] == pytest.approx([0.012, -0.008], abs=3e-3)
    assert biases["sensors.az.bias", 1] - biases["sensors.az.bias", 0] == pytest.approx(0.25, abs=0.05)


def test_mass_inertia_and_center_of_gravity() -> None:
    text = TEXT.replace("[mass]\n", "[mass]\ncenter_of_gravity = [0.03, 0.0, 0.0]\n")
    text = text.replace("alpha = 0.0\n", "alpha = 0.0\nmoment_point = [0.0, 0.0, 0.0]\n")
    truth = held(parse_vehicle(text, "truth").reduced("longitudinal"))
    bounds = {"mass.mass": (140.0, 240.0), "mass.inertia.yy": (60.0, 200.0)}
    bounds["mass.center_of_gravity.x"] = (-0.1, 0.15)
    found = recover(truth, spoiled(freed(truth, bounds), 1), maneuver(16.0, *PITCH), 1)
    z = scores(found, truth)
    assert set(z) == set(bounds)
    assert max(map(abs, z.values())) < 3.0
    assert found.estimates["mass.mass"] == pytest.approx(189.4, rel=5e-3)
    assert found.estimates["mass.center_of_gravity.x"] == pytest.approx(0.03, abs=2e-3)


def test_a_loading_of_its_own_maneuver(aircraft: Vehicle) -> None:
    """Two flights, one 20 kg heavier and balanced elsewhere; the coefficients are the same."""
    heavier = {"mass.mass": 209.4, "mass.inertia.yy": 131.0}
    loading = "\n[loadings.heavy]\n" + "".join(f'"{n}" = {x}\n' for n, x in heavier.items())
    light = parse_vehicle(aircraft.text + loading, "loaded").reduced("longitudinal")
    light = held(light.with_numbers({p.name: {"value": p.value} for p in aircraft.parameters}))
    heavy = light.with_numbers({n: {"value": x} for n, x in heavier.items()})
    drag = trim(heavy).thrust["propulsion.thrust"] - trim(light).thrust["propulsion.thrust"]
    flown, both = maneuver(16.0, *PITCH), (("a", light), ("b", heavy))
    flights = {n: simulate_flight(v, flown, seed=i, name=n) for i, (n, v) in enumerate(both)}
    start = spoiled(freed(light, BOUNDS), 6)
    own = {**heavier, "propulsion.thrust": light.value("propulsion.thrust") + drag}
    start = replace(start, file=start.file.model_copy(update={"loadings": {"heavy": own}}))
    right = fit(start, flights, [TWO[0], Window("b", 0.0, 16.0, "heavy")], Options(seed=6))
    assert max(map(abs, scores(right, light).values())) < 3.0
    same_noise = Options(seed=6, covariance=right.measurement_noise)  # or the error would count as noise of b
    assert max(map(abs, scores(fit(start, flights, TWO, same_noise), light).values())) > 5.0, "it matters"


def test_channels_that_nothing_measured(pitching: tuple[Vehicle, Flight]) -> None:
    vehicle, flight = pitching
    start = spoiled(freed(vehicle, BOUNDS), 8)
    for lost in (("alpha",), ("alpha", "V", "theta")):
        data = flight.data.copy(deep=True)
        for channel in lost:
            data[channel][:] = np.nan
        found = fit(start, {"sim": replace(flight, data=data)}, [Window("sim", 0.0, 16.0)], Options(seed=8))
        assert max(map(abs, scores(found, vehicle).values())) < 3.0, lost


INSTRUMENTED = """
[controls.elevator]
lag = 0.08
delay = 0.047
[controls.aileron]
[controls.rudder]
[sensors]
vane_position = [1.2, 0.0, 0.0]
accelerometer_position = [0.4, 0.0, 0.1]
[sensors.alpha]
scale = 1.06
delay = 0.033
[sensors.q]
delay = 0.012
"""


def test_delays_lags_positions_and_scales() -> None:
    truth = held(parse_vehicle(TEXT + INSTRUMENTED, "truth").reduced("longitudinal"))
    numbers = {
        "controls.elevator.delay": (0.0, 0.15), "controls.elevator.lag": (0.02, 0.3), "sensors.alpha.delay": (0.0, 0.15),
        "sensors.q.delay": (0.0, 0.1), "sensors.alpha.scale": (0.8, 1.3), "sensors.vane_position.x": (0.0, 3.0),
        "sensors.accelerometer_position.x": (-1.0, 2.0), **{n: BOUNDS[n] for n in ("Cmalpha", "Cmq")}, "Cmelevator": (-3.0, 0.0),
    }  # fmt: skip
    found = recover(truth, spoiled(freed(truth, numbers), 2), maneuver(16.0, *PITCH), 2)
    z = scores(found, truth)
    assert set(z) == set(numbers)
    assert max(map(abs, z.values())) < 3.0
    assert found.estimates["controls.elevator.delay"] == pytest.approx(0.047, abs=0.01)
    assert found.estimates["sensors.q.delay"] == pytest.approx(0.012, abs=0.01)


def test_a_prior_is_weighed_against_the_data(pitching: tuple[Vehicle, Flight]) -> None:
    vehicle, flight = pitching
    start = freed(vehicle, {n: BOUNDS[n] for n in ("Cmq", "Cmalpha")})
    for prior, expected in ((1e-3, pytest.approx(-40.0, abs=0.01)), (100.0, pytest.approx(-47.6, abs=2.0))):
        wrong = {"value": -40.0, "prior": prior, "free": True, "bounds": (-90.0, -10.0)}
        found = fit(start.with_numbers({"Cmq": wrong}), {"sim": flight}, [Window("sim", 0.0, 16.0)])
        assert found.estimates["Cmq"] == expected, prior


def test_free_numbers_that_cannot_be_fitted_are_refused(aircraft: Vehicle) -> None:
    loaded = parse_vehicle(aircraft.text + '\n[loadings.heavy]\n"mass.mass" = 209.4\n', "v.toml")
    for vehicle, number, window, error, said in (
        (aircraft, "reference.alpha", Window("sim", 0.0, 2.0), IdentificationError,
         r"reference\.alpha: free, but its bounds are \[0, 0\]; write bounds"),
        (loaded, "mass.mass", Window("sim", 0.0, 2.0, "heavy"), VehicleError,
         r"loadings\.heavy\.mass\.mass: the number is free.*--fix mass\.mass"),
    ):  # fmt: skip
        start = vehicle.with_numbers({number: {"free": True}})
        flight = simulate_flight(start, maneuver(2.0, *PITCH), name="sim")
        with pytest.raises(error, match=said):
            fit(start, {"sim": flight}, [window])


Inputs = tuple[tuple[str, str, float, float, float], ...]
QUAD = (
    ("roll", "3-2-1-1", 10.0, 0.15, 15.0), ("pitch", "doublet", 24.0, 0.2, 15.0), ("yaw", "3-2-1-1", 38.0, 0.4, 1.0),
)  # fmt: skip
AIRCRAFT = (
    ("elevator", "3-2-1-1", 8.0, 0.3, 0.03), ("rudder", "doublet", 28.0, 0.8, 0.1), ("aileron", "doublet", 46.0, 0.5, 0.05),
)  # fmt: skip


@pytest.mark.parametrize(("name", "inputs"), [("quad-x", QUAD), ("twin-boom", AIRCRAFT)])
def test_known_maneuvers_are_found_and_calm_flight_is_not(name: str, inputs: Inputs) -> None:
    more, vehicle = {} if name == "quad-x" else {"airspeed": 35.0}, load_vehicle(name)
    flown = maneuver(60.0, *inputs, altitude=200.0, rate=100.0, **more)
    flight = simulate_flight(vehicle, flown, seed=1, name="sim")
    found = find_windows({"sim": flight}, vehicle)
    kept = [w for w in found.windows if w.accept]
    spans = [(t, t + {"3-2-1-1": 7, "doublet": 2}[shape] * step) for _, shape, t, step, _ in inputs]
    assert all(any(w.start <= a and w.stop >= b for w in kept) for a, b in spans)
    fitted = [w for w in kept if w.use == "fit"]
    moved = [any(w.start < a + 7.0 * s and w.stop > a for _, _, a, s, _ in inputs) for w in fitted]
    assert np.mean(moved) >= 0.75
    if name == "twin-boom":  # error bars come out as foretold
        told = stoop.fit(vehicle, flight, found.texts("fit"), budget=5000.0).result.parameters
        ratios = [told[e.name].std_error / e.std_error for e in found.expected if told[e.name].identifiable]
        assert len(ratios) > 3
        assert 0.5 < float(np.median(ratios)) < 2.0


SUBSTEPS, WINDOW = 20, [Window("sim", 0.0, 15.0)]
SERVO = {"controls.elevator.rate_limit": 0.35, "controls.elevator.dead_zone": 0.012}  #: rad/s, rad
DELAYS = {"alpha": 0.033, "q": 0.012, "theta": 0.05}  #: s; 1.65, 0.6, and 2.5 samples
LATE = {f"sensors.{channel}.delay": late for channel, late in DELAYS.items()}
INPUTS = (("3-2-1-1", 1.0, 0.4, 0.06), ("doublet", 7.0, 1.0, 0.05))
GUSTS = "[turbulence]\nu = { intensity = 1.5, length = 200.0 }\nw = { intensity = 1.2, length = 100.0 }\n"
FREE = {
    "CL0": (-1.0, 2.0), "CLalpha": (2.0, 9.0), "CLelevator": (-1.0, 3.0), "Cm0": (-0.5, 0.5), "Cmalpha": (-4.0, 0.0),
    "Cmq": (-90.0, -5.0), "Cmelevator": (-3.0, 0.0),
}  # fmt: skip
UNKNOWN = {
    "controls.elevator.rate_limit": (0.6, (0.1, 1.0)), "controls.elevator.dead_zone": (0.0, (0.0, 0.05)),
    **dict.fromkeys(LATE, (0.01, (-0.05, 0.12))),
}  # fmt: skip


def truth(tables: str) -> Vehicle:
    vehicle = parse_vehicle(builtin_text("twin-boom") + tables, "truth").reduced("longitudinal")
    return vehicle.with_numbers({p.name: {"free": False} for p in vehicle.parameters if p.free})


def prompt(more: str = "") -> Vehicle:
    return truth("".join(f"[sensors.{channel}]\ndelay = 0.0\n" for channel in DELAYS) + more)


def flight(vehicle: Vehicle, seed: int, late: dict[str, float]) -> Flight:
    """Simulate a vehicle at 1 kHz and read its sensors, some late, at 50 Hz, with noise."""
    keys = ("control", "shape", "start", "step", "amplitude", "slew")
    inputs = [dict(zip(keys, ("elevator", *one, 1.0), strict=True)) for one in INPUTS]
    maneuver = Maneuver.model_validate({"duration": 15.0, "rate": 1000.0, "input": inputs})
    flown = simulate_flight(vehicle, maneuver, seed=seed, noise=False, name="sim")
    rng, columns = np.random.default_rng([seed, 1]), {}
    for name in map(str, flown.data.data_vars):
        x, steps = flown.column(name), round(1000.0 * late.get(name, 0.0))
        x = np.concatenate([np.full(steps, x[0]), x[: len(x) - steps]])[::SUBSTEPS]
        sensor = getattr(vehicle.file.sensors, name, None)
        columns[name] = x if sensor is None else x + sensor.sigma * rng.standard_normal(len(x))
    return from_columns("sim", flown.time[::SUBSTEPS], columns)


def spoiled_late(vehicle: Vehicle, seed: int) -> Vehicle:
    rng = np.random.default_rng([seed, 2])
    return vehicle.with_numbers({
        n: {"value": vehicle.value(n) * rng.uniform(0.6, 1.4), "bounds": b, "free": True} for n, b in FREE.items()
    })  # fmt: skip


def recovered(method: str, vehicle: Vehicle, seed: int, added: dict[str, float]) -> tuple[Estimate, Any]:
    unknown = {n: {"value": UNKNOWN[n][0], "bounds": UNKNOWN[n][1], "free": True} for n in added}
    flown = {"sim": flight(vehicle, seed, DELAYS if added is LATE else {})}
    found = fit_by(method, spoiled_late(vehicle, seed).with_numbers(unknown), flown, WINDOW)
    return found, deviations(found, {n: vehicle.value(n) for n in FREE} | added)


@pytest.mark.parametrize("method", ["output-error", "multiple-shooting", "filter-error"])
def test_a_servo_comes_back(method: str) -> None:
    numbers = "".join(f"{name.rpartition('.')[2]} = {value}\n" for name, value in SERVO.items())
    vehicle = truth(f"[controls.elevator]\n{numbers}[controls.aileron]\n[controls.rudder]\n")
    found, z = recovered(method, vehicle, 1, SERVO)
    assert found.outcome.status == "converged"
    assert np.abs(z).max() < 3.5
    assert found.estimates["controls.elevator.rate_limit"] == pytest.approx(0.35, rel=0.1)
    assert found.estimates["controls.elevator.dead_zone"] == pytest.approx(0.012, abs=0.004)


@pytest.mark.parametrize("method", ["output-error", "multiple-shooting"])
def test_delays_come_back_in_calm_air(method: str) -> None:
    found, z = recovered(method, prompt(), 1, LATE)
    assert found.outcome.status == "converged"
    assert np.abs(z).max() < 3.5
    assert {n: found.estimates[n] for n in LATE} == pytest.approx(LATE, abs=0.01)


def test_known_delays_leave_the_noise_as_it_is_in_gusts() -> None:
    vehicle, known = prompt(GUSTS), {n: {"value": late, "free": False} for n, late in LATE.items()}
    start, flown = spoiled_late(vehicle, 1).with_numbers(known), {"sim": flight(vehicle, 1, DELAYS)}
    found = fit_by("filter-error", start, flown, WINDOW)
    assert found.outcome.status == "converged"
    assert np.abs(deviations(found, {n: vehicle.value(n) for n in FREE})).max() < 3.5
    noise = dict(zip(vehicle.outputs, np.sqrt(np.diag(found.measurement_noise)), strict=True))
    for channel in DELAYS:
        assert noise[channel] == pytest.approx(getattr(vehicle.file.sensors, channel).sigma, rel=0.15)


def test_intervals_hold_the_truth() -> None:
    z = np.array([recovered("multiple-shooting", prompt(), seed, LATE)[1] for seed in range(40)])
    inside = np.abs(z) < 1.96
    assert 0.90 <= inside[:, : len(FREE)].mean() <= 0.98
    assert 0.90 <= inside[:, len(FREE) :].mean() <= 0.98
