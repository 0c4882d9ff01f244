"""Two and three coupled loops, each opened with the others closed, beside python-control's closed state-space systems."""

import control
import numpy as np
import pytest

from stoop_tune.control_laws import px4
from stoop_tune.loops import AxisLoop, Plants, followed, motion, opened, return_difference, stable
from stoop_tune.margins import margins

AXES = ("roll", "pitch", "yaw")
STATES = ("p", "q", "r", "phi", "theta", "x", "y")
PROPORTIONAL, INTEGRAL = (0.5, 0.7, 0.4), (0.6, 0.3, 0.5)
ATTITUDE = (3.0, 2.0, 0.0)  #: 1/s, of angles that are the integrals of p and q
LATE = (0.01, 0.03, 0.02)  #: s
GYROS = {"p": 1.1, "q": 0.9, "r": 1.05}  #: reading over rate
FREQUENCY = np.geomspace(0.2, 60.0, 800)
#: PX4's law without limits, filters and holds that last: u = P e + I integral of e
PLAIN = {
    "IMU_GYRO_CUTOFF": 0.0, "IMU_DGYRO_CUTOFF": 0.0, "IMU_GYRO_RATEMAX": 1e6, "FW_AIRSPD_TRIM": 20.0,
    **{f"FW_{a}R_{t}": x for a in "RPY" for t, x in (("FF", 0.0), ("D", 0.0), ("IMAX", 1e9))},
}  # fmt: skip


def plant() -> tuple[np.ndarray, np.ndarray]:
    """Return A (n, n) and B (n, 3) with damped rates that couple strongly, and two states of no meaning."""
    rng = np.random.default_rng(4)
    A, B = rng.normal(scale=2.0, size=(7, 7)), rng.normal(scale=3.0, size=(7, 3))
    A -= 7.0 * np.eye(7)
    A[3:5], B[3:5] = 0.0, 0.0
    A[3, 0] = A[4, 1] = 1.0
    B[:3] += 8.0 * np.eye(3)
    return A, B


def loops_of(count: int) -> list[AxisLoop]:
    terms = (("P", PROPORTIONAL), ("I", INTEGRAL))
    gains = {f"FW_{a}R_{t}": x[i] for i, a in enumerate("RPY") for t, x in terms}
    return [AxisLoop(px4.fixed_wing(PLAIN | gains, axis), ATTITUDE[i]) for i, axis in enumerate(AXES[:count])]


def plants_of(count: int) -> Plants:
    A, B = plant()
    gyros = {n: np.array([x]) for n, x in GYROS.items()}
    return Plants(STATES, A[None], B[None, :, :count], np.array([LATE[:count]]), gyros)


def systems(count: int) -> tuple[control.StateSpace, control.StateSpace, control.StateSpace]:
    """Return responses: readings p, q, r, phi, theta to commands; minus commands to readings; commands to setpoints of rates."""
    A, B = plant()
    C = np.eye(5, 7) * np.array([*GYROS.values(), 1.0, 1.0])[:, None]
    late = control.append(*(control.ss(control.tf(*control.pade(x, 6))) for x in LATE[:count]))
    motions = control.ss(A, B[:, :count], C, 0) * late
    laws = control.append(*(control.ss(0, 1, INTEGRAL[i], PROPORTIONAL[i]) for i in range(count)))
    mixing = np.eye(count, 5) + np.eye(count, 5, 3) * np.array(ATTITUDE[:count])[:, None]
    return motions, laws * mixing, laws


@pytest.mark.parametrize("count", [2, 3])
def test_loops_opened_with_the_others_closed(count: int) -> None:
    motions, feedback, _ = systems(count)
    moves, loops = motion(plants_of(count), FREQUENCY), loops_of(count)
    found = opened(return_difference(moves, loops, FREQUENCY))
    for i in range(count):
        others = np.diag([float(k != i) for k in range(count)])
        closed = control.feedback(motions, others * feedback)
        loop = (feedback * closed)[i, i]
        assert found[i, 0] == pytest.approx(loop(1j * FREQUENCY), rel=1e-3, abs=1e-4), AXES[i]
        alone = (feedback * motions)[i, i](1j * FREQUENCY)
        assert np.abs(found[i, 0] / alone - 1.0).max() > 0.1, "coupling counts"
        ours = margins(FREQUENCY, found[i])
        drawn = control.frd(loop(1j * FREQUENCY), FREQUENCY)
        gain, phase, _, _, crossover, _ = control.stability_margins(drawn)
        assert (ours.gain_up if gain > 1.0 else ours.gain_down)[0] == pytest.approx(gain, rel=2e-3), AXES[i]
        assert np.degrees(ours.phase[0]) == pytest.approx(abs(phase), rel=2e-3), AXES[i]
        assert ours.crossover[0] == pytest.approx(crossover, rel=2e-3), AXES[i]


@pytest.mark.parametrize("count", [2, 3])
def test_responses_to_setpoints_with_all_loops_closed(count: int) -> None:
    motions, feedback, laws = systems(count)
    around = control.feedback(motions, feedback)
    closed = around * laws
    assert around.poles().real.max() < 0.0
    assert stable(plants_of(count), loops_of(count))[0]
    found = followed(motion(plants_of(count), FREQUENCY), loops_of(count), FREQUENCY)
    for i in range(count):
        held, gain = (3 + i, ATTITUDE[i]) if ATTITUDE[i] else (i, 1.0)
        wanted = gain * closed[held, i](1j * FREQUENCY)
        assert found[i, 0] == pytest.approx(wanted, rel=1e-3, abs=1e-4), AXES[i]
