"""The page on JSBSim's quadrotor says what the committed table says, and the table what is claimed."""

from __future__ import annotations

import pytest

from docs.jsbsim_tables import check_summary, shown
from docs.pages import DOCS, table
from stoop_studies.verify.jsbsim_flight import Subject
from stoop_studies.verify.multirotor import EXPERIMENT, NOISE, RECORDS

PAGE = DOCS / "jsbsim.md"


@pytest.mark.parametrize("record", RECORDS, ids=lambda r: r.model)
def test_the_tables_are_those_that_were_written(record: Subject) -> None:
    assert list(table(PAGE, record.title, "parameter").rows) == shown("multirotor", record.model)


@pytest.mark.parametrize("record", RECORDS, ids=lambda r: r.model)
def test_what_is_said_of_them(record: Subject) -> None:
    summary = next(r for r in table(PAGE, "A quadrotor", "recorded").rows if r[0] == record.title)
    check_summary("multirotor", record.model, summary[1:], EXPERIMENT.runs)


def test_noise() -> None:
    listed = dict(table(PAGE, "A quadrotor", "channels").rows)
    assert {c: float(cell.split()[0]) for cs, cell in listed.items() for c in cs.split(", ")} == NOISE
