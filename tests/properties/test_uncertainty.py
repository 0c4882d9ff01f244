"""One uncertainty: each error of the table is the square root of its variance in the covariance matrix."""

import json
from pathlib import Path

import numpy as np
import pytest

from stoop.workflow import FittedModel


def test_errors_of_the_table_are_those_of_the_covariance(lacking: FittedModel, tmp_path: Path) -> None:
    """By definition; of a model that lacks a term, so that all that widens an error bar takes part."""
    lacking.result.save(tmp_path / "result.json")
    written = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    names = written["covariance"]["names"]
    roots = np.sqrt(np.diag(np.array(written["covariance"]["matrix"], dtype=float)))
    table = lacking.to_dataframe()
    assert len(names) == 3
    for name, root in zip(names, roots, strict=True):
        assert written["parameters"][name]["std_error"] == pytest.approx(root, rel=1e-9), name
        assert table.loc[name, "std_error"] == pytest.approx(root, rel=1e-9), name
        assert lacking.parameters[name].std_error == pytest.approx(root, rel=1e-9), name
        parts = {c: own[name] for c, own in written["components"]["variances"].items()}
        assert sum(parts.values()) == pytest.approx(root**2, rel=1e-9), (name, parts)
    assert any(own > 0.0 for own in written["components"]["variances"]["model"].values())
