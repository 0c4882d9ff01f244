"""The two claims of the paper's text: what their models are, against formulas and against hand-made cases."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.workflow.demo import TABLE_1
from stoop_studies.problems import pose
from stoop_studies.problems.paper import paper
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


@pytest.mark.parametrize(("name", "least"), [("V terms free", 1.0), ("propeller known", 1e-6)])
def test_models_of_the_propulsion(name: str, least: float) -> None:
    (told,) = longitudinal.work({"model": name, "noise": False, "seed": 1}, [None])
    assert told["status"] == "converged"
    assert (told["cost"] > least) == (name == "V terms free"), "only the true model is exact"
    wanted = longitudinal.expected()
    if name == "V terms free":
        assert told["values"]["CDV"] == pytest.approx(wanted["CDV"], rel=0.1)
    else:
        assert told["values"]["CLalpha"] == pytest.approx(4.78, rel=1e-6)


@pytest.mark.parametrize("model", lateral.MODELS)
def test_no_bound_hides_how_far_a_wrong_model_is_off(model: str) -> None:
    (told,) = lateral.work({"case": "all", "model": model, "noise": False, "seed": 0}, [None])
    names = [n for n in told["values"] if n in lateral.LATERAL]
    _inside(np.array([told["values"][n] for n in names]), *lateral.bounds(names, 0))


def test_nor_without_the_v_terms() -> None:
    (told,) = longitudinal.work({"model": "V terms zero", "noise": False, "seed": 0}, [None])
    _inside(np.array([told["values"][n] for n in TABLE_1]), *longitudinal.bounds(TABLE_1, 0))


def _inside(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
    assert (np.minimum(values - low, high - values) > 1e-3 * (high - low)).all()


def test_biases_are_added_to_their_channels_only() -> None:
    difference = lateral.measured("beta", 0, noise=False) - lateral.truth().measured(0, noise=False)
    outputs = lateral.truth().vehicle.outputs
    assert difference[:, outputs.index("beta")] == pytest.approx(0.01)
    assert np.abs(np.delete(difference, outputs.index("beta"), axis=1)).max() == 0.0
    every = lateral.measured("all", 0, noise=False) - lateral.truth().measured(0, noise=False)
    assert dict(zip(outputs, every[7], strict=True)) == pytest.approx(
        dict.fromkeys(outputs, 0.0) | lateral.BIASES
    )


def test_freed_biases_are_found_and_the_coefficients_with_them() -> None:
    (told,) = lateral.work({"case": "all", "model": "biases free", "noise": False, "seed": 2}, [None])
    for channel, bias in lateral.BIASES.items():
        assert told["values"][f"sensors.{channel}.bias"] == pytest.approx(bias, rel=1e-3), (
            "a weak prior pulls a little"
        )
    for name in lateral.OTHERS:
        assert told["values"][name] == pytest.approx(lateral.truth().vehicle.value(name), rel=0.01), name


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


def test_a_bound_needs_the_truth() -> None:
    from dataclasses import replace

    with pytest.raises(ValueError, match="does not know"):
        bound_deviations(replace(pose("paper-N", 1), truth=None))
    assert paper().truth.shape == (10,)
