"""Compare a law with the commands that the autopilot itself logged, which its parameters should give.

The law is evaluated where a setpoint was just logged, as setpoints are often logged more slowly than the loop runs. The
integral is the logged one, on straight lines between its samples, as it moves slowly and firmware holds it on the ground; where
it begins or is reset between two samples, nothing is compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop.extend.recordings import Recording, Stream
from stoop_tune.control_laws.rate_law import ACCELERATION, AXES, RATE, SETPOINT, RateLaw

#: instants of a setpoint that a comparison needs
ENOUGH: Final = 20
INTEGRALS: Final = {"roll": "rollspeed_integ", "pitch": "pitchspeed_integ", "yaw": "yawspeed_integ"}


@dataclass(frozen=True)
class Replay:
    """Commands by a law beside those logged, about one axis, at the instants (n,) where both are known."""

    axis: str
    time: FloatArray  #: (n,) s, of the log's clock
    logged: FloatArray  #: (n,) share of the full command
    computed: FloatArray  #: (n,)
    setpoint_rate: float  #: Hz, at which the setpoint was logged

    @property
    def error(self) -> float:
        """Root mean square of the difference over that of the logged command."""
        size = float(np.sqrt(np.mean(self.logged**2)))
        return float(np.sqrt(np.mean((self.computed - self.logged) ** 2))) / size if size else np.nan


def replay_px4(recording: Recording, law: RateLaw) -> Replay:
    """Return what a law of PX4 commands by the setpoints and rates of a ULog, beside what was commanded.

    Raises
    ------
    StoopError
        The log lacks a topic that this takes, or too few setpoints.
    """
    streams, at = recording.streams, AXES.index(law.axis)
    turning = _stream(streams, "vehicle_angular_velocity")
    slope = streams.get("vehicle_angular_acceleration", turning)
    own = f"xyz_derivative[{at}]" if slope is turning else f"xyz[{at}]"
    setpoints, status = _stream(streams, "vehicle_rates_setpoint"), _stream(streams, "rate_ctrl_status")
    torque = "vehicle_torque_setpoint" in streams
    commands = _stream(streams, "vehicle_torque_setpoint" if torque else "actuator_controls_0")
    time, integral = commands.time, status.columns[INTEGRALS[law.axis]]
    last = np.searchsorted(setpoints.time, time, "right") - 1
    behind = np.clip(np.searchsorted(status.time, time, "right"), 1, len(integral) - 1)
    steady = (integral[behind - 1] == 0.0) == (integral[behind] == 0.0)
    fresh = np.flatnonzero((np.diff(last, prepend=-1) > 0) & steady)
    if fresh.size < ENOUGH:
        raise StoopError(
            f"{recording.path.name}: {fresh.size} setpoints with a command behind them: too few to compare a law by"
        )
    # a command is computed from the sample of the gyro that it names
    older = float(np.median(time - commands.columns.get("timestamp_sample", 1e6 * time) * 1e-6))
    sampled = time[fresh] - older
    signals = {
        SETPOINT: setpoints.columns[law.axis][last[fresh]],
        RATE: np.interp(sampled, turning.time, turning.columns[f"xyz[{at}]"]),
        ACCELERATION: np.interp(sampled, slope.time, slope.columns[own]),
    }
    total = np.interp(time[fresh], status.time, integral)
    for term in (t for t in law.terms if t.integral is None):
        total = total + term.output(signals, law.rate)
    logged = commands.columns[f"xyz[{at}]" if torque else f"control[{at}]"][fresh]
    computed = np.clip(total, -law.limit, law.limit)
    return Replay(law.axis, time[fresh], logged, computed, 1.0 / setpoints.period)


def _stream(streams: Mapping[str, Stream], name: str) -> Stream:
    """Return a topic of a log, or say which it lacks."""
    if name not in streams:
        raise StoopError(f"the log has no {name}: set SDLOG_PROFILE to high rate and record again")
    return streams[name]
