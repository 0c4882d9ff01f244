"""Logs of a room: late commands that a radio holds, poses of known noise; and claims that turn with the records."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop_studies.findings import Setting
from stoop_studies.verify import pilots
from stoop_studies.verify.capture import CASES, EXPERIMENT, NOISE, fly
from stoop_studies.verify.study import run_key

SETTING = Setting(runs=3)


def record(
    inside: bool = True, error: float = 0.0, stopped: str = "", seconds: float = 20.0
) -> dict[str, Any]:
    row = [1.0, 0.1, 1.05 if inside else 2.0, False, True]
    return {
        "template": "quad", "mass": 0.1, "delay": 0.2, "stopped": stopped, "seconds": seconds,
        "late": [[0.2 + error, 0.001, 0.2, False, True]],
        "numbers": {"rotors.T2": row}, "per_inertia": {}, "predictions": [["phi", 0.1, 0.5, True]], "method": "multiple-shooting",
        "grade": "usable", "uses": ["simulation"], "needs": {"simulation": [["rotors.T2"]]}, "against": [], "windows": [],
    }  # fmt: skip


def verdicts(one: dict[str, Any]) -> list[bool]:
    results = {run_key(case, seed): one for case in CASES for seed in SETTING.seeds}
    return [claim.verdict == "holds" for claim in EXPERIMENT.findings(SETTING, results).claims]


def test_claims_turn_with_the_records() -> None:
    sound = verdicts(record())
    assert sound[0]
    assert sound[2:] == [True] * 3 + [True, False, True, True, True]
    assert not verdicts(record(inside=False))[1]
    assert not verdicts(record(error=0.02))[2]
    assert not verdicts(record(seconds=61.0))[4]
    assert not verdicts(record(stopped="no window"))[0]


def test_a_log_holds_noisy_poses_and_commands_as_they_were_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved, by_stoop = list[pilots.Columns](), pilots.by_stoop
    monkeypatch.setattr(pilots, "by_stoop", lambda *given: moved.append(by_stoop(*given)) or moved[-1])
    for seed in range(2):
        flown, late = fly("wings", seed, tmp_path)
        table = np.genfromtxt(flown.path, delimiter=",", names=True)
        time = table["t"]
        sent = np.interp(time + late, flown.time, moved[-1]["elevator"])
        np.testing.assert_allclose(table["elevator"], sent, atol=2e-5)
        name = "x_n" if seed % 2 == 0 else "pos_n"
        third = np.diff(table[name], 3)  # of white noise they have 20 times its variance
        assert 0.9 < np.std(third) / (np.sqrt(20.0) * NOISE["position"]) < 1.1
