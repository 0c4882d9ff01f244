"""The page on hostile inputs says what the committed table says, and the limits that the readers have."""

from __future__ import annotations

import csv

from studies.robustness.trials import BAD

from docs.pages import DOCS, ROOT, table
from stoop.base import toml
from stoop.flight import gridding
from stoop.logs import (
    arrays,
    blackbox,
    blackbox_walk,
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
from stoop.logs.formats import FORMATS
from stoop.optimize import state
from stoop.results import result
from stoop.workflow import archive, load

PAGE = DOCS / "robustness.md"
FAMILIES = (
    "damaged logs", "drawn logs", "readers in a child", "other readers", "round trips", "documents", "verbs", "full disks",
    "kills", "hostile names", "drawn names", "drawn results", "bombs", "odd texts", "odd paths", "limits",
)  # fmt: skip


def records(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / name).open(newline="") as file:
        return list(csv.DictReader(file))


def cases(*families: str, column: str = "cases") -> int:
    return sum(int(r[column]) for r in records("robustness.csv") if r["family"] in (families or FAMILIES))


HEADINGS = {
    "cases": "cases", "refused": "one-line error", "listed": "read, defects listed", "unnoticed": "read, damage undetected",
    "same": "the same as undamaged", "read": "read", "limit": "refused for its memory",
    "contained": "third-party code crashed or hung", "failed": "failed",
}  # fmt: skip  #: column of the table -> heading on the page


def test_the_counts_are_those_of_the_command() -> None:
    found = [[family, *(f"{cases(family, column=key):,}" for key in HEADINGS)] for family in FAMILIES[:6]]
    everything = [f"{cases(column=key):,}" for key in HEADINGS]
    lines = [["", *HEADINGS.values()], ["---"] * (len(HEADINGS) + 1), *found, ["all", *everything]]
    assert "\n".join(f"| {' | '.join(cells)} |" for cells in lines) in PAGE.read_text(encoding="utf-8")


def test_every_family_is_tried_and_described() -> None:
    assert [cells[0] for cells in table(PAGE, "Measured", "what").rows] == list(FAMILIES)
    assert {r["family"] for r in records("robustness.csv")} == set(FAMILIES[:6])
    assert cases(column="failed") == 0


def test_the_counts_of_kinds_are_those_of_the_command() -> None:
    found = records("robustness-kinds.csv")
    families = dict.fromkeys(FAMILIES[8:], 0) | {"all": 0}
    for record in found:
        for family in (record["family"], "all"):
            families[family] += int(record["cases"])
    expected = [[family, f"{count:,}", "0"] for family, count in families.items()]
    assert [list(cells) for cells in table(PAGE, "Measured", "kind").rows] == expected
    assert not any(int(record["failed"]) for record in found)
    assert families["all"] > 20_000


def test_what_others_code_did_was_contained() -> None:
    """The table of the campaign lists failures, and others' code that died."""
    found = [r["outcome"] for r in records("robustness-found.csv")]
    assert set(found) - {"contained"} <= set(BAD)
    assert sum(outcome in BAD for outcome in found) == 15


def test_the_limits_are_those_of_the_code() -> None:
    limits = {cells[0]: " ".join(cells[1:]) for cells in table(PAGE, "Limits", "reader").rows}
    told = {
        "ULog": [f"{ulog.LIMITS.size >> 30} GiB", f"{ulog.LIMITS.memory >> 30} GiB of",
                 f"{ulog.LIMITS.streams // 1000} 000 topics", f"{ulog.LIMITS.columns // 1000} 000 columns"],
        "DataFlash `.bin`": [f"{dataflash.LIMITS.size >> 30} GiB", f"{scan.MAX_LAYOUTS} kinds",
                             f"{dataflash.LIMITS.instances} instances",
                             f"{dataflash.LIMITS.parameters // 1000} 000 parameters"],
        "DataFlash `.log`": [f"{FORMATS['dataflash-text'].most >> 20} MiB", f"{dataflash_text.MAX_KINDS} kinds",
                             f"{dataflash_text.MAX_LINE >> 10} KiB"],
        "Crazyflie": [f"{FORMATS['crazyflie'].most >> 20} MiB", f"{crazyflie.MAX_VARIABLES} variables"],
        "blackbox": [f"{FORMATS['blackbox'].most >> 20} MiB", f"{blackbox.LIMITS.logs} logs",
                     f"{blackbox_walk.MAX_FIELDS} fields"],
        "CSV, plain or packed": [f"{csv_tables.MAX_BYTES >> 20} MiB", f"{csv_tables.MAX_ROWS // 10**6} million lines",
                                 f"{csv_tables.MAX_COLUMNS} columns"],
        "mapping, vehicle, maneuver, windows, geometry": [f"{toml.MAX_BYTES // 10**6} MB", f"tables {toml.MAX_DEPTH} deep",
                                                          f"keys of {toml.MAX_DEPTH} parts"],
        "result.json": [f"{result.MAX_BYTES >> 20} MiB", f"{toml.MAX_DEPTH} deep"],
        "arrays beside `result.json`": [f"{load.MAX_ATTACHED >> 20} MiB", f"{archive.MAX_BYTES >> 20} MiB when"],
        "state of an interrupted search": [f"{state.MAX_BYTES >> 20} MiB"],
        "a flight of stoop's own": [f"{netcdf.MAX_BYTES >> 30} GiB"],
        "MATLAB, netCDF": [f"{matlab.MAX_BYTES >> 30} GiB", f"{arrays.MAX_ARRAYS} arrays", f"{netcdf.MAX_DEPTH} deep"],
        "Parquet": [f"{arrays.MAX_ARRAYS} columns"],
        "ROS bag": [f"{rosbag.MAX_WIDTH} numbers", f"{rosbag.MAX_PARTS // 1000} 000 parts"],
        "MATLAB, netCDF, Parquet, ROS bag": [f"{guard.Limits.memory >> 30} GiB", f"{guard.Limits.seconds} s of"],
        "the grid of a flight": [f"{gridding.LIMITS.cells // 10**6} million", f"{gridding.LIMITS.emptiness:.0f} points",
                                 f"{gridding.LIMITS.emptiness * gridding.LIMITS.counted / 1000:.0f} 000 are"],
    }  # fmt: skip
    assert set(told) == set(limits)
    for reader, words in told.items():
        assert all(word in limits[reader] for word in words), reader
    assert f"at most {arrays.MAX_VALUES // 10**6} million" in PAGE.read_text(encoding="utf-8")


def test_what_goes_unnoticed_is_told_first() -> None:
    """The README says how many damaged logs were read with other numbers and no word."""
    logs, unnoticed = cases("damaged logs"), cases("damaged logs", column="unnoticed")
    assert f"{unnoticed:,} of {logs:,} unnoticed" in (ROOT / "README.md").read_text(encoding="utf-8")
