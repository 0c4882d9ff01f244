"""Simulate, then recover: flights of known wind, pitot, biases and incidence, as a log holds them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from stoop.base.rotations import euler_angles, matrices_of, quaternions_of
from stoop.flight import air_data
from stoop.flight.flight import AirData
from stoop.flight.velocity_smoother import Priors, smooth_velocity

Array = np.ndarray[Any, np.dtype[np.float64]]
RATE = 100.0
GRAVITY = np.array([0.0, 0.0, 9.80665])
DEG = np.pi / 180.0


@dataclass(frozen=True)
class Truth:
    """A flight as smooth functions of time: attitude (n, 3), airspeed, incidence; and the sensors' faults."""

    duration: float = 120.0
    wind: tuple[float, float] = (-3.0, 2.0)
    turn: float = 2.0 * np.pi / 45.0  # rad/s
    slope: float = 0.9
    offset: float = -2.0
    bias: tuple[float, float, float] = (0.10, -0.06, 0.08)
    gust: float = 0.5  # m/s along the flight path, correlated over 1 s, which the pitot alone feels
    pitot_noise: float = 0.0  # m/s
    velocity_noise: float = 0.05
    force_noise: float = 0.1
    delay: float = 0.0
    heading_error: float = 0.0  # true minus logged
    start: float = 0.0  # heading at the beginning
    force_beta: float = -40.0  # kappa [m], for `weathercock`
    swing: float = 1.0  # of the airspeed

    def speed(self, t: Array) -> Array:
        return 20.0 + self.swing * (3.0 * np.sin(0.21 * t) + np.sin(1.1 * t))

    def alpha(self, t: Array) -> Array:
        return 0.05 + 0.04 * np.sin(3.0 * t)

    def attitude(self, t: Array) -> Array:
        bank = np.arctan(20.0 * self.turn / 9.81) * np.ones_like(t) + 0.15 * np.sin(2.0 * t)
        return np.column_stack([bank, 0.05 + 0.05 * np.sin(1.3 * t), self.start + self.turn * t])

    def free_beta(self, t: Array) -> Array:
        return 0.08 * np.sin(2.5 * t) * (np.sin(0.3 * t) > 0.0) * np.sin(0.3 * t) ** 2


def ground_velocity(truth: Truth, t: Array, beta: Callable[[Array], Array]) -> Array:
    speed, alpha, slip = truth.speed(t), truth.alpha(t), beta(t)
    body = np.column_stack([np.cos(alpha) * np.cos(slip), np.sin(slip), np.sin(alpha) * np.cos(slip)])
    rotation = matrices_of(quaternions_of(truth.attitude(t)))
    return np.einsum("nij,nj->ni", rotation, speed[:, None] * body) + np.array([*truth.wind, 0.0])


def specific_force(truth: Truth, t: Array, beta: Callable[[Array], Array], h: float = 1e-4) -> Array:
    acceleration = (ground_velocity(truth, t + h, beta) - ground_velocity(truth, t - h, beta)) / (2.0 * h)
    rotation = matrices_of(quaternions_of(truth.attitude(t)))
    return np.einsum("nij,ni->nj", rotation, acceleration - GRAVITY)


def weathercock(truth: Truth) -> Callable[[Array], Array]:
    """Sideslip that obeys a_y = V^2 beta / kappa: dv/dt = a_y - r u + p w + g cos(theta) sin(phi)."""
    t = np.arange(-1.0, truth.duration + 1.0, 0.005)
    rotation, speed, alpha = matrices_of(quaternions_of(truth.attitude(t))), truth.speed(t), truth.alpha(t)
    spin = np.einsum("nji,njk->nik", rotation, np.gradient(rotation, t, axis=0))
    p, r, push = spin[:, 2, 1], spin[:, 1, 0], rotation[:, 2, 1] * 9.80665
    faster, slip = np.gradient(speed, t), np.zeros_like(t)
    for k in range(t.size - 1):
        along = speed[k] * np.cos(slip[k])
        lateral = speed[k] ** 2 * slip[k] / truth.force_beta + push[k]
        lateral += along * (p[k] * np.sin(alpha[k]) - r[k] * np.cos(alpha[k]))
        slip[k + 1] = slip[k] + 0.005 * (lateral - faster[k] * np.sin(slip[k])) / along
    return CubicSpline(t, slip)


def fly(truth: Truth, seed: int = 0, *, gaps: bool = True, beta: Any = None) -> tuple[xr.Dataset, Any]:
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, truth.duration, 1.0 / RATE)
    beta = beta or truth.free_beta
    angles = truth.attitude(t) - np.array([0.0, 0.0, truth.heading_error])
    force = specific_force(truth, t, beta) + truth.bias + truth.force_noise * rng.normal(size=(t.size, 3))
    native = np.arange(0.03, truth.duration, 0.1)
    logged = ground_velocity(truth, native - truth.delay, beta)
    logged += truth.velocity_noise * rng.normal(size=logged.shape)
    memory = np.exp(-1.0 / RATE)
    gust = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], rng.normal(size=t.size)) * truth.gust
    felt = truth.speed(t) + gust / truth.slope
    columns = {
        **dict(zip(("q0", "q1", "q2", "q3"), quaternions_of(angles).T, strict=True)),
        **dict(zip(("ax", "ay", "az"), force.T, strict=True)),
        **{name: np.interp(t, native, c) for name, c in zip(("vn", "ve", "vd"), logged.T, strict=True)},
        "airspeed_pitot": truth.slope * felt + truth.offset + truth.pitot_noise * rng.normal(size=t.size),
    }
    if gaps:
        begun = np.arange(11.3, t[-1], 13.7)[:, None]
        hole = ((t > begun) & (t < begun + 0.3 + 0.05 * (begun % 7))).any(axis=0)
        columns = {name: np.where(hole, np.nan, x) for name, x in columns.items()}
    exact = {"V": felt, "alpha": truth.alpha(t), "beta": beta(t)}
    exact["velocity"] = ground_velocity(truth, t, beta)
    data = {name: ("time", x) for name, x in columns.items()}
    return xr.Dataset(data, coords={"time": 1000.0 + t}), exact


def reconstruct(data: xr.Dataset) -> tuple[xr.Dataset, AirData]:
    columns = {str(name): x.to_numpy() for name, x in data.items()}
    found, air = air_data.reconstruct(data["time"].to_numpy(), columns)
    return data.assign({name: ("time", x) for name, x in found.items()}), air


def codes(air: AirData) -> set[str]:
    return {found.code for found in air.notices}


def rms(x: Array) -> float:
    return float(np.sqrt(np.nanmean(np.square(x))))


def within(estimate: float, std: float, truth: float, sigmas: float = 3.0) -> bool:
    return abs(estimate - truth) < sigmas * std


@pytest.mark.parametrize("seed", [1, 2])
def test_known_wind_pitot_and_bias_are_recovered(seed: int) -> None:
    truth = Truth()
    data, exact = fly(truth, seed)
    out, air = reconstruct(data)
    assert air.method == "pitot"
    assert within(air.wind_n, air.wind_n_std, truth.wind[0])
    assert within(air.wind_e, air.wind_e_std, truth.wind[1])
    assert within(air.pitot_scale, air.pitot_scale_std, 1.0 / truth.slope)
    assert within(air.pitot_offset, air.pitot_offset_std, truth.offset)
    biases = zip(air.accelerometer_bias, air.accelerometer_bias_std, truth.bias, strict=True)
    assert all(within(*one) for one in biases)
    assert max(air.accelerometer_bias_std) < 0.1
    assert max(air.wind_n_std, air.wind_e_std) < 0.3
    assert rms(out["V"].to_numpy() - exact["V"]) < 0.3
    assert rms(out["alpha"].to_numpy() - exact["alpha"]) < 0.3 * DEG
    assert rms(out["beta"].to_numpy() - exact["beta"]) < 0.7 * DEG
    assert abs(air.heading_error) < 3.0 * air.heading_error_std


@pytest.mark.parametrize(("gust", "noise"), [(0.0, 0.5), (0.3, 0.5), (1.5, 0.2)])
def test_airspeed_is_as_good_as_the_better_of_pitot_and_inertial_speed(gust: float, noise: float) -> None:
    data, exact = fly(Truth(gust=gust, pitot_noise=noise), 4)
    out, air = reconstruct(data)
    wind = np.array([air.wind_n, air.wind_e, 0.0])
    inertial = np.linalg.norm(out[list(air_data.SMOOTHED)].to_dataarray().to_numpy().T - wind, axis=1)
    pitot = (data["airspeed_pitot"].to_numpy() - air.pitot_offset) * air.pitot_scale
    best = min(rms(pitot - exact["V"]), rms(inertial - exact["V"]))
    assert rms(out["V"].to_numpy() - exact["V"]) < 1.05 * best + 0.01


def test_standard_errors_cover_the_truth() -> None:
    truth = Truth(duration=90.0, gust=0.7)
    data, _ = fly(truth)
    scores = []
    for seed in range(30):
        fresh, _ = fly(replace(truth, force_noise=0.0, velocity_noise=0.0), 100 + seed, gaps=False)
        _, air = reconstruct(data.assign(airspeed_pitot=fresh["airspeed_pitot"]))
        scores.append((air.wind_n - truth.wind[0]) / air.wind_n_std)
        scores.append((air.wind_e - truth.wind[1]) / air.wind_e_std)
    assert 0.6 < rms(np.array(scores)) < 1.5


@pytest.mark.parametrize("delay", [0.5, 0.2, 0.0, -0.05])
def test_a_late_velocity_is_found_and_corrected(delay: float) -> None:
    data, exact = fly(Truth(delay=delay, duration=60.0), 5)
    out, air = reconstruct(data)
    assert air.velocity_delay == pytest.approx(delay, abs=0.01)
    assert rms(out["ve_smooth"].to_numpy() - exact["velocity"][:, 1]) < 0.15
    told = {"velocity-late"} if delay > 0.0 else {"velocity-early"} if delay < 0.0 else set()
    assert codes(air) & {"velocity-late", "velocity-early"} == told


def test_a_wrong_heading_is_reported_and_not_corrected() -> None:
    truth = Truth(heading_error=4.0 * DEG)
    out, air = reconstruct(fly(truth, 7)[0])
    assert air.heading_error == pytest.approx(truth.heading_error, abs=1.0 * DEG)
    (found,) = (found for found in air.notices if found.code == "heading-error")
    assert found.values["error"] == -air.heading_error
    assert float(np.nanmean(out["beta"])) == pytest.approx(truth.heading_error, abs=1.5 * DEG)


def test_pitot_offset_at_rest_is_its_own_finding() -> None:
    truth = Truth(duration=60.0)
    flying, _ = fly(truth, 8, gaps=False)
    still = flying.isel(time=slice(0, 1000)).copy(deep=True)
    for name in still.data_vars:
        still[name][:] = {"q0": 1.0, "az": -9.80665, "airspeed_pitot": -3.0}.get(str(name), 0.0)
    still = still.assign_coords(time=still["time"] - 10.0 - 1.0 / RATE)
    out, air = reconstruct(xr.concat([still, flying], dim="time"))
    assert air.rest_offset == pytest.approx(-3.0)
    assert np.isnan(out["alpha"][:900]).all(), "nothing is given on the ground"
    smooth = [out[name].to_numpy() for name in air_data.SMOOTHED]  # such a pitot has no say in V
    through = np.linalg.norm(np.array(smooth).T - np.array([air.wind_n, air.wind_e, 0.0]), axis=1)
    np.testing.assert_allclose(out["V"], through)
    assert codes(air) >= {"pitot-pressure-offset", "pitot-offset-inconsistent"}
    assert within(air.pitot_offset, air.pitot_offset_std, truth.offset)


def test_without_a_pitot_sideslip_tells_the_wind() -> None:
    truth = Truth()
    data, exact = fly(truth, 9, beta=weathercock(truth))
    out, air = reconstruct(data.drop_vars("airspeed_pitot"))
    assert air.method == "sideslip"
    assert np.hypot(air.wind_n - truth.wind[0], air.wind_e - truth.wind[1]) < max(3.0 * air.wind_n_std, 0.3)
    assert np.isnan(air.pitot_scale)
    assert rms(out["beta"].to_numpy() - exact["beta"]) < 1.0 * DEG
    assert any("no pitot" in str(found.values.get("source")) for found in air.notices)
    _, with_pitot = reconstruct(data)
    assert with_pitot.method == "pitot"
    assert "sideslip-wind-agrees" in codes(with_pitot)


def test_without_a_pitot_a_log_wind_serves_and_no_sideslip_that_does_not_weathercock() -> None:
    data = fly(Truth(turn=0.0, duration=60.0), 11)[0].drop_vars("airspeed_pitot")
    wander = 0.2 * np.sin(np.arange(data.sizes["time"]) / 300.0)
    _, air = reconstruct(data.assign(wind_n=("time", -3.0 + wander), wind_e=("time", 2.0 + wander)))
    assert air.method == "log"
    assert (air.wind_n, air.wind_e) == pytest.approx((-3.0, 2.0), abs=0.1)
    assert air.wind_n_std == pytest.approx(0.5)
    data, _ = fly(Truth(duration=60.0), 12, beta=lambda t: 0.9 * np.sin(0.4 * t))
    _, air = reconstruct(data.drop_vars("airspeed_pitot"))
    assert (air.method, air.wind_n) == ("still air", 0.0)
    assert "wind-unknown" in codes(air)


def test_straight_flight_holds_the_pitot_scale_and_says_so() -> None:
    truth = Truth(turn=0.0, duration=60.0, swing=0.0)
    _, air = reconstruct(fly(truth, 13, beta=weathercock(truth))[0])
    assert codes(air) >= {"steady-wind-poor", "pitot-scale-unknown"}
    assert max(air.wind_n_std, air.wind_e_std) > 1.5
    assert within(air.wind_n, air.wind_n_std, truth.wind[0])
    assert within(air.wind_e, air.wind_e_std, truth.wind[1])


def test_without_the_essentials_the_data_come_back_unchanged() -> None:
    data, _ = fly(Truth(duration=20.0), 14)
    still = {name: 0.0 * data[name] for name in ("vn", "ve", "vd", "ax", "ay", "airspeed_pitot")}
    cases = {
        "no velocity": data.drop_vars(["vn", "ve", "vd"]),
        "no attitude": data.drop_vars(["q0", "q1", "q2", "q3"]),
        "no flight": data.assign(still),
        "nothing": data.map(lambda x: x * np.nan),
        "too short": data.isel(time=slice(0, 5)),
    }
    for case, incomplete in cases.items():
        out, air = reconstruct(incomplete)
        assert out.identical(incomplete), case
        assert (air.method, np.isnan(air.wind_n)) == ("none", True), case
        assert air.notices[0].code.startswith("no-air-data"), case


def test_without_accelerometers_the_logged_velocity_is_taken_and_without_velocity_none() -> None:
    data, exact = fly(Truth(duration=90.0), 15)
    out, air = reconstruct(data.drop_vars(["ax", "ay", "az"]))
    assert np.array_equal(out["vn_smooth"], data["vn"], equal_nan=True)
    assert np.isnan(air.velocity_delay)
    assert rms(out["V"].to_numpy() - exact["V"]) < 0.5
    data, _ = fly(Truth(duration=60.0), 16)
    t = data["time"].to_numpy()
    lost = (t > 1025.6) & (t < 1038.2)
    data = data.assign({name: data[name].where(~lost) for name in ("vn", "ve", "vd")})
    label = np.cumsum(np.isnan(data["ax"].to_numpy()))
    whole = [k for k in np.unique(label[lost]) if np.isnan(data["vn"].to_numpy()[label == k]).all()]
    out, _ = reconstruct(data)
    assert np.isnan(out["V"].to_numpy()[np.isin(label, whole)]).all()
    assert np.isfinite(out["alpha"]).sum() > 0.5 * data.sizes["time"]


@pytest.mark.parametrize(("turn", "shift"), [(0.7, 0.0), (-2.9, 1e4)])
def test_turning_the_world_turns_the_wind_only(turn: float, shift: float) -> None:
    """Euler angles serve where there is no quaternion."""
    data, _ = fly(Truth(duration=40.0), 19)
    c, s, names = np.cos(turn), np.sin(turn), ["q0", "q1", "q2", "q3"]
    angles = euler_angles(np.column_stack([data[n] for n in names])).T + np.array([[0.0], [0.0], [turn]])
    turned = data.drop_vars(names).assign(
        vn=c * data["vn"] - s * data["ve"], ve=s * data["vn"] + c * data["ve"],
        **{name: ("time", x) for name, x in zip(("phi", "theta", "psi"), angles, strict=True)},
    )  # fmt: skip
    out, air = reconstruct(data)
    turned_out, turned_air = reconstruct(turned.assign_coords(time=data["time"] + shift))
    assert turned_air.wind_n == pytest.approx(c * air.wind_n - s * air.wind_e, abs=1e-5)
    assert turned_air.wind_e == pytest.approx(s * air.wind_n + c * air.wind_e, abs=1e-5)
    assert turned_air.pitot_scale == pytest.approx(air.pitot_scale, abs=1e-6)
    for name in ("V", "alpha", "beta"):
        np.testing.assert_allclose(turned_out[name], out[name], atol=1e-5)


def test_smoother_equals_one_big_least_squares_problem() -> None:
    """The same model with a state at every sample, solved at once by dense normal equations."""
    truth = Truth(duration=1.5)
    data, _ = fly(truth, 20, gaps=False)
    rotation = matrices_of(np.column_stack([data[f"q{i}"] for i in range(4)]))
    force = np.column_stack([data[name] for name in ("ax", "ay", "az")])
    velocity = np.column_stack([data[name] for name in ("vn", "ve", "vd")])
    force[70:80] = np.nan  # a gap
    velocity[:3] = velocity[70:80] = np.nan
    found = smooth_velocity(data["time"].to_numpy(), rotation, force, velocity, 10.0)
    reference, std = dense_smoother(rotation, force, velocity, (found.logged_noise, found.force_noise))
    valid = np.isfinite(force[:, 0])
    np.testing.assert_allclose(found.velocity[valid], reference[valid], atol=2e-3)
    np.testing.assert_allclose(found.std[valid], std[valid], rtol=0.35)


def dense_smoother(rotation: Array, force: Array, velocity: Array, noise: tuple[float, float]) -> Any:
    (logged_noise, force_noise), size, step = noise, len(force), 0.01
    ned = np.einsum("nij,nj->ni", rotation, force)
    rows, right = [], []

    def add(blocks: dict[int, Array], value: Array, std: Array) -> None:
        row = np.zeros((value.size, 7 * size))
        for k, block in blocks.items():
            row[:, 7 * k : 7 * k + 7] = block
        rows.append(row / std[:, None])
        right.append(value / std)

    prior = np.array([Priors.velocity] * 3 + [Priors.bias] * 3 + [Priors.heading])
    first = np.flatnonzero(np.isfinite(velocity[:, 0]))[0]
    add({0: np.eye(7)}, np.concatenate([velocity[first], np.zeros(4)]), prior)
    for k in range(size - 1):
        move, gain = np.eye(7), np.zeros(7)
        sigma = np.array([Priors.velocity] * 3 + [Priors.bias_walk * 0.1] * 3 + [Priors.heading_walk * 0.1])
        if np.isfinite(ned[k : k + 2]).all():
            mean, turn = 0.5 * (ned[k] + ned[k + 1]), 0.5 * (rotation[k] + rotation[k + 1])
            move[:3, 3:6], move[0, 6], move[1, 6] = -step * turn, -step * mean[1], step * mean[0]
            gain[:3], sigma[:3] = step * (mean + GRAVITY), force_noise * np.sqrt(step)
        add({k: -move, k + 1: np.eye(7)}, gain, sigma)
    for run in (np.arange(3, 70), np.arange(80, size)):
        for k in run[::10]:
            add({int(k): np.eye(7)[:3]}, velocity[k], np.full(3, logged_noise))
    A, b = np.concatenate(rows), np.concatenate(right)
    covariance = np.linalg.inv(A.T @ A)
    states = (covariance @ (A.T @ b)).reshape(size, 7)
    spread = np.diag(covariance).reshape(size, 7)[:, :3].mean(axis=1)
    return states[:, :3], np.sqrt(spread)
