"""Every decision applies where the data call for it, and only there; without any a fit is textbook output error."""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter
from unit.flown import maneuver, with_few_free

from stoop.base.notices import notice
from stoop.base.verbs import verbs
from stoop.cli.identify import strategy_of
from stoop.cli.options import add_options
from stoop.errors import IdentificationError
from stoop.estimate.estimate import Estimate
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
from stoop.workflow.identification import identify

WINDOWS = (Window("a", 0.0, 5.0), Window("b", 0.0, 5.0))
FREE = ("Cmalpha", "Cmq", "Cmelevator")
PLAIN = Treatment(
    **dict.fromkeys(
        ("recorded_motion", "held_numbers", "stuck_channels", "noise_shape", "maneuver_noise", "noise_color"),
        False,
    )
)


@cache
def known() -> Vehicle:
    """Return a longitudinal aircraft with three free numbers and a servo without lag."""
    vehicle = with_entries(builtin_vehicle("twin-boom"), {("controls", "elevator", "lag"): 0.0})
    return with_few_free(vehicle.reduced("longitudinal"), FREE)


@cache
def flights() -> dict[str, Flight]:
    flown = maneuver(5.0, ("elevator", "doublet", 0.5, 0.5, 0.05), altitude=200.0)
    return {name: simulate_flight(known(), flown, seed=i, name=name) for i, name in enumerate("ab")}


def changed(name: str, channel: str, change: Callable[[np.ndarray], np.ndarray]) -> dict[str, Flight]:
    """Return the flights, one channel of one of them changed."""
    flight = flights()[name]
    column = change(flight.column(channel).copy())
    data = flight.data.assign({channel: ("time", column, flight.data[channel].attrs)})
    return {**flights(), name: replace(flight, data=data)}


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


def spiked_everywhere() -> dict[str, Flight]:
    return {name: changed(name, "q", spiked)[name] for name in flights()}


def drifting(y: np.ndarray) -> np.ndarray:
    steps = np.random.default_rng(4).standard_normal(len(y))
    return y + 0.003 * lfilter([1.0], [1.0, -0.95], steps)


def drifting_everywhere() -> dict[str, Flight]:
    return {name: changed(name, "theta", drifting)[name] for name in flights()}


def stuck() -> dict[str, Flight]:
    return {name: changed(name, "theta", lambda y: np.full_like(y, 0.05))[name] for name in flights()}


CALLED_FOR: dict[str, Callable[[], dict[str, Flight]]] = {
    "faults": faulty,
    "stuck-channels": stuck,
    "noise-shape": spiked_everywhere,
    "maneuver-noise": lambda: changed("b", "q", noisy),
    "noise-color": drifting_everywhere,
}


def decided(strategy: Strategy, given: dict[str, Flight], vehicle: Vehicle | None = None) -> Fitted:
    return fit(strategy, vehicle or known(), given, WINDOWS, options=Options(seed=1, budget=4000.0))


def restored(found: Estimate) -> Estimate:
    buffer = io.BytesIO()
    np.savez(buffer, **found.state())
    return restore("output-error", dict(np.load(io.BytesIO(buffer.getvalue()))), "here")


def states(done: Fitted) -> dict[str, str]:
    return {one.name: one.state for one in done.decisions}


@pytest.fixture(scope="module")
def clean() -> Fitted:
    return decided(Strategy.default(), flights())


def test_clean_data_of_a_complete_vehicle_call_for_no_decision(clean: Fitted) -> None:
    applied = {name for name, state in states(clean).items() if state == "applied"}
    assert applied <= {"recorded-motion"}
    assert states(clean)["extensions"] == "off"
    assert [one.name for one in clean.decisions] == [one.name for one in DECISIONS]


@pytest.mark.parametrize("name", CALLED_FOR)
def test_a_decision_applies_where_the_data_call_for_it_and_its_switch_turns_it_off(name: str) -> None:
    given = CALLED_FOR[name]()
    with_it, without = (
        decided(strategy, given) for strategy in (Strategy.textbook().only(name), Strategy.textbook())
    )
    assert states(with_it)[name] == "applied"
    (record,) = (one for one in with_it.decisions if one.state == "applied")
    assert record.found
    assert record.done
    assert set(states(without).values()) == {"off"}
    assert with_it.estimate.estimates != without.estimate.estimates
    # what an estimator decides is a field of its estimate, not read back from notices, and saved with it
    found = with_it.estimate
    own = [record] if name != "faults" else []
    assert [*found.prepared.decisions, *found.decisions] == own
    assert [(d.name, d.found, d.done) for d in restored(found).decisions] == [
        (d.name, d.found, d.done) for d in own
    ]


def test_textbook_is_output_error_to_the_last_bit(clean: Fitted) -> None:
    """Of data that call for four decisions, beside the estimator itself; by default the estimates differ."""
    given = {name: {**spiked_everywhere(), "b": changed("b", "q", noisy)["b"]}[name] for name in "ab"}
    options = Options(seed=1, budget=4000.0)
    done = fit(Strategy.textbook(), known(), given, WINDOWS, options=options)
    alone = output_error(known(), given, WINDOWS, replace(options, method="output-error", treatment=PLAIN))
    assert done.options.method == "output-error"
    assert done.estimate.estimates == alone.estimates
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
        identify(known(), [*flights().values()], ["a@0:5"], treatment=PLAIN)


def parsed(words: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_options(parser, verbs()["identify"].options)
    return parser.parse_args(["a.ulg", "--vehicle", "twin-boom", "--maneuver", "0:5", "-o", "out", *words])


def test_what_is_no_strategy_or_method_is_one_line_with_the_fix() -> None:
    """Types are disregarded on purpose."""
    default: Any = Strategy.default()
    of_class: Any = Strategy
    for call, advice in (
        (lambda: default.without("noise-shap"), r"decision 'noise-shap': not known; .*noise-shape"),
        (lambda: default.only("noise-shap"), r"decision 'noise-shap': not known; .*noise-shape"),
        (lambda: default.including("noise-shap"), r"decision 'noise-shap': not known; .*noise-shape"),
        (lambda: of_class.without("faults"), r"write Strategy\.default\(\)\.without\('faults'\)"),
        (lambda: of_class.including("bounds"), r"write Strategy\.default\(\)\.including\('bounds'\)"),
        (lambda: of_class(["faults"]), r"write Strategy\.only\('faults'\)"),
        (lambda: of_class.named(None), r"strategy None: give 'default', 'textbook' or"),
        (lambda: of_class.named("textbok"), "textbok.*textbook"),
        (lambda: default.without(5), "decision '5': not known"),
        (lambda: find("equation-eror"), "did you mean equation-error"),
        (lambda: find(["output-error"]), "method .*: not known"),  # type: ignore[arg-type]
        (
            lambda: strategy_of(parsed(["--textbook", "--without", "bounds"])),
            "--textbook and --without: give one",
        ),
        (
            lambda: strategy_of(parsed(["--only", "bounds", "--without", "gusts"])),
            "--only and --without: give one",
        ),
        (
            lambda: strategy_of(parsed(["--extend", "--without", "extensions"])),
            "--without extensions contradict",
        ),
    ):
        with pytest.raises(IdentificationError, match=advice) as error:
            call()
        assert "\n" not in str(error.value), advice


def test_names_and_switches_choose_decisions() -> None:
    default, textbook = Strategy.default(), Strategy.textbook()
    assert (Strategy.named("textbook"), Strategy.named("default")) == (textbook, default)
    assert Strategy.named(textbook) == textbook
    assert default.without("bounds").including("bounds") == default
    assert Strategy.only("faults").names == default.only("faults").names == {"faults"}
    assert "extensions" not in default.names
    for words, names in (
        ([], default.names),
        (["--textbook"], frozenset()),
        (["--textbook", "--extend"], {"extensions"}),
        (["--without", "bounds", "--without", "gusts"], default.names - {"bounds", "gusts"}),
        (["--only", "faults", "--only", "bounds"], {"faults", "bounds"}),
    ):
        assert strategy_of(parsed(words)).names == names, words


def test_the_app_writes_the_switches_that_give_the_checked_decisions() -> None:
    from stoop.app.fit_view import switches

    default = Strategy.default()
    for chosen in (default, Strategy.textbook(), default.without("bounds").including("extensions")):
        words = switches({one.name: one.name in chosen.names for one in DECISIONS})
        assert strategy_of(parsed(words)).names == chosen.names, words
