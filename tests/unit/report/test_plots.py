"""Plots: data at the right pixels, ticks that can be read, contours where the values are."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from itertools import pairwise

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.report.plots import (
    HEIGHT,
    LEFT,
    RIGHT,
    WIDTH,
    Mark,
    Scale,
    Series,
    Shade,
    Strip,
    contour_levels,
    contour_path,
    contour_plot,
    decade_ticks,
    plot,
    stacked_plots,
)

BOX = WIDTH - LEFT - RIGHT


def tree(html: str) -> ET.Element:
    return ET.fromstring(f"<div>{html}</div>")  # noqa: S314 - our own


def curves(html: str) -> list[FloatArray]:
    """Return the points (k, 2) of each drawn series, px within the box."""
    paths = [e for e in tree(html).iter("path") if "series" in e.get("class", "")]
    return [np.array(re.findall(r"-?\d+", e.get("d", "")), dtype=float).reshape(-1, 2) / 10.0 for e in paths]


def texts(html: str, kind: str) -> list[str]:
    return [e.text or "" for e in tree(html).iter("text") if kind in e.get("class", "").split()]


def test_points_are_where_the_axes_say() -> None:
    one = Series("a", np.array([0.0, 5.0, 10.0]), np.array([0.0, 1.0, 2.0]))
    (drawn,) = curves(plot([one], "x", "y", "d", x_range=(0.0, 10.0), y_range=(0.0, 4.0)))
    assert drawn == pytest.approx(
        np.array([[0.0, HEIGHT], [BOX / 2, 0.75 * HEIGHT], [BOX, HEIGHT / 2]]), abs=0.06
    )


def test_logarithmic_axes_give_every_decade_the_same_room() -> None:
    one = Series("a", np.array([1.0, 10.0, 100.0, -1.0]), np.array([1e-6, 1e-3, 1.0, 1.0]))
    (drawn,) = curves(
        plot([one], "x", "y", "d", log_x=True, log_y=True, x_range=(1.0, 100.0), y_range=(1e-6, 1.0))
    )
    assert drawn == pytest.approx(np.array([[0.0, HEIGHT], [BOX / 2, HEIGHT / 2], [BOX, 0.0]]), abs=0.06)


def test_steps_hold_until_the_next() -> None:
    one = Series("a", np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 1.0]), "steps")
    (drawn,) = curves(plot([one], "x", "y", "d", x_range=(0.0, 2.0), y_range=(0.0, 1.0)))
    assert drawn.tolist() == [[0, HEIGHT], [BOX / 2, HEIGHT], [BOX / 2, 0], [BOX, 0]]


@pytest.mark.parametrize(
    ("low", "high", "most", "expected"),
    [
        (1.0, 1e5, 8, [1.0, 10.0, 100.0, 1e3, 1e4, 1e5]),
        (0.5, 60.0, 8, [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0]),
        (1e-12, 1e12, 6, [1e-12, 1e-8, 1e-4, 1.0, 1e4, 1e8, 1e12]),
        (2.5, 3.5, 4, [2.5, 3.0, 3.5]),
    ],
)
def test_ticks_of_logarithmic_axes(low: float, high: float, most: int, expected: list[float]) -> None:
    assert decade_ticks(low, high, most) == pytest.approx(expected)


def test_what_has_no_logarithm_has_no_pixel() -> None:
    assert np.isnan(Scale(1.0, 10.0, 0.0, 1.0, log=True)(np.array([0.0, -1.0, np.nan]))).all()


def test_twenty_series_all_look_different_and_are_named() -> None:
    some = [Series(f"s{i}", np.arange(4.0), np.arange(4.0) + i) for i in range(20)]
    html = plot(some, "x", "y", "twenty")
    keys = list(tree(html).iter("li"))
    looks = [next(e.iter("line")).get("class") for e in keys]
    assert len(set(looks)) == 20
    assert ["".join(e.itertext()) for e in keys] == [f"s{i}" for i in range(20)]


def test_points_of_different_rounds_differ_in_shape() -> None:
    some = [Series(f"s{i}", np.ones(1), np.ones(1), "points") for i in (*range(17),)]
    spots = [e for e in tree(plot(some, "x", "y", "d")).iter() if "spot" in e.get("class", "")]
    assert len({(e.tag, e.get("class")) for e in spots}) == 17


@pytest.mark.parametrize("values", [[], [np.nan], [np.inf, 1.0], [3.0], [0.0, 0.0], [-1.0, 0.0]])
@pytest.mark.parametrize("log", [False, True])
def test_hardly_any_data_still_make_a_drawing(values: list[float], log: bool) -> None:
    array = np.array(values)
    html = plot([Series("a", array, array, "steps")], "x", "y", "d", log_x=log, log_y=log)
    assert "NaN" not in html
    assert "nan" not in html


def test_tick_labels_never_overlap() -> None:
    for high in (3.0, 40.0, 1e3, 1e5, 1e7, 1e12):
        one = Series("a", np.array([1.0, high]), np.array([1.0, high]))
        for log in (False, True):
            html = plot([one], "x", "y", "d", log_x=log)
            marks = [e for e in tree(html).iter("text") if e.get("class") == "tick mid"]
            places = [(float(e.get("x", "")), 6.0 * len(e.text or "")) for e in marks]
            assert len(places) > 1
            for (x, width), (after, wide) in pairwise(places):
                assert x + width / 2 < after - wide / 2


def test_strips_share_one_axis_and_one_legend() -> None:
    time = np.linspace(0.0, 30.0, 301)
    both = (Series("measured", time, np.sin(time)), Series("simulated", time, np.cos(time)))
    html = stacked_plots([Strip("V, m/s", both), Strip("q, deg/s", both[:1])], "time, s", "two strips")
    assert sorted(filter(None, texts(html, "label"))) == ["V, m/s", "q, deg/s", "time, s"]
    assert len(curves(html)) == 3
    assert len(list(tree(html).iter("li"))) == 2


def test_a_contour_of_a_cone_is_a_circle() -> None:
    axis = np.linspace(-2.0, 2.0, 81)
    X, Y = np.meshgrid(axis, axis)
    found = contour_path(100 * axis, 100 * axis, np.hypot(X, Y), 1.5, "contour")
    points = np.array(re.findall(r"-?\d+", found.split('d="')[1].split('"')[0]), dtype=float).reshape(-1, 2)
    assert np.hypot(*points.T) / 1000.0 == pytest.approx(1.5, abs=2e-3)
    # all around, and nothing left out: the pieces add up to the circumference
    pieces = np.diff(points, axis=0)
    assert np.hypot(*pieces.T).sum() / 1000.0 == pytest.approx(3.0 * np.pi, rel=2e-3)


def test_levels_part_the_grid_evenly_and_none_lie_in_a_plane() -> None:
    values = np.exp(np.linspace(0.0, 9.0, 100)).reshape(10, 10)
    counts = np.diff(np.searchsorted(values.ravel(), contour_levels(values, 10)))
    assert counts.min() == counts.max() == 10
    assert contour_levels(np.ones((3, 3))).size == 0
    assert contour_levels(np.full((3, 3), np.nan)).size == 0


def test_a_contour_plot_names_its_marks() -> None:
    axis = np.linspace(0.0, 1.0, 9)
    values = np.add.outer(axis, axis)
    marks = (Mark("start", 0.1, 0.2), Mark("end", 0.9, 0.8))
    html = contour_plot(axis, axis, values, np.array([[0.1, 0.2], [0.9, 0.8]]), marks, "a", "b", "d")
    assert ["".join(e.itertext()) for e in tree(html).iter("li")] == ["start", "end"]


def test_what_is_declined_lies_behind_and_every_stretch_has_its_edges() -> None:
    one = Series("a", np.array([0.0, 10.0]), np.array([0.0, 1.0]))
    shades = [
        Shade(0.0, 4.0, "1", "fitted"),
        Shade(2.0, 6.0, "2", "declined"),
        Shade(4.0, 8.0, "3", "fitted"),
    ]
    html = stacked_plots([Strip("a", (one,))], "x", "d", shades)
    kinds = [e.get("class") for e in tree(html).iter("rect")]
    assert kinds == ["shade declined", "shade fitted", "shade fitted"]
    brinks = [e for e in tree(html).iter("line") if "brink" in e.get("class", "")]
    at = {
        kind: [float(e.get("x1", "")) for e in brinks if kind in e.get("class", "")]
        for kind in ("fitted", "declined")
    }
    assert at["fitted"] == pytest.approx([BOX * s for s in _shares(0.0, 4.0, 4.0, 8.0)], abs=0.01)
    assert at["declined"] == pytest.approx([BOX * s for s in _shares(2.0, 6.0)], abs=0.01)


def _shares(*values: float) -> list[float]:
    """Return places on an axis of 0 to 10 with its margins of 4 %."""
    return [(v + 0.4) / 10.8 for v in values]


def test_zero_is_in_sight_where_it_is_asked_for() -> None:
    one = (Series("a", np.array([0.0, 1.0]), np.array([4.0, 5.0])),)
    assert "0" in texts(stacked_plots([Strip("a", one, zero=True)], "x, s", "d"), "end")
    assert "0" not in texts(stacked_plots([Strip("a", one)], "x, s", "d"), "end")


def test_ticks_stand_where_values_are() -> None:
    lengths = np.array([39.0, 41.0, 47.0])
    html = plot([Series("a", lengths, lengths)], "x", "y", "d", x_ticks=[39.0, 41.0, 47.0])
    assert [t for t in texts(html, "tick") if t in texts(html, "mid")][-3:] == ["39", "41", "47"]


def test_the_name_of_a_window_that_is_used_goes_before_one_that_is_declined() -> None:
    x = np.linspace(0.0, 100.0, 5)
    shades = [
        Shade(30.0, 52.0, "6", "declined"),
        Shade(40.0, 42.0, "7", "fitted"),
        Shade(70.0, 80.0, "8", "fitted"),
    ]
    html = stacked_plots([Strip("a", (Series("s", x, x),))], "x", "d", shades)
    assert re.findall(r'class="shade-name mid">(\d)<', html) == ["7", "8"]


@pytest.mark.parametrize("wished", [(0.0, -1.0), (0.0, 0.0), (0.0, np.nan), (0.0, np.inf), (-1e308, 1e308)])
def test_a_range_that_is_no_interval_is_that_of_the_series(wished: tuple[float, float]) -> None:
    x = np.linspace(0.0, 1.0, 5)
    series = [Series("power", x, x**2)]
    usual = plot(series, "x", "y", "d")
    assert plot(series, "x", "y", "d", x_range=wished, y_range=wished) == usual
