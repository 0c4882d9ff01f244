"""Tables, datasets and windows in memory become flights and windows, or give one line of advice."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest

import stoop
from stoop.errors import FlightError, StoopError
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.workflow.flights import as_flight

TIME = np.arange(100) * 0.02
G = 9.80665
Columns = dict[str, Any]


def table(**more: Any) -> pd.DataFrame:
    return pd.DataFrame({"time": TIME, "q": 0.1 * np.sin(TIME), **more})


def test_dates_are_seconds_from_the_first_sample() -> None:
    for first in ("2026-01-01", "1970-01-01T00:00:05"):
        dates = pd.Timestamp(first) + pd.to_timedelta(np.arange(100) * 20, unit="ms")
        found = as_flight(table().assign(time=dates))
        np.testing.assert_allclose(found.time, TIME, atol=1e-9)
        assert found.rate == as_flight(table().assign(time=dates - dates[0])).rate == 50.0
    np.testing.assert_array_equal(as_flight(table().set_index("time")).time, TIME)


def test_a_dict_of_columns_is_a_table() -> None:
    same = as_flight(table())
    kinds: tuple[Callable[..., Any], ...] = (dict, lambda t: {n: list(x) for n, x in t.items()}, pd.DataFrame)
    for kind in kinds:
        found = as_flight(kind(table()))
        assert found.data.identical(same.data)
        assert found.rate == 50.0


def test_what_is_no_flight_is_refused_in_one_line() -> None:
    unnamed = table().drop(columns="time")
    refused: list[tuple[Any, str]] = [
        (table(mode=["hover"] * 100), "^column 'mode' holds text, not numbers; leave it out or give SI numbers$"),
        (table(p=pd.Timestamp("2026-01-01")), "^column 'p' holds dates, not numbers"),
        (unnamed, "no column 'time'"),
        (unnamed.to_xarray(), "no column 'time'"),
        (unnamed.rename_axis("time").to_xarray().drop_vars("time"), "no column 'time'"),
        (table().rename(columns={"q": 0}), "there is no variable '0'"),
        ({}, "a flight is expected"),
        ({"time": 1.0, "q": 2.0}, "holds no equally long columns"),
        ({"time": TIME, "q": TIME[1:]}, "holds no equally long columns"),
        ({"time": TIME, "q": np.ones((100, 2))}, "holds no equally long columns"),
        ({"one": table(), "other": table()}, r"column 'time'|several flights as a list"),
        ({"q": TIME}, "no column 'time'"),
        (np.zeros((3, 3)), "not a ndarray; give a Flight, a path, a dict of columns"),
    ]  # fmt: skip
    for given, match in refused:
        with pytest.raises(FlightError, match=match):
            as_flight(given)
    with pytest.raises(FlightError, match=r"not a DataFrame; give a table straight to stoop\.fit"):
        stoop.load_flight(table())  # type: ignore[arg-type]
    for target in (None, 3, ["jsbsim"]):
        with pytest.raises(StoopError, match=r"there is no target .* of an export; .*jsbsim"):
            stoop.export("twin-boom", to=target)  # type: ignore[arg-type]


def test_a_window_in_every_form(flight: Flight) -> None:
    flights, one = {"sim": flight}, Window("sim", 0.5, 20.0)
    pair = (0.5, 20)
    forms = (
        "0.5:20", pair, slice(0.5, 20), ["0.5:20"], [pair], [slice(0.5, 20.0)], one, [*pair], [[*pair]],
        np.array(pair), np.array([pair]), [np.array(pair)], (np.float32(0.5), np.float64(20.0)),
    )  # fmt: skip
    for form in forms:
        assert Window.several(form, flights) == (one,), form  # type: ignore[arg-type]
    assert [w.stop for w in Window.several(["0:2", (3, 4), slice(5, 6)], flights)] == [2.0, 4.0, 6.0]
    assert Window.several((), flights) == ()
    for wrong in (np.zeros((2, 3)), np.zeros((2, 2, 2)), np.ones(3), 3.0, np.float64(3.0), [None], (1, "x")):
        with pytest.raises(FlightError, match=r"140:145|START:STOP"):
            Window.several(wrong, flights)  # type: ignore[arg-type]
    for none in ((), [], np.empty((0, 2))):
        with pytest.raises(FlightError, match="no maneuver is given"):
            stoop.fit("twin-boom", table(), none)


def test_a_name_stays_within_its_folder() -> None:
    given = table().set_index("time").to_xarray().assign_attrs(name="a/../../../evil/x@0#b:c\\d")
    assert as_flight(given).name == "a-..-..-..-evil-x-0-b-c-d"


def turning() -> Columns:
    t = 0.01 * np.arange(3000)
    phi, theta, psi = 0.4 * np.sin(1.7 * t), 0.3 * np.sin(2.3 * t), 0.5 * np.sin(1.1 * t)
    dphi, dtheta, dpsi = 0.68 * np.cos(1.7 * t), 0.69 * np.cos(2.3 * t), 0.55 * np.cos(1.1 * t)
    return {
        "time": t, "phi": phi, "theta": theta, "psi": psi,
        "p": dphi - dpsi * np.sin(theta),
        "q": dtheta * np.cos(phi) + dpsi * np.sin(phi) * np.cos(theta),
        "r": -dtheta * np.sin(phi) + dpsi * np.cos(phi) * np.cos(theta),
        "ax": G * np.sin(theta), "ay": -G * np.sin(phi) * np.cos(theta), "az": -G * np.cos(phi) * np.cos(theta),
        "V": 20.0 + 0.1 * np.sin(t), "voltage": np.full(3000, 12.0),
    }  # fmt: skip


def test_degrees_are_an_error_other_contradictions_faults_and_a_right_table_is_not_accused() -> None:
    right = pd.DataFrame(turning())
    for given in (right, right.set_index("time").to_xarray()):
        assert (as_flight(given).notices, as_flight(given).faults) == ((), ())
    for names, factor, kind, advice in (
        ("theta", 180 / np.pi, "", "convert 'theta' in the table from deg"),
        ("p q r", 180 / np.pi, "", "convert 'p', 'q' and 'r' in the table from deg/s"),
        ("ax ay az", 1 / G, "wrong unit", "convert 'ax', 'ay' and 'az' in the table from g"),
        ("voltage", 1e3, "wrong unit", "convert 'voltage' in the table from mV"),
        ("q", -1.0, "inconsistent", "multiply 'q' in the table by -1"),
    ):
        wrong = right.assign(**{name: factor * right[name] for name in names.split()})
        for given in (wrong, wrong.set_index("time").to_xarray()):
            if kind:
                (fault,) = (found := as_flight(given)).faults
                assert (fault.kind, fault.variable in names.split()) == (kind, True)
                assert fault.message.endswith(advice)
                assert fault.notice in found.notices
            else:
                with pytest.raises(FlightError, match=rf"^flight: [^\n]*{advice}$"):
                    as_flight(given)


def test_units_that_a_dataset_states_are_not_ignored() -> None:
    given = pd.DataFrame(turning()).set_index("time").to_xarray()
    given["theta"].attrs["units"] = "rad"
    assert as_flight(given).faults == ()
    given["voltage"].attrs["units"] = "mV"
    line = r"^column 'voltage' is in mV by its attribute 'units'; give it in V$"
    with pytest.raises(FlightError, match=line):
        as_flight(given)
