"""The page of a flight: everything in sight, whatever the log lacks."""

import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.cli.main import main
from stoop.flight import Flight, from_columns
from stoop.flight.windows import overview
from stoop.report.flight import flight_history, flight_sheet
from stoop.report.series import Shade
from stoop.report.sheet import render_sheet
from stoop.report.time_history import MAX_SAMPLES, blocks, in_blocks
from stoop.report.track import Track, projected


def flown(seconds: float = 120.0, rate: float = 50.0) -> Flight:
    time = np.arange(round(seconds * rate)) / rate
    turn, rng = 0.2 * time, np.random.default_rng(3)
    aileron = np.zeros(len(time))
    for t in (20, 50, 80):
        aileron += 0.1 * ((time > t) & (time < t + 0.5)) - 0.1 * ((time > t + 0.5) & (time < t + 1))
    columns = {
        "aileron": aileron, "p": np.convolve(aileron, np.ones(20), "same") + 1e-3 * rng.standard_normal(len(time)),
        "phi": 0.4 + 0 * time, "theta": 0 * time, "psi": (turn + np.pi) % (2 * np.pi) - np.pi,
        "pn": 100 * np.sin(turn), "pe": -100 * np.cos(turn), "altitude": 200 + 0.1 * time, "voltage": 12 - time / 100,
        "ax": rng.standard_normal(len(time)),
    }  # fmt: skip
    columns["ax"][len(time) // 6 : len(time) // 5] = np.nan
    return from_columns("<b>circles</b>", time, columns)


def test_all_that_was_recorded_is_on_the_page() -> None:
    page = render_sheet(flight_sheet(overview(flown()), "stoop look x.ulg", ["stoop", "identify"]))
    for words in ("Suspected faults", "attitude", "voltage of the main battery", "In space", "Spectrogram of ax",
                  "p over aileron", "Windows", "stoop look x.ulg"):  # fmt: skip
        assert words in page, words
    assert "<b>circles" not in page


def test_a_turn_is_no_stroke_across_the_panel() -> None:
    history = flight_history(flown(), overview(flown()).found)
    (attitude,) = [panel for panel in history.panels if panel.title == "attitude"]
    psi = next(one for one in attitude.strips[0].series if one.name == "psi")
    assert np.nanmax(np.abs(np.diff(psi.y))) < 180.0


def test_what_a_log_lacks_is_left_out() -> None:
    whole = flown(12.0, 20.0)
    for lacks in (("pn", "pe"), ("aileron", "p"), ("phi", "theta", "psi"), ("ax", "p")):
        kept = {str(n): whole.column(str(n)) for n in whole.data.data_vars if str(n) not in lacks}
        page = render_sheet(flight_sheet(overview(from_columns("f", whole.time, kept))))
        assert "Time histories" in page
        assert ("In space" in page) == ("pn" not in lacks), lacks
    for n in (2, 3, 30):
        flight = from_columns("f", np.arange(n) / 50.0, {"p": np.zeros(n), "q": np.full(n, np.nan)})
        assert "Channels" in render_sheet(flight_sheet(overview(flight)))


def test_a_long_record_keeps_every_peak_and_all_samples_of_its_windows() -> None:
    x, y = np.arange(4 * MAX_SAMPLES) / 100.0, np.random.default_rng(0).standard_normal(4 * MAX_SAMPLES)
    y[777:1888] = np.nan
    y[54321] = 50.0
    starts = blocks(x, [Shade(300.0, 310.0, "1", "fitted")])
    time, (values,) = in_blocks(x, [y], starts)
    assert len(time) == len(values) < MAX_SAMPLES
    assert np.nanmax(values) == 50.0
    assert np.nanmin(values) == np.nanmin(y)
    assert np.all(np.diff(time) >= 0.0)
    assert set(values[(time > 300.0) & (time < 310.0)]) == set(y[(x > 300.0) & (x < 310.0)])
    assert np.isnan(values[(time > x[777] + 0.5) & (time < x[1888] - 0.5)]).all()
    x = np.arange(40 * MAX_SAMPLES) / 100.0  # with a fault that lasts for hours
    assert len(blocks(x, [Shade(0.0, 8000.0, "", "fault")])) <= MAX_SAMPLES


def test_a_short_record_is_on_the_page_as_it_is() -> None:
    flight = flown(20.0)
    history = flight_history(flight, overview(flight).found)
    content = json.loads(history.document())
    for strip, panel in zip((s for p in content["panels"] for s in p), history.panels, strict=True):
        for drawn, series in zip(strip["series"], panel.strips[0].series, strict=True):
            packed = base64.b64decode(content["tables"][drawn["table"]][drawn["column"]])
            assert np.array_equal(np.frombuffer(packed, "<f4"), series.y.astype("f4"), equal_nan=True)


def test_the_track_is_seen_from_where_it_says() -> None:
    track = Track.of(flown())
    assert track is not None
    east_up: FloatArray = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    (right, _), (none, up), (left, away) = projected(east_up)
    assert (none, right > 0, up > 0, left < 0 < away) == (0, True, True, True)
    nose, tail, *_, fin = track.glyphs()[0]
    assert np.linalg.norm(nose - tail) == pytest.approx(1.7 * 0.03 * 200.0, rel=0.01)
    assert fin[2] > tail[2], "the fin is on top"


def test_look_writes_a_page_and_info_the_same_beside_its_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    flight, names = flown(40.0), ("p", "ax", "phi", "theta", "psi")
    table = np.column_stack([flight.time, *(flight.column(n) for n in names)])
    np.savetxt("flight.csv", table, delimiter=",", header=",".join(["time", *names]), comments="")
    for command, code, said in (
        ("map flight.csv -o map.toml", 0, "map.toml: "),
        ("look flight.csv --mapping map.toml -o one.html", 0, "wrote one.html"),
        ("info flight.csv --mapping map.toml -o two.html --verbose", 0, "Channels"),
        ("look flight.csv --mapping map.toml -o one.html", 2, "exists already"),
    ):
        assert main(command.split()) == code
        assert said in "".join(capsys.readouterr())
    made = (Path(f"{n}.html").read_text("utf-8") for n in ("one", "two"))
    one, two = (re.sub(r"<pre.*?</pre>", "", page, flags=re.DOTALL) for page in made)
    assert one == two
