"""What results depend on beside the plan, and how differences are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stoop.parallel import environment, source_digest
from stoop.parallel.worker import differences


def test_versions_processor_and_sources() -> None:
    found = environment()
    assert found["numpy"] == np.__version__
    assert {
        "Python",
        "stoop",
        "scipy",
        "numba",
        "processor",
        "processor's features",
        "sources of stoop",
    } <= set(found)
    assert all(isinstance(value, str) for value in found.values())


def test_differences_name_what_both_have() -> None:
    assert not differences({"numpy": "2.1", "cma": "4.0"}, {"numpy": "2.1"})
    assert differences({"numpy": "2.1", "x": "1"}, {"numpy": "2.0", "x": "1"}) == "numpy 2.1 here, 2.0 there"
    assert differences({"features": "a" * 99}, {"features": "b"}) == "features"


def test_digest_sees_content_names_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "room").mkdir()
    source = tmp_path / "room" / "a.py"
    source.write_text("one")
    before = source_digest(tmp_path / "room")
    (tmp_path / "room" / "a.pyc").write_text("compiled")
    assert source_digest(tmp_path / "room") == before
    source.write_text("two")
    changed = source_digest(tmp_path / "room")
    source.rename(source.with_name("b.py"))
    assert (
        len({before, changed, source_digest(tmp_path / "room"), source_digest(tmp_path / "room" / "b.py")})
        == 4
    )
