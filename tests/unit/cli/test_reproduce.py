"""The verb: what is written, said, refused; the same command again gives the same bytes."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

from stoop.parallel import environment
from stoop.parallel.store import open_store
from stoop_studies.cli.reproduce import NAMES
from stoop_studies.findings import Setting
from stoop_studies.reproduce.registry import EXPERIMENTS

Refused = Callable[..., str]


def test_a_figure_is_page_and_table_and_the_same_bytes_again(
    tmp_path: Path, done: Callable[..., str]
) -> None:
    assert tuple(EXPERIMENTS) == NAMES
    folder = tmp_path / "new" / "folder"
    said = done(f"reproduce figure3 -o {folder}")
    assert "- reproduces: Trim at 35 m/s" in said
    assert f"page: {folder / 'figure3.html'}" in said
    first = {p.name: p.read_bytes() for p in folder.iterdir()}
    assert sorted(first) == ["figure3.csv", "figure3.html"]
    page = first["figure3.html"].decode()
    assert "stoop reproduce figure3 --runs 1 --seed 0 --box N" in page
    assert "studies.html#reproduce-figure3" in page, "every page leads to what the paper leaves open"
    done(f"reproduce figure3 -o {folder}")
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == first


def test_files_of_others_stay(refused: Refused, done: Callable[..., str]) -> None:
    for file, experiment in (("figure3.html", "figure3"), ("figure3.csv", "figure3"), ("index.html", "all"),
                             ("lateral-biases.csv", "lateral")):  # fmt: skip
        path = Path(file)
        path.write_text("mine")
        said = refused(f"reproduce {experiment} -o .")
        assert "is of something else" in said, file
        path.unlink()
    path.write_text("mine")
    Path("figure3.csv").write_text("mine")
    done("reproduce figure3 -o . --overwrite")
    assert Path("figure3.csv").read_text() != "mine"
    assert path.read_text() == "mine"


def store(path: Path) -> None:
    """Make a store with one run in it: without any it would hold on to nothing."""
    plan = EXPERIMENTS["noise"].plan(Setting(1, box="W"))
    assert plan is not None
    with open_store(path, plan, environment()) as made:
        made.add(plan.runs[:1], ["null"])


def test_a_store_of_another_box_or_version_is_refused(refused: Refused) -> None:
    command = "reproduce noise -o . --runs 1 --workers 1"
    store(Path("noise.sqlite"))
    assert "noise.sqlite" in refused(f"{command} --box N")
    with sqlite3.connect("noise.sqlite") as changed:
        changed.execute("UPDATE meta SET value = replace(value, 'numpy', 'mumpy')")
    assert "noise.sqlite" in refused(command)
    with sqlite3.connect("noise.sqlite") as user:
        user.execute("BEGIN EXCLUSIVE")
        assert "cannot be removed" in refused("reproduce noise -o . --overwrite"), "it waits for nobody"
