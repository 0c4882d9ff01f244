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
def environment() -> Mapping[str, str]:
    """Return what numbers depend on beside the model: processor, versions, settings, our own sources.

    Where two processes agree on all of it, compiled equations give the same bytes. Settings of the compiler come from the
    environment or from Numba's own file.
    """
    import llvmlite
    import llvmlite.binding as llvm
    import numba

    settings = [f"{name}={getattr(numba.config, name, None)!r}" for name in _CODE_SETTINGS]
    sources = b"".join(p.read_bytes() for p in sorted(_HERE.glob("*.py")))
    return MappingProxyType(
        {
            "Python": sys.version,
            "numba": numba.__version__,
            "llvmlite": llvmlite.__version__,
            "sympy": metadata.version("sympy"),
            "processor": llvm.get_host_cpu_name(),
            "processor's features": llvm.get_host_cpu_features().flatten(),
            "settings of the compiler": " ".join(settings),
            "sources of stoop.kernels": hashlib.sha256(sources).hexdigest(),
        }
    )
