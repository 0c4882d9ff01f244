"""An aircraft that is unstable in pitch and is flown by a damper: windows that meet find it."""

import numpy as np
import pytest
from unit.estimate.fits import deviations, fit_by
from unit.flown import maneuver, with_few_free

from stoop.errors import IdentificationError
from stoop.estimate.fit import Options, estimation_problem
from stoop.estimate.multiple_shooting import MultipleShooting
from stoop.flight import from_columns
from stoop.kernels import filtering
from stoop.problem.windows import Window
from stoop.simulation import initial_states, parameter_rows, trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow import demo

DT = 0.02
FREE = ("CL0", "CLalpha", "CLelevator", "CD0", "CDalpha", "Cm0", "Cmalpha", "Cmq", "Cmelevator")
MANEUVER = maneuver(15.0, ("elevator", "3-2-1-1", 1.0, 0.5, 0.04), ("elevator", "3-2-1-1", 7.0, 0.5, -0.05))


@pytest.fixture(scope="module")
def unstable():
    """A divergence that doubles in half a second."""
    vehicle = resolve_vehicle("twin-boom").reduced("longitudinal")
    alpha = trim(vehicle).start["alpha"]  # where Cmalpha is changed about, so that the trim stays
    changed = {"Cmalpha": {"value": 1.5}, "Cm0": {"value": vehicle.value("Cm0") - 3.62 * alpha}}
    return with_few_free(vehicle, FREE).with_numbers(changed)


@pytest.fixture(scope="module")
def flight(unstable):
    """What sensors record while the elevator damps pitch rate and holds the angle of attack."""
    point = trim(unstable)
    kernel, rows = unstable.kernel(), parameter_rows(unstable, point.changes)
    x = initial_states(unstable, point.start, rows, point.inputs)
    pilot, u, inputs, readings = MANEUVER.deflections()["elevator"], point.inputs[:, None], [], []
    for k in range(len(MANEUVER.time)):
        _, y = kernel.evaluate(rows, x, u)
        inputs.append(u[:, 0])
        readings.append(y[:, 0])
        alpha, q = y[1, 0] - point.start["alpha"], y[2, 0]
        after = point.inputs[:, None] + pilot[min(k + 1, len(pilot) - 1)] + 3.0 * alpha + 0.3 * q
        x, _ = filtering.step(kernel, rows, x, u, after, DT)
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


WINDOW = [Window("damped", 0.0, 15.0)]


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
    aircraft = resolve_vehicle("twin-boom")
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
