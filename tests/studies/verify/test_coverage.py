from typing import Any

import numpy as np
import pytest

from stoop.parallel.plan import to_text
from stoop_studies.verify import scenes
from stoop_studies.verify.coverage import CASES, cover
from stoop_studies.verify.scenes import AR_COEFFICIENT, OUTLIERS, SPIKES


def test_noise_is_what_it_is_called() -> None:
    for make, correlation in ((scenes.white, 0.0), (scenes.autoregressive, AR_COEFFICIENT)):
        v = make(np.random.default_rng(1), 200_000, 2)
        assert v.std(axis=0) == pytest.approx(1.0, abs=0.03)
        assert np.mean(v[1:] * v[:-1], axis=0) == pytest.approx(correlation, abs=0.02)
        assert abs(np.mean(v[:, 0] * v[:, 1])) < 0.03
    first = np.array([scenes.autoregressive(np.random.default_rng(s), 2, 50) for s in range(200)])
    assert first.std() == pytest.approx(1.0, abs=0.02), "stationary from the first sample on"


def test_scenes_differ_by_seed_and_in_their_noise_alone() -> None:
    scene, again, other = scenes.in_white_noise(3), scenes.in_white_noise(3), scenes.in_white_noise(4)
    assert list(scene.flights) == list(scenes.STEPS)
    assert scene.truth == scenes.coefficients(scenes.aircraft())
    assert len(scene.truth) == 32
    assert min(map(abs, scene.truth.values())) > 0.0
    q, same, new = (s.flights["pitch"].data["q"].to_numpy() for s in (scene, again, other))
    assert (q == same).all()
    assert (q != new).any()
    remembered = scenes.in_autoregressive_noise(3).flights["pitch"].data["q"].to_numpy()
    assert np.diff(remembered).std() < 0.7 * np.diff(q).std()


def test_outliers_are_added_to_the_same_noise() -> None:
    """So that the scatter of estimates compares with that in white noise, seed by seed."""
    clean = scenes.white(np.random.default_rng(3), 50_000, 2)
    for noise, share, square in (
        (scenes.with_outliers, OUTLIERS[0], OUTLIERS[1] ** 2),
        (scenes.with_spikes, SPIKES[0], SPIKES[1] ** 2 + 1.0),
    ):
        found = noise(np.random.default_rng(3), 50_000, 2)
        changed = found != clean
        assert changed.mean() == pytest.approx(share, rel=0.1)
        assert np.mean(found[changed] ** 2) == pytest.approx(square, rel=0.1)
    heavy = scenes.student(np.random.default_rng(3), 50_000, 2)
    assert np.array_equal(np.sign(heavy), np.sign(clean))
    assert np.median(np.abs(heavy)) == pytest.approx(0.765, rel=0.02)  # of three degrees of freedom


def check_flight(case: str) -> dict[str, Any]:
    (found,) = cover({"case": case, "seed": 7}, [None])
    z = np.array(found["errors"]) / np.array(found["sigma"])
    assert len(z) == (35 if case == "dryden" else 32)  # the intensities of the gusts too
    assert found["status"] == "converged"
    assert np.abs(z).max() < 4.5
    assert np.mean(z**2) < 3.0  # errors of one flight go together
    return found


def test_the_same_arguments_give_the_same_bytes() -> None:
    assert to_text(check_flight("outliers"), "") == to_text(check_flight("outliers"), "")


@pytest.mark.parametrize("case", CASES)
def test_one_flight_of_each_case(case: str) -> None:
    check_flight(case)
