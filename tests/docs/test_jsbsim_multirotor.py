"""The page on JSBSim's quadrotor says what the committed table says, and the table what is claimed."""

from __future__ import annotations

import csv
from collections.abc import Callable
from typing import Any

import pytest

from docs.pages import DOCS, table
from stoop_studies.verify.jsbsim import SHARE, SIGMAS, parameter_table
from stoop_studies.verify.jsbsim_flight import Subject
from stoop_studies.verify.multirotor import EXPERIMENT, NOISE, RECORDS

PAGE = DOCS / "jsbsim.md"


def records(model: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / "multirotor.csv").open(newline="") as file:
        return [row for row in csv.DictReader(file) if row["recorded"] == model]


def told(model: str) -> list[tuple[Any, ...]]:
    """Return what the page shows of the records of the table."""
    read: dict[str, Callable[[str], Any]] = {
        **dict.fromkeys(("recorded", "parameter"), str),
        **dict.fromkeys(("flights", "flights_that_agree"), int),
        "agrees": "yes".__eq__,
    }
    parsed = [
        {k: read.get(k, lambda cell: float(cell) if cell else None)(v) for k, v in r.items()}
        for r in records(model)
    ]
    return list(parameter_table("", "parameter", parsed).rows)


@pytest.mark.parametrize("record", RECORDS, ids=lambda r: r.model)
def test_the_tables_are_those_that_were_written(record: Subject) -> None:
    assert list(table(PAGE, record.title, "parameter").rows) == told(record.model)


@pytest.mark.parametrize("record", RECORDS, ids=lambda r: r.model)
def test_what_is_said_of_them(record: Subject) -> None:
    rows = records(record.model)
    flights = int(rows[0]["flights"])
    assert flights == EXPERIMENT.runs
    agree = sum(int(r["flights_that_agree"]) for r in rows)
    square = sum(float(r["rms_difference_in_sigma"]) ** 2 for r in rows) / len(rows)
    summary = next(r for r in table(PAGE, "A quadrotor", "recorded").rows if r[0] == record.title)
    assert summary[1:] == (str(len(rows)), f"{agree} of {flights * len(rows)}", f"{square:.2f}")
    for r in rows:
        off = abs(float(r["mean_estimate"]) - float(r["jsbsim"]))
        assert off <= max(SIGMAS * float(r["sigma"]), SHARE * abs(float(r["jsbsim"]))), r["parameter"]


def test_noise() -> None:
    shown = dict(table(PAGE, "A quadrotor", "channels").rows)
    assert {c: float(cell.split()[0]) for cs, cell in shown.items() for c in cs.split(", ")} == NOISE
