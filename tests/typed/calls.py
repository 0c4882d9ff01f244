"""Calls of a user, for mypy: right ones have types, and each wrong one is an error, or its comment is (warn_unused_ignores)."""

from typing import assert_type

import stoop
from stoop.flight import Flight
from stoop.simulation import LinearModel
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.validation import Validated
from stoop_analysis.workflow.propagation import Propagated
from stoop_tune.tuning import JudgedGains


def right(model: stoop.FittedModel, flight: stoop.Flight) -> None:
    """Fit, and use the model."""
    assert_type(stoop.load_flight("log.ulg"), Flight)
    assert_type(stoop.fit("v.toml", flight, ["1:2"], validate="3:4"), FittedModel)
    assert_type(model.validate(flight, "5:6"), Validated)
    assert_type(model.linearize(airspeed=20.0), LinearModel)
    assert_type(model.propagate(draws=100), Propagated)
    assert_type(model.tune("log.ulg", airspeed=(10.0, 12.0)), JudgedGains)
    assert_type(stoop.tune(model, "log.ulg"), JudgedGains)
    assert_type(model.parameters["Clp"].std_error, float)


def wrong(model: stoop.FittedModel, flight: stoop.Flight) -> None:
    """Make mistakes that an editor shows."""
    print(stoop.fitt)  # type: ignore[attr-defined]
    stoop.fit(flight=flight)  # type: ignore[call-arg]
    model.tune()  # type: ignore[call-arg]
    model.propagate(draws="many")  # type: ignore[arg-type]
    model.linearise()  # type: ignore[attr-defined]
    model.save(1.0)  # type: ignore[arg-type]
