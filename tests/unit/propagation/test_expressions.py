"""Expressions: the delta method is exact for linear ones, names are checked, nothing is run."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.assessment.draws import Draws
from stoop.errors import StoopError
from stoop.propagation.expressions import parse_expressions
from stoop.propagation.propagation import propagate_draws
from stoop.propagation.quantities import figure
from stoop.propagation.wing_figures import Domain
from stoop.simulation.initial import parameter_rows
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle

DOMAIN = Domain((33.0, 37.0), 35.0, 200.0, 1.20165, (0.0, 0.2))


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return resolve_vehicle("twin-boom").reduced("longitudinal")


def test_a_linear_expression_has_the_error_of_the_delta_method(vehicle: Vehicle) -> None:
    names, covariance = ("CLalpha", "CD0"), np.array([[0.04, -0.001], [-0.001, 0.0001]])
    rng = np.random.default_rng(0)
    values = rng.multivariate_normal([4.78, 0.06], covariance, 20_000)
    one = parse_expressions({"sum": "2*CLalpha - 30*CD0 + mass.inertia.yy/60"}, vehicle)["sum"]
    drawn = parameter_rows(vehicle, dict(zip(names, values.T, strict=True)), len(values))
    rows = np.hstack([parameter_rows(vehicle), drawn])
    found = figure("Expressions", one.samples(rows), names, values)
    gradient = np.array([2.0, -30.0])
    std = float(np.sqrt(gradient @ covariance @ gradient))
    assert found.estimate == pytest.approx(2 * 4.78 - 30 * 0.06 + 2.0)
    assert found.std_error == pytest.approx(std, rel=0.02)
    assert found.ci95_upper - found.ci95_lower == pytest.approx(2 * 1.96 * std, rel=0.03)
    assert found.sources[0][0] in names


def test_a_value_that_does_not_exist_is_counted(vehicle: Vehicle) -> None:
    values = np.array([[0.0], [1.0]] * 20)
    found = propagate_draws(vehicle, Draws(("CDV",), values, "covariance"), DOMAIN, {"inverse": "1/CDV"})
    assert found["inverse"].failed == 0.5
    (told,) = (n for n in found.notices if n.code == "propagate-figure-failed")
    assert told.values == {"figures": "inverse", "share": 0.5}


def test_bad_expressions_are_refused_in_one_line(vehicle: Vehicle) -> None:
    for text, message in (
        ("CLalphaa/CD0", "no number 'CLalphaa'; did you mean CLalpha"),
        ("mass.inertia.x", "no number 'mass.inertia.x'; did you mean mass.inertia"),
        ("__import__('os')", "there is no function __import__"),
        ("CD0.real", "has no number 'CD0.real'"),
        ("CD0 +", "cannot read the term"),
        ("CD0**CL0", "not allowed"),
        ("[CD0]", "not allowed"),
    ):
        with pytest.raises(StoopError, match="expression x") as caught:
            parse_expressions({"x": text}, vehicle)
        assert message in str(caught.value), text


def test_numbers_with_exponents_and_names_with_points(vehicle: Vehicle) -> None:
    found = parse_expressions({"x": "1e2*mass.mass + abs(Cmq)^2"}, vehicle)["x"]
    assert found.values(parameter_rows(vehicle)) == pytest.approx(100 * 189.40 + 47.6**2)
