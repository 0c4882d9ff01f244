"""Generated modules: built in the cache, imported from there, compiled by Numba where they are written for it."""

from __future__ import annotations

import functools
import hashlib
import sys
from collections.abc import Callable, Mapping
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType

from stoop.base import cache
from stoop.errors import KernelError
from stoop.kernels.fingerprint import environment

_RICCATI = {
    "run_riccati": (
        "void(f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[::1], f8[:,::1], i8[::1], f8[:,::1], "
        "f8[:,:,::1], f8[:,:,::1])"
    ),
}  #: entry -> its arguments


def build(final: Path, write: Callable[[Path], None]) -> Path:
    """Make the sealed folder of one module unless it is there; return where it lies."""
    try:
        return cache.provide(final, write)
    except OSError as error:
        raise KernelError(
            f"kernel cache: no room to keep compiled equations ({error.strerror or error}); "
            "free disk space, or set STOOP_CACHE_DIR or TMPDIR to a folder on another disk"
        ) from error


class _SourceLoader(SourceFileLoader):
    """Runs a source and leaves no byte code beside its file: the sealed folder must not change."""

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        code: CodeType = self.source_to_code(self.get_data(path), path)
        return code


def import_source(path: Path, name: str) -> ModuleType:
    """Return the module of a generated file under a name of its own."""
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = str(path)
    _SourceLoader(name, str(path)).exec_module(module)
    return module


def import_generated(folder: Path, key: str, name: str) -> ModuleType:
    """Return the module ``name.py`` of a folder, with Numba's files beside it.

    They lie beside the source even where the user sends them to another folder: no checksum would guard them there, and
    a damaged one ends the process.
    """
    from numba import config

    wanted, config.CACHE_DIR = config.CACHE_DIR, ""
    try:  # Numba's files hold the module's name: it may not depend on the folder
        return import_source(folder / f"{name}.py", f"_stoop_kernel_{key}_{name}")
    finally:
        config.CACHE_DIR = wanted


def _compiled(folder: Path, key: str, name: str, signatures: Mapping[str, str]) -> ModuleType:
    """Import a generated module and compile its entry points, or take them from Numba's files beside it."""
    module = import_generated(folder, key, name)
    for entry, signature in signatures.items():
        dispatcher = getattr(module, entry)
        dispatcher.compile(signature)
        dispatcher.disable_compile()
    return module


@functools.cache
def riccati_module() -> ModuleType:
    """Return the compiled covariance recursion of a filter; one serves every model."""
    from numba import config

    if config.DISABLE_JIT:
        raise KernelError(
            "NUMBA_DISABLE_JIT: set, so the recursion of a filter cannot be compiled, and uncompiled it does not run; "
            "unset it (or take disable_jit out of .numba_config.yaml)"
        )
    key = hashlib.sha256("\n".join(["riccati", *environment().values()]).encode()).hexdigest()[:32]

    def write(folder: Path) -> None:
        (folder / "riccati.py").write_text(Path(__file__).with_name("recursion.py").read_text())
        _compiled(folder, key, "riccati", _RICCATI)

    folder = build(cache.cache_folder() / f"{key}-riccati", write)
    return _compiled(folder, key, "riccati", _RICCATI)
