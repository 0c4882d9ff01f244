"""Records of a million samples: they take the memory of what is kept, and little more."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
from studies.robustness.commands import run_quietly
from studies.robustness.trials import BAD, READ, Bounds, Child

SAMPLES = 1_000_000
RATE = 25.0  #: Hz; the grid has twice as many
MAPPING = """time = {column = "t", unit = "s"}
[variables]
p = {column = "p", unit = "rad/s"}
q = {column = "q", unit = "rad/s"}
r = {column = "r", unit = "rad/s"}
ax = {column = "ax", unit = "m/s2"}
az = {column = "az", unit = "m/s2"}
"""
KEPT = 6 * 8 * 2 * SAMPLES  #: bytes of the flight: time and five channels


def test_a_table_of_a_million_samples(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    columns = {name: random.standard_normal(SAMPLES).round(4) for name in ("p", "q", "r", "ax", "az")}
    pd.DataFrame({"t": np.arange(SAMPLES) / RATE, **columns}).to_csv(tmp_path / "long.csv", index=False)
    (tmp_path / "long.csv.toml").write_text(MAPPING)

    def describe(folder: Path) -> str:
        code, out, errors = run_quietly(["info", str(tmp_path / "long.csv")], {}, folder)
        assert code == 0, errors
        assert "50 Hz" in out
        return READ

    bounds = Bounds(seconds=30, wall=300.0, address_space=2**31, memory=KEPT + 2**29)
    with closing(Child(describe, bounds)) as child:
        ended = child()
    assert ended.outcome not in BAD, ended.message
