"""Responses of a linear model: SciPy's, delays as phase, and the band of a parameter's standard error."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from stoop.assessment.frequency import ModelResponse, transfer, uncertain_model
from stoop.results.result import Covariance, NoiseCovariance, ParameterEstimate, Result
from stoop.simulation import linearize, trim
from stoop.vehicle.builtin import resolve_vehicle

FREQUENCY = np.geomspace(0.5, 30.0, 40)


def test_the_response_is_scipys_and_delays_turn_its_phase() -> None:
    vehicle = resolve_vehicle("twin-boom").reduced("longitudinal")
    model = linearize(vehicle, trim(vehicle, 35.0))
    found = transfer(model, FREQUENCY)
    j, k = model.outputs.index("q"), model.inputs.index("elevator")
    with warnings.catch_warnings():  # its numerator begins with rounding errors
        warnings.simplefilter("ignore", signal.BadCoefficients)
        exact = signal.freqresp((model.A, model.B[:, [k]], model.C[[j]], model.D[[j]][:, [k]]), FREQUENCY)[1]
    assert_allclose(found[:, j, k], exact, rtol=1e-6)
    late = replace(model, input_delays=model.input_delays + 0.05)
    assert_allclose(transfer(late, FREQUENCY)[:, j, k], exact * np.exp(-0.05j * FREQUENCY), rtol=1e-6)


def test_a_vehicle_file_has_no_band() -> None:
    vehicle = resolve_vehicle("twin-boom")
    found = uncertain_model(vehicle, trim(vehicle, 35.0)).responses(["elevator"], ["q"], FREQUENCY)
    assert np.isnan(found["elevator", "q"].magnitude_half_width).all()


@pytest.mark.parametrize("variance", [1e-4, np.inf])
def test_the_band_follows_the_covariance_or_the_prior(variance: float) -> None:
    """A standard error of 1 % of Cmelevator moves q above the short period by 1 %."""
    vehicle = resolve_vehicle("twin-boom").reduced("longitudinal")
    gain = vehicle.value("Cmelevator")
    parameters = {
        "Cmelevator": ParameterEstimate(gain, prior_mean=gain, prior_std=0.01 * abs(gain)),
        "Cm0": ParameterEstimate(vehicle.value("Cm0"), identifiable=False),
        "Cmq": ParameterEstimate(vehicle.value("Cmq")),
    }
    matrix = np.diag([variance * gain**2, np.inf, 1e-8])
    other = NoiseCovariance((), np.empty((0, 0))), (), (), (), (), 0.0, 0.0, 0.0, 0, "lm", "converged"
    found = uncertain_model(
        vehicle, trim(vehicle, 35.0), Result(parameters, Covariance(tuple(parameters), matrix), *other)
    )
    one = found.responses(["elevator"], ["q"], np.array([30.0]))["elevator", "q"]
    assert one.magnitude_half_width == pytest.approx(1.96 * 20.0 * np.log10(1.01), rel=0.25)
    assert [(n.code, n.values["parameters"]) for n in found.notices] == [("parameters-held", ("Cm0",))]


def test_the_band_of_a_gain() -> None:
    """A gain of relative standard error 0.05 has a band of 1.96 x 0.05 of its magnitude, and none of its phase."""
    draws = np.exp(0.05 * np.random.default_rng(0).standard_normal((20000, 1))) * np.ones((1, 40))
    one = ModelResponse("u", "y", FREQUENCY, np.ones(40, dtype=complex), draws.astype(complex))
    assert one.magnitude_half_width == pytest.approx(1.96 * 0.05 * 20.0 / np.log(10.0), rel=0.02)
    assert_allclose(one.phase_half_width, 0.0, atol=1e-12)
