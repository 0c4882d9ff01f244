"""A search and its result: what is refused before it, what stands in the result, and files that can be read again."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.flown import with_few_free

import stoop
from stoop.base.notices import as_notice
from stoop.base.variables import WRAPPED
from stoop.errors import FlightError, StoopError
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.results.uncertainty import ParameterIdentifiability
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text
from stoop.workflow import FittedModel, fit
from stoop.workflow.curves import unwrapped
from stoop.workflow.identification import search
from stoop.workflow.outputs import with_values
from stoop.workflow.summary import advice_by_doubt, estimates_table, figures_table


def test_result_has_the_documented_keys_and_one_covariance(job: FittedModel) -> None:
    doc = json.loads(job.result.to_json())
    assert {"estimate", "std_error", "ci95_lower", "bound_upper", "unit"} <= {*doc["parameters"]["CLalpha"]}
    assert {"covariance", "noise_covariance", "initial_states", "biases", "cost", "seed", "inputs"} <= {*doc}
    assert [m["role"] for m in doc["maneuvers"]] == ["fit", "validation"]
    assert {"rmse", "theil", "r2", "baseline_theil"} <= doc["maneuvers"][1]["channels"]["q"].keys()
    sigma = np.sqrt(np.diag(job.result.covariance.matrix))
    assert sigma == pytest.approx([p.std_error for p in job.result.parameters.values()])


def test_tables_say_estimate_and_truth(job: FittedModel) -> None:
    assert re.search(r"^CLalpha .*4\.78", estimates_table(job.result.parameters, {"CLalpha": 4.78}), re.M)
    fitted, predicted = figures_table(job.result.maneuvers).split("20:28 (validation)")
    assert "0:20 (fit)" in fitted
    bands = [[one.split() for one in t.splitlines() if one.endswith("band %")] for t in (fitted, predicted)]
    assert bands[0] == []
    assert bands[1][0][0] == f"{100.0 * job.result.maneuvers[1].channels['V'].within:.0f}"


def test_identified_file_keeps_comments_and_adds_what_was_left_out() -> None:
    text = builtin_text("twin-boom").replace("Cmq = -47.6\n", "").replace("notes = [", "# mine\nnotes = [")
    text = text.replace("mass = 189.40", "center_of_gravity = [0.1, 0.0, 0.0]\nmass = 189.40 # weighed")
    values = {
        "CLalpha": 4.5, "Cmq": -9.0, "mass.mass": 198.25, "mass.center_of_gravity.x": 0.12, "mass.inertia.xx": 101.0,
    }  # fmt: skip
    before = parse_vehicle(text, "x.toml")
    again = parse_vehicle(new := with_values(before, values), "x.toml")
    assert ("# mine" in new, "# weighed" in new) == (True, True)
    assert {name: again.value(name) for name in values} == values
    assert again.value("reference.span") == before.value("reference.span")


def test_identified_file_keeps_priors_about_their_own_means(aircraft: Vehicle, flight: Flight) -> None:
    """A fit that begins from the identified file gives the same estimate: the prior is not about the estimate of before."""
    prior = 0.05
    few = with_few_free(aircraft, ("Cmalpha", "Cmq"))
    tight = few.with_numbers({"CLalpha": {"free": True, "value": 4.6, "prior": prior}})
    first = fit(tight, flight, ["0:10"])
    again = parse_vehicle(with_values(first.vehicle, first.estimate.estimates), "again.toml")
    p = again.parameters[again.rows["CLalpha"]]
    assert (p.prior, p.prior_mean) == (prior, 4.6)
    assert p.value == pytest.approx(first.estimate.estimates["CLalpha"], rel=1e-9)
    assert abs(p.value - 4.6) > prior, "the data move it"
    before, now = (one.parameters["CLalpha"] for one in (first, fit(again, flight, ["0:10"])))
    assert now.estimate == pytest.approx(before.estimate, abs=0.1 * before.std_error)
    assert now.prior_mean == 4.6


def test_windows_are_judged_first(wrong: Vehicle, flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError("the search began")

    monkeypatch.setattr("stoop.estimate.fit.fit", never)
    for fitted, predicted, line in (
        (["0:15", "10:20"], [], r"sim@10:20: overlaps the fitted sim@0:15; the same samples"),
        (["0:15", "0:15"], [], "overlaps"),
        (["0:15"], ["14:20"], "nothing may be fitted in a window that is predicted"),
        (["0:20"], ["500:510"], "outside the record"),
        (["0:20"], ["20:28#heavy"], "no loading is called 'heavy'"),
        ([], [], "no maneuver"),
    ):
        with pytest.raises(StoopError, match=line):
            fit(wrong, flight, fitted, predicted)
    with pytest.raises(FlightError, match="two flights"):
        fit(wrong, [flight, flight], ["0:20"])
    with pytest.raises(FlightError, match=r"^fit: no maneuver is given; name at least one window START:STOP"):
        stoop.fit(wrong, flight)


def test_windows_that_touch_or_are_of_two_flights_do_not_overlap(wrong: Vehicle, flight: Flight) -> None:
    flights = [replace(flight, name=name) for name in ("a", "b")]
    fitted, predicted = ["a@0:4", "a@4:8", "b@0:4"], ["a@8:10", "b@4:8"]
    done = search(with_few_free(wrong, ["Cmq"]), flights, fitted, predicted, Options(generations=1))
    windows = [str(w) for w in (*done.estimate.prepared.windows, *done.setup.held_back)]
    assert windows == [*fitted, *predicted]


def test_angles_on_a_circle_are_shown_without_jumps() -> None:
    heading = 3.0 + 0.5 * np.arange(200) / 50.0
    wrapped = (heading + np.pi) % (2.0 * np.pi) - np.pi
    measured, simulated = unwrapped(wrapped, wrapped - 0.01, "psi" in WRAPPED)
    assert measured == pytest.approx(heading)
    assert simulated == pytest.approx(heading - 0.01)


def test_doubts_stand_under_one_phrase_and_those_of_one_advice_in_one_line() -> None:
    def sight(doubt: str, advice: str) -> ParameterIdentifiability:
        why, what = (as_notice(text, "info") if text else None for text in (doubt, advice))
        return ParameterIdentifiability(1.0, 1.0, 0.5, (), why, () if what is None else (what,))

    doubts = {
        "Cl0": ("combined", "bank more"), "CL0": ("at its bound", "pull up"), "Cn0": ("combined", "bank more"),
        "CD0": ("combined", "fly faster"), "CLq": ("", ""), "Cmq": ("no advice", ""),
    }  # fmt: skip
    found = advice_by_doubt({name: sight(*doubt) for name, doubt in doubts.items()})
    assert found == {"combined": ["Cl0, Cn0: bank more", "CD0: fly faster"], "at its bound": ["CL0: pull up"]}
    assert advice_by_doubt({"CLq": sight("", "")}) == {}
