"""Readers under damage, in little; and that those who watch over them see a crash, a hang and a hunger for memory."""

from __future__ import annotations

import contextlib
import json
import os
import runpy
import sys
import types
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.errors import LogError
from stoop.logs import guard
from stoop.logs.recording import Recording, Stream
from stoop_studies.findings import Setting
from stoop_studies.verify import readers
from stoop_studies.verify.damaged_logs import DAMAGES, FORMS
from stoop_studies.verify.readers import (
    BAD,
    CONTAINED,
    FLIGHT,
    GUARD,
    READ,
    Case,
    Series,
    Tried,
    count_outcomes,
    make_case,
    show,
)
from stoop_studies.verify.sample_logs import SAMPLES, samples

SMOKE = 107  #: cases of each of fourteen readers: 1498


@pytest.mark.parametrize("reader", SAMPLES)
def test_damage_is_told(reader: str) -> None:
    readers.prepare(reader, "")
    tried = list(readers.try_all(Series(reader, 77), SMOKE))
    assert [t.number for t in tried] == list(range(SMOKE))
    assert [t for t in tried if t.outcome in BAD] == []
    assert {"refused", "listed"} & {t.outcome for t in tried}


@pytest.mark.slow
@pytest.mark.parametrize("reader", SAMPLES)
def test_much_damage_is_told(reader: str) -> None:
    readers.prepare(reader, "")
    assert [t for t in readers.try_all(Series(reader, 78), 1500) if t.outcome in BAD] == []


@pytest.mark.parametrize("reader", readers.GUARDED)
def test_others_code_in_a_process_of_its_own(reader: str) -> None:
    readers.prepare(reader, "")
    tried = list(readers.try_all(Series(reader, 3, guarded=True), 2))
    assert [t.way for t in tried] == [GUARD, GUARD]
    assert not {t.outcome for t in tried} & set(BAD)


@pytest.mark.parametrize("reader", SAMPLES)
def test_sound_logs_are_read(reader: str, tmp_path: Path) -> None:
    for k, sample in enumerate(samples(reader)):
        folder = tmp_path / str(k)
        folder.mkdir()
        with readers.in_this_process():
            told = readers.ask(*sample.write(folder), READ)
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


def test_a_number_makes_a_case_and_another_another() -> None:
    cases = [make_case(Series("ulog", 1), number) for number in range(150)]
    again = [make_case(Series("ulog", 1), number) for number in range(150)]
    assert cases == again
    assert len({bytes(c.broken.files["a.ulg"]) for c in cases}) > 130
    assert {c.damage for c in cases} == set(DAMAGES)
    assert {c.way for c in cases} == {READ, FLIGHT}


def _outcomes(monkeypatch: pytest.MonkeyPatch, bad: Any, reader: str = "csv") -> list[Tried]:
    """Try four cases, of which one, the second, ends badly."""
    real = readers.try_case
    worst = make_case(Series(reader, 5), 1).broken

    def one(case: Case, folder: Path) -> Tried:
        if case.broken == worst and case.way != GUARD:
            bad()
        return real(case, folder)

    monkeypatch.setattr(readers, "try_case", one)
    readers.prepare(reader, "")
    return list(readers.try_all(Series(reader, 5), 4))


def _loop() -> None:
    while True:
        pass


def test_a_crash_is_seen_and_the_others_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = _outcomes(monkeypatch, os.abort)
    assert [t.outcome in BAD for t in tried] == [False, True, False, False]
    assert (tried[1].outcome, tried[1].said) == ("crash", "signal 6")


def test_a_hang_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readers, "SECONDS", 0)
    assert [t.outcome for t in _outcomes(monkeypatch, _loop)][1] == "hang"


def test_silence_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readers, "WALL", 0.5)
    assert [t.outcome for t in _outcomes(monkeypatch, lambda: os.read(os.pipe()[0], 1))][1] == "hang"


def test_hunger_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readers, "SWELL", 2**25)
    eat = _outcomes(monkeypatch, lambda: np.ones(2**23))
    assert [t.outcome for t in eat][1] == "memory"


def test_others_code_that_dies_is_contained(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = _outcomes(monkeypatch, os.abort, "matlab")
    assert [t.outcome == CONTAINED for t in tried] == [False, True, False, False]
    assert tried[1].said.startswith("crash: signal 6")


@pytest.mark.parametrize(
    "raised", [ValueError("x"), ZeroDivisionError(), LogError(""), MemoryError(), RecursionError()]
)
def test_what_is_no_error_of_ours_is_a_fault(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, raised: BaseException
) -> None:
    def ask(*_: object) -> None:
        raise raised

    monkeypatch.setattr(readers, "ask", ask)
    assert readers.try_case(make_case(Series("csv", 1), 0), tmp_path).outcome in BAD


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
    cases = (make_case(Series("csv", 1), n) for n in range(99))
    case = next(c for c in cases if c.way == READ)
    assert readers.try_case(case, tmp_path).outcome == "fault"


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


def test_counts_are_those_of_the_cases() -> None:
    result = count_outcomes(Series("csv", 0), 40)
    assert sum(result["counts"].values()) == 40
    findings = show(Setting(1), {"csv": [result]})
    assert all(c.verdict == "holds" for c in findings.claims)
    rows = [row for row in findings.rows if row[0] == "csv"]
    assert sum(int(row[2] or 0) for row in rows) == 40
    assert not any(row[2] for row in findings.rows if row not in rows)


@pytest.mark.parametrize("reader", ["csv", "mapping"])
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
