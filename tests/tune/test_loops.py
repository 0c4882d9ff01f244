"""Loops around linear plants: margins beside python-control's, beside loops in the time domain, and counts of growing poles."""

import control
import numpy as np
import pytest
from naive.closed_loops import grows
from tune.made_up import rolling

from stoop_tune import loops as modeled
from stoop_tune.control_laws import px4
from stoop_tune.control_laws.rate_law import RateLaw
from stoop_tune.loops import AxisLoop, Plants, motion, stable
from stoop_tune.margins import margins

S = control.tf("s")
LOOPS = {
    "conditional": 5.0 * (S + 1.0) / (S * (S / 5.0 + 1.0) * (S / 30.0 + 1.0) ** 2),
    "third order": 5.0 / (S + 1.0) ** 3,
    "leading": 6.0 * S**2 / ((S + 1.0) ** 2 * (S / 20.0 + 1.0)),  # crosses first 48 degrees beyond -180
    "unstable plant": 6.0 * (S + 3.0) / (S * (S - 1.0) * (S / 50.0 + 1.0)),
    "resonance": 30.0 * (S**2 + 0.6 * S + 9.0) / (S * (S**2 + 0.4 * S + 30.0) * (S / 40.0 + 1.0)),
}
WING = {"FW_RR_P": 0.4, "FW_RR_I": 0.6, "FW_RR_FF": 0.0, "FW_RR_IMAX": 1e9, "IMU_GYRO_CUTOFF": 0.0, "IMU_DGYRO_CUTOFF": 0.0,
        "IMU_GYRO_RATEMAX": 100.0}  # fmt: skip


@pytest.mark.parametrize("name", LOOPS)
def test_margins_are_those_of_python_control(name: str) -> None:
    system, frequency = LOOPS[name], np.geomspace(1e-2, 500.0, 1000)
    found = margins(frequency, system(1j * frequency)[None])
    gain, phase, *_ = control.stability_margins(system)
    crossover = max(control.stability_margins(system, returnall=True)[4])
    assert found.crossover[0] == pytest.approx(crossover, rel=1e-6)
    assert np.degrees(found.phase[0]) == pytest.approx(abs(phase), rel=1e-6)
    if np.isfinite(gain):
        assert (found.gain_up if gain > 1.0 else found.gain_down)[0] == pytest.approx(gain, rel=1e-6)
    coarse = np.geomspace(1e-2, 500.0, 2000)
    near = coarse[np.argmin(control.disk_margins(system, coarse, returnall=True)[0])]
    fine = near * np.geomspace(0.99, 1.01, 2001)
    disk, gain_of_disk, phase_of_disk = control.disk_margins(system, fine)
    assert found.disk[0] == pytest.approx(disk, rel=2e-6)
    assert 20.0 * np.log10(found.disk_gain[0]) == pytest.approx(gain_of_disk, rel=1e-5)
    assert np.degrees(found.disk_phase[0]) == pytest.approx(phase_of_disk, rel=1e-5)


@pytest.mark.parametrize("name", ["conditional", "resonance"])
def test_rejection_and_peak_are_those_of_the_sensitivity(name: str) -> None:
    """A loop that never crosses has no limit."""
    system, (frequency, fine) = LOOPS[name], (np.geomspace(1e-2, 500.0, n) for n in (1000, 1_000_000))
    found = margins(frequency, system(1j * frequency)[None])
    size = np.abs(1.0 / (1.0 + system(1j * fine)))
    assert found.peak[0] == pytest.approx(size.max(), rel=1e-5)
    assert found.rejection[0] == pytest.approx(fine[np.argmax(size > np.sqrt(0.5))], rel=2e-5)
    found = margins(frequency, (0.5 / (1j * frequency + 1.0))[None])
    assert np.isinf([found.gain[0], found.phase[0], found.delay[0]]).all()
    assert np.isnan(found.crossover[0])


def opened_by(plants: Plants, law: RateLaw) -> tuple[np.ndarray, np.ndarray]:
    frequency = modeled.frequencies(loops := [AxisLoop(law)])
    difference = modeled.return_difference(motion(plants, frequency), loops, frequency)
    return frequency, modeled.opened(difference)[0]


def test_the_gain_margin_is_where_a_loop_in_the_time_domain_begins_to_grow() -> None:
    """A law at 100 Hz whose commands are held: 2 % below its margin the loop settles, 2 % above it grows."""
    plants = rolling([4.0, 6.0])
    limit = margins(*opened_by(plants, px4.fixed_wing(WING, "roll"))).gain_up
    assert limit[0] != limit[1]
    for lane in range(2):
        for factor, expected in ((0.98, False), (1.02, True)):
            given = plants.A[lane, :2, :2], plants.B[lane, :2, 0], 0, {"P": 0.4, "I": 0.6}
            assert grows(*given, factor * limit[lane], 100.0) == expected


def test_a_delay_takes_the_margin_that_is_said() -> None:
    law = px4.fixed_wing(WING, "roll")
    left = margins(*opened_by(rolling([4.0, 6.0]), law)).delay[0]
    later = margins(*opened_by(rolling([4.0, 6.0], late=0.5 * left), law)).delay[0]
    assert later == pytest.approx(0.5 * left, rel=1e-3)
    assert stable(rolling([4.0, 6.0], late=0.95 * left), [AxisLoop(law)])[0]
    assert not stable(rolling([4.0, 6.0], late=1.05 * left), [AxisLoop(law)])[0]


def test_growing_poles_are_those_of_the_matrix_of_the_closed_loops() -> None:
    """300 random plants of two axes under P and I without limits or holds: as the eigenvalues say."""
    rng, right, stands = np.random.default_rng(0), 0, 0
    fast = {"IMU_GYRO_RATEMAX": 2e4, "FW_PR_P": 0.0, "FW_PR_IMAX": 1e9, "FW_PR_FF": 0.0, "FW_PR_D": 0.0}
    for _ in range(300):
        A, B = rng.normal(size=(5, 5)) * 2.0 - rng.uniform(0.0, 4.0) * np.eye(5), rng.normal(size=(5, 2))
        k, i = rng.uniform(0.0, 1.5, 2), rng.uniform(0.0, 1.0, 2)
        values = WING | fast | {"FW_RR_P": k[0], "FW_RR_I": i[0], "FW_PR_P": k[1], "FW_PR_I": i[1]}
        loops = [AxisLoop(px4.fixed_wing(values, axis)) for axis in ("roll", "pitch")]
        C = np.eye(2, 5)
        closed = np.block([[A - B @ np.diag(k) @ C, B @ np.diag(i)], [-C, np.zeros((2, 2))]])
        growth = np.linalg.eigvals(closed).real.max() - modeled.GROWTH
        if abs(growth) < 0.02:  # held commands, of 50 us, decide
            continue
        plants = Plants(("p", "q", "x", "y", "z"), A[None], B[None], np.zeros((1, 2)))
        assert stable(plants, loops)[0] == (growth < 0.0)
        right, stands = right + 1, stands + (growth < 0.0)
    assert right > 250
    assert 20 < stands < right - 20


def test_a_gyro_scales_what_it_reads_and_neither_attitude_nor_heading() -> None:
    states = ("p", "r", "phi")
    A = np.array([[[-2.0, 0.0, 0.0], [0.1, -1.0, 0.0], [1.0, 0.0, -0.1]]])
    B, delays, frequency = np.eye(3)[None, :, :2], np.zeros((1, 2)), np.geomspace(0.1, 50.0, 20)
    exact = motion(Plants(states, A, B, delays), frequency)
    read = motion(Plants(states, A, B, delays, {"p": np.full(1, 1.03), "r": np.full(1, 0.9)}), frequency)
    for name, scale in {"p": 1.03, "r": 0.9, "phi": 1.0, "psi": 1.0}.items():
        np.testing.assert_allclose(read[name], scale * exact[name], rtol=1e-12)
