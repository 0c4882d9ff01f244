"""A log of a real ArduPilot: every number as pymavlink has it; cut anywhere, damaged anywhere."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from naive.dataflash import same_as_pymavlink

from stoop.errors import LogError
from stoop.logs import read
from stoop.logs.dataflash import parse_dataflash


@pytest.fixture
def sample(shared_data: Path) -> Path:
    return shared_data / "ardupilot-dataflash-sample" / "test.BIN"


def test_the_same_numbers_as_pymavlink(sample: Path) -> None:
    recording = read(sample)
    assert same_as_pymavlink(recording, sample) == 7164
    assert [str(d) for d in recording.defects] == ["test.BIN byte 65512: the last message is cut"]
    assert recording.info["firmware"] == "ArduPlane V3.8.2-dev (8178ab40)"
    assert recording.parameters["ARSPD_FBW_MAX"] == 22.0


def test_cut_anywhere(sample: Path) -> None:
    whole = sample.read_bytes()
    rows = []
    for end in np.linspace(1, len(whole), 40).astype(int):
        try:
            recording = parse_dataflash(sample, whole[:end])
            rows.append(sum(stream.time.size for stream in recording.streams.values()))
        except LogError as error:
            assert "\n" not in str(error)  # noqa: PT017  both outcomes are right
            rows.append(0)
    assert rows == sorted(rows)
    assert rows[-1] == 784


def test_damaged_anywhere(sample: Path) -> None:
    whole = sample.read_bytes()
    rng = np.random.default_rng(5)
    for _ in range(40):
        content = bytearray(whole)
        for place in rng.integers(0, len(whole) if rng.random() < 0.5 else 12_000, size=30):
            content[place] = rng.integers(0, 256)
        with suppress(LogError):
            recording = parse_dataflash(sample, bytes(content))
            assert recording.defects
