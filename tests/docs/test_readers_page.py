"""The page on damaged logs says what the committed table says, and the limits that the readers have."""

from __future__ import annotations

import csv
import re

from docs.pages import DOCS, ROOT, table
from stoop.base import toml
from stoop.flight import gridding
from stoop.logs import (
    arrays,
    crazyflie,
    csv_tables,
    dataflash,
    dataflash_text,
    guard,
    matlab,
    netcdf,
    rosbag,
    ulog,
)
from stoop.logs import dataflash_walk as scan
from stoop.report.sheet import Sheet, render_sheet
from stoop_studies.verify.damaged_logs import DAMAGES
from stoop_studies.verify.readers import BAD, GOOD, GUARDED, LEAD
from stoop_studies.verify.sample_logs import SAMPLES

PAGE = DOCS / "robustness.md"


def records(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / name).open(newline="") as file:
        return list(csv.DictReader(file))


def sums(reader: str) -> list[int]:
    rows = [r for r in records("readers.csv") if reader in ("all", r["reader"])]
    return [sum(int(r[key]) for r in rows) for key in ("cases", *GOOD)]


def test_the_table_is_the_one_that_was_written() -> None:
    shown = table(PAGE, "Measured", "reader").rows
    assert [cells[0] for cells in shown] == [*SAMPLES, "all"]
    for cells in shown:
        assert [int(cell.replace(" ", "")) for cell in cells[1:]] == sums(cells[0])


def test_there_are_as_many_as_were_asked_for_and_none_is_bad() -> None:
    rows = records("readers.csv")
    assert len(rows) == len(SAMPLES) * len(DAMAGES)
    assert sum(int(r["cases"]) for r in rows) >= 100_000
    assert all(int(r["cases"]) > 0 for r in rows)
    assert not any(int(r[outcome]) for r in rows for outcome in BAD)


def test_what_others_code_did_was_contained() -> None:
    found = records("readers-found.csv")
    assert {r["outcome"] for r in found} <= {"contained"}
    assert {r["reader"] for r in found} <= set(GUARDED)
    assert len(found) == sum(int(r["contained"]) for r in records("readers.csv"))


def test_the_limits_are_those_of_the_code() -> None:
    limits = {cells[0]: " ".join(cells[1:]) for cells in table(PAGE, "Limits", "reader").rows}
    told = {
        "ULog": [f"{ulog.LIMITS.size >> 30} GiB", f"{ulog.LIMITS.memory >> 30} GiB of",
                 f"{ulog.LIMITS.streams // 1000} 000 topics", f"{ulog.LIMITS.columns // 1000} 000 columns"],
        "DataFlash `.bin`": [f"{scan.MAX_LAYOUTS} kinds", f"{dataflash.LIMITS.instances} instances",
                             f"{dataflash.LIMITS.parameters // 1000} 000 parameters"],
        "DataFlash `.log`": [f"{dataflash_text.MAX_BYTES >> 20} MiB", f"{dataflash_text.MAX_KINDS} kinds",
                             f"{dataflash_text.MAX_LINE >> 10} KiB"],
        "Crazyflie": [f"{crazyflie.MAX_BYTES >> 20} MiB", f"{crazyflie.MAX_VARIABLES} variables"],
        "CSV, plain or packed": [f"{csv_tables.MAX_BYTES >> 20} MiB", f"{csv_tables.MAX_ROWS // 10**6} million lines",
                                 f"{csv_tables.MAX_COLUMNS} columns"],
        "mapping": [f"{toml.MAX_BYTES // 10**6} MB"],
        "a flight of stoop's own": [f"{netcdf.MAX_BYTES >> 30} GiB"],
        "MATLAB, netCDF": [f"{matlab.MAX_BYTES >> 30} GiB", f"{arrays.MAX_ARRAYS} arrays", f"{netcdf.MAX_DEPTH} deep"],
        "Parquet": [f"{arrays.MAX_ARRAYS} columns"],
        "ROS bag": [f"{rosbag.MAX_WIDTH} numbers", f"{rosbag.MAX_PARTS // 1000} 000 parts"],
        "all of the last three rows": [f"{guard.Limits.memory >> 30} GiB", f"{guard.Limits.seconds} s of"],
        "the grid of a flight": [f"{gridding.LIMITS.cells // 10**6} million", f"{gridding.LIMITS.emptiness:.0f} points",
                                 f"{gridding.LIMITS.emptiness * gridding.LIMITS.counted / 1000:.0f} 000 are"],
    }  # fmt: skip
    assert set(told) == set(limits)
    for reader, words in told.items():
        assert all(word in limits[reader] for word in words), reader
    assert f"at most {arrays.MAX_VALUES // 10**6} million" in PAGE.read_text(encoding="utf-8")


def test_the_page_of_the_command_is_as_the_code_writes_it() -> None:
    html = (DOCS / "verify" / "readers.html").read_text(encoding="utf-8")
    assert str(render_lead(LEAD)) in html
    assert "`" not in html
    rows = re.findall(r'<th scope="row">all</th>(.*?)</tr>', html)
    shown = [[int(n) for n in re.findall(r">(\d+)<", row)] for row in rows]
    assert [*sums("all")] in [cells[: 1 + len(GOOD)] for cells in shown]


def render_lead(text: str) -> str:
    """Return the paragraph that a page begins with."""
    page = render_sheet(Sheet("", text, ()))
    return page.partition('<div class="lead">')[2].partition("</div>")[0].strip()


def test_what_goes_unnoticed_is_told_first() -> None:
    """The README says how many damaged logs were read with other numbers and no word."""
    cases, unnoticed = (sum(int(r[key]) for r in records("readers.csv")) for key in ("cases", "unnoticed"))
    assert f"{unnoticed:,} of {cases:,} unnoticed" in (ROOT / "README.md").read_text(encoding="utf-8")
