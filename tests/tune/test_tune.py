"""`stoop tune`: margins of gains around the demonstration, its surfaces moved by commands."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.command_line import Done, Refused
from naive.closed_loops import asked_at_random, flown
from tune.test_flown_loops import px4_log

import stoop
from stoop.cli.main import main
from stoop.errors import StoopError
from stoop.vehicle.load import parse_vehicle
from stoop.workflow.fitted_model import FittedModel
from stoop_analysis.frequency import known
from stoop_tune.control_laws.parameters import read_parameters
from stoop_tune.tuning import JudgedGains, gyro_noise

GAINS = {
    "FW_RR_P": 0.1, "FW_RR_I": 0.1, "FW_RR_FF": 0.3, "FW_PR_P": 0.2, "FW_PR_I": 0.2, "FW_PR_FF": 0.3, "FW_YR_P": 0.1,
    "FW_YR_I": 0.1, "FW_YR_FF": 0.3,
    "FW_AIRSPD_TRIM": 35.0, "FW_AIRSPD_MAX": 50.0, "FW_AIRSPD_MIN": 20.0,
}  # fmt: skip
FLOWN = GAINS | {
    "FW_RR_P": 0.4, "FW_RR_I": 0.3, "FW_PR_P": 0.8, "FW_PR_I": 0.6, "FW_YR_P": 0.3, "FW_PR_FF": 1.0,
}  # fmt: skip
#: parameters of PX4 that are physics, as flown
PHYSICS = {"FW_PSP_OFF": 0.0, "TRIM_PITCH": 0.02, "FW_T_SINK_MIN": 2.0, "FW_THR_TRIM": 0.6, "TRIM_ROLL": 0.0}
LOOP = 100.0  #: Hz
THROW = {"elevator": ("pitch", -0.35), "aileron": ("roll", 0.35), "rudder": ("yaw", -0.35)}
SERVO = "lag = 0.05\ndelay = 0.03\n"


def moved_by_commands(demo: Path, servo: str = "") -> FittedModel:
    """Return the demonstration with the commands of an autopilot as the channels of its surfaces."""
    model = stoop.load(demo)
    text = model.vehicle.text.replace('reduce = "longitudinal"', 'reduce = "full"')
    for surface, (axis, throw) in THROW.items():
        text += f"\n[controls.{surface}]\nmix = {{ control_{axis} = {throw} }}\n{servo}"
    return replace(model, vehicle=parse_vehicle(text, "commanded"))


def write(values: dict[str, float], path: Path) -> Path:
    path.write_text("".join(f"{n},{x}\n" for n, x in values.items()), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def commanded(fitted: Path) -> FittedModel:
    return moved_by_commands(fitted)


@pytest.fixture(scope="module")
def servos(fitted: Path) -> FittedModel:
    return moved_by_commands(fitted, SERVO)


def test_bands_hold_the_estimates_and_doubts_are_told(commanded: FittedModel, tmp_path: Path) -> None:
    judged = commanded.tune(GAINS | {"IMU_GYRO_DNF_EN": 1.0}, airspeed=(33.0, 38.0), draws=100)
    first = [(one.axis, one.airspeed) for one in judged.axes[:3]]
    assert first == [(axis, 33.0) for axis in ("roll", "pitch", "yaw")]
    table = judged.to_dataframe().set_index(["axis", "airspeed", "figure"])
    finite = table[np.isfinite(table["p95"]) & np.isfinite(table["p5"])]
    assert len(finite) > 20
    assert (finite["p5"] <= finite["p50"]).all()
    assert (finite["p50"] <= finite["p95"]).all()
    notices = "".join(map(str, judged.notices))
    assert "IMU_GYRO_DNF_EN" in notices
    assert "noise of the gyro about roll and yaw" in notices
    html = judged.page().save(tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Over the airspeed, flown" in html
    assert "Trial flights" not in html
    assert html.count("Nichols plot of the") == 3


def test_gains_that_cannot_have_flown_or_are_of_another_kind(commanded: FittedModel) -> None:
    unstable = r"at 33 m/s the loops of roll, pitch, yaw are unstable with these gains"
    with pytest.raises(StoopError, match=unstable):
        commanded.tune(GAINS | {"FW_PR_P": 200.0}, airspeed=(33.0, 33.0), draws=100)
    with pytest.raises(StoopError, match="those of PX4 multicopter, but the vehicle flies on wings"):
        commanded.tune({"MC_ROLLRATE_P": 0.1})


def test_bad_input_is_one_line(fitted: Path, refused: Refused) -> None:
    gains = Path("gains.parm")
    for content, said in (
        ("".join(f"{n},{x}\n" for n, x in GAINS.items()), "no surface moves by"), ("FW_RR_P,nan\n", "FW_RR_P = nan"),
        ("FW_RR_P -0.1\n", "FW_RR_P = -0.1: it must be a number of at least 0"), ("", "is empty"),
        ("nothing here\n", "holds no parameters of an autopilot"),
    ):  # fmt: skip
        gains.write_text(content, encoding="utf-8")
        assert said in refused(f"tune {fitted} {gains}")


def test_parameters_are_read_from_files_of_both_ground_stations(tmp_path: Path) -> None:
    for text in ("RLL_RATE_P,0.08\nLOOP 50 # Hz\n", "# x\n1\t1\tRLL_RATE_P\t0.08\t9\n1 1 LOOP 50 6\n"):
        (tmp_path / "a.parm").write_text(text, encoding="utf-8")
        assert read_parameters(tmp_path / "a.parm") == {"RLL_RATE_P": 0.08, "LOOP": 50.0}


@pytest.mark.parametrize("rate", [100.0, 400.0])
def test_the_noise_of_a_gyro_is_found_behind_the_low_pass_of_the_grid(rate: float, tmp_path: Path) -> None:
    rng, time = np.random.default_rng(0), np.arange(0.0, 60.0, 1.0 / rate)
    rows = np.column_stack([time, 0.02 * rng.standard_normal((len(time), 3))])
    log = tmp_path / "log.csv"
    np.savetxt(log, rows, delimiter=",", header="time,p,q,r", comments="", fmt="%.6f")
    columns = "".join(f'{n} = {{column = "{n}", unit = "rad/s"}}\n' for n in "pqr")
    (tmp_path / "log.csv.toml").write_text(f'[time]\ncolumn = "time"\nunit = "s"\n[variables]\n{columns}')
    found = gyro_noise([stoop.load_flight(log)])
    assert found == pytest.approx(dict.fromkeys(("roll", "pitch", "yaw"), 0.02**2 / (0.5 * rate)), rel=0.15)


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


def test_the_closed_loops_of_a_log(servos: FittedModel, tmp_path: Path, done: Done) -> None:
    """Flown step by step by the model itself it agrees; with surfaces 30 % weaker in the model it does not."""
    values = FLOWN | {
        "IMU_GYRO_RATEMAX": LOOP, "IMU_GYRO_CUTOFF": 0.0, "IMU_DGYRO_CUTOFF": 0.0, "FW_ARSP_SCALE_EN": 0.0,
        **{f"FW_{axis}_IMAX": 10.0 for axis in ("RR", "PR", "YR")},
    }  # fmt: skip
    alone = servos.tune(values, airspeed=(35.0, 35.0), draws=100)
    assert alone.closed_loops is None
    assert "parameters alone: the closed loop that flew is not shown" in "".join(map(str, alone.notices))
    log = fly_by(alone, tmp_path / "log.ulg")
    judged = servos.tune(log, airspeed=(35.0, 35.0), draws=100)
    assert judged.closed_loops is not None
    pairs = [(r.input, r.output) for r in judged.closed_loops.responses]
    assert pairs == [("roll", "p"), ("pitch", "q"), ("yaw", "r")]
    assert not [one for one in judged.notices if one.code.startswith("tune-loop")]
    for one in judged.closed_loops.responses:
        model = judged.closed_loops.model[one.input, one.output].response
        good = known(one) & (one.frequency > 1.0) & (one.frequency < 15.0)
        assert good.sum() > 20
        assert np.median(np.abs(one.response / model - 1.0)[good]) < 0.05
    html = judged.page().save(tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Closed loops in flight" in html
    for axis, rate in pairs:
        assert f"Response of {rate} to {axis}" in html
    weak = servos.vehicle
    for throw, less in ((-0.35, -0.25), (0.35, 0.25)):
        weak = parse_vehicle(weak.text.replace(f" = {throw} ", f" = {less} "), "weak")
    replace(servos, vehicle=weak).save(tmp_path / "weak")
    command = f"tune {tmp_path / 'weak'} {log} --airspeed 34.9:35.1 --draws 100"
    document = json.loads(done(f"{command} --json"))
    doubts = [one for one in document["notices"] if one["code"] == "tune-loop-contradicted"]
    assert {one["values"]["axis"] for one in doubts} >= {"roll", "pitch"}
    assert len(document["closed_loops"]["responses"]) == 3
    assert {one["axis"] for one in document["loops"]} == {"roll", "pitch", "yaw"}
    assert main([*command.split(), "-o", str(tmp_path / "tuned")]) == 2
    assert not (tmp_path / "tuned").exists()


def test_a_proposal_and_the_physics_beside_it(servos: FittedModel, tmp_path: Path, done: Done) -> None:
    """Files at shares of the way from the gains that flew, whose last step leads back to the flown values."""
    gains, out = write(FLOWN | PHYSICS, tmp_path / "gains.parm"), tmp_path / "tuned"
    servos.save(tmp_path / "result")
    command = f"tune {tmp_path / 'result'} {gains} --airspeed 33:38 -o {out}"
    printed = done(command)
    for words in (
        "PX4 fixed wing", "draws from the covariance", "roll, 33 m/s", "phase margin", "disk margin", "Proposed gains",
        "that are physics", "FW_YR_P and FW_YR_I: at 10 times the value that flew",
    ):  # fmt: skip
        assert words in printed
    full, quarter, before = (read_parameters(out / f"gains-{n}.params") for n in ("100", "25", "flown"))
    rates = {n for n in FLOWN if n.startswith(("FW_RR", "FW_PR", "FW_YR"))} - {"FW_YR_FF"}
    assert rates <= set(full)
    assert full["FW_PR_P"] > FLOWN["FW_PR_P"]
    assert quarter["TRIM_PITCH"] == pytest.approx(0.055, abs=1e-3)
    known_physics = {"FW_PSP_OFF", "TRIM_PITCH", "FW_T_SINK_MIN"}
    assert {n: before[n] for n in quarter.keys() & PHYSICS.keys()} == {n: PHYSICS[n] for n in known_physics}
    html = (out / "tuning.html").read_text(encoding="utf-8")
    missing = "FW_THR_TRIM: not from this model; the thrust is not modeled over a throttle"
    for words in ("Nichols plot of the pitch loop", "Over the airspeed, proposed", "Trial flights", missing):
        assert words in html
    assert main(command.split()) == 2, "files are not written over"


def test_what_speaks_against_gains_leaves_no_file(servos: FittedModel, refused: Refused, done: Done) -> None:
    """A law with a feature that is not modeled; a band of the flight that ends below the crossover of what is proposed."""
    servos.save(Path("result"))
    write(FLOWN | {"IMU_GYRO_DNF_EN": 1.0}, Path("gains.parm"))
    command = "tune result gains.parm --airspeed 33:38 --draws 100"
    assert "IMU_GYRO_DNF_EN" in refused(f"{command} -o tuned")
    done(f"{command} --page flown")
    assert "Gains that flew." in Path("flown.html").read_text(encoding="utf-8")
    assert "exists already" in refused(f"{command} --page flown")
    assert "name a folder for it with -o" in refused(f"{command} --anyway")
    found = replace(servos.tune(FLOWN, airspeed=(33.0, 38.0), draws=100), band={"pitch": 5.0}).propose()
    assert [one.code for one in found.against] == ["tune-beyond-band"]
    with pytest.raises(StoopError, match=r"pitch loop crosses at .* shows the answer up to 5 rad/s only"):
        found.save("tuned")
