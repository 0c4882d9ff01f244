"""From LLVM's text to a function of this process: compile, keep as an object file, load."""

from __future__ import annotations

import ctypes
import functools
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from stoop.kernels.instructions import Function

_KINDS = {"ptr": ctypes.c_void_p, "i64": ctypes.c_int64, "double": ctypes.c_double}


@dataclass(frozen=True)
class Target:
    """The processor that code is made for."""

    processor: str
    features: str
    triple: str = field(default_factory=llvm.get_process_triple)

    def machine(self) -> Any:
        """Return LLVM's generator of code; whoever loads code with it owns it."""
        found = llvm.Target.from_triple(self.triple)
        options = {"reloc": "default", "codemodel": "jitdefault", "jit": True}
        return found.create_target_machine(cpu=self.processor, features=self.features, opt=3, **options)

    def doubles(self) -> int:
        """Return how many doubles a vector register holds."""
        code = Function("ptr %A", 8)
        total = code.vector_at("%A", 0) + code.vector_at("%A", 8)
        code.write(f"store {code.vector} {total.name}, ptr %A, align 8")
        text = self.assembly(code.text())
        return 8 if "zmm" in text else 4 if "ymm" in text else 2

    def _optimized(self, text: str, machine: Any) -> Any:
        """Return LLVM's module of a text. Nothing is left to vectorize, so level 1 gives the same speed as 2 and 3."""
        module = llvm.parse_assembly(text)
        module.triple, module.data_layout = self.triple, str(machine.target_data)
        module.verify()
        options = llvm.create_pipeline_tuning_options(speed_level=1)
        options.loop_vectorization = options.slp_vectorization = options.loop_unrolling = False
        llvm.create_pass_builder(machine, options).getModulePassManager().run(
            module, llvm.create_pass_builder(machine, options)
        )
        return module

    def object_file(self, text: str) -> bytes:
        """Return the object file of a module."""
        machine = self.machine()
        made: bytes = machine.emit_object(self._optimized(text, machine))
        return made

    def assembly(self, text: str) -> str:
        """Return the machine code of a module as text."""
        machine = self.machine()
        made: str = machine.emit_assembly(self._optimized(text, machine))
        return made


@functools.cache
def native() -> Target:
    """Return the processor of this machine, or the one that ``NUMBA_CPU_NAME`` and ``NUMBA_CPU_FEATURES`` name."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    named, features = os.environ.get("NUMBA_CPU_NAME"), os.environ.get("NUMBA_CPU_FEATURES")
    here = "" if named else llvm.get_host_cpu_features().flatten()
    return Target(named or llvm.get_host_cpu_name(), here if features is None else features)


@functools.cache
def lanes() -> int:
    """Return how many candidates a block holds, where there are so many: those of two registers.

    The second register keeps the processor busy while the first waits for its own results; three registers for each value
    do not fit in.
    """
    return 2 * native().doubles()


def load(made: bytes, arguments: str) -> Callable[..., None]:
    """Return the function of an object file that takes arrays, integers and numbers, and lets other threads run.

    Arrays are those of :func:`stoop.kernels.arrays.matrix`; nothing is checked here.
    """
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), native().machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(made))
    engine.finalize_object()
    kinds = [_KINDS[argument.split()[0]] for argument in arguments.split(", ")]
    function = ctypes.CFUNCTYPE(None, *kinds)(engine.get_function_address("run"))

    def call(*values: Any, keep: Any = engine) -> None:  # the engine owns the code: it must live as long
        function(*[v.ctypes.data if isinstance(v, np.ndarray) else v for v in values])

    return call
