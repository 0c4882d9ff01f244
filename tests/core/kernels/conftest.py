"""A kernel of the pendulum, compiled once per session in a cache of its own."""

from pathlib import Path

import pytest
from naive import oscillator

from stoop.kernels import Kernel, kernel, load_kernel


@pytest.fixture(scope="session")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Kernel:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STOOP_CACHE_DIR", str(tmp_path_factory.mktemp("kernels")))
        return load_kernel("pendulum", oscillator.equations)


@pytest.fixture
def forget(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Give the test an empty cache and a process that has loaded nothing yet; return the cache's folder."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("STOOP_CACHE_DIR", str(folder))
    for kept in ("_loaded", "_models"):
        monkeypatch.setattr(kernel, kept, {})
    return folder
