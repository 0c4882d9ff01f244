"""The verb: what is written, said, refused; the same command again gives the same bytes."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from stoop.cli.main import main
from stoop_studies.cli.reproduce import NAMES
from stoop_studies.findings import Setting
from stoop_studies.reproduce.registry import EXPERIMENTS

Complaint = Callable[..., str]


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Complaint:
    """Return what runs a command and gives back its one line of complaint."""

    def run(*words: str) -> str:
        assert main(["reproduce", *words]) == 2
        out, err = capsys.readouterr()
        lines = [line for line in err.splitlines() if "runs" not in line.partition("stoop: ")[0]]
        assert out == ""
        assert len(lines) == 1
        return lines[0]

    return run


def test_every_experiment_is_offered() -> None:
    assert tuple(EXPERIMENTS) == NAMES


def test_a_figure_is_page_and_table_and_the_same_bytes_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "new" / "folder"
    assert main(["reproduce", "figure3", "-o", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "- reproduces: Trim at 35 m/s" in said
    assert f"page: {folder / 'figure3.html'}" in said
    first = {p.name: p.read_bytes() for p in folder.iterdir()}
    assert sorted(first) == ["figure3.csv", "figure3.html"]
    page = first["figure3.html"].decode()
    assert "stoop reproduce figure3 --runs 1 --seed 0 --box N" in page
    assert "studies.html#reproduce-figure3" in page, "every page leads to what the paper leaves open"
    assert main(["reproduce", "figure3", "-o", str(folder)]) == 0
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == first


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["figure4"], "invalid choice: 'figure4'"),
        (["figure3", "--runs", "0"], "'0' is not a whole number from 1 to 1000000"),
        (["figure3", "--seed", "-1"], "is not a whole number"),
        (["table1", "--box", "X"], "invalid choice: 'X'"),
        ([], "required: EXPERIMENT"),
    ],
)
def test_bad_words(refused: Complaint, words: list[str], complaint: str) -> None:
    assert complaint in refused(*words)


def test_an_output_that_is_a_file(refused: Complaint, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("mine")
    assert f"{path}: is a file; name a folder" in refused("figure3", "-o", str(path))
    assert path.read_text() == "mine"


@pytest.mark.parametrize("name", ["figure3.html", "figure3.csv"])
def test_files_of_others_stay(refused: Complaint, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    assert "is of something else than stoop reproduce figure3; add --overwrite" in refused(
        "figure3", "-o", str(tmp_path)
    )
    assert (tmp_path / name).read_text() == "mine"
    assert main(["reproduce", "figure3", "-o", str(tmp_path), "--overwrite"]) == 0
    assert (tmp_path / name).read_text() != "mine"


def test_a_further_table_of_others_stays(refused: Complaint, tmp_path: Path) -> None:
    path = tmp_path / "lateral-biases.csv"
    path.write_text("mine")
    assert "is of something else than stoop reproduce lateral" in refused("lateral", "-o", str(tmp_path))
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert path.read_text() == "mine"


def test_an_index_of_others_stays(refused: Complaint, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("mine")
    assert "index.html: is of something else" in refused("all", "-o", str(tmp_path))


def test_a_store_of_another_box_or_version_is_refused(refused: Complaint, tmp_path: Path) -> None:
    command = ["noise", "-o", str(tmp_path), "--runs", "1", "--workers", "1"]
    store(tmp_path / "noise.sqlite")
    before = (tmp_path / "noise.sqlite").read_bytes()
    assert "noise.sqlite" in refused(*command, "--box", "N")
    assert (tmp_path / "noise.sqlite").read_bytes() == before
    with sqlite3.connect(tmp_path / "noise.sqlite") as changed:
        changed.execute("UPDATE meta SET value = replace(value, 'numpy', 'mumpy')")
    assert "noise.sqlite" in refused(*command)
    assert not (tmp_path / "noise.html").exists()


@pytest.mark.parametrize("content", [b"mine", b"SQLite format 3\x00 but not really", None])
def test_overwrite_removes_nothing_but_stores_of_its_own(
    refused: Complaint, tmp_path: Path, content: bytes | None
) -> None:
    path = tmp_path / "noise.sqlite"
    if content is None:
        with sqlite3.connect(path) as other:
            other.execute("CREATE TABLE mine (a)")
    else:
        path.write_bytes(content)
    before = path.read_bytes()
    assert "noise.sqlite: " in refused("noise", "-o", str(tmp_path), "--overwrite")
    assert path.read_bytes() == before


def test_overwrite_waits_for_nobody(refused: Complaint, tmp_path: Path) -> None:
    path = tmp_path / "noise.sqlite"
    store(path)
    with sqlite3.connect(path) as user:
        user.execute("BEGIN EXCLUSIVE")
        assert "cannot be removed" in refused("noise", "-o", str(tmp_path), "--overwrite")
    assert path.exists()


def store(path: Path) -> None:
    """Make a store with one run in it: without any it would hold on to nothing."""
    from stoop.parallel import environment
    from stoop.parallel.store import open_store

    plan = EXPERIMENTS["noise"].plan(Setting(1, box="W"))
    assert plan is not None
    with open_store(path, plan, environment()) as made:
        made.add(plan.runs[:1], ["null"])
