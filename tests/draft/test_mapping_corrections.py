"""Advice on a mapping, applied: other keys stay, lists change in one place, and what is not confirmed is left."""

import tomllib
from pathlib import Path

import pytest
from draft.test_mapping_draft import T, flown
from helpers.made_logs import CLOCK, csv_log, lines_of

from stoop.base.arrays import FloatArray
from stoop.cli.main import main
from stoop.errors import StoopError
from stoop_draft.checks.entries import read_lines
from stoop_draft.checks.frames import frame_edits
from stoop_draft.checks.lines import mapping_edits
from stoop_draft.mapping_corrections import corrected_mapping, with_changes

MAPPING = "# my own\n" + CLOCK.replace("les]", "les]  # as the manual says")
MAPPING += lines_of("phi", "theta", "psi", "ax", "ay", "az", "vd", "altitude")
GYRO = '[group.gyro]\nvariables = ["p", "q", "r"]\nunit = "rad/s"\n'
GROUPED = GYRO + 'sources = [{columns = ["p", "q", "r"]}]\n'
SINGLE = lines_of("p", "q", "r")


def written(folder: Path, columns: dict[str, FloatArray], text: str) -> tuple[Path, Path]:
    mapping = folder / "m.toml"
    mapping.write_text(text)
    return csv_log(folder / "log.csv", {"t": T, **columns}), mapping


def test_a_scale_that_stands_there_is_kept(tmp_path: Path) -> None:
    truth = flown()
    kept = '"q", unit = "rad/s", scale = 0.5}  # counts by halves'
    text = (MAPPING + SINGLE).replace('"q", unit = "rad/s"}', kept)
    path, mapping = written(tmp_path, {**truth, "q": -2.0 * truth["q"]}, text)
    made = corrected_mapping(path, mapping)
    (applied,) = made.applied
    assert str(applied).endswith(f"write scale = -0.5 for variables.q in {mapping}")
    assert made.text == text.replace(kept, kept.replace("0.5", "-0.5"))


def test_one_variable_of_a_group_is_turned_and_the_others_stay(tmp_path: Path) -> None:
    truth = flown()
    path, mapping = written(tmp_path, {**truth, "q": -truth["q"]}, MAPPING + GROUPED)
    mapping.write_text(mapping.read_text(), "utf-8-sig")
    made = corrected_mapping(path, mapping)
    (source,) = tomllib.loads(made.text)["group"]["gyro"]["sources"]
    assert source == {"columns": ["p", "q", "r"], "scale": [1.0, -1.0, 1.0]}
    assert "write scale = [1, -1, 1] for group.gyro.sources[0] in" in str(made.applied[0])
    assert made.left == ()


def test_edits_of_a_group_change_its_lists_or_advise_where_columns_are_not_plain(tmp_path: Path) -> None:
    place = tmp_path / "m.toml"
    place.write_text(GROUPED.replace('unit = "rad/s"', 'scale = [1.0, 2.0, 3.0]\nunit = "rad/s"'))
    lines = read_lines(dict.fromkeys("pqr", f"{place}: group.gyro.sources[0]"))
    turned = next(edit for edit in frame_edits(lines) if edit.lines == ("q", "r"))
    assert [*map(str, turned.changes(lines))] == ["group.gyro.sources[0].scale = [1, -2, -3]"]
    every = mapping_edits(dict.fromkeys("pqr", (T, T)), "pqr", lines, {})
    swapped = next(edit for edit in every if edit.kind == "exchange" and edit.lines == ("p", "q"))
    text = with_changes(place.read_text(), [*map(str, swapped.changes(lines))])
    (source,) = tomllib.loads(text)["group"]["gyro"]["sources"]
    assert (source["columns"], source["scale"]) == (["q", "p", "r"], [2, 1, 3])
    place = tmp_path / "m.toml"
    for entry in (
        'columns = ["g[{0..2}]"]', 'columns = "g[{0..2}]"',
        'columns = ["p", "q", "r"]\nframe = "flu"', 'columns = [{p = 1.0, q = -1.0}, "q", "r"]',
    ):  # fmt: skip
        place.write_text(f"{GYRO}{entry}\n")
        lines = read_lines(dict.fromkeys("pqr", f"{place}: group.gyro.sources[0]"))
        for edit in (*mapping_edits(dict.fromkeys("pqr", (T, T)), "pqr", lines, {}), *frame_edits(lines)):
            assert edit.changes(lines) == ()
            assert "group.gyro" in edit.advice(lines)


def test_the_verb_writes_the_mapping(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth, before, other = flown(), MAPPING + SINGLE, tmp_path / "new.toml"
    path, mapping = written(tmp_path, {**truth, "q": -truth["q"]}, before)
    assert main(["map", str(path), "--apply", str(mapping), "-o", str(other)]) == 0
    assert mapping.read_text() == before
    assert "corrections applied: 1, each confirmed" in capsys.readouterr().out
    assert other.read_text() == before.replace('"q", unit = "rad/s"}', '"q", unit = "rad/s", scale = -1}')
    assert main(["map", str(path), "--apply", str(mapping)]) == 0
    assert capsys.readouterr().out == other.read_text()


def test_an_exchange_writes_names_of_any_kind_and_only_within_a_stream(tmp_path: Path) -> None:
    place = tmp_path / "m.toml"
    place.write_text(
        '[variables]\np = {column = "a\\"b", unit = "rad/s"}\nq = {column = "b", unit = "deg/s"}\n'
        'r = {column = "c", unit = "rad/s", valid = "ok"}\n'
    )
    lines = read_lines({name: f"{place}: variables.{name}" for name in "pqr"})
    edits = mapping_edits(dict.fromkeys("pqr", (T, T)), "pqr", lines, {})
    every = {edit.lines: edit for edit in edits if edit.kind == "exchange"}
    text = with_changes(place.read_text(), [*map(str, every["p", "q"].changes(lines))])
    assert tomllib.loads(text)["variables"]["q"] == {"column": 'a"b', "unit": "rad/s"}
    assert every["q", "r"].changes(lines) == ()  # the flag goes with its column
    text = '[variables]\nq = {column = "q", unit = "rad"}  # unsure: rad by its size only; rad by its size; mine\n'
    assert with_changes(text, ['variables.q.unit = "deg"']).endswith('"deg"}  # mine\n')
    # a rate and its angle alone contradict each other, and nothing shows which is wrong
    truth = flown()
    text = CLOCK + lines_of("phi", "p")
    path, mapping = written(tmp_path, {**truth, "p": -truth["p"]}, text)
    made = corrected_mapping(path, mapping)
    assert (made.text, made.applied) == (mapping.read_text(), ())
    assert [one.code for one in made.left] == ["mapping-ambiguous"]


def test_what_is_no_mapping_is_told(tmp_path: Path) -> None:
    variables = "[variables]\n" + SINGLE
    for text, words in (
        ('name = "twin"\n[mass]\nmass = 1.0\n', "no mapping but a file of name, mass; a mapping has"),
        ("t,p,q\n1,2,3\n", "not valid TOML"),
        (variables.replace("rad/s", "dps"), 'is unknown; write "deg/s"'),
        (variables.replace("rad/s", "kotz"), "is unknown; choose from|is unknown; the nearest"),
        (variables.replace('column = "q"', 'column = "altitud"'), "did you mean altitude"),
        (MAPPING + SINGLE.replace('"p"', '"zz"'), r"m\.toml: variables\.p"),  # and not a copy of it
    ):
        path, mapping = written(tmp_path, flown(), text)
        with pytest.raises(StoopError, match=words):
            corrected_mapping(path, mapping)
    with pytest.raises(ValueError, match="no change"):
        with_changes(MAPPING, ["everything"])
