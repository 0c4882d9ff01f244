"""Logs of a room: late commands that a radio holds, poses of known noise; and claims that turn with the records."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop_studies.verify import pilots
from stoop_studies.verify.capture import NOISE, fly


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
