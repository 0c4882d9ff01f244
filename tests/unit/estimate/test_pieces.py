"""Windows as they are written, and where pieces of a flight of a vehicle with rotors start."""

from __future__ import annotations

import numpy as np
import pytest
from naive.aircraft import rotation

from stoop.errors import FlightError
from stoop.flight import Flight, from_columns
from stoop.problem import Piece
from stoop.problem.layout import Layout
from stoop.problem.prepare import Prepared, nuisances, prepare, without_stuck_channels
from stoop.problem.windows import Window, parse_window
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle


def test_windows_are_read_or_say_what_to_write(flight: Flight) -> None:
    one, two, last = {"sim": flight}, {"a": flight, "b": flight}, float(flight.time[-1])
    assert parse_window("1.5:9", one) == Window("sim", 1.5, 9.0)
    assert parse_window("b@1:2#heavy", two) == Window("b", 1.0, 2.0, "heavy")
    assert parse_window("20:end", one) == Window("sim", 20.0, last)
    assert parse_window("sim@start:end#light", one) == Window("sim", 0.0, last, "light")
    for text, known, advice in (
        ("1-2", one, "START:STOP"), ("1:2:3", one, "START:STOP"), ("", one, "START:STOP"), ("2:1", one, "before"),
        ("nan:1", one, "before"), ("c@1:2", one, "flights are"), ("1:2", two, "FLIGHT@START:STOP"),
        ("20:ende", one, "write START:STOP"),
    ):  # fmt: skip
        with pytest.raises(FlightError, match=advice) as caught:
            parse_window(text, known)
        assert "\n" not in str(caught.value), text


WIND = {"sensors.vn.bias": 2.0, "sensors.ve.bias": -1.0, "sensors.vd.bias": 0.2}
ANGLES = (0.2, -0.1, 2.0)
THROUGH_AIR = np.array([3.0, -1.0, 0.5])


@pytest.fixture(scope="module")
def quad() -> Vehicle:
    return builtin_vehicle("quad-x").with_numbers({name: {"value": w} for name, w in WIND.items()})


def drifting(vehicle: Vehicle) -> Prepared:
    """Return a piece of a flight whose every channel stands still, a motor that is off among them."""
    t = np.arange(200) * 0.01
    ground = rotation(*ANGLES) @ THROUGH_AIR + list(WIND.values())
    columns = dict(zip(("vn", "ve", "vd", "phi", "theta", "psi"), (*ground, *ANGLES), strict=True))
    columns |= {"p": 0.3, "q": -0.2, "r": 0.1, "ax": 0.0, "ay": 0.0, "az": -9.8, "altitude": 120.0}
    columns |= {f"motor_{i}": 0.2 * i for i in (1, 2, 3)} | {"motor_4": 0.0}
    flight = from_columns("drift", t, {name: np.full(len(t), value) for name, value in columns.items()})
    return prepare(vehicle, {"drift": flight}, [Window("drift", 0.0, 1.9)])


def test_the_wind_is_taken_off_and_the_attitude_undone(quad: Vehicle) -> None:
    prepared = drifting(quad)
    (piece,) = prepared.pieces
    assert set(piece.start) == set(quad.start_names)
    found = [piece.start[n] for n in (*"uvwpqr", "phi", "theta", "psi", "h")]
    assert found == pytest.approx([*THROUGH_AIR, 0.3, -0.2, 0.1, *ANGLES, 120.0], abs=1e-9)
    assert all(isinstance(value, float) for value in piece.start.values())
    assert (piece.measured.shape[1], prepared.notices) == (12, ())


def test_nuisances(quad: Vehicle) -> None:
    """The wind is one of them, and no parameter of the search."""
    found = {n.name: n for n in nuisances(quad, drifting(quad))}
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
    vehicle, t, rng = builtin_vehicle("twin-boom"), np.arange(400) * 0.01, np.random.default_rng(1)
    south = (0.02 * rng.standard_normal(400)) % (2.0 * np.pi) - np.pi
    spikes, psi = np.where(rng.random(400) < 0.02, 1.0, 0.01), vehicle.outputs.index("psi")
    for readings, lost in ((south, []), (0.0 * t, ["stuck-channel"]), (spikes, ["outliers-left-out"])):
        measured = 1e-4 * rng.standard_normal((400, 12))
        measured[:, psi] = readings
        piece = Piece(0, t, np.zeros((400, len(vehicle.inputs))), measured, {})
        found = without_stuck_channels(vehicle, Prepared((), (piece,)))
        assert [n.code for n in found.notices] == lost
        assert np.isnan(found.pieces[0].measured[:, psi]).all() == bool(lost)
