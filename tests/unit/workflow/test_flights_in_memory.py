"""Tables and datasets in memory become flights, or give one line of advice."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

import stoop
from stoop.errors import FlightError
from stoop.workflow.flights import as_flight

TIME = np.arange(100) * 0.02


def table(**more: Any) -> pd.DataFrame:
    return pd.DataFrame({"time": TIME, "q": 0.1 * np.sin(TIME), **more})


@pytest.mark.parametrize("first", ["2026-01-01", "1970-01-01T00:00:05"])
def test_dates_are_seconds_from_the_first_sample(first: str) -> None:
    dates = pd.Timestamp(first) + pd.to_timedelta(np.arange(100) * 20, unit="ms")
    found = as_flight(table().assign(time=dates))
    np.testing.assert_allclose(found.time, TIME, atol=1e-9)
    assert found.rate == 50.0
    assert as_flight(table().assign(time=dates - dates[0])).rate == 50.0


def test_an_index_of_times_is_the_time() -> None:
    np.testing.assert_array_equal(as_flight(table().set_index("time")).time, TIME)


@pytest.mark.parametrize(
    ("given", "match"),
    [
        (
            table(mode=["hover"] * 100),
            "^column 'mode' holds text, not numbers; leave it out or give SI numbers$",
        ),
        (table(p=pd.Timestamp("2026-01-01")), "^column 'p' holds dates, not numbers"),
        (table().drop(columns="time"), "no column 'time'"),
        (table().drop(columns="time").to_xarray(), "no column 'time'"),
        (table().rename_axis("time").drop(columns="time").to_xarray().drop_vars("time"), "no column 'time'"),
        (table().rename(columns={"q": 0}), "there is no variable '0'"),
    ],
)
def test_what_is_no_flight_is_refused_in_one_line(given: Any, match: str) -> None:
    with pytest.raises(FlightError, match=match):
        as_flight(given)


def test_a_table_is_no_path() -> None:
    with pytest.raises(FlightError, match=r"not a DataFrame; give a table straight to stoop\.fit"):
        stoop.load_flight(table())  # type: ignore[arg-type]


def test_a_name_stays_within_its_folder() -> None:
    given = table().set_index("time").to_xarray().assign_attrs(name="a/../../../evil/x@0#b:c\\d")
    assert as_flight(given).name == "a-..-..-..-evil-x-0-b-c-d"
