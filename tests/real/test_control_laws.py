"""Laws of autopilots beside what real firmware commanded in its own logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stoop.control_laws import ardupilot, px4
from stoop.control_laws.replay import replay_px4
from stoop.errors import StoopError
from stoop.logs.read import read
from stoop.logs.recording import Recording


@pytest.fixture(scope="module")
def recording(shared_data: Path) -> Recording:
    return read(shared_data / "px4-ulog-reader-samples" / "sample_log_small.ulg")


def test_px4_commands_what_its_law_does(recording: Recording, shared_data: Path) -> None:
    """A VTOL in hover mode: within half a percent of the rms, by the right law with the right gains only."""
    for axis in ("roll", "pitch", "yaw"):
        found = replay_px4(recording, px4.multicopter(recording.parameters, axis))
        assert found.error < 0.005
        assert len(found.time) > 250
        assert replay_px4(recording, px4.fixed_wing(recording.parameters, axis)).error > 0.3
    wrong = {**recording.parameters, "MC_PITCHRATE_P": 1.1 * recording.parameters["MC_PITCHRATE_P"]}
    assert replay_px4(recording, px4.multicopter(wrong, "pitch")).error > 0.05
    # PX4 1.6 logged the gyro before the filters of the loop, and commands at 10 Hz
    old = read(shared_data / "px4-ulog-reader-samples" / "sample_appended_multiple.ulg")
    with pytest.raises(StoopError, match="the log has no vehicle_angular_velocity: set SDLOG_PROFILE"):
        replay_px4(old, px4.multicopter(old.parameters, "roll"))


def test_a_plane_of_version_3_8_scales_both_axes_alike(shared_data: Path) -> None:
    """P over the demanded rate, in degrees: about roll and pitch the law needs the same ratio of airspeeds, over EAS2TAS."""
    log = read(shared_data / "ardupilot-dataflash-sample" / "test.BIN", topics=frozenset({"PIDR", "PIDP"}))
    ratios = []
    for axis, message in (("roll", "PIDR"), ("pitch", "PIDP")):
        law, logged = ardupilot.old_plane(log.parameters, axis), log.streams[message].columns
        demanded = np.radians(logged["Des"])
        terms = law.outputs({"setpoint": demanded, "rate": np.zeros(len(demanded))})
        ratios.append(np.median(logged["P"] / ardupilot.FULL / terms["P"]))
        np.testing.assert_array_equal(terms["FF"], logged["FF"])
    assert ratios[0] == pytest.approx(ratios[1], rel=1e-4)
    least, most = (ardupilot.airspeed_ratio(log.parameters, v) for v in (100.0, 0.0))
    assert least < ratios[0] < most
