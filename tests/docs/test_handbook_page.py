"""The page on a priori derivatives says what the committed table says, and the table what is claimed and what the code gives."""

from __future__ import annotations

import csv
import json
from functools import cache

import pytest

from docs.pages import DOCS, table
from stoop.vehicle_draft import handbook as methods
from stoop.vehicle_draft.apriori import METHOD
from stoop.vehicle_draft.geometry import Geometry
from stoop_studies.findings import Findings, Setting
from stoop_studies.verify import handbook

PAGE = DOCS / "handbook.md"


def records() -> list[dict[str, object]]:
    texts = ("airplane", "kind", "derivative")
    with (DOCS / "verify" / "handbook.csv").open(newline="") as file:
        return [
            {k: v if k in texts else (float(v) if v else None) for k, v in row.items()}
            for row in csv.DictReader(file)
        ]


@cache
def findings() -> Findings:
    return handbook.show(Setting(runs=1), {"all": [{"rows": records()}]})


def test_what_is_claimed_holds() -> None:
    assert [c.verdict for c in findings().claims] == ["holds"] * 6
    assert len({r["airplane"] for r in records()}) == len(handbook.airplanes())


def shown(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def test_the_tables_are_those_that_were_written() -> None:
    head, rows = findings().parts["pooled"]
    forms = dict(zip(head, ("", "d", "d", ".2f", ".1f", ".2f", ".1f"), strict=True))
    pooled = [
        tuple(format(cell, form) for cell, form in zip(row, forms.values(), strict=True)) for row in rows
    ]
    assert [tuple(r) for r in table(PAGE, "What holds", "method").rows] == pooled
    airplanes = handbook.by_airplane(records())
    own = [
        (r["airplane"], r["kind"], *(shown(r[f"{m}_rms"], ".2f") for m in handbook.METHODS))
        for r in airplanes
    ]
    assert [tuple(r) for r in table(PAGE, "Each airplane", "airplane").rows] == own
    terms = {row[0]: list(row[1:]) for row in table(PAGE, "Standard deviations", "term").rows}
    assert set(terms) == set(METHOD)
    counted = [r for r in records() if r["kind"] != handbook.UNCOUNTED]
    written = []
    for method in handbook.METHODS:
        given = [r for r in counted if r[f"{method}_z"] is not None]
        written.append({r["derivative"]: r["rms_z"] for r in handbook.by_derivative(given, method)})
    for name, rule in METHOD.items():
        assert terms[name] == [
            f"{rule.share:g}", f"{rule.floor:g}", *(shown(w.get(name), ".2f") for w in written)
        ]  # fmt: skip


@pytest.mark.parametrize("key", [k for k, a in handbook.airplanes().items() if "derivatives" in a])
def test_the_code_gives_what_the_table_says(key: str) -> None:
    airplane = handbook.airplanes()[key]
    rows = [r for r in records() if r["airplane"] == airplane["name"]]
    assert {r["derivative"]: r["published"] for r in rows} == pytest.approx(airplane["derivatives"])
    methods_run = ["sizes"] + (["measured"] if rows[0]["measured"] is not None else [])
    for method in methods_run:
        raw = handbook.sizes(airplane["geometry"]) if method == "sizes" else airplane["geometry"]
        found = methods.derivatives(
            Geometry.of(raw, key), airplane["airspeed"], airplane.get("alpha"), airplane["density"]
        )
        for r in rows:
            a = found[str(r["derivative"])]
            assert [a.value, a.std] == pytest.approx([r[method], r[f"{method}_std"]], rel=1e-6), r[
                "derivative"
            ]


def test_numbers_in_the_text() -> None:
    text = PAGE.read_text(encoding="utf-8")
    counted = [r for r in records() if r["kind"] != handbook.UNCOUNTED]
    airplanes = {r["airplane"] for r in counted}
    measured = {r["airplane"] for r in counted if r["measured"] is not None}
    assert f"{len(airplanes)} airplanes" in text
    assert f"{len(measured)} of them" in text
    assert json.dumps(handbook.RMS)[1:-1].replace(", ", " to ") in text
