"""Cut propellers of real quadrotors: what `stoop verify propellers` says, and what it rests on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.cli.main import main
from stoop.errors import StoopError
from stoop.logs import read
from stoop_studies.findings import Findings, Setting
from stoop_studies.verify.propellers import EXPERIMENT, FOLDER, read_flights

COMMITTED = Path(__file__).parents[2] / "docs" / "verify"


@pytest.fixture(scope="module")
def findings(shared_data: Path) -> Findings:
    return EXPERIMENT.findings(Setting(1, data=shared_data), {})


@pytest.mark.parametrize("part", ["", "conditions"])
def test_the_committed_tables_are_made_again(findings: Findings, part: str) -> None:
    name = f"propellers-{part}.csv" if part else "propellers.csv"
    written = (COMMITTED / name).read_text(encoding="utf-8").splitlines()
    made = (findings.part(part) if part else findings.csv).splitlines()
    for one, other in zip(written, made, strict=True):
        for a, b in zip(one.split(","), other.split(","), strict=True):
            assert a == b or abs(float(a) - float(b)) < 0.02 + 0.02 * abs(float(a))


def test_the_cut_rotor_is_suspected_after_every_cut_and_no_healthy_flight_is_accused(
    findings: Findings,
) -> None:
    verdicts = {claim.statement: claim.verdict for claim in findings.claims}
    assert verdicts["The rotor that was cut is the one that explains most, after every cut"] == "holds"
    assert verdicts["No normal flight is accused, each compared with the others"] == "holds"
    assert verdicts["Of every weight near M3 it is said: propeller or mass near M3"] == "holds"


def test_the_firmware_corrects_for_the_battery_as_the_example_says(shared_data: Path) -> None:
    for path in sorted((shared_data / FOLDER).glob("*.usd"))[::6]:
        columns = read(path).streams["fixedFrequency"].columns
        flying = columns["stateEstimate.z"] > 0.5
        grams = columns["motor.m3"][flying] / 65536.0 * 60.0
        asked = 0.088 * grams - 0.0006239 * grams**2
        given = columns["pwm.m3_pwm"][flying] / 65535.0 * columns["pm.vbatMV"][flying] * 1e-3
        assert np.median(np.abs(given / asked - 1.0)) < 0.01


def test_a_folder_without_the_flights_is_said(tmp_path: Path) -> None:
    with pytest.raises(StoopError, match="holds none of its flights"):
        read_flights(tmp_path)


def test_the_page_shows_the_loss_and_the_flights(shared_data: Path, tmp_path: Path) -> None:
    logs = shared_data / "crazypad-propeller-damage"
    cut, *healthy = (
        str(logs / f"{n}.usd")
        for n in (
            "cut_propeller_M3_2mm_2mm_43mm__E8_log03",
            *(f"normal_flight__E8_log0{i}" for i in range(3)),
        )
    )
    page = tmp_path / "rotors.html"
    vehicle = Path(__file__).parents[2] / "examples" / "crazyflie.toml"
    assert main(["rotors", cut, "--healthy", *healthy, "--vehicle", str(vehicle), "-o", str(page)]) == 0
    text = page.read_text("utf-8")
    assert "propeller or mass near M3" in text
    assert text.count("Time histories of") == 4
    assert text.index("Time histories of cut_") < text.index("Time histories of normal_")
