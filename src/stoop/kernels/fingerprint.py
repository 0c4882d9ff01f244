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


def _code_settings() -> list[str]:
    """Return the settings that change compiled code, be they from the environment or from Numba's own file."""
    from numba import config

    return [f"{name}={getattr(config, name, None)!r}" for name in _CODE_SETTINGS]


@functools.cache
def environment() -> Mapping[str, str]:
    """Return what numbers depend on beside the model: processor, versions, settings, our own sources.

    Where two processes agree on all of it, compiled equations give the same bytes.
    """
    import llvmlite
    import llvmlite.binding as llvm
    import numba

    sources = b"".join(p.read_bytes() for p in sorted(_HERE.glob("*.py")))
    return MappingProxyType(
        {
            "Python": sys.version,
            "numba": numba.__version__,
            "llvmlite": llvmlite.__version__,
            "sympy": metadata.version("sympy"),
            "processor": llvm.get_host_cpu_name(),
            "processor's features": llvm.get_host_cpu_features().flatten(),
            "settings of the compiler": " ".join(_code_settings()),
            "sources of stoop.kernels": hashlib.sha256(sources).hexdigest(),
        }
    )
