"""A folder of stoop identify, read back: whatever was done to its files is one line."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.errors import StoopError
from stoop.workflow import FittedModel
from stoop.workflow.design import known_before
from stoop.workflow.load import load, model_or_vehicle
from stoop.workflow.outputs import ARCHIVES

#: place in result.json -> what is written there, what the complaint says
EDITS: list[tuple[tuple[str | int, ...], Any, str]] = [
    (("noise_covariance", "matrix", 0, 0), -1.0, "noise covariance that is not positive definite"),
    (("parameters", "CLalpha", "estimate"), 1e200, "numbers out of range"),
    (("parameters", "CLalpha", "std_error"), 1e-300, "numbers out of range"),
    (("covariance", "matrix", 0, 1), None, "not symmetric, has holes or negative variances"),
    (("parameters", "CLalpha", "estimate"), None, "has no estimate of CLalpha"),
    (("covariance", "names", 0), "Nonsense", "covariance of other parameters"),
    (("covariance", "names"), ["CLalpha"], "rows for"),
    (("noise_covariance", "matrix"), [[1.0]], "has a covariance of 1 rows"),
    (("maneuvers",), [], "no maneuver that was fitted"),
    (("biases",), [{"maneuver": 9, "values": {}}], "maneuver that it does not name"),
    *(
        (("process_noise",), {"gain": "steady", "states": ["u"], "intensities": values, "share": share},
         "process noise without positive intensities")
        for values, share in (([], 0.0), ([-1.0], 0.0), ([None], 0.0), ([1.0], 2.0))
    ),
]  # fmt: skip


def test_an_edited_result_is_one_line(folder: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(folder, tmp_path / "r"))
    whole = (folder / "result.json").read_text()
    for (*place, last), value, says in EDITS:
        result: Any = json.loads(whole)
        inner = result
        for key in place:
            inner = inner[key]
        inner[last] = value
        (copy / "result.json").write_text(json.dumps(result))
        for read in (load, model_or_vehicle):
            with pytest.raises(StoopError, match=says) as caught:
                read(copy)
            assert "\n" not in str(caught.value)


def test_damaged_and_missing_files_are_one_line(job: FittedModel, folder: Path, tmp_path: Path) -> None:
    """Curves are columns of double precision; an estimate is that of the result beside it."""
    with np.load(folder / "traces.npz") as file:
        curves = dict(file)
    for name, damage in (("flat", {"0.time": curves["0.time"][:, None]}),
                         ("single", {k: x.astype(np.int8) for k, x in curves.items() if k.startswith("0.input")})):  # fmt: skip
        np.savez(tmp_path / f"{name}.npz", **curves | damage)
    flat, single = ((tmp_path / f"{name}.npz").read_bytes() for name in ("flat", "single"))
    text, copy = (folder / "result.json").read_text(), tmp_path / "r"
    for name, content, says in (
        *((name, content, name) for name in ARCHIVES for content in (b"", b"PK\x03\x04 damaged")),
        ("traces.npz", flat, "is no curve"),
        ("traces.npz", single, "is no curve"),
        ("result.json", None, "holds no result.json"),
        ("vehicle.toml", None, "holds no vehicle.toml"),
        (
            "result.json",
            text.replace('"CLalpha"', '"CLnonsense"').encode(),
            "no number is called 'CLnonsense'",
        ),
    ):
        shutil.copytree(folder, copy, dirs_exist_ok=True)
        if content is None:
            (copy / name).unlink()
        else:
            (copy / name).write_bytes(content)
        with pytest.raises(StoopError, match=says) as said:
            _ = load(copy).estimate
        assert "\n" not in str(said.value)
    parameters = {n: replace(p, estimate=1.01 * p.estimate) for n, p in job.parameters.items()}
    mixed = replace(load(folder), result=replace(job.result, parameters=parameters))
    with pytest.raises(StoopError, match=r"holds another fit than result\.json beside it"):
        _ = mixed.estimate


def test_a_design_asks_for_what_was_estimated(job: FittedModel, folder: Path) -> None:
    """The file leaves free what --fix held: the design would chase it, and not what was asked for."""
    free = {p.name: p for p in known_before(load(folder))[0].parameters if p.free}
    estimated = job.result.parameters
    assert set(free) == set(estimated)
    assert all((free[n].lower, free[n].upper) == (p.bound_lower, p.bound_upper) for n, p in estimated.items())
