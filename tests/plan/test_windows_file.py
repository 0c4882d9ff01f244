"""windows.toml: what is written comes back, and whatever an editor leaves in it is taken or refused in a line."""

import tomllib
from pathlib import Path

import pytest

from stoop.errors import FlightError
from stoop_plan.input_design.windows_file import Entry, expanded, read_windows, written

GOOD = (
    Entry(flight="flight2", start=140.5, stop=145.9, axis="roll", why='says "so"\n', information=1.25),
    Entry(flight="a b@c", start=1.0, stop=2.5, use="validate", loading="heavy"),
    Entry(flight="flight2", start=161.6, stop=168.3, accept=False),
    Entry(flight="\U0001f681 \x7f\n[[window]]", start=1_700_000_123.456, stop=1_700_000_125.25, accept=False),
)
HEAD, WINDOW = 'format = "stoop-windows/1"\n[[window]]\n', 'flight = "f"\nstart = 1.0\nstop = 2.0\n'


@pytest.fixture
def good(tmp_path: Path) -> Path:
    path = tmp_path / "windows.toml"
    path.write_text(written(GOOD, "stoop identify 'a\nb'", ["a note\nover lines"]), encoding="utf-8")
    return path


def test_what_is_written_comes_back(good: Path) -> None:
    back = read_windows(good)
    assert [(e.text, e.accept, e.use) for e in back] == [(e.text, e.accept, e.use) for e in GOOD]
    assert GOOD[3].text.endswith("@1700000123.456:1700000125.25")
    first, *_ = tomllib.loads(good.read_text())["window"]
    assert (first["why"], first["information"]) == ('says "so"\n', 1.25)


def test_accepted_windows_take_the_place_of_the_file(good: Path) -> None:
    fitted, predicted = expanded(["0:3", str(good)], [])
    assert fitted == ["0:3", "flight2@140.5:145.9"]
    assert predicted == ["a b@c@1:2.5#heavy"]
    assert expanded([str(good)], ["5:6"])[1] == ["5:6"], "windows to validate on the command line rule"
    assert expanded(["0:3"], [str(good)])[1] == ["a b@c@1:2.5#heavy"]
    assert expanded(["0:3"], []) == (["0:3"], [])
    good.write_text(good.read_text().replace("accept = true", "accept = false"))
    with pytest.raises(FlightError, match="no window is accepted for fitting; set accept = true"):
        expanded([str(good)], [])
    with pytest.raises(FlightError, match=r"none\.toml: cannot read the windows file"):
        expanded(["none.toml"], [])


def test_an_edited_file_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "w.toml"
    for text, advice in (
        ("", 'format is not "stoop-windows/1"'), ("[[window", "not valid TOML"),
        (HEAD + WINDOW.replace("2.0", '"2"'), r"window\.0\.stop: it must be a valid number"),
        (HEAD + WINDOW.replace("start = 1.0\n", ""), r"window\.0\.start: missing; add it"),
        (HEAD + WINDOW.replace("2.0", "nan"), r"window\.0\.stop: it must be a finite number"),
        (HEAD + WINDOW.replace("2.0", "0.5"), "start = 1 is not before stop = 0.5"),
        (HEAD + WINDOW.replace('"f"', '""'), r"window\.0\.flight"), (HEAD + WINDOW.replace('"f"', "3"), "must be a valid string"),
        (HEAD + WINDOW + 'accept = "yes"', r"window\.0\.accept: it must be a valid boolean"),
        (HEAD + WINDOW + 'use = "train"', r"window\.0\.use: it must be 'fit' or 'validate'"),
        (HEAD + WINDOW + "use = [1]", r"window\.0\.use: it must be 'fit' or 'validate'"),
        (HEAD + WINDOW + "acept = true", r"window\.0\.acept: unknown key; .*did you mean accept"),
        ('format = "stoop-windows/1"\nwindow = 3', "window: this must be a list"),
        ('format = "stoop-windows/1"\nwindow = [3]', r"window\.0: this must be a table"),
    ):  # fmt: skip
        path.write_text(text)
        with pytest.raises(FlightError, match=rf"^[^\n]*w\.toml[^\n]*{advice}[^\n]*$"):
            read_windows(path)
