"""Coverage: made-up estimates turn every verdict round; noise is what its name says; one flight end to end."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from stoop.parallel.plan import to_text
from stoop_studies.findings import Setting
from stoop_studies.verify.coverage import CASES, EXPERIMENT, cover
from stoop_studies.verify.scenes import (
    AR_COEFFICIENT,
    BIASES,
    NOISY,
    OUTLIERS,
    SPIKES,
    STEPS,
    aircraft,
    autoregressive,
    coefficients,
    in_autoregressive_noise,
    in_unequal_noise,
    in_white_noise,
    student,
    white,
    with_outliers,
    with_spikes,
    wrong_start,
)
from stoop_studies.verify.study import run_key

SETTING = Setting(runs=400)


def made_up(scale: dict[str, float], seed: int = 0) -> dict[str, Any]:
    """Return results whose standard errors are too large by a factor for each case; plain ones are right.

    Errors are the same in all cases.
    """
    rng, names = np.random.default_rng(seed), list("abcdefghijkl")
    errors = {s: rng.standard_normal(12).tolist() for s in SETTING.seeds}
    return {
        run_key(case, s): {
            "names": names, "errors": errors[s], "sigma": [scale.get(case, 1.0)] * 12,
            "cramer_rao": [1.0] * 12, "status": "converged",
        }
        for s in SETTING.seeds
        for case in CASES
    }  # fmt: skip


def verdicts(results: dict[str, Any]) -> dict[str, list[str]]:
    found = EXPERIMENT.findings(SETTING, results)
    return {
        name: [c.verdict for c in found.claims if c.statement.startswith(f"With {case.words} the")]
        for name, case in CASES.items()
    }


def test_right_standard_errors_hold() -> None:
    found = EXPERIMENT.findings(SETTING, made_up({}))
    assert {c.verdict for c in found.claims} == {"holds"}
    pooled = {row[0]: row for row in found.rows if row[1] == "pooled"}
    assert set(pooled) == set(CASES)
    assert pooled["white"][3] == pytest.approx(0.95, abs=0.02)
    assert pooled["white"][4] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("factor", [0.7, 1.5])
def test_wrong_ones_do_not_in_either_direction(factor: float) -> None:
    said = verdicts(made_up({"white": factor}))
    assert said["white"] == ["does not hold", "does not hold"]
    assert set(said["ar1"]) == {"holds"}


def test_one_wrong_parameter_is_seen_though_the_pool_is_right() -> None:
    results = made_up({})
    for s in SETTING.seeds:
        results[run_key("white", s)]["sigma"] = [0.7] + [1.0] * 11
    assert verdicts(results)["white"] == ["holds", "does not hold"]


def test_an_interval_that_is_not_given_holds_nothing() -> None:
    results = made_up({})
    for s in SETTING.seeds:
        results[run_key("ar1", s)]["sigma"] = [None] + [1.0] * 11
    found = EXPERIMENT.findings(SETTING, results)
    row = next(r for r in found.rows if r[:2] == ("ar1", "a"))
    assert row[3:5] == (0.0, None)
    for s in SETTING.seeds:
        results[run_key("ar1", s)]["sigma"] = [None] * 3 + [1.0] * 9
    assert verdicts(results)["ar1"] == ["does not hold"]


def test_noise_is_what_it_is_called() -> None:
    for make, correlation in ((white, 0.0), (autoregressive, AR_COEFFICIENT)):
        v = make(np.random.default_rng(1), 200_000, 2)
        assert v.std(axis=0) == pytest.approx(1.0, abs=0.03)
        assert np.mean(v[1:] * v[:-1], axis=0) == pytest.approx(correlation, abs=0.02)
        assert abs(np.mean(v[:, 0] * v[:, 1])) < 0.03
    first = np.array([autoregressive(np.random.default_rng(s), 2, 50) for s in range(200)])
    assert first.std() == pytest.approx(1.0, abs=0.02), "stationary from the first sample on"


def test_scenes_differ_by_seed_and_in_their_noise_alone() -> None:
    scene, again, other = in_white_noise(3), in_white_noise(3), in_white_noise(4)
    assert list(scene.flights) == list(STEPS)
    assert scene.truth == coefficients(aircraft())
    assert len(scene.truth) == 32
    assert min(map(abs, scene.truth.values())) > 0.0
    q, same, new = (s.flights["pitch"].data["q"].to_numpy() for s in (scene, again, other))
    assert (q == same).all()
    assert (q != new).any()
    remembered = in_autoregressive_noise(3).flights["pitch"].data["q"].to_numpy()
    assert np.diff(remembered).std() < 0.7 * np.diff(q).std()


def test_the_start_is_wrong_and_knows_no_bias() -> None:
    vehicle = wrong_start(aircraft(), np.random.default_rng(0))
    wrong = [abs(vehicle.value(n) / v - 1.0) for n, v in coefficients(aircraft()).items()]
    assert 0.05 < np.mean(wrong) < 0.3
    assert max(wrong) < 0.3
    for channel, prior in BIASES.items():
        p = vehicle.parameters[vehicle.rows[f"sensors.{channel}.bias"]]
        assert (p.value, p.free, p.prior) == (0.0, True, prior)


def test_outliers_are_added_to_the_same_noise() -> None:
    """So that the scatter of estimates compares with that in white noise, seed by seed."""
    clean = white(np.random.default_rng(3), 50_000, 2)
    for noise, share, square in (
        (with_outliers, OUTLIERS[0], OUTLIERS[1] ** 2),
        (with_spikes, SPIKES[0], SPIKES[1] ** 2 + 1.0),
    ):
        found = noise(np.random.default_rng(3), 50_000, 2)
        changed = found != clean
        assert changed.mean() == pytest.approx(share, rel=0.1)
        assert np.mean(found[changed] ** 2) == pytest.approx(square, rel=0.1)
    heavy = student(np.random.default_rng(3), 50_000, 2)
    assert np.array_equal(np.sign(heavy), np.sign(clean))
    assert np.median(np.abs(heavy)) == pytest.approx(
        0.765, rel=0.02
    )  # of Student's t with three degrees of freedom


def test_the_noisy_maneuver_is_as_noisy_as_it_says() -> None:
    equal, unequal = in_white_noise(4), in_unequal_noise(4)
    for name in STEPS:
        same = equal.flights[name].data["q"].to_numpy() == unequal.flights[name].data["q"].to_numpy()
        assert same.all() == (name != NOISY[0])


def test_a_case_that_scatters_too_much_does_not_hold() -> None:
    results = made_up({})
    assert all(v == "holds" for own in verdicts(results).values() for v in own)
    for s in SETTING.seeds:
        one = results[run_key("spikes", s)]
        one["errors"] = [1.3 * e for e in one["errors"]]
        one["sigma"] = [1.3] * 12
    claims = {c.statement: c.verdict for c in EXPERIMENT.findings(SETTING, results).claims}
    (found,) = [
        v for text, v in claims.items() if text.startswith(f"With {CASES['spikes'].words} estimates scatter")
    ]
    assert found == "does not hold"


@cache
def flown(case: str) -> dict[str, Any]:
    """Return what comes of one flight."""
    return cover({"case": case, "seed": 7}, [None])[0]


@pytest.mark.parametrize("case", CASES)
def test_one_flight_of_each_case(case: str) -> None:
    """Estimates lie where their error bars say."""
    found = flown(case)
    z = np.array(found["errors"]) / np.array(found["sigma"])
    assert len(z) == (35 if case == "dryden" else 32)  # the intensities of the gusts too
    assert found["status"] == "converged"
    assert np.abs(z).max() < 4.5
    assert np.mean(z**2) < 3.0  # errors of one flight go together


def test_the_same_arguments_give_the_same_bytes() -> None:
    again = cover({"case": "outliers", "seed": 7}, [None])[0]
    assert to_text(again, "") == to_text(flown("outliers"), "")
