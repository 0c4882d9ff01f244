"""Symbolic vehicle -> straight-line functions -> LLVM -> lanes of a vector; the only room that imports Numba."""

from stoop.base.cache import cache_folder
from stoop.kernels.fingerprint import environment
from stoop.kernels.kernel import Kernel, load_kernel
from stoop.kernels.symbolic import SymbolicModel

__all__ = ["Kernel", "SymbolicModel", "cache_folder", "environment", "load_kernel"]
