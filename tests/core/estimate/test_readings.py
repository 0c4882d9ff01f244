"""Windows and where their pieces start; readings of late sensors are moved, those of slow ones count where they were read."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.fits import posed
from naive.aircraft import rotation
from scipy.signal import lfilter

from stoop import Flight, Vehicle, load_vehicle, simulate_flight
from stoop.errors import FlightError, IdentificationError
from stoop.estimate.linearization import advanced, aligned, as_recorded, undelayed
from stoop.estimate.noise import correlation_times
from stoop.flight import from_columns
from stoop.flight.gridding import Channels, grid_channels
from stoop.problem import Layout, Misfit, Piece
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import parse_vehicle
from stoop.workflow.demo import MANEUVER

LATE, TWIN = "[sensors.q]\ndelay = 0.03\n[sensors.psi]\ndelay = 0.015\n", load_vehicle("twin-boom")
SLOW = ("V", "alpha", "beta", "phi", "theta", "psi")
EVERY = 10  #: samples of the grid
WIND = {"sensors.vn.bias": 2.0, "sensors.ve.bias": -1.0, "sensors.vd.bias": 0.2}
ANGLES, THROUGH_AIR = (0.2, -0.1, 2.0), np.array([3.0, -1.0, 0.5])


def late_problem(bounds: tuple[float, float]) -> Misfit:
    late = {"sensors.q.delay": {"free": True, "bounds": bounds}}
    vehicle = parse_vehicle(TWIN.text + LATE, "late").with_numbers(late)
    return posed(vehicle, simulate_flight(vehicle, parse_maneuver(MANEUVER, "m"), name="sim"), 8.0)


@pytest.mark.parametrize("samples", [-2.3, 0.5, 1.0, 3.7])
def test_a_smooth_signal_is_read_where_it_will_be(samples: float) -> None:
    t = np.arange(400.0)
    found, later = advanced(np.sin(0.2 * t) + 0.01 * t, samples), t + samples
    assert found[10:-10] == pytest.approx((np.sin(0.2 * later) + 0.01 * later)[10:-10], abs=2e-3)


@pytest.mark.parametrize("samples", [0.25, 0.5, 2.5])
def test_noise_stays_as_large_and_as_white(samples: float) -> None:
    noise = np.random.default_rng(1).standard_normal(20_000)
    found = advanced(noise, samples)
    assert np.var(found) == pytest.approx(np.var(noise), rel=1e-3)
    before, after = (np.mean(x[1:] * x[:-1]) for x in (noise, found))
    assert after == pytest.approx(before, abs=1e-3)


def test_a_filter_leaves_out_what_a_gap_or_an_end_is_near_to() -> None:
    problem = late_problem((0.0, 0.1))
    held = problem.layout.vehicle.with_numbers({"sensors.q.delay": {"free": False}})
    piece, psi = problem.pieces[0], held.outputs.index("psi")
    piece.measured[100:103] = np.nan
    problem = replace(problem, layout=Layout.of(held, problem.layout.nuisances))
    (shifted,) = undelayed(problem).pieces
    count, needed = len(piece.time), np.arange(-3, 4)
    lost = {*range(-9, 0), 100, 101, 102, *range(count, count + 9)}
    expected = [x for x in range(count) if lost & {*(round(x + 0.015 / piece.dt) + needed).tolist()}]
    assert np.flatnonzero(np.isnan(shifted.measured[:, psi])).tolist() == expected


def test_windows_move_readings_without_changing_them() -> None:
    problem = late_problem((0.0, 0.1))
    piece, q = problem.pieces[0], problem.layout.vehicle.outputs.index("q")
    moved = aligned(problem, problem.layout.start).pieces[0]
    assert moved.moved[q] == round(0.03 / piece.dt)
    n, back = round(0.1 / piece.dt), np.roll(moved.measured[:, q], round(moved.moved[q]))
    assert np.isnan(back[:n]).all()
    assert np.array_equal(back[n:], piece.measured[n:, q])
    simulated = as_recorded(moved, np.arange(len(back))[:, None] * np.ones(len(moved.moved)))
    assert np.array_equal(simulated[n:, q], np.arange(len(back))[n:] - moved.moved[q])


def test_a_short_piece_beside_a_long_one_may_lose_its_late_readings() -> None:
    problem = late_problem((0.0, 1.0))
    whole, q = problem.pieces[0], problem.layout.vehicle.outputs.index("q")
    short = whole.part(0, round(0.8 / whole.dt), whole.start)
    both = aligned(replace(problem, pieces=(whole, short)), problem.layout.start).pieces
    assert np.isfinite(both[0].measured[:, q]).sum() == len(whole.time) - round(1.0 / whole.dt)
    assert np.isnan(both[1].measured[:, q]).all()
    with pytest.raises(IdentificationError, match=r"sensors\.q\.delay: its bounds leave .*; narrow them"):
        aligned(replace(problem, pieces=(short,)), problem.layout.start)
    with pytest.raises(IdentificationError, match=r"q\.delay: a filter needs .* --fix sensors\.q\.delay"):
        undelayed(problem)


@pytest.fixture(scope="module")
def flown() -> Flight:
    return simulate_flight(TWIN, parse_maneuver(MANEUVER, "m"), name="sim", seed=3)


def slowed(flight: Flight) -> Flight:
    slow = Channels("slow", flight.time[::EVERY], {n: flight.column(n)[::EVERY] for n in SLOW})
    others = set(flight.channels) - {*SLOW, "q0", "q1", "q2", "q3"}
    fast = Channels("log", flight.time, {n: flight.column(n) for n in sorted(others)})
    grid, data, sources = grid_channels([slow, fast], flight.rate, "test")
    assert grid.size == len(flight.time)
    return replace(flight, data=type(vars(flight)["data"])(grid.time, data), sources=sources)


def test_a_residual_holds_nothing_interpolated(flown: Flight) -> None:
    whole, slow = (posed(TWIN, flown, 8.0).pieces[0], posed(TWIN, slowed(flown), 8.0).pieces[0])
    for i, channel in enumerate(TWIN.outputs):
        read = np.flatnonzero(np.isfinite(slow.measured[:, i]))
        np.testing.assert_array_equal(read, np.arange(0, len(slow.time), EVERY if channel in SLOW else 1))
        assert slow.measured[read, i] == pytest.approx(whole.measured[read, i], abs=1e-9)
    assert np.isfinite(slow.whole).all()
    np.testing.assert_array_equal(slow.part(100, 200, slow.start).whole, slow.whole[100:200])


def test_the_cost_is_that_of_the_readings_alone(flown: Flight) -> None:
    """Twin: what lies between readings is deleted by hand from the whole record."""
    slow, naive = (posed(TWIN, slowed(flown), 8.0), posed(TWIN, flown, 8.0))
    measured = naive.pieces[0].measured.copy()
    for i, channel in enumerate(naive.layout.vehicle.outputs):
        if channel in SLOW:
            measured[np.arange(len(measured)) % EVERY != 0, i] = np.nan
    naive = replace(naive, pieces=(replace(naive.pieces[0], measured=measured),))
    points = np.random.default_rng(0).uniform(0.45, 0.55, (5, naive.layout.dimension))
    assert [n.name for n in naive.layout.nuisances] == [n.name for n in slow.layout.nuisances]
    last = len(naive.prices) - 1
    assert slow.costs(points, last) == pytest.approx(naive.costs(points, last), rel=0.02)


def test_late_readings_stay_readings(flown: Flight) -> None:
    vehicle = parse_vehicle(TWIN.text + "[sensors.alpha]\ndelay = 0.04\n[sensors.q]\ndelay = 0.04\n", "late")
    problem = posed(vehicle, slowed(flown), 8.0)
    alpha, before = vehicle.outputs.index("alpha"), problem.pieces[0]
    moved = round(0.04 / before.dt)
    for piece in (aligned(problem, problem.layout.start).pieces[0], undelayed(problem).pieces[0]):
        read = np.flatnonzero(np.isfinite(piece.measured[:, alpha]))
        assert set((read + moved) % EVERY) == {0}
        inner = read[(read > 50) & (read < len(piece.time) - 50)]
        assert len(inner) >= 30
        assert piece.measured[inner, alpha] == pytest.approx(before.measured[inner + moved, alpha], abs=1e-3)


def test_color_is_counted_from_reading_to_reading() -> None:
    """1 + 2 sum a^k = (1 + a) / (1 - a), k counting readings; one reading in each piece is independent."""
    x = lfilter([1.0], [1.0, -0.7], np.random.default_rng(1).standard_normal(20_000))
    for every in (1, 7):
        spread = np.full((len(x) * every, 1), np.nan)
        spread[::every, 0] = x
        assert correlation_times([spread], 0.02 / every)[0] == pytest.approx(1.7 / 0.3, rel=0.2)
    single = [np.where(np.arange(50) == 10, 1.0 + k, np.nan)[:, None] for k in range(20)]
    assert correlation_times(single, 0.02) == pytest.approx([1.0])


def test_windows_are_read_or_say_what_to_write(flight: Flight) -> None:
    one, two, last = {"sim": flight}, {"a": flight, "b": flight}, float(flight.time[-1])
    assert Window.parse("1.5:9", one) == Window("sim", 1.5, 9.0)
    assert Window.parse("b@1:2#heavy", two) == Window("b", 1.0, 2.0, "heavy")
    assert Window.parse("20:end", one) == Window("sim", 20.0, last)
    assert Window.parse("sim@start:end#light", one) == Window("sim", 0.0, last, "light")
    for text, known, advice in (
        ("1-2", one, "START:STOP"), ("1:2:3", one, "START:STOP"), ("", one, "START:STOP"), ("2:1", one, "before"),
        ("nan:1", one, "before"), ("c@1:2", one, "flights are"), ("1:2", two, "FLIGHT@START:STOP"),
        ("20:ende", one, "write START:STOP"),
    ):  # fmt: skip
        with pytest.raises(FlightError, match=advice) as caught:
            Window.parse(text, known)
        assert "\n" not in str(caught.value), text


@pytest.fixture(scope="module")
def quad() -> Vehicle:
    return load_vehicle("quad-x").with_numbers({name: {"value": w} for name, w in WIND.items()})


def drifting(vehicle: Vehicle) -> Prepared:
    """Return a piece of a flight whose every channel stands still, a motor that is off among them."""
    t, ground = np.arange(200) * 0.01, rotation(*ANGLES) @ THROUGH_AIR + list(WIND.values())
    columns = dict(zip(("vn", "ve", "vd", "phi", "theta", "psi"), (*ground, *ANGLES), strict=True))
    columns |= {"p": 0.3, "q": -0.2, "r": 0.1, "ax": 0.0, "ay": 0.0, "az": -9.8, "altitude": 120.0}
    columns |= {f"motor_{i}": 0.2 * i for i in (1, 2, 3)} | {"motor_4": 0.0}
    flight = from_columns("drift", t, {name: np.full(len(t), value) for name, value in columns.items()})
    return Prepared.of(vehicle, {"drift": flight}, [Window("drift", 0.0, 1.9)])


def test_the_wind_is_taken_off_and_the_attitude_undone(quad: Vehicle) -> None:
    prepared = drifting(quad)
    (piece,) = prepared.pieces
    assert set(piece.start) == set(quad.start_names)
    found = [piece.start[n] for n in (*"uvwpqr", "phi", "theta", "psi", "h")]
    assert found == pytest.approx([*THROUGH_AIR, 0.3, -0.2, 0.1, *ANGLES, 120.0], abs=1e-9)
    assert all(isinstance(value, float) for value in piece.start.values())
    assert (piece.measured.shape[1], prepared.notices) == (12, ())


def test_nuisances(quad: Vehicle) -> None:
    found = {n.name: n for n in drifting(quad).nuisances(quad)}
    assert [n for n in found if not found[n].is_bias] == [
        "u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "m1.lag", "m2.lag", "m3.lag", "m4.lag",
    ]  # fmt: skip
    assert [found[f"m{i}.lag"].scale for i in (1, 2, 3, 4)] == pytest.approx([0.02, 0.04, 0.06, 0.1])
    assert all(found[f"m{i}.lag"].center == 0.0 for i in (1, 2, 3, 4)), "it is added to the command"
    assert [(found[n].center, found[n].scale) for n in WIND] == [(2.0, 3.0), (-1.0, 3.0), (0.2, 0.5)]
    assert found["sensors.p.bias"].is_bias
    searched = [p.name for p in Layout.of(quad, []).parameters]
    assert not [name for name in searched if name.startswith("sensors.")]
    assert "rotors.T2" in searched


def test_a_channel_that_is_stuck_or_all_spikes_counts_as_not_measured() -> None:
    """A heading about south is neither, though its readings jump by a whole turn."""
    vehicle, t, rng = load_vehicle("twin-boom"), np.arange(400) * 0.01, np.random.default_rng(1)
    south = (0.02 * rng.standard_normal(400)) % (2.0 * np.pi) - np.pi
    spikes, psi = np.where(rng.random(400) < 0.02, 1.0, 0.01), vehicle.outputs.index("psi")
    for readings, lost in ((south, []), (0.0 * t, ["stuck-channel"]), (spikes, ["outliers-left-out"])):
        measured = 1e-4 * rng.standard_normal((400, 12))
        measured[:, psi] = readings
        piece = Piece(0, t, np.zeros((400, len(vehicle.inputs))), measured, {})
        found = Prepared((), (piece,)).without_stuck_channels(vehicle)
        assert [n.code for n in found.notices] == lost
        assert np.isnan(found.pieces[0].measured[:, psi]).all() == bool(lost)
