"""The result's JSON form: everything survives the round trip, and nothing is half-written."""

import json
import math
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stoop.base.notices import as_notice, notice
from stoop.errors import OutputError, StoopError
from stoop.estimate.filter_gains import STATED
from stoop.results import result as results
from stoop.results.modes import ConditionModes, DerivedValue, MeasuredMode, ModeEstimate, StateEquations
from stoop.results.result import GoodnessOfFit, ManeuverResult, ParameterEstimate, Result, from_json, to_json
from stoop.results.uncertainty import ParameterRepeatability, Repeatability, SingleEstimate


def minimal(**changes: object) -> Result:
    given: dict[str, object] = {
        "parameters": {"CLalpha": ParameterEstimate(5.0, 0.1)},
        "covariance": results.Covariance(("CLalpha",), np.array([[0.01]])),
        "noise_covariance": results.NoiseCovariance((), np.empty((0, 0))), "cost": 1.0, "trajectories": 10.0,
        "seconds": 0.5, "seed": 1, "optimizer": "scouts", "status": "converged",
    }  # fmt: skip
    given |= dict.fromkeys(("initial_states", "biases", "wind", "maneuvers"), ())
    return Result(**(given | changes))  # type: ignore[arg-type]


@given(st.floats(), st.floats())
def test_text_is_strict_json(cost: float, estimate: float) -> None:
    def refuse(constant: str) -> float:
        raise AssertionError(f"{constant} is no JSON")

    parameter = ParameterEstimate(np.float64(estimate), at_bound=np.bool_(True))  # type: ignore[arg-type]
    text = to_json(minimal(cost=cost, parameters={"a": parameter}, seed=np.int64(7)))
    document = json.loads(text, parse_constant=refuse)
    assert (document["schema"], document["seed"]) == (results.READABLE[0], 7)  # without components
    assert document["cost"] == (cost if math.isfinite(cost) else None)
    assert document["parameters"]["a"]["bound_upper"] is None
    again = from_json(json.dumps(document | {"later": 1})).parameters["a"]
    assert (again.bound_lower, again.bound_upper, again.at_bound) == (-math.inf, math.inf, True)
    assert math.isnan(again.prior_std)


def test_a_file_of_an_older_version_is_read() -> None:
    channel = GoodnessOfFit(0.1, 0.2, 0.9, 0.3)
    one = ManeuverResult("a", 0.0, 1.0, "fit", ((0.0, 1.0),), {"q": channel})
    document = json.loads(to_json(minimal(maneuvers=(one,))))
    for key in ("modes", "repeatability"):
        del document[key]
    for key in ("press", "theil_shares", "whiteness", "baseline"):
        del document["maneuvers"][0]["channels"]["q"][key]
    again = from_json(json.dumps(document))
    assert (repr(again.maneuvers[0].channels["q"]), again.modes) == (repr(channel), ())
    assert not again.repeatability.parameters
    varying = results.ProcessNoise("varying", ("w", "q"), (0.3, 0.1))
    told = {"filter-error-ekf": varying, "output-error": results.ProcessNoise()}
    told["stabilized-output-error"] = results.ProcessNoise("steady", share=STATED)
    for method, noise in told.items():  # then by a notice
        found = notice("process-noise", states=noise.states, intensities=noise.intensities)
        said = (notice("filter-error"), found)[: 1 + bool(noise.states)]
        document = json.loads(to_json(minimal(method=method, notices=said)))
        assert document.pop("process_noise")["gain"] == "none"
        assert from_json(json.dumps(document)).process_noise == noise, method


def test_every_part_survives() -> None:
    some, own = DerivedValue(2.0, 0.1, 1.8, 2.2), {"vn": results.Quantity(1.0, math.nan, "m/s")}
    remarks = (notice("mode-becomes-real", share=0.2), notice("mode-stability-unknown"))
    seen = MeasuredMode(0, 1.0, 3.0, ("r", "beta"), some, some, notice("response-no-rest"))
    mode = ModeEstimate(
        "Dutch roll", some, some, some, some, DerivedValue(), "sampled", 0.2, remarks, measured=(seen,)
    )  # fmt: skip
    linear = StateEquations(("p", "r"), ("rudder",), ((-1.0, 2.0), (0.0, -3.0)), ((4.0,), (5.0,)))
    single = SingleEstimate(1.0, 0.1, True)
    repeated = ParameterRepeatability((single, single), 1.0, 0.07, 0.0, 1, 1.0, "agree")
    one = ParameterEstimate(
        1.0, 0.1, 0.8, 1.2, bound_lower=-2.0, bound_upper=3.0, at_bound=True, identifiable=False, unit="1/s",
        prior_mean=0.5, prior_std=0.2, start=0.7,
    )  # fmt: skip
    figures = {"\u00fc\x00": GoodnessOfFit(0.1, math.nan, -1e300, 0.4)}
    whole = minimal(
        modes=(ConditionModes((0, 2), "trim", 20.0, 100.0, 0.05, (mode,), linear=linear),),
        repeatability=Repeatability((0, 1), {"Clp": repeated}), biases=(results.SensorBiases(1, own),),
        wind=(results.WindEstimate("a", own, 0.5, ()),), parameters={"Clp": one}, trust=(notice("filter-error"),),
        initial_states=(results.InitialState(0, 1, 2.0, own),), notices=(as_notice("it"),), advice="allow more",
        maneuvers=(ManeuverResult("a", 0.0, 1.0, "validation", ((0.0, 1.0), (2.0, 3.0)), figures),),
        versions={"stoop": "1"}, inputs={"a.csv": "f0"},
        noise_covariance=results.NoiseCovariance(("p", "q"), np.array([[1.0, math.nan], [0.2, 2.0]])),
    )  # fmt: skip
    text = to_json(whole)
    again = from_json(text)
    assert (to_json(again), str(again.trust[0])) == (text, str(whole.trust[0]))
    for part in {f.name for f in fields(whole)} - {"modes", "trust"}:
        assert repr(getattr(again, part)) == repr(getattr(whole, part)), part  # NaN equals NaN
    (found,), own = again.modes, json.loads(text)["modes"][0]["modes"][0]  # texts, as older readers expect
    said = "two real modes in 20 % of the draws; stability not determined by the data"
    unsaid = "not identified: the controls never rest"
    assert (own["remark"], own["measured"][0]["remark"]) == (said, unsaid)
    assert (found.remark, found.linear, repr(found.modes[0].frequency)) == (None, linear, repr(some))
    assert [*map(str, found.modes[0].remark), str(found.modes[0].measured[0].remark)] == [said, unsaid]


def test_what_is_no_result_is_refused_in_one_line(tmp_path: Path) -> None:
    whole, uneven = json.loads(to_json(minimal())), {"names": ["a"], "matrix": [[1], [1, 2]]}
    bad = [{"maneuvers": [{"role": "other"}]}, {"parameters": 3}, {"cost": "much"}, {"covariance": uneven}]
    schemas = ['{"schema": "stoop-result/3"}', '{"schema": "stoop-result/1"}']
    for text in ("", "{", "[1]", "[" * 100_000, *schemas, *(json.dumps(whole | one) for one in bad)):
        with pytest.raises(StoopError) as caught:
            from_json(text, "folder/result.json")
        assert str(caught.value).startswith("folder/result.json: "), text[:80]
        assert "\n" not in str(caught.value), text[:80]
    with pytest.raises(StoopError, match="cannot read the result file"):
        results.read_result(tmp_path / "none.json")


def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "result.json"
    minimal().save(path)
    assert to_json(results.read_result(path)) == to_json(minimal())
    with pytest.raises(OutputError, match=r"none.*cannot be written.*choose another"):
        minimal().save(tmp_path / "none" / "result.json")

    def fail(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OutputError, match="No space left"):
        minimal(cost=2.0).save(path)
    assert (results.read_result(path).cost, list(tmp_path.iterdir())) == (1.0, [path])
