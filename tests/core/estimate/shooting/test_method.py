"""Windows that meet: an unstable aircraft flown by a damper, and a quadrotor flown by its autopilot."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.fits import deviations, fit_by
from helpers.flown import maneuver, with_few_free

import stoop
from stoop import Options, load_vehicle, simulate_flight, trim
from stoop.checks.excitation import in_ratio, ratios
from stoop.checks.rotors import foreign_motors, rotor_notices
from stoop.errors import FlightError, IdentificationError
from stoop.estimate import multiple_shooting
from stoop.estimate.fit import estimation_problem
from stoop.estimate.multiple_shooting import MultipleShooting
from stoop.flight import from_columns
from stoop.problem.windows import Window
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import parse_vehicle
from stoop.workflow import demo

DT, FREE = 0.02, ("CL0", "CLalpha", "CLelevator", "CD0", "CDalpha", "Cm0", "Cmalpha", "Cmq", "Cmelevator")
MANEUVER = maneuver(15.0, ("elevator", "3-2-1-1", 1.0, 0.5, 0.04), ("elevator", "3-2-1-1", 7.0, 0.5, -0.05))
WINDOW = [Window("damped", 0.0, 15.0)]


@pytest.fixture(scope="module")
def unstable():
    """A divergence that doubles in half a second."""
    vehicle = load_vehicle("twin-boom").reduced("longitudinal")
    alpha = trim(vehicle).start["alpha"]  # where Cmalpha is changed about, so that the trim stays
    changed = {"Cmalpha": {"value": 1.5}, "Cm0": {"value": vehicle.value("Cm0") - 3.62 * alpha}}
    return with_few_free(vehicle, FREE).with_numbers(changed)


@pytest.fixture(scope="module")
def flight(unstable):
    """What sensors record while the elevator damps pitch rate and holds the angle of attack."""
    point = trim(unstable)
    kernel, rows = unstable.kernel(), unstable.parameter_rows(point.changes)
    x = unstable.initial_states(point.start, rows, point.inputs)
    pilot, u, inputs, readings = MANEUVER.deflections()["elevator"], point.inputs[:, None], [], []
    for k in range(len(MANEUVER.time)):
        _, y = kernel.evaluate(rows, x, u)
        inputs.append(u[:, 0])
        readings.append(y[:, 0])
        alpha, q = y[1, 0] - point.start["alpha"], y[2, 0]
        after = point.inputs[:, None] + pilot[min(k + 1, len(pilot) - 1)] + 3.0 * alpha + 0.3 * q
        x, _ = kernel.step(rows, x, u, after, DT)
        u = after
    sigma = np.array([getattr(unstable.file.sensors, c).sigma for c in unstable.outputs])
    noise = np.random.default_rng(2).standard_normal((len(readings), len(sigma)))
    columns = dict(zip(unstable.outputs, (np.array(readings) + sigma * noise).T, strict=True))
    columns |= dict(zip(unstable.inputs, np.array(inputs).T, strict=True))
    columns["altitude"] = np.full(len(readings), 200.0)
    return from_columns("damped", MANEUVER.time, columns, ("simulated flight",))


@pytest.fixture(scope="module")
def truth(unstable):
    thrust = trim(unstable).changes.get("propulsion.thrust", unstable.value("propulsion.thrust"))
    return {n: unstable.value(n) for n in FREE} | {"propulsion.thrust": thrust}


@pytest.fixture(scope="module")
def start(unstable, truth):
    """Coefficients that are wrong by up to 40 %, stable in pitch."""
    rng = np.random.default_rng(5)
    wrong = {n: {"value": truth[n] * rng.uniform(0.6, 1.4)} for n in FREE if n != "Cmalpha"}
    thrust = {"propulsion.thrust": {"value": truth["propulsion.thrust"]}}
    return unstable.with_numbers({**wrong, **thrust, "Cmalpha": {"value": -0.5, "bounds": [-4.0, 4.0]}})


@pytest.fixture(scope="module")
def found(start, flight):
    return MultipleShooting()(start, {"damped": flight}, WINDOW, Options(method="multiple-shooting"))


def test_truth_comes_back_within_three_standard_errors(start, flight, found, truth):
    """Open loop even the truth runs away, from a first sample that is known to the noise only."""
    problem, _ = estimation_problem(start, {"damped": flight}, WINDOW, Options())
    right = problem.layout.unit(np.array([truth[p.name] for p in problem.layout.parameters]))
    readings = np.sum(np.isfinite(problem.pieces[0].measured))
    assert not problem.costs(right[None, :], len(problem.prices) - 1)[0] < 1e3 * readings
    assert found.outcome.status == "converged"
    own = {p.name: truth[p.name] for p in found.problem.layout.parameters}
    assert np.abs(deviations(found, own)).max() < 3.0
    assert found.estimates["Cmalpha"] == pytest.approx(1.5, abs=0.1)


def test_parameters_that_nothing_determines_do_not_keep_it_from_converging(unstable):
    """Thirty-two of them, half lateral, from an elevator input; steps of windows that are kept together are not cut short."""
    aircraft = load_vehicle("twin-boom")
    calm = simulate_flight(aircraft, parse_maneuver(demo.MANEUVER, "calm"), seed=3, name="sim")
    found = MultipleShooting()(aircraft, {"sim": calm}, [Window("sim", 0.0, 8.0)], Options())
    assert found.outcome.status == "converged"


def test_a_budget_ends_it_where_the_windows_are_and_more_of_it_goes_on(start, flight, found):
    args = (start, {"damped": flight}, WINDOW)
    short = MultipleShooting()(*args, Options(method="multiple-shooting", budget=100.0))
    assert short.outcome.status == "budget"
    assert short.trajectories <= 100.0
    assert "the windows meet within" in short.outcome.advice
    more = MultipleShooting()(*args, Options(method="multiple-shooting"), None, short.outcome.state)
    assert more.outcome.status == "converged"
    assert np.array_equal(more.z, found.z)
    few = MultipleShooting()(*args, Options(generations=3))
    assert (few.outcome.status, few.outcome.generation) == ("generations", 3)


@pytest.mark.parametrize("seed", range(4))
def test_a_hostile_start_ends_in_a_value_or_in_one_line(unstable, flight, seed):
    """Values anywhere in boxes a thousand times as wide as the file's, attitudes of windows included."""
    rng, wild = np.random.default_rng(seed), {}
    for p in unstable.parameters:
        if p.free:
            reach = 1e3 * max(abs(p.value), 0.1)
            wild[p.name] = {"value": float(rng.uniform(-reach, reach)), "bounds": [-reach, reach]}
    hostile = unstable.with_numbers(wild)
    try:
        found = MultipleShooting()(hostile, {"damped": flight}, WINDOW, Options(budget=2000.0))
    except IdentificationError as error:
        assert "\n" not in str(error)  # noqa: PT017
    else:
        assert np.isfinite(found.z).all()
        assert found.outcome.status == "converged" or found.outcome.advice


def test_an_interrupted_fit_is_resumed_to_the_same_result(start, flight, resumed):
    options = Options(method="multiple-shooting")
    found = resumed(MultipleShooting(), start, {"damped": flight}, WINDOW, options)
    assert found.outcome.status == "converged"


def test_the_length_of_the_windows_does_not_matter(start, flight, found):
    options = Options(method="multiple-shooting")
    for length in (0.5, 2.0):
        other = MultipleShooting(length)(start, {"damped": flight}, WINDOW, options)
        assert other.estimates == pytest.approx(found.estimates, rel=1e-3, abs=1e-4)


def test_a_stable_aircraft_is_found_as_by_output_error(wrong, aircraft):
    calm = simulate_flight(aircraft, parse_maneuver(demo.MANEUVER, "calm"), seed=3, name="sim")
    each = ("output-error", "multiple-shooting")
    one, many = (fit_by(method, wrong, {"sim": calm}, [Window("sim", 0.0, 16.0)]) for method in each)
    assert np.abs(deviations(one, many.estimates)).max() < 0.05


WHOLE, WIND = [Window("sim", 0.0, 16.0)], (2.0, -1.0, 0.0)
INPUTS = (
    ("roll", "doublet", 1.0, 0.15, 8.0), ("pitch", "doublet", 2.0, 0.15, 8.0), ("yaw", "doublet", 3.0, 0.4, 1.5),
    ("heave", "3-2-1-1", 4.0, 0.25, 2.0), ("north", "doublet", 6.0, 2.0, 2.5), ("east", "doublet", 8.0, 2.0, 2.5),
    ("down", "doublet", 9.5, 2.0, 1.0), ("roll", "doublet", 13.0, 0.15, -8.0), ("pitch", "doublet", 14.0, 0.15, -8.0),
)  # fmt: skip
WRONG = {
    "rotors.T1": 0.8, "rotors.T2": 1.2, "rotors.inflow": 1.3, "rotors.drag": 0.7, "rotors.torque_ratio": 1.25,
    "rotors.lag": 1.3,
}  # fmt: skip


@pytest.fixture(scope="module")
def quad():
    text = load_vehicle("quad-x").text.replace("lag = ", "delay = 0.012\nlag = ", 1)
    return parse_vehicle(text.replace("# front left\n", "# front left\nfactor = 0.85\n", 1), "quad.toml")


@pytest.fixture(scope="module")
def flown(quad):
    return simulate_flight(quad, maneuver(16.0, *INPUTS, rate=100.0, wind=WIND), seed=1, name="sim")


@pytest.fixture(scope="module")
def begun(quad):
    wrong = {n: {"value": quad.value(n) * f, "free": True} for n, f in WRONG.items()}
    more = {"rotors.delay": {"value": 0.02, "free": True}, "rotor.m3.factor": {"value": 1.0, "free": True}}
    return quad.with_numbers({**wrong, **more})


@pytest.fixture(scope="module")
def job(begun, flown):
    return stoop.fit(begun, flown, ["0:11"], validate=["11.5:16"])


def test_windows_are_the_default_and_find_the_truth(quad, job):
    result = job.result
    assert (result.method, result.status) == ("multiple-shooting", "converged")
    off = [(p.estimate - quad.value(n)) / p.std_error for n, p in result.parameters.items()]
    assert np.abs(off).max() < 3.5
    assert result.parameters["rotor.m3.factor"].estimate == pytest.approx(0.85, abs=0.01)
    assert result.parameters["rotors.delay"].estimate == pytest.approx(0.012, abs=1e-3)
    for channel, blown in zip(("vn", "ve", "vd"), WIND, strict=True):
        bias = result.biases[0].values[channel]
        assert abs(bias.estimate - blown) < 4.0 * bias.std_error
    # what was not fitted is predicted window by window
    predicted = result.maneuvers[1].channels
    assert max(predicted[channel].theil for channel in ("p", "q", "r", "az")) < 0.3
    assert predicted["az"].theil < predicted["az"].baseline_theil
    assert "predicted-in-windows" in [n.code for n in result.data_notices]
    assert "multiple-shooting-rotors" in [n.code for n in result.basis]


def test_a_hopeless_start_is_searched_for(begun, flown, monkeypatch, resumed):
    """Without the regression's start, and with thrust and torque far off, the optimizer takes over; it may be interrupted."""
    monkeypatch.setattr(
        multiple_shooting, "starts",
        lambda problem, _: problem.layout.unit(np.array([p.value for p in problem.layout.parameters]))[None],
    )  # fmt: skip
    groups = ("rotors.", "rotor.", "body_drag.")
    numbers = {p.name: {"free": False} for p in begun.parameters if p.free and p.name.startswith(groups)}
    right = {n: begun.value(n) / f for n, f in WRONG.items()}
    right |= {"rotors.delay": 0.012, "rotor.m3.factor": 0.85}
    numbers |= {n: {"value": v, "free": False} for n, v in right.items()}
    for name, far, bounds in (("rotors.T2", 0.7, (0.1, 20.0)), ("rotors.T1", 0.5, (0.0, 10.0))):
        numbers[name] = {"value": far, "free": True, "bounds": bounds}
    args = (begun.with_numbers(numbers), {"sim": flown}, [Window("sim", 0.0, 8.0)], Options(budget=900.0))
    fit = resumed(multiple_shooting.fit, *args)
    assert (fit.outcome.optimizer, fit.estimates["rotors.T2"]) == ("ps-gde-lm", pytest.approx(6.0, rel=0.02))
    assert "global-start" in [n.code for n in fit.notices]


def test_without_mass_and_inertia_ratios_are_told(quad, flown):
    free = {n: {"free": True} for n in ("mass.mass", *(f"mass.inertia.{a}" for a in ("xx", "yy", "zz")))}
    unknown = quad.with_numbers({**free, "mass.mass": {"value": 3.0, "free": True}})
    problem, _ = estimation_problem(unknown, {"sim": flown}, WHOLE, Options())
    names = {p.name for p in problem.layout.parameters}
    assert names & {"mass.mass", "mass.inertia.xx"} == {"mass.inertia.xx"}
    assert "rotors.T2 4 +/- 0.1 N/kg" in ratios(problem.layout.vehicle, {"rotors.T2": (12.0, 0.3)})
    text = quad.text.replace("[rotors]", "[rotors]\ndrag_inflow = { value = 0.001, free = %s }", 1)
    told, held = (parse_vehicle(text % word, "quad").with_numbers(free) for word in ("true", "false"))
    assert "rotors.drag_inflow" in {p.name for p in in_ratio(told)}
    weighed = unknown.with_numbers({"mass.mass": {"value": 1.5, "prior": 0.1}})
    known = quad.with_numbers({"mass.mass": {"free": True}})
    for vehicle in (held, weighed, known):  # a force that is known tells the mass, and so does inertia
        assert not in_ratio(vehicle)


def changed(flown, **columns):
    kept = {str(n): flown.column(str(n)) for n in flown.data.data_vars}
    return replace(from_columns("sim", flown.time, {**kept, **columns}, ()), sources=flown.sources)


def noticed(begun, flown, **columns):
    return rotor_notices(estimation_problem(begun, {"sim": changed(flown, **columns)}, WHOLE, Options())[0])


def test_motors_off_and_rates_that_lack_are_no_flight(begun, flown):
    off = {f"motor_{i}": np.where(flown.time < 12.0, 0.01 * i, 0.6 + 0.01 * i) for i in range(1, 5)}
    blank = dict.fromkeys("pqr", np.full(len(flown.time), np.nan))
    for columns, advice in (
        (blank, r"none of the rates p.*\[variables\]"),
        (off, r"off in 75% .*rotors\.idle"),
    ):
        with pytest.raises(IdentificationError, match=advice):
            estimation_problem(begun, {"sim": changed(flown, **columns)}, WHOLE, Options())
    partly = {n: np.where(flown.time < 3.0, 0.0, flown.column(n)) for n in off}
    (one,) = (one for one in noticed(begun, flown, **partly) if one.code == "motors-off")
    assert one.values["first"] == pytest.approx(3.0, abs=0.02)


def test_saturation_and_stillness_are_said(begun, flown):
    full = np.where(flown.time < 4.0, 1.0, flown.column("motor_2"))
    (one,) = (one for one in noticed(begun, flown, motor_2=full) if one.code == "command-saturated")
    assert (one.subject, one.values["end"]) == ("motor_2", "upper")
    assert one.values["share"] == pytest.approx(0.25, abs=0.005)
    rng = np.random.default_rng(0)
    still = {f"motor_{i}": 0.6 + 1e-4 * rng.standard_normal(len(flown.time)) for i in range(1, 5)}
    still |= {c: 0.01 * rng.standard_normal(len(flown.time)) for c in "pqr"}
    codes = [one.code for one in noticed(begun, flown, **still)]
    assert codes.count("axis-not-excited") == 3
    assert "lift-not-excited" in codes


def test_the_log_of_another_vehicle_is_recognized(begun, flown):
    hexa, more = load_vehicle("hexa-x"), ("motor_5", "motor_6")
    constant = changed(flown, **dict.fromkeys(more, np.zeros(len(flown.time))))
    for given, advice in (
        (flown, r"input .motor_5., .motor_6. is not in this flight.*\[rotor\.m5\]"),
        (constant, r"motor_5, motor_6 never change.*\[rotor\.m5\], \[rotor\.m6\]"),
    ):
        with pytest.raises((FlightError, IdentificationError), match=advice):
            estimation_problem(hexa, {"sim": given}, WHOLE, Options())
    (one,) = foreign_motors(begun, changed(flown, **dict.fromkeys(more, flown.column("motor_1"))), WHOLE)
    assert (one.code, one.values["channels"]) == ("foreign-motors", more)


@pytest.mark.parametrize(("name", "wrong"), [("mass.mass", 1.2), ("mass.inertia.xx", 1.5)])
def test_a_wrong_mass_or_inertia_is_named_and_its_value_comes_out(name, wrong):
    """Thrust takes up the error silently: thrust nearly independent of the command, and much more drag."""
    vehicle = load_vehicle("quad-x")
    calm = simulate_flight(vehicle, maneuver(16.0, *INPUTS, rate=100.0, wind=WIND), seed=1, name="sim")
    off = vehicle.with_numbers({name: {"value": wrong * vehicle.value(name)}})
    given = stoop.fit(off, calm, ["0:11"], validate=["11.5:16"]).result
    assert given.extensions.found[0].name == name
    assert name == "mass.inertia.xx" or given.verdict.grade == "do not use"
    longer = stoop.fit(off, calm, ["0:11"], validate=["11.5:16"], extend=True).result
    assert longer.parameters[name].estimate == pytest.approx(vehicle.value(name), rel=0.01)
    assert longer.verdict.grade == "usable"
