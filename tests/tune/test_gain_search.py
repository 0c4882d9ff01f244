"""Proposed gains: beside a grid of all gains, over draws, within the noise; files of parameters; what is refused."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from naive.closed_loops import moved_by_noise
from tune.made_up import rolling

from stoop.base.notices import notice
from stoop.errors import StoopError
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.document import with_entries
from stoop_analysis.draws import Draws
from stoop_tune.control_laws.parameters import read_parameters
from stoop_tune.control_laws.table import firmwares
from stoop_tune.gain_search import DAMPING, FARTHEST, SLACK, Design, Specification, propose
from stoop_tune.judgment import Condition
from stoop_tune.proposal import proposal
from stoop_tune.tuning import conditions_of

FLOWN = {"FW_RR_P": 0.05, "FW_RR_I": 0.05, "FW_RR_FF": 0.2, "FW_R_TC": 0.5, "IMU_GYRO_CUTOFF": 30.0,
         "IMU_GYRO_RATEMAX": 200.0, "FW_PR_P": 0.3}  # fmt: skip
GYRO = 1e-6  #: (rad/s)^2/Hz


def design(*damping: float, **specification: float) -> Design:
    conditions, bounds = [Condition(20.0, 1.0, rolling(damping, late=0.04))], Specification(**specification)
    return Design(firmwares(FLOWN)[0], FLOWN, ("roll",), conditions, bounds, {"roll": GYRO})


def least(found: Design, values: dict[str, float]) -> float:
    return float(found.left({**found.flown, **values})[1].min())


def test_more_damping_leaves_less_rejection() -> None:
    """The presets are those of the standards, in order; each proposal keeps its own, and the next rejects less."""
    published = [(4.5, 30.0), (6.0, 45.0), (7.0, 50.0), (8.0, 60.0)]
    assert [(one.gain, one.phase) for one in DAMPING.values()] == published
    assert DAMPING["SAE AS94900"] == Specification()
    rejected = []
    for one in DAMPING.values():
        assert one.disk == pytest.approx(one.gain / 1.5, abs=0.05)
        found = propose(own := design(4.0, 4.0, **vars(one)))
        assert least(own, found) > -SLACK
        rejected.append(float(own.judged({**FLOWN, **found})[0][0].margins.rejection[0]))
    assert rejected == sorted(rejected, reverse=True)
    with pytest.raises(StoopError, match=r"at 20 m/s no gains keep the specification about roll: lower it"):
        propose(design(4.0, 4.0, phase=130.0, gain=60.0))


def test_no_gains_of_a_grid_reject_more() -> None:
    found = propose(own := design(4.0, 4.0))
    # the rate follows at 2 rad/s of the attitude loop: damping over effectiveness, the phase of the servo hardly counts
    assert found["FW_RR_FF"] == pytest.approx(4.0 / 30.0, rel=0.15)
    high = replace(own, flown=FLOWN | {"FW_RR_P": 0.6, "FW_RR_I": 0.6})
    assert least(high, {}) < -0.1
    assert propose(high)["FW_RR_P"] < 0.6, "gains that flew too high come down"
    best = 0.0
    for p, ratio in itertools.product(np.geomspace(0.05, 1.0, 60), np.geomspace(0.5, 10.0, 25)):
        values = {"FW_RR_P": float(p), "FW_RR_I": float(p * ratio), "FW_RR_FF": found["FW_RR_FF"]}
        if p * ratio <= FARTHEST * FLOWN["FW_RR_I"] and least(own, values) >= 0.0:
            (one,) = own.judged({**FLOWN, **values})[0]
            best = max(best, float(np.nan_to_num(one.margins.rejection[0])))
    (one,) = own.judged({**FLOWN, **found})[0]
    assert best > 1.0
    assert one.margins.rejection[0] > 0.97 * best
    assert least(own, found) >= -SLACK


def test_no_axis_gives_up_rejection_for_what_another_misses() -> None:
    """An airplane with coupled axes: about none of them a grid rejects more while every margin of every axis is kept."""
    gains = {"FW_RR_P": 0.4, "FW_RR_I": 0.3, "FW_RR_FF": 0.3, "FW_PR_P": 0.8, "FW_PR_I": 0.6, "FW_PR_FF": 1.0,
             "FW_YR_P": 0.3, "FW_YR_I": 0.1, "FW_YR_FF": 0.0, "FW_AIRSPD_TRIM": 35.0, "FW_AIRSPD_MIN": 20.0,
             "FW_AIRSPD_MAX": 50.0}  # fmt: skip
    throws = {"elevator": ("pitch", -0.35), "aileron": ("roll", 0.35), "rudder": ("yaw", -0.35)}
    entries = {("controls", s, "mix"): {f"control_{axis}": x} for s, (axis, x) in throws.items()}
    entries |= {("controls", s, n): x for s in throws for n, x in (("lag", 0.048), ("delay", 0.036))}
    vehicle, rng = with_entries(builtin_vehicle("twin-boom"), entries), np.random.default_rng(0)
    names = ("Claileron", "Cmelevator", "Clp", "Cmq", "Cnrudder", "controls.aileron.lag")
    drawn = np.column_stack([vehicle.value(n) * (1.0 + 0.03 * rng.standard_normal(60)) for n in names])
    firmware = firmwares(gains)[0]
    conditions = conditions_of(vehicle, firmware, gains, [35.0], 200.0, Draws(names, drawn, "covariance"))
    own = Design(firmware, gains, ("roll", "pitch", "yaw"), conditions, Specification(), {})
    proposed = {**gains, **propose(own)}
    kept = min(0.0, float(own.left(proposed)[1].min()))
    assert kept >= -SLACK
    for i, axis in enumerate(own.axes):
        best, (p, integral) = 0.0, (own.tuned(axis)[term] for term in "PI")
        for share, ratio in itertools.product(np.geomspace(0.2, 9.0, 10), (0.5, 1.0, 2.0)):
            integrated = gains[integral] * min(float(share) * ratio, FARTHEST)
            values = {p: gains[p] * float(share), integral: integrated}
            if own.left({**proposed, **values})[1].min() >= kept:
                best = max(best, float(own.judged({**proposed, **values})[0][i].margins.rejection[0]))
        found = float(own.judged(proposed)[0][i].margins.rejection[0])
        assert found > 0.9 * best > 0.9, axis  # it is searched for 4 dB


def test_less_is_proposed_where_less_is_known() -> None:
    rng, gains = np.random.default_rng(0), []
    for spread in (0.0, 0.4):
        found = propose(own := design(4.0, *(4.0 + spread * rng.standard_normal(40))))
        assert least(own, found) == pytest.approx(0.0, abs=0.03)
        gains.append(found["FW_RR_P"])
    assert gains[1] < gains[0]


def test_noise_is_that_of_the_loop_step_by_step_and_bounds_the_gains() -> None:
    """White noise of a gyro of 200 Hz through the law and the plant, 400 s; the bound is half of what there was."""
    loud = replace(design(4.0, 4.0), noise={"roll": 1e-4})
    loud = replace(loud, flown=FLOWN | {"FW_RR_P": 0.2, "FW_R_TC": 1e9, "IMU_GYRO_CUTOFF": 0.0})
    (one,) = loud.judged(loud.flown)[0]
    A, B = loud.conditions[0].plants.A[0, :2, :2], loud.conditions[0].plants.B[0, :2, 0]
    rms = moved_by_noise(A, B, {"P": 0.2, "I": 0.05}, 200.0, 0.04, np.sqrt(1e-4 * 100.0))
    assert one.noise[0] == pytest.approx(rms, rel=0.03)
    noise = 100.0 * float(one.noise[0])
    found = propose(replace(loud, specification=Specification(noise=0.5 * noise)))
    assert found["FW_RR_P"] < 0.2
    (quiet,) = loud.judged({**loud.flown, **found})[0]
    assert 100.0 * quiet.noise[0] == pytest.approx(0.5 * noise, rel=0.02)


def test_refusals() -> None:
    still = FLOWN | dict.fromkeys(("FW_RR_P", "FW_RR_I", "FW_RR_FF"), 0.0)
    few = {n: x for n, x in FLOWN.items() if n != "FW_RR_I"}
    for flown, said in ((still, "all gains are zero"), (few, "FW_RR_I is missing, so that no gains")):
        with pytest.raises(StoopError, match=said):
            propose(replace(design(4.0), flown=flown))
    with pytest.raises(StoopError, match="phase = -5: write a number above zero"):
        Specification(phase=-5.0)


def test_files_lead_from_the_gains_that_flew_to_the_proposal(tmp_path: Path) -> None:
    own = design(4.0, 4.0)
    found = proposal(own, tuple(own.judged(own.flown)[0]))
    written = {path.name: read_parameters(path) for path in found.save(tmp_path / "tuned")}
    assert list(written) == ["gains-flown.params", *(f"gains-{n}.params" for n in (25, 50, 75, 100))]
    assert written["gains-flown.params"] == {n: FLOWN[n] for n in found.changes}
    assert written["gains-100.params"] == {n: new for n, (_, new) in found.changes.items()}
    rising = [written[f"gains-{n}.params"]["FW_RR_P"] for n in (25, 50, 75, 100)]
    rejection = [row["rejection"] for row in found.trials()]
    assert (rising, rejection) == (sorted(rising), sorted(rejection))
    with pytest.raises(StoopError, match="exists already"):
        found.save(tmp_path / "tuned")
    doubted = replace(found, against=(notice("tune-model-not-for-control", "result"),))
    place = tmp_path / "doubted"
    with pytest.raises(StoopError, match=r"control design; no file is written without --anyway"):
        doubted.save(place)
    assert not place.exists()
    assert doubted.save(place, anyway=True)


def test_gains_of_betaflight_are_whole_and_written_as_commands(tmp_path: Path) -> None:
    flown = {"looptime": 1000.0, "pidsum_limit": 500.0, "rollPID[0]": 30.0, "rollPID[1]": 40.0, "rollPID[2]": 40.0,
             "d_min[0]": 30.0, "gyro_lpf2_static_hz": 250.0, "dterm_lpf1_static_hz": 100.0, "levelPID[0]": 50.0,
             "dterm_lpf2_static_hz": 0.0, "gyro_lpf1_static_hz": 0.0}  # fmt: skip
    hover = Condition(0.0, 1.0, rolling(np.linspace(1.0, 3.0, 20), late=0.01))
    own = Design(firmwares(flown)[0], flown, ("roll",), [hover], Specification(), {"roll": GYRO})
    assert own.loop(flown, "roll", hover).held == "p"  # margins are those of rates without angle mode
    found = proposal(own, tuple(own.judged(flown)[0]))
    assert set(found.changes) <= {"rollPID[0]", "rollPID[1]", "d_min[0]"}
    assert all(new == int(new) and 1.0 <= new <= 250.0 for _, new in found.changes.values())
    assert least(own, {n: new for n, (_, new) in found.changes.items()}) >= -SLACK
    found.save(tmp_path, anyway=True)
    text = (tmp_path / "gains-100.config").read_text(encoding="utf-8").splitlines()
    assert text[0] == f"set p_roll = {found.changes['rollPID[0]'][1]:.0f}"
    assert read_parameters(tmp_path / "gains-100.config") == {n: new for n, (_, new) in found.changes.items()}
