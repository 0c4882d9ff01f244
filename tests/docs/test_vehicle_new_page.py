"""The page of drafted vehicle files: its figures are those of the code."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

import stoop
from docs.by_defaults import PAGE, check_rows, estimate
from docs.pages import ROOT, commands, table
from stoop.cli.main import main
from stoop.flight import Flight, load
from stoop.results.result import read_result
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.load import parse_vehicle
from stoop.vehicle_draft.draft import Drafted
from stoop.vehicle_draft.inertia import PUBLISHED, of_airplane


def page_text() -> str:
    return " ".join(PAGE.read_text(encoding="utf-8").split())


def test_inertias() -> None:
    rows = table(PAGE, "Inertia", "aircraft").rows
    assert [row[0] for row in rows] == list(PUBLISHED)
    for name, template, given, *moments in rows:
        one = PUBLISHED[name]
        sizes = (one.mass, one.span, one.chord)
        assert (template, given) == (one.template, ", ".join(f"{x:.4g}" for x in sizes))
        drafted = of_airplane(one.template, one.mass, one.span, one.chord)
        said = [f"{getattr(one, axis):.3g}, {drafted[axis].value:.3g}" for axis in ("xx", "yy", "zz")]
        assert moments == said


def test_quadrotor_by_defaults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The printed commands give the printed table, within its rounding and half a standard error."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    for command in (c for c in commands(PAGE) if "hover.ulg" in c):
        assert main(shlex.split(command)[1:]) == 0
    drafted, truth = resolve_vehicle("quad.toml"), resolve_vehicle("quad-x")
    found = read_result("result/result.json").parameters
    for name, start, value, error, true in table(PAGE, "A quadrotor by defaults", "parameter").rows:
        one, sigma = found[name], float(error)
        assert drafted.value(name) == pytest.approx(float(start), rel=0.03)
        assert one.estimate == pytest.approx(float(value), abs=0.5 * sigma)
        assert one.std_error == pytest.approx(sigma, rel=0.5)
        assert truth.value(name) == float(true)
        assert abs(one.estimate - float(true)) < 3.0 * sigma


@pytest.fixture(scope="module")
def hexacopter(shared_data: Path) -> Flight:
    return load(shared_data / "altlnt-hexacopter-px4", ROOT / "examples" / "hexacopter_mapping.toml")


@pytest.fixture(scope="module")
def drafted_hexacopter(hexacopter: Flight) -> Drafted:
    return stoop.new_vehicle(hexacopter, template="hexa", mass=1.895, span=0.55)


def test_hexacopter_by_defaults(hexacopter: Flight, drafted_hexacopter: Drafted) -> None:
    text = drafted_hexacopter.text
    (line,) = (line for line in text.splitlines() if line.startswith("# radius ="))
    measured = parse_vehicle(text.replace(line, "radius = 0.11"), "hexa.toml")
    files = (ROOT / "examples" / "hexacopter.toml", drafted_hexacopter.vehicle, measured)
    jobs = [stoop.fit(file, hexacopter, ["140:214"], ["214:260"]) for file in files]
    forces = [job.forces[-1].axes for job in jobs]
    for axis, *cells in table(PAGE, "The hexacopter", "axis").rows:
        found = [*(one[axis].model for one in forces), forces[1][axis].constant, forces[1][axis].static]
        assert found == pytest.approx([float(cell) for cell in cells], rel=0.03), axis
    hand, drafted, _ = (job.result for job in jobs)
    levers = {"accelerometers forward of the center of gravity, m": "x", "accelerometers below it, m": "z"}
    numbers = [
        {said: estimate(result, f"sensors.accelerometer_position.{axis}") for said, axis in levers.items()}
        for result in (hand, drafted)
    ]
    numbers[0]["lag and delay, s"] = estimate(hand, "rotors.lag")
    numbers[1]["lag and delay, s"] = estimate(drafted, "rotors.lag", "rotors.delay")
    check_rows("The hexacopter", *numbers)


def test_the_proposed_windows_of_the_hexacopter(hexacopter: Flight, drafted_hexacopter: Drafted) -> None:
    fitted = [
        "155.8:158.3",
        "214.6:218.9",
        "229.6:234",
        "237.2:240.8",
        "243.8:251.7",
        "253.3:258.5",
        "263.8:271.7",
    ]
    job = stoop.fit(drafted_hexacopter.vehicle, hexacopter, fitted, ["141.9:144.9"])
    az = job.forces[-1].axes["az"]
    said = re.search(r"held back \(141.9:144.9\) with (\S+) m/s2, a constant with (\S+)\.", page_text())
    assert said is not None
    found = [az.model, az.constant]
    assert found == pytest.approx([float(number) for number in said.groups()], rel=0.05)


def test_solar_surfer_by_defaults(shared_data: Path) -> None:
    flight = load(shared_data / "mit-solar-surfer-px4csv")
    drafted = stoop.new_vehicle(flight, mass=9.4, span=4.27, area=1.499)
    (still,) = (found for found in drafted.notices if found.code == "draft-not-excited")
    assert still.values["axes"] == ("roll", "pitch")
    result = stoop.fit(drafted.vehicle, flight, ["1354.2:1360"], ["1184.3:1188"]).result
    unknown = [name for name, one in result.parameters.items() if not one.identifiable or one.at_bound]
    said = re.search(r"Of (\d+) numbers more than (\d+) are not identifiable, `CL0` among them", page_text())
    assert said is not None
    # none or one is held, by the kernels of a BLAS
    held = [one for one in result.notices if one.code == "inertia-held"]
    assert len(result.parameters) + len(held) == int(said[1])
    assert len(unknown) > int(said[2])  # 34 or 41, by the kernels of a BLAS
    assert "CL0" in unknown
    assert result.verdict is not None
    assert result.verdict.grade == "do not use"
