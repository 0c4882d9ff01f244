"""Which method to trust: white, colored, curved, bounded, open, not converged."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan

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


def found(**methods: MethodIntervals | None) -> dict[str, Notice]:
    given = {"corrected": method(0.1), "conditional": method(0.1), "cramer_rao": method(0.1), **methods}
    return {n.code: n for n in method_agreement(ONE, {name: one for name, one in given.items() if one})}


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


def test_what_methods_say_decides_which_one_is_trusted() -> None:
    """Methods beside three that agree, the notice that follows, its subject and some of its values."""
    good, both = {"rhat": 1.001}, "a and b"
    for methods, code, subject, values in (
        ({}, "agreement-white", "", {}),
        ({"cramer_rao": method(0.025)}, "agreement-colored", "", {"ratio": pytest.approx(4.0)}),
        ({"corrected": method(0.2)}, "agreement-maneuvers", "", {"ratio": pytest.approx(2.0)}),
        ({"bootstrap": method(0.11)}, "bootstrap-agrees", "", {}),
        # conditional on the model, too
        ({"corrected": method(0.2), "bootstrap": method(0.1)}, "bootstrap-agrees", "", {}),
        ({"bootstrap": method(0.2)}, "bootstrap-wider", "", {"wider": both}),
        ({"bootstrap": method(0.05)}, "bootstrap-narrower", "", {"narrower": both}),
        ({"posterior": method(0.1, figures=good)}, "posterior-agrees", "", {}),
        ({"posterior": method(0.1, 1.0, 3.0, good)}, "posterior-skewed", "", {}),
        ({"posterior": method(0.3, figures=good)}, "posterior-disagrees", both, {}),
        ({"posterior": method(0.1, figures={"rhat": 1.2})}, "agreement-no-posterior", "", {}),
        ({"profile": MethodIntervals({"a": Interval(nan, nan, 1.4)})}, "profiles-open", "a", {}),
        ({"conditional": None}, "agreement-one-maneuver", "", {}),
    ):
        notices = found(**methods)
        assert code in notices, (methods, list(notices))
        assert subject in ("", notices[code].subject), code
        assert dict(notices[code].values) | values == notices[code].values, code
    parameters = ONE | {"c": ParameterEstimate(1.0, 5.0, identifiable=False)}
    *_, last = method_agreement(parameters, {"corrected": method(0.1), "cramer_rao": method(0.1)})
    assert (last.code, last.subject) == ("no-interval-trusted", "c")
    assert method_agreement(ONE, {}) == ()
