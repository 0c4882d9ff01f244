"""`stoop tune`: margins of gains around the demonstration, its surfaces moved by commands; bad input in one line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from naive.closed_loops import asked_at_random, flown

import stoop
from stoop.assessment.frequency import known
from stoop.cli.main import main
from stoop.control_laws.parameters import read_parameters
from stoop.errors import StoopError
from stoop.vehicle.load import parse_vehicle
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.tuning import JudgedGains, gyro_noise
from tests.unit.tuning.test_flown_loops import px4_log

GAINS = {
    "FW_RR_P": 0.1, "FW_RR_I": 0.1, "FW_RR_FF": 0.3, "FW_PR_P": 0.2, "FW_PR_I": 0.2, "FW_PR_FF": 0.3, "FW_YR_P": 0.1,
    "FW_YR_I": 0.1, "FW_YR_FF": 0.3,
    "FW_AIRSPD_TRIM": 35.0, "FW_AIRSPD_MAX": 50.0, "FW_AIRSPD_MIN": 20.0,
}  # fmt: skip
FLOWN = GAINS | {
    "FW_RR_P": 0.4,
    "FW_RR_I": 0.3,
    "FW_PR_P": 0.8,
    "FW_PR_I": 0.6,
    "FW_YR_P": 0.3,
    "FW_PR_FF": 1.0,
}
LOOP = 100.0  #: Hz
TABLES = 23  #: lines of the gains and trial flights of the page
THROW = {"elevator": ("pitch", -0.35), "aileron": ("roll", 0.35), "rudder": ("yaw", -0.35)}


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tune") / "demo"
    assert main(["demo", "-o", str(folder)]) == 0
    return folder


def moved_by_commands(demo: Path, servo: str = "") -> FittedModel:
    """Return the demonstration with the commands of an autopilot as the channels of its surfaces."""
    model = stoop.load(demo)
    text = model.vehicle.text
    text = text.replace('reduce = "longitudinal"', 'reduce = "full"')
    for surface, (axis, throw) in THROW.items():
        text += f"\n[controls.{surface}]\nmix = {{ control_{axis} = {throw} }}\n{servo}"
    return replace(model, vehicle=parse_vehicle(text, "commanded"))


@pytest.fixture(scope="module")
def commanded(demo: Path) -> FittedModel:
    return moved_by_commands(demo)


@pytest.fixture(scope="module")
def with_servos(demo: Path) -> FittedModel:
    return moved_by_commands(demo, "lag = 0.05\ndelay = 0.03\n")


def test_margins_shrink_with_gains_and_bands_hold_the_estimates(commanded: FittedModel) -> None:
    found = commanded.tune(GAINS, airspeed=(33.0, 38.0), draws=200)
    assert [(one.axis, one.airspeed) for one in found.axes[:3]] == [
        ("roll", 33.0),
        ("pitch", 33.0),
        ("yaw", 33.0),
    ]
    table = found.to_dataframe().set_index(["axis", "airspeed", "figure"])
    finite = table[np.isfinite(table["p95"]) & np.isfinite(table["p5"])]
    assert len(finite) > 20
    assert (finite["p5"] <= finite["p50"]).all()
    assert (finite["p50"] <= finite["p95"]).all()
    more = commanded.tune(GAINS | {"FW_PR_P": 2.0}, airspeed=(33.0, 38.0), draws=200)
    for before, after in zip(found.axes[1::3], more.axes[1::3], strict=True):
        assert after.margins.gain[0] < before.margins.gain[0]
        assert after.margins.crossover[0] > before.margins.crossover[0]


def test_the_example_of_the_page(commanded: FittedModel) -> None:
    page = (Path(__file__).parents[3] / "docs" / "tune.md").read_text(encoding="utf-8")
    shown = page.partition("pitch, 33 m/s\n")[2].partition("```")[0].splitlines()[1:]
    found = next(
        one for one in commanded.tune(GAINS, airspeed=(33.0, 38.0)).axes if one.axis == "pitch"
    ).figures()
    assert len(shown) == len(found)
    for line in shown:
        name, (unit, spread) = next((n, own) for n, own in found.items() if line.startswith(n))
        *numbers, printed = line.removeprefix(name).split()
        assert printed == unit
        assert [float(x) for x in numbers] == pytest.approx(list(spread.values()), rel=2e-3)


def test_the_proposal_of_the_page(
    with_servos: FittedModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (Path(__file__).parents[3] / "docs" / "tune.md").read_text(encoding="utf-8")
    gains = tmp_path / "gains.parm"
    gains.write_text("".join(f"{n},{x}\n" for n, x in FLOWN.items()), encoding="utf-8")
    with_servos.save(tmp_path / "result")
    command = [
        "tune",
        str(tmp_path / "result"),
        str(gains),
        "--airspeed",
        "33:38",
        "-o",
        str(tmp_path / "tuned"),
    ]
    assert main(command) == 0
    printed = capsys.readouterr().out
    shown, said = (
        [line.split() for line in text.partition("Proposed gains\n")[2].splitlines()]
        for text in (page, printed)
    )
    assert len(shown) > TABLES
    for line, found in zip(shown[:TABLES], said[:TABLES], strict=True):
        assert len(line) == len(found)
        for word, other in zip(line, found, strict=True):
            same = word == other or float(word) == pytest.approx(float(other), rel=0.02)
            assert same, (line, found)
    written = read_parameters(tmp_path / "tuned" / "gains-100.params")
    assert "FW_YR_P and FW_YR_I: at 10 times the value that flew" in printed
    assert set(written) == {n for n in FLOWN if n.startswith(("FW_RR", "FW_PR", "FW_YR"))} - {"FW_YR_FF"}
    html = (tmp_path / "tuned" / "tuning.html").read_text(encoding="utf-8")
    for words in (
        "Nichols plot of the pitch loop",
        "Over the airspeed, proposed",
        "Trial flights",
        "FW_PR_P",
    ):
        assert words in html
    assert main(command) == 2
    assert "exists already" in capsys.readouterr().err


def test_physics_stands_beside_the_gains(
    with_servos: FittedModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Printed as on the page, with the reason where the model does not tell; the flown values lead back."""
    flown = {
        "FW_PSP_OFF": 0.0,
        "TRIM_PITCH": 0.02,
        "FW_T_SINK_MIN": 2.0,
        "FW_THR_TRIM": 0.6,
        "TRIM_ROLL": 0.0,
    }
    gains = tmp_path / "gains.parm"
    gains.write_text("".join(f"{n},{x}\n" for n, x in (FLOWN | flown).items()), encoding="utf-8")
    with_servos.save(tmp_path / "result")
    command = ["tune", str(tmp_path / "result"), str(gains), "--airspeed", "33:38"]
    assert main([*command, "-o", str(tmp_path / "tuned")]) == 0
    page = (Path(__file__).parents[3] / "docs" / "tune.md").read_text(encoding="utf-8")
    shown, said = (
        text.partition("Parameters that are physics\nparameter")[2].splitlines()[1:6]
        for text in (page, capsys.readouterr().out)
    )
    for line, found in zip(shown, said, strict=True):
        for word, other in zip(line.split(), found.split(), strict=True):
            assert word == other or float(word) == pytest.approx(float(other), rel=0.1), (line, found)
    written, before = (
        read_parameters(tmp_path / "tuned" / f"gains-{step}.params") for step in ("25", "flown")
    )
    assert written["TRIM_PITCH"] == pytest.approx(0.055, abs=1e-3)
    assert {n: before[n] for n in written.keys() & flown.keys()} == {
        n: flown[n] for n in ("FW_PSP_OFF", "TRIM_PITCH", "FW_T_SINK_MIN")
    }
    html = (tmp_path / "tuned" / "tuning.html").read_text(encoding="utf-8")
    assert "Parameters that are physics" in html
    assert "FW_THR_TRIM: not from this model; the thrust is not modeled over a throttle" in html
    assert main([*command, "--json", "--draws", "100"]) == 0
    rows = json.loads(capsys.readouterr().out)["physics"]
    assert [row["parameter"] for row in rows] == ["FW_PSP_OFF", "TRIM_PITCH", "FW_T_SINK_MIN"]
    assert list(with_servos.tune(FLOWN | flown, draws=100).physics.to_dataframe()["unit"]) == [
        "deg",
        "1",
        "m/s",
    ]


def test_the_page_of_flown_gains_alone(commanded: FittedModel, tmp_path: Path) -> None:
    judged = commanded.tune(GAINS, airspeed=(33.0, 38.0), draws=100)
    html = judged.page().save(tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Over the airspeed, flown" in html
    assert "Trial flights" not in html
    assert html.count("Nichols plot of the") == 3


def fly_by(judged: JudgedGains, path: Path, seconds: float = 100.0) -> Path:
    """Write the log of a pilot who moves all sticks at random, flown step by step by the judged model at the first airspeed."""
    values, plants = judged.design.flown, judged.design.conditions[0].plants
    states, gains, held = plants.states, [], np.zeros((3, len(plants.states)))
    for i, (name, angle) in enumerate((("RR", "phi"), ("PR", "theta"), ("YR", ""))):
        gains.append({t: values[f"FW_{name}_{t}"] for t in ("P", "I", "FF")})
        if angle:
            held[i, states.index(angle)] = 2.5
    asked = asked_at_random(round(seconds * LOOP), 3, LOOP, 0, 0.2)
    rates = [states.index(rate) for rate in "pqr"]
    return px4_log(path, flown(plants.A[0], plants.B[0], rates, gains, LOOP, 3, asked, held), values)


def test_the_closed_loops_of_a_log(
    with_servos: FittedModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Flown step by step by the model itself it agrees; with surfaces 30 % weaker in the model it does not."""
    values = FLOWN | {
        "IMU_GYRO_RATEMAX": LOOP, "IMU_GYRO_CUTOFF": 0.0, "IMU_DGYRO_CUTOFF": 0.0, "FW_ARSP_SCALE_EN": 0.0,
        **{f"FW_{axis}_IMAX": 10.0 for axis in ("RR", "PR", "YR")},
    }  # fmt: skip
    alone = with_servos.tune(values, airspeed=(35.0, 35.0), draws=100)
    assert alone.closed_loops is None
    assert "parameters alone: the closed loop that flew is not shown" in "".join(map(str, alone.notices))
    log = fly_by(alone, tmp_path / "log.ulg")
    judged = with_servos.tune(log, airspeed=(35.0, 35.0), draws=100)
    assert judged.closed_loops is not None
    assert [(r.input, r.output) for r in judged.closed_loops.responses] == [
        ("roll", "p"),
        ("pitch", "q"),
        ("yaw", "r"),
    ]
    assert not [one for one in judged.notices if one.code.startswith("tune-loop")]
    for one in judged.closed_loops.responses:
        model = judged.closed_loops.model[one.input, one.output].response
        good = known(one) & (one.frequency > 1.0) & (one.frequency < 15.0)
        assert good.sum() > 20
        assert np.median(np.abs(one.response / model - 1.0)[good]) < 0.05
    html = judged.page().save(tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Closed loops in flight" in html
    for axis, rate in zip(("roll", "pitch", "yaw"), "pqr", strict=True):
        assert f"Response of {rate} to {axis}" in html
    weak = with_servos.vehicle
    for throw, less in ((-0.35, -0.25), (0.35, 0.25)):
        weak = parse_vehicle(weak.text.replace(f" = {throw} ", f" = {less} "), "weak")
    replace(with_servos, vehicle=weak).save(tmp_path / "weak")
    command = ["tune", str(tmp_path / "weak"), str(log), "--airspeed", "34.9:35.1", "--draws", "100"]
    assert main([*command, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    doubts = [one for one in document["notices"] if one["code"] == "tune-loop-contradicted"]
    assert {one["values"]["axis"] for one in doubts} >= {"roll", "pitch"}
    assert len(document["closed_loops"]["responses"]) == 3
    assert main([*command, "-o", str(tmp_path / "tuned")]) == 2
    assert "model, delays or law are not to be trusted" in capsys.readouterr().err
    assert not (tmp_path / "tuned").exists()


def test_gains_that_cannot_have_flown_are_refused(commanded: FittedModel) -> None:
    with pytest.raises(
        StoopError, match=r"at 33 m/s the loops of roll, pitch, yaw are unstable with these gains"
    ):
        commanded.tune(GAINS | {"FW_PR_P": 200.0}, airspeed=(33.0, 38.0), draws=200)


def test_what_speaks_against_a_proposal_leaves_no_file(
    with_servos: FittedModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A law with a feature that is not modeled; a band of the flight that ends below the crossover of what is proposed."""
    with_servos.save(tmp_path / "result")
    gains = tmp_path / "gains.parm"
    gains.write_text(
        "".join(f"{n},{x}\n" for n, x in (FLOWN | {"IMU_GYRO_DNF_EN": 1.0}).items()), encoding="utf-8"
    )
    command = ["tune", str(tmp_path / "result"), str(gains), "--airspeed", "33:38", "--draws", "100"]
    assert main([*command, "-o", str(tmp_path / "tuned")]) == 2
    assert "IMU_GYRO_DNF_EN" in capsys.readouterr().err
    assert not (tmp_path / "tuned").exists()
    assert main([*command, "--page", str(tmp_path / "flown")]) == 0
    assert "Gains that flew." in (tmp_path / "flown.html").read_text(encoding="utf-8")
    assert main([*command, "--page", str(tmp_path / "flown")]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main([*command, "--anyway"]) == 2
    assert "name a folder for it with -o" in capsys.readouterr().err
    judged = with_servos.tune(FLOWN, airspeed=(33.0, 38.0), draws=100)
    found = replace(judged, band={"pitch": 5.0}).propose()
    assert [one.code for one in found.against] == ["tune-beyond-band"]
    with pytest.raises(StoopError, match=r"pitch loop crosses at .* shows the answer up to 5 rad/s only"):
        found.save(tmp_path / "tuned")


def test_unknown_noise_is_told(with_servos: FittedModel) -> None:
    """The demonstration recorded q alone."""
    found = with_servos.tune(FLOWN, airspeed=(33.0, 38.0), draws=100)
    assert "noise of the gyro about roll and yaw" in "".join(map(str, found.notices))


@pytest.mark.parametrize("rate", [100.0, 400.0])
def test_the_noise_of_a_gyro_is_found_behind_the_low_pass_of_the_grid(rate: float, tmp_path: Path) -> None:
    rng, time = np.random.default_rng(0), np.arange(0.0, 60.0, 1.0 / rate)
    rows = np.column_stack([time, 0.02 * rng.standard_normal((len(time), 3))])
    log = tmp_path / "log.csv"
    np.savetxt(log, rows, delimiter=",", header="time,p,q,r", comments="", fmt="%.6f")
    (tmp_path / "log.csv.toml").write_text(
        '[time]\ncolumn = "time"\nunit = "s"\n[variables]\n'
        + "".join(f'{n} = {{column = "{n}", unit = "rad/s"}}\n' for n in "pqr")
    )
    found = gyro_noise([stoop.load_flight(log)])
    assert found == pytest.approx(dict.fromkeys(("roll", "pitch", "yaw"), 0.02**2 / (0.5 * rate)), rel=0.15)


def test_a_model_of_another_kind_is_refused(commanded: FittedModel) -> None:
    with pytest.raises(StoopError, match="those of PX4 multicopter, but the vehicle flies on wings"):
        commanded.tune({"MC_ROLLRATE_P": 0.1})


def test_what_a_law_leaves_out_is_told(commanded: FittedModel) -> None:
    found = commanded.tune(GAINS | {"IMU_GYRO_DNF_EN": 1.0}, airspeed=(33.0, 38.0), draws=200)
    assert "IMU_GYRO_DNF_EN" in "".join(map(str, found.notices))


def test_command_line(commanded: FittedModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    commanded.save(tmp_path / "result")
    gains = tmp_path / "gains.params"
    gains.write_text(
        "# Onboard\n" + "".join(f"1\t1\t{n}\t{x}\t9\n" for n, x in GAINS.items()), encoding="utf-8"
    )
    assert main(["tune", str(tmp_path / "result"), str(gains), "--draws", "200", "--airspeed", "33:38"]) == 0
    printed = capsys.readouterr().out
    for words in (
        "PX4 fixed wing",
        "200 draws from the covariance",
        "roll, 33 m/s",
        "phase margin",
        "disk margin",
    ):
        assert words in printed
    assert (
        main(
            ["tune", str(tmp_path / "result"), str(gains), "--draws", "200", "--airspeed", "33:38", "--json"]
        )
        == 0
    )
    document = json.loads(capsys.readouterr().out)
    assert {one["axis"] for one in document["loops"]} == {"roll", "pitch", "yaw"}


def test_bad_input_is_one_line(demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The demonstration records deflections: no command of an autopilot moves them."""
    gains = tmp_path / "gains.parm"
    for content, said in (
        ("".join(f"{n},{x}\n" for n, x in GAINS.items()), "no surface moves by"),
        ("FW_RR_P -0.1\n", "FW_RR_P = -0.1: it must be a number of at least 0"),
        ("", "is empty"),
        ("nothing here\n", "holds no parameters of an autopilot"),
        ("FW_RR_P,nan\n", "FW_RR_P = nan"),
    ):
        gains.write_text(content, encoding="utf-8")
        assert main(["tune", str(demo), str(gains)]) == 2
        complaint = capsys.readouterr().err
        assert said in complaint, (content, complaint)
        assert complaint.count("\n") == 1


def test_parameters_are_read_from_files_of_both_ground_stations(tmp_path: Path) -> None:
    expected = {"RLL_RATE_P": 0.08, "SCHED_LOOP_RATE": 50.0}
    (tmp_path / "a.parm").write_text("RLL_RATE_P,0.08\nSCHED_LOOP_RATE 50 # Hz\n", encoding="utf-8")
    (tmp_path / "b.params").write_text(
        "# x\n1\t1\tRLL_RATE_P\t0.08\t9\n1 1 SCHED_LOOP_RATE 50 6\n", encoding="utf-8"
    )
    assert read_parameters(tmp_path / "a.parm") == expected
    assert read_parameters(tmp_path / "b.params") == expected
