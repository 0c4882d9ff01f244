"""Which method to trust: white, colored, curved, bounded, open, not converged."""

from __future__ import annotations

from collections.abc import Mapping

from stoop.assessment.uncertainty import method_agreement
from stoop.results.result import ParameterEstimate
from stoop.results.uncertainty import Interval, MethodIntervals

ONE = {"a": ParameterEstimate(1.0, 0.1), "b": ParameterEstimate(2.0, 0.1)}


def method(
    std: float, lower: float = 1.96, upper: float = 1.96, figures: Mapping[str, float] | None = None
) -> MethodIntervals:
    return MethodIntervals(
        {n: Interval(std, p.estimate - lower * std, p.estimate + upper * std) for n, p in ONE.items()},
        figures or {},
    )


def said(**methods: MethodIntervals) -> str:
    return " ".join(method_agreement(ONE, {"corrected": method(0.1), "cramer_rao": method(0.1), **methods}))


def test_white_residuals() -> None:
    assert "either may be used" in said()


def test_colored_residuals() -> None:
    text = said(cramer_rao=method(0.025))
    assert "4.0 times too small" in text
    assert "trust the corrected" in text


def test_bootstrap_agrees_or_not() -> None:
    assert "both may be trusted" in said(bootstrap=method(0.11))
    assert "wider for a and b" in said(bootstrap=method(0.2))
    assert "narrower for a and b" in said(bootstrap=method(0.05))


def test_a_lopsided_or_unconverged_posterior() -> None:
    good = {"rhat": 1.001}
    assert "nearly normal" in said(posterior=method(0.1, figures=good))
    assert "not normal about the estimate" in said(posterior=method(0.1, 1.0, 3.0, good))
    assert "disagree for a and b" in said(posterior=method(0.3, figures=good))
    assert "has not converged" in said(posterior=method(0.1, figures={"rhat": 1.2}))


def test_a_profile_with_an_open_end() -> None:
    opened = MethodIntervals({"a": Interval(float("nan"), float("nan"), 1.4)})
    assert "profile of a is open" in said(profile=opened)


def test_what_cannot_be_told_is_trusted_by_nobody() -> None:
    parameters = ONE | {"c": ParameterEstimate(1.0, 5.0, identifiable=False)}
    assert "c: the data cannot tell" in " ".join(
        method_agreement(parameters, {"corrected": method(0.1), "cramer_rao": method(0.1)})
    )


def test_without_methods_nothing_is_said() -> None:
    assert method_agreement(ONE, {}) == ()
