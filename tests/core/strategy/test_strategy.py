"""Every decision applies where the data call for it, and only there; without any a fit is textbook output error."""

import argparse
import io
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers.flown import maneuver, with_few_free
from scipy.signal import lfilter

import stoop
from stoop.base.notices import notice
from stoop.base.verbs import add_options, verbs
from stoop.cli.identify import strategy_of
from stoop.errors import IdentificationError
from stoop.estimate.fit import Options
from stoop.estimate.fit import fit as output_error
from stoop.estimate.methods import find, restore
from stoop.estimate.treatment import Treatment
from stoop.flight import Flight
from stoop.flight.faults import Fault
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.strategy import DECISIONS, Strategy, fit
from stoop.strategy.decision import Fitted
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.document import with_entries

WINDOWS, FREE = (Window("a", 0.0, 5.0), Window("b", 0.0, 5.0)), ("Cmalpha", "Cmq", "Cmelevator")
OFF = ("recorded_motion", "held_numbers", "stuck_channels", "noise_shape", "maneuver_noise", "noise_color")
PLAIN = Treatment(**dict.fromkeys(OFF, False))


@cache
def known() -> Vehicle:
    vehicle = with_entries(builtin_vehicle("twin-boom"), {("controls", "elevator", "lag"): 0.0})
    return with_few_free(vehicle.reduced("longitudinal"), FREE)


@cache
def flights() -> dict[str, Flight]:
    flown = maneuver(5.0, ("elevator", "doublet", 0.5, 0.5, 0.05), altitude=200.0)
    return {name: simulate_flight(known(), flown, seed=i, name=name) for i, name in enumerate("ab")}


def changed(names: str, channel: str, change: Callable[[np.ndarray], np.ndarray]) -> dict[str, Flight]:
    out = dict(flights())
    for name in names:
        column = change(out[name].column(channel).copy())
        data = out[name].data.assign({channel: ("time", column, out[name].data[channel].attrs)})
        out[name] = replace(out[name], data=data)
    return out


def noisy(y: np.ndarray) -> np.ndarray:
    return y + 0.02 * np.random.default_rng(1).standard_normal(len(y))


def spiked(y: np.ndarray) -> np.ndarray:
    random = np.random.default_rng(2)
    y[random.choice(len(y), len(y) // 12, replace=False)] += 0.1 * random.choice([-1.0, 1.0], len(y) // 12)
    return y


def faulty() -> dict[str, Flight]:
    flight = flights()["a"]
    one = Fault("stuck", "q", 0.0, 1.0, 2.0, notice("samples-not-measured", variables=("q",)))
    return {**flights(), "a": replace(flight, faults=(one,))}


def drifting(y: np.ndarray) -> np.ndarray:
    return y + 0.003 * lfilter([1.0], [1.0, -0.95], np.random.default_rng(4).standard_normal(len(y)))


CALLED_FOR: dict[str, Callable[[], dict[str, Flight]]] = {
    "faults": faulty,
    "stuck-channels": lambda: changed("ab", "theta", lambda y: np.full_like(y, 0.05)),
    "noise-shape": lambda: changed("ab", "q", spiked),
    "maneuver-noise": lambda: changed("b", "q", noisy),
    "noise-color": lambda: changed("ab", "theta", drifting),
}


def decided(strategy: Strategy, given: dict[str, Flight], vehicle: Vehicle | None = None) -> Fitted:
    return fit(strategy, vehicle or known(), given, WINDOWS, options=Options(seed=1, budget=4000.0))


def states(done: Fitted) -> dict[str, str]:
    return {one.name: one.state for one in done.decisions}


@pytest.fixture(scope="module")
def clean() -> Fitted:
    return decided(Strategy.default(), flights())


def test_clean_data_of_a_complete_vehicle_call_for_no_decision(clean: Fitted) -> None:
    assert {name for name, state in states(clean).items() if state == "applied"} <= {"recorded-motion"}
    assert states(clean)["extensions"] == "off"
    assert [one.name for one in clean.decisions] == [one.name for one in DECISIONS]


@pytest.mark.parametrize("name", CALLED_FOR)
def test_a_decision_applies_where_the_data_call_for_it_and_its_switch_turns_it_off(name: str) -> None:
    given, textbook = CALLED_FOR[name](), Strategy.textbook()
    with_it, without = (decided(strategy, given) for strategy in (textbook.only(name), textbook))
    (record,) = (one for one in with_it.decisions if one.state == "applied")
    assert record.name == name
    assert record.found
    assert record.done
    assert set(states(without).values()) == {"off"}
    assert with_it.estimate.estimates != without.estimate.estimates
    # what an estimator decides is a field of its estimate, not read back from notices, and saved with it
    found, own, buffer = with_it.estimate, [record] if name != "faults" else [], io.BytesIO()
    assert [*found.prepared.decisions, *found.decisions] == own
    np.savez(buffer, **found.state())
    again = restore("output-error", dict(np.load(io.BytesIO(buffer.getvalue()))), "here").decisions
    assert [(d.name, d.found, d.done) for d in again] == [(d.name, d.found, d.done) for d in own]


def test_textbook_is_output_error_to_the_last_bit(clean: Fitted) -> None:
    given = changed("a", "q", spiked) | {"b": changed("b", "q", noisy)["b"]}
    options = Options(seed=1, budget=4000.0)
    done = fit(Strategy.textbook(), known(), given, WINDOWS, options=options)
    alone = output_error(known(), given, WINDOWS, replace(options, method="output-error", treatment=PLAIN))
    assert (done.options.method, done.estimate.estimates) == ("output-error", alone.estimates)
    assert done.estimate.cost == alone.cost
    assert np.array_equal(done.estimate.z, alone.z)


def test_assumptions_free_the_lag_that_a_file_leaves_out() -> None:
    incomplete = with_few_free(builtin_vehicle("twin-boom").reduced("longitudinal"), FREE)
    only = Strategy.textbook().only("assumptions")
    assumed = decided(only, flights(), incomplete)
    lags = {name for name in assumed.estimate.estimates if name.endswith(".lag")}
    assert (states(assumed)["assumptions"] == "applied") == bool(lags)
    assert states(decided(only, flights()))["assumptions"] == "not needed"


def test_treatment_is_decided_by_the_strategy_alone() -> None:
    with pytest.raises(IdentificationError, match="switch decisions off with strategy="):
        fit(Strategy.default(), known(), flights(), WINDOWS, options=Options(treatment=PLAIN))
    with pytest.raises(TypeError, match="no keyword 'treatment'"):
        stoop.fit(known(), [*flights().values()], ["a@0:5"], treatment=PLAIN)


def switched(words: str) -> Strategy:
    parser = argparse.ArgumentParser()
    add_options(parser, verbs()["identify"].options)
    given = ["a.ulg", "--vehicle", "twin-boom", "--maneuver", "0:5", "-o", "out", *words.split()]
    return strategy_of(parser.parse_args(given))


def test_what_is_no_strategy_or_method_is_one_line_with_the_fix() -> None:
    default: Any = Strategy.default()
    of_class: Any = Strategy
    for call, given, advice in (
        *((one, "noise-shap", "noise-shap': not known; .*noise-shape") for one in (default.without, default.only)),
        (default.including, "noise-shap", "noise-shap': not known; .*noise-shape"),
        (of_class.without, "faults", r"write Strategy\.default\(\)\.without\('faults'\)"),
        (of_class.including, "bounds", r"write Strategy\.default\(\)\.including\('bounds'\)"),
        (of_class, ["faults"], r"write Strategy\.only\('faults'\)"), (default.without, 5, "decision '5': not known"),
        (of_class.named, None, r"strategy None: give 'default', 'textbook' or"), (of_class.named, "textbok", "textbok.*textbook"),
        (find, "equation-eror", "did you mean equation-error"), (find, ["output-error"], "method .*: not known"),
        (switched, "--textbook --without bounds", "--textbook and --without: give one"),
        (switched, "--only bounds --without gusts", "--only and --without: give one"),
        (switched, "--extend --without extensions", "--without extensions contradict"),
        (switched, "--without-component noise", "component 'noise': cannot be left out"),
        (switched, "--without-component gusts", "component 'gusts': cannot be left out"),
    ):  # fmt: skip
        with pytest.raises(IdentificationError, match=advice) as error:
            call(given)
        assert "\n" not in str(error.value), advice


def test_names_and_switches_choose_decisions() -> None:
    default, textbook = Strategy.default(), Strategy.textbook()
    assert (Strategy.named("textbook"), Strategy.named("default")) == (textbook, default)
    assert (Strategy.named(textbook), default.without("bounds").including("bounds")) == (textbook, default)
    assert Strategy.only("faults").names == default.only("faults").names == {"faults"}
    assert "extensions" not in default.names
    for words, names in (
        ("", default.names), ("--textbook", frozenset()), ("--textbook --extend", {"extensions"}),
        ("--without bounds --without gusts", default.names - {"bounds", "gusts"}),
        ("--only faults --only bounds", {"faults", "bounds"}),
    ):  # fmt: skip
        assert switched(words).names == names, words


def test_components_of_the_covariance_are_left_out_beside_any_decisions() -> None:
    default, chosen = (
        Strategy.default(),
        switched("--without-component model --without bounds --without-component held"),
    )
    assert (chosen.left_out, chosen.names) == ({"model", "held"}, default.names - {"bounds"})
    assert chosen == default.without_component("model", "held").without("bounds")
    assert default.without("bounds").left_out == frozenset()
    assert repr(default.without_component("model")) == "<Strategy: default, without component model>"
