"""A bag of a real flight against the tables that were made of it by other means."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from stoop.logs import read


@pytest.mark.parametrize(
    ("topic", "table", "columns"),
    [
        ("/plane/bodyrate", "plane_bodyrate.csv", ("point.x", "point.y", "point.z")),
        ("/plane/euler", "plane_euler.csv", ("point.x", "point.y", "point.z")),
        (
            "/plane/actuators",
            "plane_actuators.csv",
            ("controls[0]", "controls[1]", "controls[2]", "controls[3]"),
        ),
    ],
)
def test_the_same_numbers(
    shared_data: Path, tmp_path: Path, topic: str, table: str, columns: tuple[str, ...]
) -> None:
    folder = shared_data / "stanford-skywalker-10hz"
    bag = tmp_path / "a.bag"
    bag.write_bytes(gzip.decompress((folder / "skywalker_manual_06_30_21.bag.gz").read_bytes()))
    stream = read(bag, topics=frozenset({topic})).streams[topic]
    theirs = np.loadtxt(folder / table, delimiter=",", skiprows=1)
    assert stream.time.size == len(theirs)
    assert np.abs(stream.time - theirs[:, 0]).max() < 0.2  # theirs is the time of recording
    for k, column in enumerate(columns):
        np.testing.assert_allclose(stream.columns[column], theirs[:, k + 1], rtol=1e-6)
