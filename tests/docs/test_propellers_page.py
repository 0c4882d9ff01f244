"""The page on weak propellers says what the committed tables say, and the tables what is claimed."""

from __future__ import annotations

import csv
import re

from docs.pages import DOCS, ROOT, table
from stoop_studies.findings import number
from stoop_studies.verify.study import vehicle_text

PAGE = DOCS / "propellers.md"


def records(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / name).open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_tables_are_those_that_were_written() -> None:
    shown = table(PAGE, "Real flights", "airframe").rows
    for cells, row in zip(shown, records("propellers-conditions.csv"), strict=True):
        assert list(cells) == [
            row["airframe"], row["condition"], row["suspected"], f"{float(row['chance']):.4f}",
            f"{float(row['factor_m3']):.3f}", f"{float(row['std_error']):.3f}",
            f"{float(row['lowest']):.3f} to {float(row['highest']):.3f}", f"{row['accused_m3']} of {row['flights']}",
            row["verdict"],
        ]  # fmt: skip
    shown = table(PAGE, "Every flight", "airframe").rows
    for cells, row in zip(shown, records("propellers.csv"), strict=True):
        assert list(cells) == [
            row["airframe"], row["condition"], row["log"], f"{float(row['voltage']):.2f}", row["suspected"],
            f"{float(row['chance']):.4f}", f"{float(row['factor_m3']):.3f}", f"{float(row['std_error']):.3f}",
            f"{float(row['left_if_weak']):.1f}", f"{float(row['left_if_mass']):.1f}", row["verdict"],
        ]  # fmt: skip


def test_what_is_said_of_them() -> None:
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    found = records("propellers-conditions.csv")
    cut = [r for r in found if not r["condition"].startswith("weight")]
    flights = [r for r in records("propellers.csv") if r["condition"].endswith("mm")]
    assert all(r["suspected"] == "M3" for r in cut)
    right = sum(r["suspected"] == "M3" for r in flights)
    assert f"M3 explains most after every cut, in {right} of {len(flights)} flights" in text
    accused = sum(r["verdict"] == "propeller or mass near M3" for r in cut)
    assert f"{accused} of {len(cut)} cuts." in text
    by_name = {(r["airframe"], r["condition"]): r for r in found}
    for length in ("41", "39"):
        row = by_name["E8", f"{length} mm"]
        assert f"{float(row['factor_m3']):.3f} ± {float(row['std_error']):.3f} at {length} mm" in text
        low, high = (f"{float(row[k]):.3f}" for k in ("lowest", "highest"))
        assert f"from {low} to {high}" in text or f"between {low} and {high}" in text
    normal = [r for r in records("propellers.csv") if r["condition"] == "normal"]
    assert len(normal) == 8
    assert max(float(r["chance"]) for r in flights) < min(float(r["chance"]) for r in normal), (
        "all cut flights come before all normal ones"
    )
    assert (
        f"all {len(flights)} flights with a cut propeller come before all {len(normal)} normal ones" in text
    )
    assert all(r["verdict"].startswith("as healthy") for r in normal)


def test_the_example_is_what_was_verified() -> None:
    example = ROOT / "examples" / "crazyflie.toml"
    assert example.read_text(encoding="utf-8") == vehicle_text("crazyflie")


def test_the_page_of_the_command_shows_the_tables() -> None:
    html = (DOCS / "verify" / "propellers.html").read_text(encoding="utf-8")
    rows = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>(.*?)</tr>", html)]
    shown = [row for row in rows if len(row) == 13 and row[0] != "airframe"]
    told = [*records("propellers.csv"), *records("propellers-conditions.csv")]
    for cells, row in zip(shown, told, strict=True):
        assert cells == [
            number(float(said), 4) if re.search(r"\d[.e]", said) else said for said in row.values()
        ]
