"""Windows amid gusts: each kind of input is found, gusts are none, and made-up figures turn every verdict round."""

from __future__ import annotations

from typing import Any

import pytest

from stoop.errors import FlightError
from stoop.flight import from_columns
from stoop.input_design.windows import find_windows
from stoop.vehicle.checks import is_body
from stoop_studies.findings import Setting
from stoop_studies.verify.closed_loop import quadrotor_scene
from stoop_studies.verify.study import run_key
from stoop_studies.verify.windows import CASES, EXPERIMENT, held, propose

SETTING = Setting(runs=2)


@pytest.mark.parametrize("case", [c for c in CASES if c.endswith("moderate") and "gusts" not in c])
def test_inputs_are_found(case: str) -> None:
    flown = CASES[case](7)
    assert len(flown.spans) == 3
    found = find_windows({flown.flight.name: flown.flight})
    assert all(held(found, span) for span in flown.spans)
    assert all(any(w.start < b and a < w.stop for a, b in flown.spans) for w in found.windows)


@pytest.mark.parametrize("case", [c for c in CASES if "gusts" in c])
def test_gusts_are_no_maneuver(case: str) -> None:
    flown = CASES[case](7)
    with pytest.raises(FlightError, match="no maneuver here"):
        find_windows({flown.flight.name: flown.flight}, flown.start)


@pytest.mark.parametrize(
    "kind", ["multisine-moderate", "sweep-light", "gusts-light", "gusts-moderate", "gusts-severe"]
)
def test_a_log_that_is_all_maneuver(kind: str) -> None:
    """Nothing usual is to compare with: what feedback leaves of the command decides."""
    flight = CASES[f"aircraft-{kind}"](3).flight
    inside = (flight.time >= 10.0) & (flight.time < 18.0)
    cut = from_columns("cut", flight.time[inside], {n: flight.column(n)[inside] for n in flight.names})
    if "gusts" in kind:
        with pytest.raises(FlightError, match="no maneuver here"):
            find_windows({"cut": cut})
    else:
        assert any(w.use == "fit" for w in find_windows({"cut": cut}).windows)


def test_errors_are_as_foretold_from_a_wrong_start() -> None:
    (found,) = propose({"case": "aircraft-steps-moderate", "seed": 1}, [None])
    assert found["found"] == found["maneuvers"] == 3
    assert len(found["ratios"]) > 20
    assert max(found["ratios"]) < 1.5
    assert min(found["ratios"]) > 1.0 / 1.5


def test_windows_of_rotors_without_an_input_claim_no_maneuver() -> None:
    """Thrust and drag show in them, and the start is one that a user can load."""
    (found,) = propose({"case": "quadrotor-steps-light", "seed": 0}, [None])
    assert found["false"] == 0
    assert found["windows"] == found["maneuvers"] + found["beside"]
    for seed in range(20):
        assert is_body(quadrotor_scene(0.0, seed).start)


def verdicts(**changes: Any) -> set[str]:
    flown = {
        "maneuvers": 3, "found": 3, "windows": 3, "beside": 0, "false": 0, "bare_windows": 3, "bare_false": 0,
        "ratios": [0.9, 1.1], "inside": 19, "estimates": 20,
    }  # fmt: skip
    gusts = {key: [] if key == "ratios" else 0 for key in flown}
    results = {
        run_key(case, seed): gusts if "gusts" in case else flown | changes
        for seed in SETTING.seeds
        for case in CASES
    }
    return {c.verdict for c in EXPERIMENT.findings(SETTING, results).claims}


def test_verdicts() -> None:
    assert verdicts() == {"holds"}
    for changes in ({"found": 2}, {"false": 1}, {"ratios": [1.6, 1.7]}, {"ratios": [0.5]}):
        assert "does not hold" in verdicts(**changes)
