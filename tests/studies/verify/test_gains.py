from dataclasses import replace

import numpy as np
import pytest

from stoop.vehicle.document import with_entries
from stoop_studies.verify import autotune, gains
from stoop_studies.verify.gains import CASES, OF_CASE
from stoop_studies.verify.made_up import made_up
from stoop_tune.control_laws.table import firmwares
from stoop_tune.gain_search import Design, Specification
from stoop_tune.judgment import commands_of


@pytest.mark.parametrize("case", CASES)
def test_the_truth_by_itself_keeps_what_it_proposes(case: str) -> None:
    made = made_up(40 + OF_CASE[case][0])
    (firmware,) = firmwares({"FW_RR_P" if case == "wings" else "MC_ROLLRATE_P": 1.0})
    throw = {s: {"mix": {f"control_{a}": 0.3}} for s, a in (("elevator", "pitch"), ("aileron", "roll"))}
    truth = made.vehicle
    if case == "wings":
        truth = with_entries(truth, {("controls", s, "mix"): one["mix"] for s, one in throw.items()})
    airspeed = made.vehicle.value("reference.airspeed") if case == "wings" else 0.0
    values = gains.flown_gains(truth, firmware, airspeed, {}, np.random.default_rng(0))
    conditions = gains.conditions_of(truth, firmware, values, [airspeed], 100.0, gains.NONE)
    axes = commands_of(truth, firmware, values).axes
    own = Design(firmware, values, axes, conditions, Specification(), {"roll": 1e-8})
    assert min(one.margins.gain[0] for one in own.judged(values)[0]) >= gains.STABLE
    best = gains.gains(own)
    assert best is not None
    found = gains.kept(own, best, best)
    assert found is not None
    assert found["left"] >= -0.01
    np.testing.assert_allclose(found["ratios"], 1.0, rtol=1e-6)
    hopeless = replace(own, specification=Specification(gain=300.0))
    assert gains.gains(hopeless) is None
    assert gains.kept(own, best, None) is None
    assert gains.lost(truth, firmware, best, 0) is False
    if case == "wings":
        reversed_aileron = with_entries(truth, {("controls", "aileron", "mix"): {"control_roll": -0.3}})
        assert gains.lost(reversed_aileron, firmware, best, 0) is True


def test_the_rule_of_px4_fits_a_difference_equation_and_its_gains_fly() -> None:
    """A known equation comes back; without detuning the gain is as the plant is weak; the truth's own gains are stable."""
    den, num, step = np.array([-1.5, 0.56]), np.array([0.02, 0.01, -0.004]), 0.01
    frequency = 2.0 * np.pi * np.linspace(0.5, 40.0, 50)
    delay = np.exp(-1j * frequency * step)
    response = delay * np.polyval(num[::-1], delay) / (1.0 + den[0] * delay + den[1] * delay**2)
    found = autotune.difference_equation(response, frequency, step)
    np.testing.assert_allclose(np.r_[found], np.r_[den, num], atol=1e-10)
    weak, strong = (autotune.minimum_variance_pid(den, k * num, step, 0.14, 0.0) for k in (1.0, 3.0))
    assert weak[0] == pytest.approx(3.0 * strong[0])
    assert weak[1:] == pytest.approx(strong[1:])
    made = made_up(40 + OF_CASE["rotors"][0])
    (firmware,) = firmwares({"MC_ROLLRATE_P": 1.0})
    values = gains.flown_gains(made.vehicle, firmware, 0.0, {}, np.random.default_rng(0))
    axes = commands_of(made.vehicle, firmware, values).axes
    conditions = gains.conditions_of(made.vehicle, firmware, values, [0.0], 100.0, gains.NONE)
    design = Design(firmware, values, axes, conditions, Specification(), {})
    tuned = autotune.minimum_variance(design)
    assert tuned is not None
    assert all(one.margins.gain[0] > 1.5 for one in design.judged(tuned)[0])
    less = autotune.backed_off(design, tuned)
    assert less is not None
    assert less["MC_ROLLRATE_P"] == pytest.approx(0.75 * tuned["MC_ROLLRATE_P"])
    assert less["MC_ROLL_P"] == tuned["MC_ROLL_P"]
