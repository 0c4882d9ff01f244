"""The committed tables of JSBSim's vehicles, read back and shown as their pages show them."""

from __future__ import annotations

import csv
from collections.abc import Callable

from docs.pages import DOCS
from stoop_studies.findings import number
from stoop_studies.verify.jsbsim import SHARE, SIGMAS


def records(name: str, model: str) -> list[dict[str, str]]:
    """Return the rows of a table whose first column is the model."""
    with (DOCS / "verify" / f"{name}.csv").open(newline="") as file:
        return [row for row in csv.DictReader(file) if next(iter(row.values())) == model]


def _digits(count: int) -> Callable[[str], str]:
    return lambda cell: number(float(cell), count)


def _signed(cell: str) -> str:
    return f"{float(cell):+.1f}".replace("-", "−") if cell else "–"


COLUMNS: dict[str, Callable[[str], str]] = {
    "parameter": str,
    "jsbsim": _digits(4),
    "estimate": _digits(4),
    "sigma": _digits(2),
    "difference_in_sigma": _signed,
    "difference_percent": _signed,
    "agrees": str,
    "flights_that_agree": str,
    "mean_difference_in_sigma": _signed,
}


def shown(name: str, model: str) -> list[tuple[str, ...]]:
    """Return what the page shows of them."""
    rows = [
        {**r, "flights_that_agree": f"{r['flights_that_agree']} of {r['flights']}"}
        for r in records(name, model)
    ]
    return [tuple(form(row[key]) for key, form in COLUMNS.items()) for row in rows]


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
