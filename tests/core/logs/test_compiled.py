"""Compiled walks are kept with checksums: a damaged file of theirs is compiled anew, never run, never unpickled."""

import errno
import json
import shutil
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


def the_only(root: Path, pattern: str) -> Path:
    (found,) = root.rglob(pattern)
    return found


def counted(monkeypatch: pytest.MonkeyPatch, walk: Any) -> list[int]:
    with monkeypatch.context() as patch:
        patch.setattr(dataflash_survey, "walk", walk)
        found = dataflash_survey.survey(LOG)
    return [*found.count.tolist(), found.damaged, found.lost]


def test_damaged_walks_are_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Never run, never unpickled; without room anywhere plain Python walks."""

    def fails(*_: object) -> Path:
        raise OSError(errno.ENOSPC, "No space left on device")

    root = tmp_path / "cache"
    monkeypatch.setenv("STOOP_CACHE_DIR", str(root))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(compiled, "dataflash", compiled.dataflash.__wrapped__)
    expected = counted(monkeypatch, plain.walk)
    compiled.dataflash()
    with monkeypatch.context() as patch:  # nothing is built
        patch.setattr(cache, "start_build", fails)
        patch.setattr(cache, "private", fails)
        assert counted(monkeypatch, compiled.dataflash().walk) == expected
    manifest = json.loads(the_only(root, "manifest.json").read_text())
    assert {Path(name).suffix for name in manifest} == {".py", ".nbi", ".nbc"}
    the_only(root, "*.nbi").write_bytes(b"cos\nmkdir\n(S'unpickled'\ntR.")
    assert not cache.intact(the_only(root, "*-dataflash"))
    assert counted(monkeypatch, compiled.dataflash().walk) == expected
    assert not (tmp_path / "unpickled").exists()
    assert cache.intact(the_only(root, "*-dataflash"))
    assert [p.name for p in root.iterdir()] == [the_only(root, "*-dataflash").name], "nothing is left behind"
    shutil.rmtree(root)
    monkeypatch.setattr(cache, "start_build", fails)
    monkeypatch.setattr(cache, "private", fails)
    with pytest.warns(CacheWarning):
        assert compiled.dataflash() is plain
