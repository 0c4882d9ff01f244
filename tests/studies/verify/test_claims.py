from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from stoop_studies.findings import Setting
from stoop_studies.verify import (
    capture,
    components,
    coverage,
    extensions,
    feedback,
    fleet,
    gains,
    unstable,
    verdict,
)
from stoop_studies.verify import windows as maneuvers
from stoop_studies.verify.defects import RIGHT, defects
from stoop_studies.verify.study import error_statistics, run_key


def test_statistics_of_errors_and_standard_errors() -> None:
    """An interval is 1.96 standard errors wide to either side; one that is not given holds nothing."""
    errors = np.array([[1.9, 1.0], [-1.97, 3.0], [0.1, 1.0], [-0.1, 3.0]])
    rows = [{"errors": e.tolist(), "sigma": [1.0, None if k == 0 else 2.0]} for k, e in enumerate(errors)]
    rms, mean, share, bias = error_statistics(rows)
    assert rms == pytest.approx(np.sqrt(np.mean(errors**2, axis=0)))
    assert mean.tolist() == [1.0, 2.0]
    assert share.tolist() == [0.75, 0.75]
    assert bias == pytest.approx([-0.0175 / (errors[:, 0].std() / 2.0), 4.0])


def verdicts(module: Any, setting: Setting, records: Mapping[str, Any]) -> list[bool]:
    found = module.EXPERIMENT.findings(setting, records)
    return [claim.verdict == "holds" for claim in found.claims]


@pytest.mark.parametrize("module", [coverage, feedback, unstable])
def test_coverage(module: Any) -> None:
    """Right standard errors hold; too small ones, too large ones and a bias do not, where they are."""
    setting = Setting(runs=400)

    noise = np.random.default_rng(0).standard_normal((len(setting.seeds), 12))

    def claims(sigma: float, offset: float = 0.0, only: str = "") -> list[bool]:
        records = {}
        for case in module.CASES:
            wrong = case == only or not only
            fixed = {"names": list("abcdefghijkl"), "cramer_rao": [1.0] * 12, "status": "converged"}
            fixed |= {"sigma": [sigma if wrong else 1.0] * 12, "method": "filter-error"}
            for seed, errors in zip(setting.seeds, noise, strict=True):
                records[run_key(case, seed)] = fixed | {"errors": (errors + offset * wrong).tolist()}
        return verdicts(module, setting, records)

    assert all(claims(1.0))
    first = next(iter(module.CASES))
    for wrong in (claims(0.6, only=first), claims(1.0, 1.5, only=first)):
        assert 1 <= wrong.count(False) < len(wrong)
    assert not all(claims(0.6))


def test_the_worth_of_components() -> None:
    """Of errors whose variance is that of two components each is worth having, and a third is not."""
    noise, records = np.random.default_rng(1), {}
    setting, parts = Setting(runs=4), {"noise": 1.0, "color": 3.0, "held": 1.0}
    for seed, case in ((s, c) for s in setting.seeds for c in components.CASES):
        numbers = {"errors": (2.0 * noise.standard_normal(30)).tolist(), "sizes": [1.0] * 30,
                   "variances": {c: [v] * 30 for c, v in parts.items()}}  # fmt: skip
        records[run_key(case, seed)] = {"numbers": numbers, "figures": numbers}
    found = components.EXPERIMENT.findings(setting, records)
    verdicts = {c.statement.split()[2]: c.verdict for c in found.claims if "worth having" in c.statement}
    assert (verdicts["color"], verdicts["held"]) == ("holds", "does not hold")
    head = [*found.head]
    for row in (dict(zip(head, row, strict=True)) for row in found.rows):
        left = 5.0 - sum(parts.get(name, 0.0) for name in str(row["without"]).split(" + "))
        assert row["width"] == pytest.approx(np.sqrt(left / 5.0))
        assert row["rms"] == pytest.approx(np.sqrt(4.0 / left), rel=0.2)


def test_size_and_power_of_extensions() -> None:
    setting = Setting(runs=10)

    def claims(suggested: int = 0, missed: int = 0, seconds: float = 0.5) -> list[bool]:
        fixed = {
            "value": 0.04, "rivals": 1, "tested": 100, "harm": 10.0, "outside": 0.3, "status": "converged", "fit_seconds": 1.0,
            "test_seconds": seconds,
        }  # fmt: skip
        records = {}
        for seed, case in ((s, c) for s in setting.seeds for c in extensions.CASES):
            named = case not in RIGHT and seed >= missed
            names = [min(defects()[case].names)] if named else ["CLbeta"]
            flights = []
            for k in range(extensions.REPEATS if case in RIGHT else 1):
                told = case not in RIGHT or extensions.REPEATS * seed + k < suggested
                flights.append(fixed | {"found": names * told, "first": named, "named": named})
            records[run_key(case, seed)] = {"flights": flights}
        return verdicts(extensions, setting, records)

    assert claims() == claims(suggested=2) == [True] * 4
    assert claims(suggested=3) == [False, True, True, True]
    assert claims(missed=2) == [True, False, False, True]
    assert claims(seconds=1.5) == [True, True, True, False]


def test_error_rates_of_the_verdict() -> None:
    setting = Setting(runs=4)

    def claims(refused: int = 0, trusted: int = 0, harm: float = 10.0) -> list[bool]:
        def flight(good: bool, harm: float) -> dict[str, Any]:
            fixed = {"uses": [], "against": [], "off": None, "seconds": 5.0, "inside": [0.95]}
            return fixed | {"grade": "trusted" if good else "do not use", "harm": harm}

        records = {}
        for seed in setting.seeds:
            right = [flight(verdict.REPEATS * seed + k >= refused, 1.0) for k in range(verdict.REPEATS)]
            wrong = [flight(seed < trusted, harm)]
            records |= {run_key(c, seed): {"flights": right if c in RIGHT else wrong} for c in verdict.CASES}
        return verdicts(verdict, setting, records)

    assert claims() == claims(refused=1) == [True, True]
    assert claims(refused=2) == [False, True]
    assert claims(trusted=1) == [True, False]
    assert claims(trusted=4, harm=0.9 * verdict.HARM) == [True, True], "no bad model"


def test_windows() -> None:
    setting = Setting(runs=2)

    def claims(**changes: Any) -> bool:
        flown = {
            "maneuvers": 3, "found": 3, "windows": 3, "beside": 0, "false": 0, "bare_windows": 3, "bare_false": 0,
            "ratios": [0.9, 1.1], "inside": 19, "estimates": 20,
        }  # fmt: skip
        gusts = {key: [] if key == "ratios" else 0 for key in flown}
        of_case = {case: gusts if "gusts" in case else flown | changes for case in maneuvers.CASES}
        records = {run_key(case, seed): one for case, one in of_case.items() for seed in setting.seeds}
        return all(verdicts(maneuvers, setting, records))

    assert claims()
    for changes in ({"found": 2}, {"false": 1}, {"ratios": [1.6, 1.7]}, {"ratios": [0.5]}):
        assert not claims(**changes)


def test_motion_capture() -> None:
    setting = Setting(runs=3)

    def claims(inside: bool = True, error: float = 0.0, stopped: str = "", seconds: int = 20) -> list[bool]:
        record = {
            "template": "quad", "mass": 0.1, "delay": 0.2, "stopped": stopped, "seconds": seconds,
            "late": [[0.2 + error, 0.001, 0.2, False, True]],
            "numbers": {"rotors.T2": [1.0, 0.1, 1.05 if inside else 2.0, False, True]}, "per_inertia": {},
            "predictions": [["phi", 0.1, 0.5, True]], "method": "multiple-shooting", "grade": "usable",
            "uses": ["simulation"], "needs": {"simulation": [["rotors.T2"]]}, "against": [], "windows": [],
        }  # fmt: skip
        keys = [run_key(case, seed) for case in capture.CASES for seed in setting.seeds]
        return verdicts(capture, setting, dict.fromkeys(keys, record))

    assert claims()[2:] == [True] * 3 + [True, False, True, True, True]
    assert not claims(inside=False)[1]
    assert not claims(error=0.02)[2]
    assert not claims(seconds=61)[4]
    assert not claims(stopped="no window")[0]


def test_fleets() -> None:
    setting, kinds = Setting(runs=3), len(fleet.CASES) - 2

    def claims(**changed: Any) -> list[bool]:
        record = {
            "threshold": 20.0, "false": 0, "told": 1, "found": True, "possible": True, "delay": 5, "least": 5.0,
            "named": True, "figure": "climb", "back": True, "dated": 0, **changed,
        }  # fmt: skip
        keys = [run_key(case, seed) for case in fleet.CASES for seed in fleet.EXPERIMENT.seeds(case, setting)]
        return verdicts(fleet, setting, dict.fromkeys(keys, record))

    assert all(claims())
    assert not claims(told=9)[0]
    for changed in ({"found": False}, {"delay": 9}, {"named": False}):
        assert claims(**changed).count(True) == 1 + 2 * kinds + 1
    assert not claims(dated=3)[-1]


def test_gains() -> None:
    setting = Setting(runs=20)

    def record(
        inside: bool = True, left: float = 0.0, ratio: float = 0.9, against: str = "", lost: bool = False
    ) -> dict[str, Any]:
        rows = [["roll", "gain margin", 1.0, 2.0, 1.5 if inside else 3.0]]
        ways = {key: {"left": left, "ratios": [ratio] * 3} for key in gains.WAYS}
        return {
            "vehicle": 40, "template": "quad", "gusts": "calm", "stopped": "", "grade": "usable",
            "against": [against] * bool(against), "intervals": rows, "lost": lost, **ways,
        }  # fmt: skip

    def claims(records: list[dict[str, Any]]) -> list[bool]:
        pairs = list(zip(setting.seeds, records, strict=True))
        return verdicts(gains, setting, {run_key(case, s): one for case in gains.CASES for s, one in pairs})

    good = [record()] * 19
    assert claims([*good, record(inside=False)]) == [True] * 8
    assert claims([record(inside=False)] * 20)[0] is False
    assert claims([*good[:18], *[record(left=-0.1)] * 2])[1] is False
    assert claims([record(ratio=0.5)] * 20)[2] is False
    assert claims([*good, record(lost=True)])[3] is False
    refused = record(left=-0.5, ratio=0.1, against="tune-model-not-for-control")
    assert claims([*[record()] * 10, *[refused] * 8, record(), record(inside=False)])[1:3] == [True, True]
