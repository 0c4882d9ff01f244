"""What compiled numbers depend on beside the model."""

from __future__ import annotations

import functools
import hashlib
import sys
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from types import MappingProxyType

_HERE = Path(__file__).parent
_CODE_SETTINGS = (
    "OPT", "CPU_NAME", "CPU_FEATURES", "ENABLE_AVX", "LOOP_VECTORIZE", "SLP_VECTORIZE", "USING_SVML",
    "BOUNDSCHECK", "DEBUGINFO_DEFAULT", "EXTEND_VARIABLE_LIFETIMES", "ENABLE_PROFILING", "DEBUG_NRT", "NRT_STATS",
    "LLVM_REFPRUNE_PASS", "LLVM_REFPRUNE_FLAGS",
)  # fmt: skip


@functools.cache
def equations_environment() -> Mapping[str, str]:
    """Return what compiled equations depend on beside the model: processor, versions, our own sources."""
    import llvmlite

    from stoop.kernels.compiler import native

    sources = b"".join(p.read_bytes() for p in sorted(_HERE.glob("*.py")))
    return MappingProxyType(
        {
            "Python": sys.version,
            "llvmlite": llvmlite.__version__,
            "sympy": metadata.version("sympy"),
            "processor": native().processor,
            "processor's features": native().features,
            "sources of stoop.kernels": hashlib.sha256(sources).hexdigest(),
        }
    )


@functools.cache
def environment() -> Mapping[str, str]:
    """Return what numbers depend on beside the model: that of equations, and Numba with its settings.

    Where two processes agree on all of it, compiled code gives the same bytes. Settings of the compiler come from the
    environment or from Numba's own file.
    """
    import numba

    settings = [f"{name}={getattr(numba.config, name, None)!r}" for name in _CODE_SETTINGS]
    found = {"numba": numba.__version__, "settings of the compiler": " ".join(settings)}
    return MappingProxyType({**equations_environment(), **found})
