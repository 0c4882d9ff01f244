"""Compiled walks are kept with checksums: a damaged file of theirs is compiled anew, never run, never unpickled."""

from __future__ import annotations

import errno
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.base import cache
from stoop.errors import CacheWarning
from stoop.logs import compiled, dataflash_survey
from stoop.logs import dataflash_walk as plain

from .dataflash_case import small_log

LOG = np.frombuffer(small_log(5), np.uint8)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("kept")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STOOP_CACHE_DIR", str(root))
        compiled.dataflash.cache_clear()
        compiled.dataflash()
    compiled.dataflash.cache_clear()
    return root


@pytest.fixture
def root(kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return a copy of it, which is the cache of this process."""
    shutil.copytree(kept, tmp_path / "cache")
    monkeypatch.setenv("STOOP_CACHE_DIR", str(tmp_path / "cache"))
    compiled.dataflash.cache_clear()
    yield tmp_path / "cache"
    compiled.dataflash.cache_clear()


def the_only(root: Path, pattern: str) -> Path:
    (found,) = root.rglob(pattern)
    return found


def counted(monkeypatch: pytest.MonkeyPatch, walk: Any) -> list[int]:
    with monkeypatch.context() as patch:
        patch.setattr(dataflash_survey, "walk", walk)
        found = dataflash_survey.survey(LOG)
    return [*found.count.tolist(), found.damaged, found.lost]


def test_what_is_kept_is_taken(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = counted(monkeypatch, plain.walk)

    def never(*_: object) -> Path:
        raise AssertionError("compiled anew")

    monkeypatch.setattr(cache, "start_build", never)
    monkeypatch.setattr(cache, "private", never)
    assert counted(monkeypatch, compiled.dataflash().walk) == expected
    assert cache.intact(the_only(root, "*-dataflash"))
    manifest = json.loads(the_only(root, "manifest.json").read_text())
    assert {Path(name).suffix for name in manifest} == {".py", ".nbi", ".nbc"}


def test_damage_is_compiled_anew(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Never run, never unpickled; without room anywhere plain Python walks."""
    monkeypatch.chdir(tmp_path)
    the_only(root, "*.nbi").write_bytes(b"cos\nmkdir\n(S'unpickled'\ntR.")
    assert not cache.intact(the_only(root, "*-dataflash"))
    assert counted(monkeypatch, compiled.dataflash().walk) == counted(monkeypatch, plain.walk)
    assert not (tmp_path / "unpickled").exists()
    assert cache.intact(the_only(root, "*-dataflash"))
    assert [p.name for p in root.iterdir()] == [the_only(root, "*-dataflash").name], "nothing is left behind"

    def full(*_: object) -> Path:
        raise OSError(errno.ENOSPC, "No space left on device")

    shutil.rmtree(root)
    compiled.dataflash.cache_clear()
    monkeypatch.setattr(cache, "start_build", full)
    monkeypatch.setattr(cache, "private", full)
    with pytest.warns(CacheWarning):
        assert compiled.dataflash() is plain
