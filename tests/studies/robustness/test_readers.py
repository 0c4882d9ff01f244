"""Hostile logs in little: the generators, and others' code in a process of its own."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import runpy
import sys
import types
import warnings
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from stoop.errors import LogError
from stoop.logs import guard
from stoop.logs.recording import Recording, Stream
from stoop_studies.robustness import readers
from stoop_studies.robustness.damaged_logs import DAMAGES, FORMS, Sample
from stoop_studies.robustness.log_grammars import Draw
from stoop_studies.robustness.readers import FLIGHT, READER, Series
from stoop_studies.robustness.sample_logs import SAMPLES, samples
from stoop_studies.robustness.trials import BAD, CONTAINED, try_case


@pytest.mark.parametrize("reader", readers.GUARDED)
def test_others_code_in_a_process_of_its_own(reader: str) -> None:
    tried = list(readers.try_logs(Series(reader, 3, guarded=True), 2))
    assert [t.number for t in tried] == [0, 1]
    assert not {t.outcome for t in tried} & set(BAD)


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
        spans = FORMS[form].spans(opened)
        assert all(0 <= a < b <= len(opened) for a, b in spans)
        assert len(spans) > 5


def test_a_number_makes_a_case_and_another_another(tmp_path: Path) -> None:
    def written(number: int) -> bytes:
        case = readers.damaged_case(Series("ulog", 1), number)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(readers, "ask", lambda path, *_: (path.read_bytes().hex(), frozenset()))
            patch.setattr(readers, "_sound", lambda *_: ("", frozenset()))
            case.run(tmp_path)
        return (tmp_path / "a.ulg").read_bytes()

    contents = [written(number) for number in range(150)]
    assert contents == [written(number) for number in range(150)]
    assert len(set(contents)) > 130
    cases = [readers.damaged_case(Series("ulog", 1), number) for number in range(150)]
    assert {c.damage for c in cases} == set(DAMAGES)
    assert {c.way for c in cases} == {READER, FLIGHT}


@pytest.mark.parametrize("form", readers.DRAWN)
def test_a_number_makes_a_log(form: str) -> None:
    def logs(seed: int) -> list[Sample]:
        return [readers.DRAWN[form](Draw(Random(n + seed), 0.1)) for n in range(20)]  # noqa: S311

    assert logs(0) == logs(0)
    assert logs(0)[0] != logs(100)[0]


def test_others_code_that_dies_is_contained(monkeypatch: pytest.MonkeyPatch) -> None:
    """One case of two dies in this process, but not in one of its own."""
    real, asked = readers._ask, itertools.count()

    def ask(guarded: bool, *rest: Any) -> tuple[str, frozenset[str]]:
        if not guarded and next(asked) == 1:
            os.abort()
        return real(guarded, *rest)

    monkeypatch.setattr(readers, "_ask", ask)
    monkeypatch.setattr(readers, "_sound", lambda *_: ("", frozenset()))
    tried = list(readers.try_logs(Series("matlab", 5), 2))
    assert [t.outcome == CONTAINED for t in tried] == [False, True]
    assert tried[1].message.startswith("crash: signal 6")


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
    cases = (readers.damaged_case(Series("csv", 1), n) for n in range(99))
    assert try_case(next(c for c in cases if c.way == READER), tmp_path).outcome == "fault"


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
    """With a stand-in for atheris, which need not be installed: it damages what the script has put into the corpus."""
    calls: list[Any] = []

    def fuzz() -> None:
        (_, corpus), read, mutate = calls
        logs = [path.read_bytes() for path in sorted(Path(corpus).iterdir())]
        for seed in range(40):
            read(mutate(logs[seed % len(logs)], 4096, seed))

    fake = types.SimpleNamespace(
        instrument_imports=lambda include: contextlib.nullcontext(),
        Mutate=lambda data, most: data[: most // 2],
        Setup=lambda argv, read, custom_mutator: calls.extend((argv, read, custom_mutator)),
        Fuzz=fuzz,
    )
    monkeypatch.setitem(sys.modules, "atheris", fake)
    script = runpy.run_path(str(Path(__file__).parents[3] / "scripts" / "fuzz_readers.py"))
    with warnings.catch_warnings():
        script["main"](reader, [])
    assert len(calls) == 3
