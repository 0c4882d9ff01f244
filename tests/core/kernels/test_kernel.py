"""What every compiled model promises, shown on a pendulum and its plain twin."""

import functools
import math
import multiprocessing
import os
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from naive import march, oscillator

from stoop.kernels import Kernel, SymbolicModel, compiler, load_kernel
from stoop.kernels.kernel import ENTRIES, thread_count
from stoop.vehicle.builtin import load_vehicle

DT, N = 0.02, 60


def candidates(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    p = np.array([4.0, 0.4, 2.0])[:, None] * rng.uniform(0.5, 1.5, (3, count))
    return p, rng.uniform(-0.5, 0.5, (2, count))


def inputs(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (N, 1))


def record(seed: int = 2) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.5, 0.5, (N, 3)), rng.uniform(0.5, 2.0, (N, 3))


def twins(p: np.ndarray, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    return np.array([
        march.march(lambda s, v, q=q: oscillator.rates(s, v, q), lambda s, v, q=q: oscillator.readings(s, v, q), at, u, DT)
        for q, at in zip(p.T, x.T, strict=True)
    ])  # fmt: skip


def test_trajectories_and_rates_equal_plain_python(pendulum: Kernel) -> None:
    p, x = candidates(11)
    y = pendulum.trajectories(p, x, inputs(), DT)
    np.testing.assert_allclose(y, twins(p, x, inputs()), rtol=1e-12, atol=1e-13)
    u = np.linspace(-1, 1, 11)[None, :]
    d, y = pendulum.evaluate(p, x, u)
    for b in range(11):
        np.testing.assert_allclose(d[:, b], oscillator.rates(x[:, b], u[:, b], p[:, b]), rtol=1e-14)
        np.testing.assert_allclose(y[:, b], oscillator.readings(x[:, b], u[:, b], p[:, b]), rtol=1e-14)


def test_cost_is_the_weighted_sum_of_squares(pendulum: Kernel) -> None:
    (p, x), (z, w) = candidates(11), record()
    z[:, 0] += 2 * np.pi * np.random.default_rng(5).integers(-1, 2, N) * (np.arange(N) % 3 == 0)
    z[7, 1], w[7, 1] = np.nan, 0.0
    z[9] = np.nan
    w[9] = 0.0
    J = pendulum.cost(p, x, inputs(), z, w, DT)
    expected = [march.cost(t, z, w, (True, False, False)) for t in twins(p, x, inputs())]
    np.testing.assert_allclose(J, expected, rtol=1e-12)


def test_products_are_the_sum_of_residuals_times_weights(pendulum: Kernel) -> None:
    (p, x), (z, w) = candidates(11), record()
    w *= np.where(np.arange(N) % 2, -1.0, 1.0)[:, None]
    z[7, 1], w[7, 1] = np.nan, 0.0
    x[0, 3] = np.nan
    found = pendulum.products(p, x, inputs(), z, w, DT)
    left = pendulum.trajectories(p, x, inputs(), DT) - np.where(w, z, 0.0)
    left[:, :, 0] -= 2.0 * np.pi * np.round(left[:, :, 0] / (2.0 * np.pi))
    lanes = np.arange(11) != 3
    np.testing.assert_allclose(found[lanes], np.einsum("bnk,nk->b", left, w)[lanes], rtol=1e-11)
    assert np.isnan(found[3])


def test_what_a_weight_hides_does_not_matter_and_what_it_shows_must_be_a_number(pendulum: Kernel) -> None:
    (p, x), (z, w) = candidates(8), record()
    w[::4] = 0.0
    costs = []
    for hidden in (0.0, np.nan, np.inf, 1e308):
        z[::4] = hidden
        costs.append(pendulum.cost(p, x, inputs(), z, w, DT))
    w[::8] = np.nan
    costs.append(pendulum.cost(p, x, inputs(), z, w, DT))
    assert all(np.array_equal(J, costs[0]) for J in costs)
    assert np.isfinite(costs[0]).all()
    z[3, 2] = np.nan
    assert np.isposinf(pendulum.cost(p, x, inputs(), z, w, DT)).all()


def test_a_diverging_candidate_disturbs_no_other(pendulum: Kernel) -> None:
    z, w = record()
    u, (p, x) = inputs(), candidates(13)
    J, y = pendulum.cost(p, x, u, z, w, DT), pendulum.trajectories(p, x, u, DT)
    for lane in (0, 3, 7, 8, 12):
        for bad in (np.nan, np.inf, -np.inf, 1e200, -1e9):
            wild = p.copy()
            wild[0, lane] = bad
            J2, y2 = pendulum.cost(wild, x, u, z, w, DT), pendulum.trajectories(wild, x, u, DT)
            others = np.arange(13) != lane
            assert np.isposinf(J2[lane]), bad
            assert not np.isfinite(y2[lane]).all(), bad
            assert np.array_equal(J[others], J2[others]), bad
            assert np.array_equal(y[others], y2[others]), bad


def test_threads_place_company_and_width_do_not_change_a_bit(pendulum: Kernel) -> None:
    (p, x), (z, w), u = candidates(67), record(), inputs()
    J, y = pendulum.cost(p, x, u, z, w, DT, threads=1), pendulum.trajectories(p, x, u, DT, threads=1)
    for threads in (2, 3, 8, 50):
        assert np.array_equal(pendulum.cost(p, x, u, z, w, DT, threads=threads), J)
        assert np.array_equal(pendulum.trajectories(p, x, u, DT, threads=threads), y)
    for count in (1, 2, 7, 8, 9, 16, 17, 24, 31):
        assert np.array_equal(pendulum.cost(p[:, :count], x[:, :count], u, z, w, DT), J[:count])
        order = np.random.default_rng(count).permutation(67)
        assert np.array_equal(pendulum.cost(p[:, order], x[:, order], u, z, w, DT), J[order])
        assert np.array_equal(pendulum.trajectories(p[:, order], x[:, order], u, DT), y[order])
    entry = ENTRIES["cost"]
    for lanes in (2, 4, 8):
        made = compiler.native().object_file(entry.text(pendulum.model, lanes))
        load = functools.partial(compiler.load, made, entry.arguments)
        narrow = replace(pendulum, lanes=lanes, entries=lambda *_, load=load: load())
        assert np.array_equal(narrow.cost(p, x, u, z, w, DT), J), lanes


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_the_child_of_a_fork_has_threads_of_its_own(pendulum: Kernel) -> None:
    (p, x), (z, w) = candidates(67), record()
    expected = pendulum.cost(p, x, inputs(), z, w, DT, threads=2)

    def again() -> None:
        os._exit(0 if np.array_equal(pendulum.cost(p, x, inputs(), z, w, DT, threads=2), expected) else 1)

    forked = multiprocessing.get_context("fork").Process(target=again)
    forked.start()
    forked.join(20)
    waited = forked.is_alive()
    forked.kill()
    forked.join()
    assert not waited, "the child waits for threads that only its parent has"
    assert forked.exitcode == 0


def test_first_samples_only(pendulum: Kernel) -> None:
    (p, x), (z, w), u = candidates(9), record(), inputs()
    y = pendulum.trajectories(p, x, u, DT)
    for samples in (1, 2, 17, N):
        assert np.array_equal(pendulum.trajectories(p, x, u, DT, samples), y[:, :samples])
        short = np.where(np.arange(N)[:, None] < samples, w, 0.0)
        J = pendulum.cost(p, x, u, z, w, DT, samples)
        assert np.array_equal(J, pendulum.cost(p, x, u, z, short, DT))
    assert np.array_equal(pendulum.cost(p, x, u, z, w, DT, 0), np.zeros(9))
    assert pendulum.trajectories(p, x, u, DT, 0).shape == (9, 0, 3)
    assert pendulum.cost(p[:, :0], x[:, :0], u, z, w, DT).shape == (0,)
    assert pendulum.trajectories(p[:, :0], x[:, :0], u, DT).shape == (0, N, 3)


def test_every_lane_hears_its_own_inputs(pendulum: Kernel) -> None:
    p, x = candidates(13)
    out, shared = np.full((13, N, 3), np.nan), np.repeat(inputs()[:, :, None], 13, axis=2)
    assert pendulum.trajectories(p, x, inputs(), DT, out=out) is out
    np.testing.assert_allclose(pendulum.trajectories(p, x, shared, DT), out, rtol=1e-13, atol=1e-14)
    z, w = record()
    J = pendulum.cost(p, x, inputs(), z, w, DT)
    np.testing.assert_allclose(pendulum.cost(p, x, shared, z, w, DT), J, rtol=1e-13)
    with pytest.raises(ValueError, match="out"):
        pendulum.trajectories(p, x, inputs(), DT, out=out[1:])
    lanes = np.random.default_rng(8).uniform(-1, 1, (N, 1, 13))
    for b, y in enumerate(pendulum.trajectories(p, x, lanes, DT)):
        alone = pendulum.trajectories(p[:, b : b + 1], x[:, b : b + 1], lanes[:, :, b], DT)[0]
        np.testing.assert_allclose(y, alone, rtol=1e-12, atol=1e-13)


def test_read_only_strided_and_integer_arrays(pendulum: Kernel) -> None:
    (p, x), (z, w) = candidates(9), record()
    z[0], w[0] = np.nan, 0.0
    arrays = (p, x, inputs(), z, w)
    J = pendulum.cost(*arrays, DT)
    strided = [np.asfortranarray(a) for a in arrays]
    for a in arrays:
        a.setflags(write=False)
    assert np.array_equal(pendulum.cost(*arrays, DT), J)
    assert np.array_equal(pendulum.cost(*strided, DT), J)
    still = pendulum.trajectories(np.ones((3, 1), int), np.zeros((2, 1), int), np.zeros((4, 1), int), DT)
    assert np.array_equal(still, np.zeros((1, 4, 3)))


def test_shapes_that_do_not_fit_are_refused(pendulum: Kernel) -> None:
    fits = {"parameters": (3, 9), "initial": (2, 9), "inputs": (N, 1), "measured": (N, 3), "weights": (N, 3)}
    for changed, *shapes in (
        ("parameters", (4, 9), (2, 9)), ("initial", (2, 8), (3, 9)), ("measured", (N, 2)), ("weights", (N - 1, 3)),
        ("inputs", (N - 1, 1), (N, 2), (N, 1, 8), (N,)),
    ):  # fmt: skip
        for shape in shapes:
            arrays = {name: np.ones(s) for name, s in (fits | {changed: shape}).items()}
            with pytest.raises(ValueError, match="shape"):
                pendulum.cost(**arrays, dt=DT)


def test_thread_count_can_be_set(monkeypatch: pytest.MonkeyPatch) -> None:
    for text in ("3", "0", "-1", "many", ""):
        monkeypatch.setenv("STOOP_THREADS", text)
        assert thread_count() == 3 if text == "3" else thread_count() >= 1


def test_functions_of_numbers_are_numbers_in_every_lane(tmp_path, monkeypatch):
    monkeypatch.setenv("STOOP_CACHE_DIR", str(tmp_path))
    x, p = sp.symbols("x p", real=True)
    with sp.evaluate(False):
        two, one = sp.Float(2.0), sp.Float(1.0)
        rate = sp.sqrt(sp.Float(3.0)) * sp.Abs(-two) * p - sp.atan2(one, two) * x
        reading = sp.atan2(one, 2.0 + x)
    model = SymbolicModel((x,), (), (p,), (rate,), (reading,), ("x",), (False,))
    made = load_kernel("numbers", lambda: model)
    d, y = made.evaluate(np.ones((1, 3)), np.full((1, 3), 0.5), np.empty((0, 3)))
    np.testing.assert_allclose(d, 3.0**0.5 * 2.0 - math.atan2(1.0, 2.0) * 0.5, rtol=1e-15)
    np.testing.assert_allclose(y, math.atan2(1.0, 2.5), rtol=1e-15)


@pytest.mark.parametrize("reduced", ["longitudinal", "full"])
def test_a_candidate_costs_the_same_in_every_lane(reduced: str) -> None:
    """On real equations, whose sums LLVM may take in another order."""
    vehicle = load_vehicle("twin-boom").reduced(reduced)
    kernel, rng, count = vehicle.kernel(), np.random.default_rng(3), 37
    rows = vehicle.parameter_rows(None, count) * rng.uniform(0.9, 1.1, (len(vehicle.values), count))
    u = 0.02 * rng.standard_normal((300, len(vehicle.inputs)))
    x = vehicle.initial_states({"V": rng.uniform(28.0, 40.0, count), "alpha": 0.05, "h": 100.0}, rows, u[0])
    z, w = np.ones((2, 300, len(vehicle.outputs)))
    J, y = kernel.cost(rows, x, u, z, w, 0.02), kernel.trajectories(rows, x, u, 0.02)
    assert np.isfinite(J).all()
    for shift in (1, 8, 13):
        order = np.roll(np.arange(count), shift)
        assert np.array_equal(kernel.cost(rows[:, order], x[:, order], u, z, w, 0.02), J[order])
        assert np.array_equal(kernel.trajectories(rows[:, order], x[:, order], u, 0.02), y[order])


@settings(max_examples=40)
@given(st.lists(st.floats(), min_size=5, max_size=5), st.integers(0, 9))
def test_any_numbers_give_a_cost_and_leave_the_others(pendulum, numbers, lane):
    (p, x), (z, w) = candidates(10), record()
    before = pendulum.cost(p, x, inputs(), z, w, DT)
    p[:, lane], x[:, lane] = numbers[:3], numbers[3:]
    after, others = pendulum.cost(p, x, inputs(), z, w, DT), np.arange(10) != lane
    assert np.array_equal(before[others], after[others])
    assert after[lane] >= 0.0
