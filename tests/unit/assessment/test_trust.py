"""Which method to trust: white, colored, curved, bounded, open, not converged."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from stoop.assessment.uncertainty import method_agreement, scatter
from stoop.base.notices import Notice
from stoop.results.result import ParameterEstimate
from stoop.results.uncertainty import Interval, MethodIntervals, Repeatability, SingleEstimate

ONE = {"a": ParameterEstimate(1.0, 0.1), "b": ParameterEstimate(2.0, 0.1)}


def method(
    std: float, lower: float = 1.96, upper: float = 1.96, figures: Mapping[str, float] | None = None
) -> MethodIntervals:
    return MethodIntervals(
        {n: Interval(std, p.estimate - lower * std, p.estimate + upper * std) for n, p in ONE.items()},
        figures or {},
    )


def found(**methods: MethodIntervals) -> dict[str, Notice]:
    given = {"corrected": method(0.1), "conditional": method(0.1), "cramer_rao": method(0.1), **methods}
    return {n.code: n for n in method_agreement(ONE, given) if n.code != "agreement-maneuvers"}


def test_white_residuals() -> None:
    assert list(found()) == ["agreement-white"]


def test_one_maneuver_leaves_intervals_conditional_on_the_model() -> None:
    alone = method_agreement(ONE, {"corrected": method(0.1), "cramer_rao": method(0.1)})
    assert [n.code for n in alone] == ["agreement-one-maneuver", "agreement-white"]


def test_maneuvers_that_disagree() -> None:
    apart = method_agreement(ONE, {"corrected": method(0.2), "conditional": method(0.1)})
    assert apart[0].code == "agreement-maneuvers"
    assert apart[0].values["ratio"] == pytest.approx(2.0)


def test_the_bootstrap_is_conditional_on_the_model_too() -> None:
    assert "bootstrap-agrees" in found(corrected=method(0.2), bootstrap=method(0.1))


def test_colored_residuals() -> None:
    notices = found(cramer_rao=method(0.025))
    assert notices["agreement-colored"].values["ratio"] == pytest.approx(4.0)
    assert "4.0 times too small" in str(notices["agreement-colored"])


def test_bootstrap_agrees_or_not() -> None:
    assert "bootstrap-agrees" in found(bootstrap=method(0.11))
    assert found(bootstrap=method(0.2))["bootstrap-wider"].values["wider"] == "a and b"
    assert found(bootstrap=method(0.05))["bootstrap-narrower"].values["narrower"] == "a and b"


def test_a_lopsided_or_unconverged_posterior() -> None:
    good = {"rhat": 1.001}
    assert "posterior-agrees" in found(posterior=method(0.1, figures=good))
    assert "posterior-skewed" in found(posterior=method(0.1, 1.0, 3.0, good))
    assert found(posterior=method(0.3, figures=good))["posterior-disagrees"].subject == "a and b"
    assert "agreement-no-posterior" in found(posterior=method(0.1, figures={"rhat": 1.2}))


def test_a_profile_with_an_open_end() -> None:
    opened = MethodIntervals({"a": Interval(float("nan"), float("nan"), 1.4)})
    assert found(profile=opened)["profiles-open"].subject == "a"


def test_what_the_data_cannot_tell_is_not_trusted() -> None:
    parameters = ONE | {"c": ParameterEstimate(1.0, 5.0, identifiable=False)}
    *_, last = method_agreement(parameters, {"corrected": method(0.1), "cramer_rao": method(0.1)})
    assert (last.code, last.subject) == ("no-interval-trusted", "c")


def test_without_methods_nothing_is_found() -> None:
    assert method_agreement(ONE, {}) == ()


def repeated(scale: float, seed: int, count: int = 40) -> Repeatability:
    """Return parameters whose three maneuvers scatter by so many error bars."""
    rng = np.random.default_rng(seed)
    drawn = scale * 0.1 * rng.standard_normal((count, 3))
    return Repeatability(
        (0, 1, 2),
        {f"p{i}": scatter([SingleEstimate(1.0 + d, 0.1, True) for d in row]) for i, row in enumerate(drawn)},
    )


def test_no_error_bars_are_trusted_beside_maneuvers_that_scatter_beyond_them() -> None:
    methods = {"corrected": method(0.1), "cramer_rao": method(0.025)}
    codes = {n.code: n for n in method_agreement(ONE, methods, repeated(2.4, 1, 400))}
    assert "agreement-colored" not in codes
    told = codes["agreement-scatter-colored"]
    assert told.severity == "warning"
    assert told.values["ratio"] == pytest.approx(2.4, rel=0.15)
    assert told.values["plain"] == pytest.approx(4.0 * 2.4, rel=0.15)
    assert "corrected ones until the cause is found" in str(told)
    white = {"corrected": method(0.1), "cramer_rao": method(0.1)}
    assert "agreement-scatter" in {n.code for n in method_agreement(ONE, white, repeated(2.4, 1))}


def test_maneuvers_that_agree_change_nothing_but_for_one_in_twenty() -> None:
    methods = {"corrected": method(0.1), "cramer_rao": method(0.025)}
    codes = [[n.code for n in method_agreement(ONE, methods, repeated(1.0, seed))] for seed in range(100)]
    assert sum("agreement-scatter-colored" in one for one in codes) <= 12
    assert sum("agreement-colored" in one for one in codes) >= 88
