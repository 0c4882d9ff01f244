import numpy as np
import pytest

from stoop_studies.problems import pose
from stoop_studies.reproduce import lateral, longitudinal
from stoop_studies.reproduce.suite import bound_deviations, unit_deviations


def test_the_propeller_holds_the_trim_and_has_constant_power() -> None:
    trim = longitudinal.truth().flown.trim
    assert longitudinal.thrust(35.0) == pytest.approx(220.87, abs=0.05), "the paper's thrust"
    slope = longitudinal.thrust(36.0) - longitudinal.thrust(35.0)
    assert slope == pytest.approx(-220.87 / 35.0, rel=0.01), "dT/dV = -T/V"
    assert trim.residual < 1e-7


def test_expected_terms_of_a_constant_power_propeller_are_those_of_the_trim() -> None:
    """T' = -T/V* makes CDV equal to T cos(alpha) / (qbar S), the drag coefficient of steady flight."""
    wanted = longitudinal.expected()
    assert wanted["CDV"] == pytest.approx(0.10413, rel=0.01)
    assert wanted["CLV"] == pytest.approx(-0.10413 * np.tan(np.radians(5.88)), rel=0.01)
    assert wanted["CmV"] == 0.0


def test_biases_are_added_to_their_channels_only() -> None:
    difference = lateral.measured("beta", 0, noise=False) - lateral.truth().measured(0, noise=False)
    outputs = lateral.truth().vehicle.outputs
    assert difference[:, outputs.index("beta")] == pytest.approx(0.01)
    assert np.abs(np.delete(difference, outputs.index("beta"), axis=1)).max() == 0.0
    every = lateral.measured("all", 0, noise=False) - lateral.truth().measured(0, noise=False)
    wanted = dict.fromkeys(outputs, 0.0) | lateral.BIASES
    assert dict(zip(outputs, every[7], strict=True)) == pytest.approx(wanted)


def test_the_bound_does_not_depend_on_the_box() -> None:
    few, many = bound_deviations(pose("paper-N", 1)), bound_deviations(pose("paper-W", 5))
    assert few == pytest.approx(many, rel=1e-3)
    truth = pose("paper-N", 1).truth
    assert truth is not None
    assert (few / np.abs(truth)).max() == pytest.approx(0.0567, abs=0.002), "CLq is the weakest of the ten"


def test_the_bound_of_a_line_is_that_of_linear_regression() -> None:
    """Residuals z - t: the information of each is the number of readings, in units of the box."""

    class Mean:
        dimension, extra, prices = 1, 0, (1.0,)

        def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
            return np.repeat(Z, 25, axis=1)

        def jacobian(self, z: np.ndarray, rung: int, r: np.ndarray) -> tuple[np.ndarray, float]:
            return np.ones((25, 1)), 1.0

    assert unit_deviations(Mean(), np.array([0.5])) == pytest.approx([0.2])  # type: ignore[arg-type]
