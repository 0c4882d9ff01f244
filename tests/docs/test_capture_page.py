"""The page of motion capture: its figures are those of the tables of the study."""

from __future__ import annotations

import csv

import numpy as np

from docs.pages import DOCS, table
from stoop.assessment.covariance import NORMAL_95
from stoop_studies.verify.capture import KINDS
from stoop_studies.verify.made_up import made_up

PAGE = DOCS / "motion-capture.md"
WITHIN = 0.010  #: s
#: numbers of which a flight tells the ratio to the mass
PER_MASS = ("mass.inertia", "rotors.T", "rotors.inflow", "rotors.drag", "body_drag")


def rows(name: str) -> list[dict[str, str]]:
    with (DOCS / "verify" / name).open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_table_is_that_of_the_study() -> None:
    shown = {row[0]: row[1:] for row in table(PAGE, "How well it works", "", "airplanes").rows}
    vehicles = rows("capture-vehicles.csv")
    for column, one in enumerate(rows("capture.csv")):
        said = {name: cells[column] for name, cells in shown.items()}
        share, count = 100.0 * float(one["coverage"]), one["numbers"]
        assert said["95 % intervals that hold the truth"] == f"{share:.1f} % of {count}"
        assert said["rms error, standard errors"].startswith(f"{float(one['rms']):.3g}"[:4].rstrip("0"))
        assert f"{one['far']} of {count} above 5" in said["rms error, standard errors"]
        own = [v for v in vehicles if v["case"] == one["case"]]
        late = [abs(float(v["found"]) - float(v["delay"])) <= WITHIN for v in own if v["found"]]
        assert said["delay of the commands within 10 ms"] == f"{sum(late)} of {len(own)}"
        assert said["verdict right"] == f"{one['right']} of {one['flights']}"
        assert said["stopped on the way"] == one["stopped"]
        times = f"{float(one['seconds']):.0f} s, {float(one['slowest']):.0f} s"
        assert said["from log to report, median and longest"] == times


def test_over_the_mass_that_was_given() -> None:
    """Errors of a quadrotor's numbers, in standard errors, where the truth is that of a vehicle of the mass that was weighed."""
    weighed = [float(row["mass"]) for row in rows("capture-vehicles.csv") if row["case"] == "rotors"]
    errors = []
    for row in rows("capture-numbers.csv"):
        if row["case"] == "rotors" and float(row["identifiable"]) and float(row["std_error"]) > 0.0:
            seed = int(row["vehicle"])
            true = made_up(seed, KINDS["rotors"]).vehicle.value("mass.mass")
            scale = weighed[seed] / true if row["number"].startswith(PER_MASS) else 1.0
            errors.append((float(row["estimate"]) - scale * float(row["truth"])) / float(row["std_error"]))
    z = np.array(errors)
    share, rms = 100.0 * float(np.mean(np.abs(z) <= NORMAL_95)), float(np.sqrt(np.mean(z**2)))
    said = f"{share:.1f} % of the {len(z)} intervals hold the truth, with an rms error of {rms:.2f} and none above 5"
    assert said in PAGE.read_text(encoding="utf-8")
    assert np.abs(z).max() < 5.0
