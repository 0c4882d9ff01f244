"""The page on the hexacopter says what the committed tables say, and its files are those that were verified."""

from __future__ import annotations

import csv
from importlib.resources import files

from docs.pages import DOCS, ROOT, table
from stoop_studies.verify.hexacopter import MAPPING
from stoop_studies.verify.study import vehicle_text

PAGE = DOCS / "hexacopter.md"
AXES = ("ax", "ay", "az")


def records(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / name).open(newline="") as file:
        return list(csv.DictReader(file))


def digits(row: dict[str, str], *names: str) -> list[str]:
    return [f"{float(row[name]):.3f}" for name in names]


def test_the_tables_are_those_that_were_written() -> None:
    numbers = ("model", "constant", "static_thrust", "authors_here", "authors_published")
    shown = table(PAGE, "Results", "fitted").rows
    for cells, row in zip(shown, records("hexacopter.csv"), strict=True):
        assert list(cells) == [row["fitted"], row["window"], row["axis"], *digits(row, *numbers)]
    shown = table(PAGE, "Results", "without").rows
    for cells, row in zip(shown, records("hexacopter-without.csv"), strict=True):
        assert list(cells) == [row["left_out"], *digits(row, *AXES)]
    numbers = ("value", "std_error", "of_whole_flight", "authors")
    shown = table(PAGE, "Comparison with the published coefficients", "quantity").rows
    for cells, row in zip(shown, records("hexacopter-coefficients.csv"), strict=True):
        assert list(cells) == [row["quantity"], row["unit"], *(f"{float(row[n]):.4g}" for n in numbers)]


def test_what_is_said_of_them() -> None:
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    rows = records("hexacopter.csv")
    sprints = {r["axis"]: r for r in rows if r["window"] == "214:260"}
    whole = {r["axis"]: r for r in rows if r["fitted"] == "140:281"}
    for found, name in ((sprints, "model"), (sprints, "authors_here"), (whole, "model")):
        a, b, c = (digits(found[axis], name)[0] for axis in AXES)
        assert f"{a} (ax), {b} (ay) and {c} (az)" in text
    shares = [
        float(r["model"]) / float(r[k]) for r in sprints.values() for k in ("constant", "static_thrust")
    ]
    assert f"at most {max(shares):.2f} is left" in text
    assert all(float(r["model"]) < float(r["authors_here"]) for r in sprints.values())
    assert float(sprints["ax"]["model"]) > float(sprints["ax"]["authors_published"]), "the page says so"
    assert all(float(r["model"]) < float(r["authors_published"]) for r in whole.values())


def test_the_examples_are_what_was_verified() -> None:
    package, name = MAPPING
    mapping = files(package).joinpath(name).read_text(encoding="utf-8")
    for example, text in ((name, mapping), ("hexacopter.toml", vehicle_text("hexacopter"))):
        assert (ROOT / "examples" / example).read_text(encoding="utf-8") == text
    clocks = mapping.partition('extends = "px4"')[2].strip()
    assert clocks in PAGE.read_text(encoding="utf-8").replace("   ", "")
