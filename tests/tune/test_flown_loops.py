"""Closed loops that logs show: beside loops step by step, in gusts under an attitude loop, and beside wrong models."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from naive.closed_loops import asked_at_random, flown
from tune.made_up import rolling

from stoop.base.notices import Notice
from stoop.flight.frequency_responses import FrequencyResponse, Stretch
from stoop_analysis.frequency import ModelResponse, known
from stoop_plan.log_bytes import Table, Topic, dataflash_bytes, ulog
from stoop_tune.control_laws import px4
from stoop_tune.flown_loops import closed_loops, disagreement, modeled_loop, under_feedback
from stoop_tune.judgment import Condition, judge, with_handling
from stoop_tune.loops import AxisLoop, Plants

RATE = 100.0
PARAMETERS = {"FW_RR_P": 0.15, "FW_RR_I": 0.3, "FW_RR_FF": 0.1, "FW_RR_IMAX": 1e9, "IMU_GYRO_CUTOFF": 0.0,
              "IMU_DGYRO_CUTOFF": 0.0, "IMU_GYRO_RATEMAX": RATE}  # fmt: skip
ATTITUDE = 2.5
Signals = tuple[np.ndarray, ...]
Found = tuple[FrequencyResponse, ModelResponse, list[Notice]]


def plants(effect: float = 1.0, spread: float = 0.01) -> Plants:
    """Return roll modes with the lag of a servo, 30 ms late: the plant, its effectiveness changed, and 200 draws."""
    drawn = np.vstack([[0.0, 0.0], spread * np.random.default_rng(0).standard_normal((200, 2))])
    return rolling(4.0 * (1.0 + drawn[:, 0]), 30.0 * effect * (1.0 + drawn[:, 1]), 0.03)


@cache
def fly(seed: int, attitude: float = 0.0, pilot: float = 0.5, gust: float = 0.0) -> Signals:
    asked, one = asked_at_random(round(120.0 * RATE), 1, RATE, seed, pilot), rolling([4.0])
    outer = attitude * np.array([[0.0, 0.0, 1.0]])
    return flown(one.A[0], one.B[0], [0], [{"P": 0.15, "I": 0.3, "FF": 0.1}], RATE, 3, asked, outer, gust)


def compared(signals: Signals, model: Plants, attitude: float = 0.0, full: float = 0.0) -> Found:
    (one,) = FrequencyResponse.estimate([Stretch(RATE, *signals[:2])], ["roll"], ["roll"], (0.0, 60.0))
    shown = replace(under_feedback(one, attitude), output="p")
    loops = [{"roll": AxisLoop(px4.fixed_wing(PARAMETERS, "roll"), attitude)}]
    modeled = modeled_loop(shown, [Condition(20.0, 1.0, model)], loops)
    return shown, modeled, disagreement(shown, modeled, full)


def codes(found: list[Notice]) -> list[str]:
    return [one.code for one in found]


def test_the_response_is_that_of_the_loop_step_by_step() -> None:
    """A random setpoint, 120 s: within 3 % of the model up to 60 rad/s, and a servo late by one more sample is not."""
    shown, modeled, doubts = compared(fly(0), plants())
    good = known(shown)
    assert good.sum() > 70
    assert shown.frequency[good][-1] > 55.0
    assert np.abs(shown.response / modeled.response - 1.0)[good].max() < 0.05
    assert doubts == []
    later = replace(plants(), delays=np.full((201, 1), 0.04))
    assert codes(compared(fly(0), later)[2]) == ["tune-loop-contradicted"]


@pytest.mark.parametrize("gust", [0.0, 3.0])
def test_an_effectiveness_30_percent_off_is_named_and_the_right_one_is_not(gust: float) -> None:
    for seed in range(3):
        signals = fly(seed, attitude=ATTITUDE, gust=gust)
        assert compared(signals, plants(), ATTITUDE)[2] == []
        assert codes(compared(signals, plants(1.3), ATTITUDE)[2]) == ["tune-loop-contradicted"]
    (doubt,) = compared(signals, plants(1.3), ATTITUDE, full=0.2)[2]
    assert (doubt.code, "20 % of the samples" in str(doubt)) == ("tune-loop-saturated", True)


def test_gusts_that_make_all_setpoints_show_nothing() -> None:
    """Setpoint and rate are coherent, but as the inverse of the feedback."""
    signals = fly(0, attitude=ATTITUDE, gust=3.0, pilot=0.0)
    (raw,) = FrequencyResponse.estimate([Stretch(RATE, *signals[:2])], ["roll"], ["roll"], (0.0, 60.0))
    assert known(raw).sum() > 20
    shown, _, doubts = compared(signals, plants(), ATTITUDE)
    assert known(shown).sum() == 0
    assert codes(doubts) == ["tune-loop-unknown"]


def px4_log(path: Path, signals: Signals, parameters: Mapping[str, float] = PARAMETERS) -> Path:
    setpoint, rate, command = (np.pad(one, ((0, 0), (0, 3 - one.shape[1]))) for one in signals)
    time, few = 10.0 + np.arange(len(setpoint)) / RATE, slice(None, None, 2)
    asked = {a: setpoint[few, i] for i, a in enumerate(("roll", "pitch", "yaw"))}
    xyz = [{f"xyz[{i}]": one[:, i] for i in range(3)} for one in (rate, command)]
    topics = [Topic("vehicle_angular_velocity", time, xyz[0]), Topic("vehicle_rates_setpoint", time[few], asked),
              Topic("vehicle_torque_setpoint", time, xyz[1])]  # fmt: skip
    path.write_bytes(ulog(topics, parameters))
    return path


def ardupilot_log(path: Path, signals: Signals) -> Path:
    target, actual = (np.degrees(one[:, 0]) for one in signals[:2])
    stamp, zero = 1_000_000 + 10_000 * np.arange(len(target)), np.zeros(len(target))
    pid = {"TimeUS": stamp, "Tar": target, "Act": actual, "P": 45.0 * signals[2][:, 0]}
    pid |= {"I": zero, "D": zero, "FF": zero}
    gyro = {"TimeUS": stamp, "I": zero.astype(int), "GyrX": signals[1][:, 0], "GyrY": zero, "GyrZ": zero}
    rates = Table("PIDR", ",".join(pid), "Qffffff", "s------", "F------", pid)
    tables = [rates, Table("IMU", ",".join(gyro), "QBfff", "s#EEE", "F-000", gyro)]
    path.write_bytes(dataflash_bytes(tables, {"RLL_RATE_P": 0.1}, ["ArduPlane V4.5.7 (1a2b)"]))
    return path


def test_logs_of_both_autopilots_show_it(tmp_path: Path) -> None:
    signals, loops = fly(0), [{"roll": AxisLoop(px4.fixed_wing(PARAMETERS, "roll"))}]
    right, wrong = ([Condition(20.0, 1.0, plants(effect))] for effect in (1.0, 1.3))
    for path in (px4_log(tmp_path / "log.ulg", signals), ardupilot_log(tmp_path / "log.bin", signals)):
        found, doubts = closed_loops(path, False, right, loops)
        assert doubts == []
        shown = found.response("roll", "p")
        good = known(shown)
        assert good.sum() > 50
        apart = np.abs(shown.response / found.model["roll", "p"].response - 1.0)
        assert apart[good & (shown.frequency < 30.0)].max() < 0.05
    full = px4_log(tmp_path / "full.ulg", (*signals[:2], np.clip(20.0 * signals[2], -1.0, 1.0)))
    for one, code in ((path, "tune-loop-contradicted"), (full, "tune-loop-saturated")):
        assert codes(closed_loops(one, False, wrong, loops)[1]) == [code]


def test_a_log_without_setpoints_says_so_in_one_line(shared_data: Path) -> None:
    """PX4 1.6 logged the gyro before the filters of the loop; ArduPlane 3.8 no rate beside its target."""
    loops = [{"roll": AxisLoop(px4.fixed_wing(PARAMETERS, "roll"))}]
    px4_sample = "px4-ulog-reader-samples/sample_appended_multiple.ulg"
    for log in (px4_sample, "ardupilot-dataflash-sample/test.BIN"):
        found, (said,) = closed_loops(shared_data / log, False, [Condition(20.0, 1.0, plants())], loops)
        assert (found, said.code) == (None, "tune-no-closed-loop")
        assert "\n" not in str(said)


def test_bandwidth_and_phase_delay_are_those_of_the_closed_attitude_loop() -> None:
    """By their definitions, from a finely spaced response: of the attitude over its setpoint, others closed or not there."""
    model, law = plants(spread=0.05), px4.fixed_wing(PARAMETERS, "roll")
    for attitude in (ATTITUDE, 0.0):
        loops = {"roll": AxisLoop(law, attitude)}
        condition = Condition(20.0, 1.0, model)
        (found,) = with_handling(condition, loops, judge(condition, loops, {}))
        w = np.linspace(0.2, 80.0, 200_000)
        z = np.exp(1j * w / RATE)
        hold = (1.0 - 1.0 / z) / (1j * w / RATE)
        for lane in (0, 7):
            effect, lag, damping = model.A[lane, 0, 1], 15.0, -model.A[lane, 0, 0]
            rate = effect * lag / ((1j * w + lag) * (1j * w + damping)) * np.exp(-0.03j * w) * hold
            integral = 0.3 / RATE / (1.0 - 1.0 / z) / z
            inner = rate * (0.25 + integral) / (1.0 + rate * (0.15 + integral))
            angle = inner / (1j * w)
            closed = attitude * angle / (1.0 + attitude * angle) if attitude else angle
            phase = np.unwrap(np.angle(closed))
            crossing = w[np.argmax(phase < -np.pi)]
            delay = -(phase[np.argmax(w >= 2.0 * crossing)] + np.pi) / (2.0 * crossing)
            assert found.bandwidth[lane] == pytest.approx(w[np.argmax(phase < -0.75 * np.pi)], rel=2e-3)
            assert found.phase_delay[lane] == pytest.approx(delay, rel=2e-3)
