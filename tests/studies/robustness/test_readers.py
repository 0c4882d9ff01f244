"""Hostile logs in little: the generators, and others' code in a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import random
import runpy
import sys
import types
import warnings
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from studies.robustness import readers
from studies.robustness.damage import FORMS, damaged
from studies.robustness.readers import READER
from studies.robustness.sample_logs import SAMPLES, samples
from studies.robustness.trials import CONTAINED, Child, try_case

from stoop.errors import LogError
from stoop.logs import guard
from stoop.logs.recording import Recording, Stream


@pytest.mark.parametrize("reader", SAMPLES)
def test_sound_logs_are_read(reader: str, tmp_path: Path) -> None:
    for k, sample in enumerate(samples(reader)):
        folder = tmp_path / str(k)
        folder.mkdir()
        with readers.in_this_process():
            told = readers.ask(*sample.write(folder), READER)
        assert told[0]
        assert set(sample.targets) <= set(sample.files)


@pytest.mark.parametrize("form", FORMS)
def test_what_is_opened_and_closed_is_what_it_was(form: str) -> None:
    found = [s for reader in SAMPLES for s in samples(reader) if s.form == form]
    assert found
    for sample in found:
        data = sample.files[sample.targets[0]]
        opened = FORMS[form].open(data)
        assert FORMS[form].open(FORMS[form].close(opened)) == opened
        marks = FORMS[form].marks(opened)
        assert marks == sorted(set(marks))
        assert 0 <= marks[0] <= marks[-1] <= len(opened)
        assert len(marks) > 5


@pytest.mark.parametrize("form", FORMS)
def test_content_is_damaged_in_every_way(form: str) -> None:
    """More than half of a hundred are unlike all others."""
    data = next(s.files[s.targets[0]] for reader in SAMPLES for s in samples(reader) if s.form == form)
    made = []

    @settings(max_examples=100, derandomize=True, database=None, deadline=None)
    @given(damaged(data, data, form))
    def collect(content: bytes) -> None:
        made.append(content)

    collect()
    assert len(set(made)) > 50


def test_others_code_that_dies_is_contained() -> None:
    """A case that dies in this process, but not in one of its own."""

    def dies(_: Path, log: str, guarded: bool = False) -> str:
        if not guarded:
            os.abort()
        return "read"

    with closing(Child(dies)) as child, closing(Child(dies)) as apart:
        ended = readers.contained("matlab", child, apart, "log")
        assert readers.contained("ulog", child, apart, "log").outcome == "crash"
    assert ended == (CONTAINED, "signal 6; ")


@pytest.mark.parametrize(
    "streams",
    [
        {},
        {"a": Stream(np.array([2.0, 1.0]), {})},
        {"a": Stream(np.array([]), {})},
        {"a": Stream(np.arange(2.0), {"x": np.zeros(3)})},
        {"a": Stream(np.arange(2.0), {"x": np.zeros(2, "f4")})},  # type: ignore[dict-item]
    ],
)
def test_a_recording_that_breaks_its_promises_is_a_fault(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, streams: dict[str, Stream]
) -> None:
    monkeypatch.setattr(readers.logs, "read", lambda path, _: Recording(path, "table", streams))
    assert try_case(readers.try_drawn, tmp_path, samples("csv")[0], READER).outcome == "fault"


def test_an_impatient_guard_leaves_its_child_less_time(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    seconds = []

    def run_child(known: str, path: Path, folder: Path, limits: guard.Limits) -> None:
        seconds.append(json.loads((folder / guard.TASK).read_text())["limits"]["seconds"])
        raise LogError("enough")

    monkeypatch.setattr(guard, "run_child", run_child)
    with readers.impatient(2), pytest.raises(LogError, match="enough"):
        guard.read_in_child("matlab", tmp_path)
    assert seconds == [2]
    assert guard.run_child is run_child


@pytest.mark.parametrize("reader", ["csv", "mapping", "netcdf-3", "maneuver"])
def test_the_script_that_is_guided_by_coverage(monkeypatch: pytest.MonkeyPatch, reader: str) -> None:
    """With a stand-in for atheris, which need not be installed: it gives the script's test bytes to draw from."""
    calls: list[Any] = []
    fake = types.SimpleNamespace(
        instrument_imports=lambda include: contextlib.nullcontext(),
        Setup=lambda argv, test: calls.append(test),
        Fuzz=lambda: [calls[0](random.Random(seed).randbytes(2000)) for seed in range(40)],  # noqa: S311
    )
    monkeypatch.setitem(sys.modules, "atheris", fake)
    script = runpy.run_path(str(Path(__file__).parents[3] / "scripts" / "fuzz_readers.py"))
    with warnings.catch_warnings():
        script["main"](reader, [])
    assert len(calls) == 1
