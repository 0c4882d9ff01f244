"""A folder of stoop identify, read back: whatever was done to its files is one line."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from stoop.errors import StoopError
from stoop.workflow import FittedModel
from stoop.workflow.design import known_before
from stoop.workflow.load import load, model_or_vehicle


@pytest.fixture(scope="module")
def folder(job: FittedModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return job.save(tmp_path_factory.mktemp("identified") / "result")


def _no_estimate(result: dict[str, Any]) -> None:
    result["parameters"]["CLalpha"]["estimate"] = None


def _other_name(result: dict[str, Any]) -> None:
    result["covariance"]["names"][0] = "Nonsense"


def _name_missing(result: dict[str, Any]) -> None:
    del result["covariance"]["names"][0]


def _small_noise(result: dict[str, Any]) -> None:
    result["noise_covariance"]["matrix"] = [[1.0]]


def _no_maneuvers(result: dict[str, Any]) -> None:
    result["maneuvers"] = []


def _far_bias(result: dict[str, Any]) -> None:
    result["biases"] = [{"maneuver": 9, "values": {}}]


def _no_covariance(result: dict[str, Any]) -> None:
    result["noise_covariance"]["matrix"][0][0] = -1.0


def _large(result: dict[str, Any]) -> None:
    result["parameters"]["CLalpha"]["estimate"] = 1e200


def _precise(result: dict[str, Any]) -> None:
    result["parameters"]["CLalpha"]["std_error"] = 1e-300


def _hole(result: dict[str, Any]) -> None:
    result["covariance"]["matrix"][0][1] = None


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (_no_covariance, "noise covariance that is not positive definite"),
        (_large, "numbers out of range"),
        (_precise, "numbers out of range"),
        (_hole, "not symmetric, has holes or negative variances"),
        (_no_estimate, "has no estimate of CLalpha"),
        (_other_name, "covariance of other parameters"),
        (_name_missing, "rows for"),
        (_small_noise, "has a covariance of 1 rows"),
        (_no_maneuvers, "no maneuver that was fitted"),
        (_far_bias, "maneuver that it does not name"),
    ],
)
def test_an_edited_result_is_one_line(
    edit: Callable[[dict[str, Any]], None], says: str, folder: Path, tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path / "r")
    path = tmp_path / "r" / "result.json"
    result = json.loads(path.read_text())
    edit(result)
    path.write_text(json.dumps(result))
    for read in (load, model_or_vehicle):
        with pytest.raises(StoopError, match=says) as caught:
            read(tmp_path / "r")
        assert "\n" not in str(caught.value)


def test_a_design_asks_for_what_was_estimated(job: FittedModel, folder: Path) -> None:
    """The file leaves free what --fix held: the design would chase it, and not what was asked for."""
    free = {p.name: p for p in known_before(load(folder))[0].parameters if p.free}
    estimated = job.result.parameters
    assert set(free) == set(estimated)
    assert all((free[n].lower, free[n].upper) == (p.bound_lower, p.bound_upper) for n, p in estimated.items())
