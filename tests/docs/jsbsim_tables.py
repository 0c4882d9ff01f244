"""The committed tables of JSBSim's vehicles, read back and shown as their pages show them."""

from __future__ import annotations

import csv
from collections.abc import Callable
from typing import Any

from docs.pages import DOCS
from stoop_studies.verify.jsbsim import SHARE, SIGMAS, parameter_table


def records(name: str, model: str) -> list[dict[str, str]]:
    """Return the rows of a table whose first column is the model."""
    with (DOCS / "verify" / f"{name}.csv").open(newline="") as file:
        return [row for row in csv.DictReader(file) if next(iter(row.values())) == model]


def shown(name: str, model: str) -> list[tuple[Any, ...]]:
    """Return what the page shows of them."""
    read: dict[str, Callable[[str], Any]] = {
        **dict.fromkeys(("aircraft", "recorded", "parameter"), str),
        **dict.fromkeys(("flights", "flights_that_agree"), int),
        "agrees": "yes".__eq__,
    }
    parsed = [
        {k: read.get(k, lambda cell: float(cell) if cell else None)(v) for k, v in r.items()}
        for r in records(name, model)
    ]
    return list(parameter_table("", "", parsed).rows)


def check_summary(name: str, model: str, summary: tuple[str, ...], runs: int) -> None:
    """Compare what the text says of a model with its rows: parameters, single estimates, mean square, means."""
    rows = records(name, model)
    assert int(rows[0]["flights"]) == runs
    agree = sum(int(r["flights_that_agree"]) for r in rows)
    square = sum(float(r["rms_difference_in_sigma"]) ** 2 for r in rows) / len(rows)
    assert summary == (str(len(rows)), f"{agree} of {runs * len(rows)}", f"{square:.2f}")
    assert agree >= 0.99 * runs * len(rows)
    for r in rows:
        off = abs(float(r["mean_estimate"]) - float(r["jsbsim"]))
        assert off <= max(SIGMAS * float(r["sigma"]), SHARE * abs(float(r["jsbsim"]))), r["parameter"]
