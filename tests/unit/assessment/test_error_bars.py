"""Error bars: the same bits whatever the threads; what a bound holds makes others lean."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.assessment.error_bars import error_bars
from stoop.flight import Flight
from stoop.vehicle import Vehicle
from stoop.workflow import identify


def test_same_bits_whatever_the_threads(
    wrong: Vehicle, flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    from threadpoolctl import threadpool_limits

    def run(threads: int) -> str:
        monkeypatch.setenv("STOOP_THREADS", str(threads))
        with threadpool_limits(limits=threads, user_api="blas"):
            result = identify(wrong, flight, ["0:20"]).result
        return repr([(p.estimate, p.std_error) for p in result.parameters.values()])

    assert run(1) == run(2)


def test_a_parameter_at_its_bound_makes_others_lean(wrong: Vehicle, flight: Flight) -> None:
    """CL0 held far from the truth: CLalpha takes its place, with an error bar that is only conditional."""
    boxed = wrong.with_numbers({"CL0": {"value": 0.3, "bounds": (0.2, 0.35)}})
    job = identify(boxed, flight, ["0:20"])
    bars = error_bars(job.estimate)
    assert bars.at_bound[[p.name for p in job.estimate.problem.layout.parameters].index("CL0")]
    assert "CLalpha" in bars.conditional
    assert job.result.parameters["CL0"].at_bound
    assert np.isnan(job.result.parameters["CL0"].std_error)
    assert any("CLalpha" in w and "Known only if CL0" in w for w in job.result.warnings)
