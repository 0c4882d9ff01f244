"""Which method is meant where none is named: gusts seen by air data and inertial sensors alone, and how motors were logged."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.fits import fit_by
from scipy.signal import lfilter

from stoop import Flight, Options, Strategy, load_vehicle, simulate_flight
from stoop.base.variables import RATES, SPECIFIC_FORCE
from stoop.errors import IdentificationError
from stoop.estimate import filter_error, scoring
from stoop.estimate.gusts import Limits, exceed_sensors, gust_levels, unexplained, with_turbulence
from stoop.flight.flight import dataset, from_columns
from stoop.flight.gridding import Channels, grid_channels
from stoop.problem.windows import Window
from stoop.strategy import gusts as decision
from stoop.strategy.decision import Fitted
from stoop.strategy.method import MIN_MOTOR_RATE
from stoop.strategy.run import choose_method, fit, setup_of
from stoop.vehicle import parse_vehicle

from .conftest import MANEUVER

FIT_ALONE = Strategy.default().without("faults", "assumptions", "sensor-delays")
WINDOWS = (Window("sim", 0.0, 15.0),)
GUSTS = "\n[turbulence]\n" + "".join(f"{a} = {{{{ intensity = {{0}}, length = 150.0 }}}}\n" for a in "uvw")
ERRORS = {
    "sensors.alpha.bias": 0.03, "sensors.beta.bias": -0.02, "sensors.ax.bias": 0.3,
    "sensors.az.bias": -0.3, "sensors.q.bias": 0.02, "sensors.theta.bias": 0.02,
}  # fmt: skip
MOTORS = tuple(f"motor_{i}" for i in range(1, 5))


def flown(intensity=0.0, numbers=(), seed=1):
    text = load_vehicle("twin-boom").text + (GUSTS.format(intensity) if intensity else "")
    if numbers:
        text += "\n[sensors]\nalpha = { scale = 1.15 }\n"
    vehicle = parse_vehicle(text, "truth").with_numbers({n: {"value": v} for n, v in dict(numbers).items()})
    return {"sim": simulate_flight(vehicle, MANEUVER, seed=seed, name="sim")}


def levels(flights):
    return gust_levels(load_vehicle("twin-boom"), flights, WINDOWS)


@pytest.mark.parametrize("numbers", [{}, ERRORS])
def test_calm_air_shows_no_gusts_whatever_the_sensors_are_off(numbers):
    found = levels(flown(numbers=numbers))
    assert np.all(found < 0.1)
    assert not exceed_sensors(load_vehicle("twin-boom"), found)


def test_without_an_airspeed_or_by_reconstruction_nothing_is_known():
    flight = flown(2.0)["sim"]
    blind = {"sim": replace(flight, data=flight.data.drop_vars("V"))}
    assert np.isnan(levels(blind)).all()
    sources = {**flight.sources, "alpha": replace(flight.sources["alpha"], source="reconstructed")}
    assert np.isnan(levels({"sim": replace(flight, sources=sources)})).all()
    found = choose_method("", load_vehicle("twin-boom"), blind.values(), WINDOWS)
    assert (found.options.method, found.notices, found.in_calm) == ("output-error", (), "")


def test_gusts_choose_the_filter_and_who_names_another_is_warned():
    vehicle, flights = load_vehicle("twin-boom"), flown(2.0)
    found = choose_method("", vehicle, flights.values(), WINDOWS)
    assert (found.options.method, found.in_calm) == ("filter-error", "output-error")
    assert [n.code for n in found.notices] == ["gusts-filtered"]
    for name in ("output-error", "multiple-shooting"):
        named = choose_method(name, vehicle, flights.values(), WINDOWS)
        assert (named.options.method, named.in_calm) == (name, "")
        assert [(n.code, n.severity) for n in named.notices] == [("gusts-ignored", "warning")]
        setup = setup_of(Strategy.default(), vehicle, flights, WINDOWS, options=Options(method=name))
        assert decision.look_for_gusts(setup).done == f"{name} kept, which takes no gusts"
    for name in ("filter-error", "equation-error"):
        named = choose_method(name, vehicle, flights.values(), WINDOWS)
        assert (named.options.method, named.notices, named.in_calm) == (name, (), "")
    delay = "\n[sensors]\nalpha = { delay = { value = 0.02, free = true, bounds = [0.0, 0.1] } }\n"
    late = choose_method("", parse_vehicle(vehicle.text + delay, "late"), flights.values(), WINDOWS)
    assert (late.options.method, [n.code for n in late.notices]) == ("output-error", ["gusts-ignored"])


def test_a_table_of_the_file_is_kept_and_a_reduced_model_has_its_own_axes(gusty):
    plain = load_vehicle("twin-boom")
    assert with_turbulence(gusty) is gusty
    blown, short = with_turbulence(plain), with_turbulence(plain.reduced("longitudinal"))
    assert (blown.gusts, short.gusts) == (("u", "v", "w"), ("u", "w"))
    assert parse_vehicle(blown.text, "again").file == blown.file, "the identified vehicle is written"
    free = {p.name for p in short.parameters if p.free and p.name.startswith("turbulence")}
    assert free == {"turbulence.u.intensity", "turbulence.w.intensity"}


def test_white_innovations_of_a_converged_fit_are_asked_for():
    for status, correlation, codes in (
        ("converged", 0.0, []), ("converged", Limits.correlation + 0.01, ["gusts-not-explained"]),
        ("interrupted", 0.9, []), ("generations", 0.0, ["gusts-no-optimum"]),
    ):  # fmt: skip
        fit = SimpleNamespace(outcome=SimpleNamespace(status=status), innovation_correlation=correlation)
        assert [n.code for n in unexplained(fit, "filter-error", "output-error")] == codes, status


def test_a_filter_whose_innovations_gusts_do_not_explain_ends_early(gusty_start, gusty_flight, monkeypatch):
    """Slow errors of all readings; a filter that was named goes on to its optimum."""
    rng, data, searches, plain = np.random.default_rng(0), gusty_flight.data, [], scoring.maximize
    for n in gusty_start.outputs:
        slow = lfilter([1.5], [1.0, -0.95], rng.standard_normal(gusty_flight.time.size))
        data = data.assign({n: data[n] + getattr(gusty_start.file.sensors, n).sigma * slow})
    flights = {"sim": replace(gusty_flight, data=data)}
    monkeypatch.setattr(filter_error, "maximize", lambda *args: searches.append(args[3]) or plain(*args))
    done = fit(FIT_ALONE, gusty_start, flights, WINDOWS)
    assert done.setup.options.method == "output-error"
    assert "gusts-not-explained" in [n.code for n in done.estimate.notices]
    assert set(searches) == {filter_error.Tolerances.first}
    found = fit_by("filter-error", gusty_start, flights, WINDOWS)
    assert searches[-1] == filter_error.Tolerances.last
    assert abs(found.innovation_correlation) > Limits.correlation


@pytest.mark.parametrize("resumed", [True, False])
@pytest.mark.parametrize("failing", ["output-error", "filter-error"])
def test_the_method_that_fails_gives_way_to_the_other(monkeypatch, failing, resumed):
    """A search in calm air that was interrupted goes on where it was, and the filter begins anew."""
    vehicle, options = load_vehicle("twin-boom"), Options(method="output-error")
    setup = setup_of(Strategy.default(), vehicle, {}, WINDOWS, options=options)
    state, start = SimpleNamespace(optimizer="ps-gde-lm") if resumed else None, {"CLalpha": 5.0}
    setup, asked = replace(setup, in_calm="output-error", state=state).by("filter-error"), []
    estimate = SimpleNamespace(outcome=SimpleNamespace(status="converged"), start=start, notices=())

    def fitted(one):
        own = one.options
        asked.append((own.method, one.state, dict(own.start or {}), own.treatment.gives_up))
        if own.method == failing:
            raise IdentificationError("the filter diverges from every start")
        return Fitted(one, estimate)

    monkeypatch.setattr(decision, "unexplained", lambda *args: ())
    done = decision.fit_in_gusts(setup, fitted)
    calm = failing == "filter-error"  # then the filter begins once more at its estimates
    assert done.setup.options.method == ("output-error" if calm else "filter-error")
    first = [] if resumed else [("filter-error", None, {}, True)]
    later = [("output-error", state, {}, False), ("filter-error", None, start if calm else {}, calm)]
    assert asked == [*first, *(later if calm or resumed else [])]
    assert [n.code for n in done.setup.notices] == (["filter-diverges"] if calm else [])


def logged(rate: float, grid: float = 100.0) -> Flight:
    """Return seconds of a log whose motors came at a rate of their own, and one other channel at 250 Hz."""
    fast, slow = np.arange(0.0, 4.0, 0.004), np.arange(0.0, 4.0, 1.0 / rate)
    motors = Channels("actuator_outputs", slow, {m: 0.5 + 0.1 * np.sin(slow) for m in MOTORS})
    laid, data, sources = grid_channels([Channels("gyro", fast, {"p": np.sin(fast)}), motors], grid, "log")
    return Flight("log", None, dataset(laid.time, data), grid, sources)


@pytest.mark.parametrize(("rate", "name"), [(43.0, "equation-error"), (250.0, "multiple-shooting")])
def test_motors_that_were_logged_slowly_choose(rate: float, name: str) -> None:
    found = choose_method("", load_vehicle("quad-x"), [replace(logged(250.0), name="fast"), logged(rate)])
    assert found.options.method == name
    assert [(n.code, n.values["rate"]) for n in found.notices] == (
        [("motors-logged-slowly", pytest.approx(43.0, abs=0.5))] if rate < MIN_MOTOR_RATE else []
    )


def test_what_lies_on_the_grid_as_it_was_commanded_is_not_slow() -> None:
    """A simulated flight at 40 Hz holds all that was commanded, and a clock of 49.9 Hz is one of 50 Hz; a log of 40 Hz lacks
    what came between its samples, whatever its grid.
    """
    vehicle, time = load_vehicle("quad-x"), np.arange(0.0, 4.0, 0.025)
    given = from_columns("flight", time, {c: np.sin(time) for c in ("p", "theta", *MOTORS)})
    for one in (given, logged(49.9)):
        found = choose_method("", vehicle, [one])
        assert (found.options.method, found.notices, found.in_calm) == ("multiple-shooting", (), "")
    for grid in (50.0, 100.0):
        assert choose_method("", vehicle, [logged(40.0, grid)]).options.method == "equation-error"


def test_gyros_and_accelerometers_alone_are_regressed() -> None:
    """Without velocity and attitude; one channel of either, and windows can be simulated."""
    time = np.arange(0.0, 4.0, 0.01)
    columns = {c: np.sin(time) for c in (*RATES, *SPECIFIC_FORCE, *MOTORS)}
    vehicle, log = load_vehicle("quad-x"), from_columns("log", time, columns)
    found = choose_method("", vehicle, [log])
    assert found.options.method == "equation-error"
    assert [n.code for n in found.notices] == ["no-states-recorded"]
    other = from_columns("log", time, {**columns, "theta": 0.1 * np.sin(time)})
    assert choose_method("", vehicle, [log, other]).options.method == "multiple-shooting"
