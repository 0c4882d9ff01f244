"""What one core can do at most: fused multiply-adds on whole registers, nothing else.

Twelve independent sums hide the latency of every processor of today (two units of four cycles need eight) and
fit the sixteen registers of AVX2.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import llvmlite.binding as llvm

from stoop.kernels.compiler import Target, native

SUMS = 12
STEPS = 400_000  #: of the loop in one call


def lanes(target: Target | None = None) -> int:
    """Return how many doubles a register holds; 0 where there is no fused multiply-add."""
    made_for = target or native()
    text = made_for.assembly(source(made_for.doubles()))
    return made_for.doubles() if "fmadd" in text or "fmla" in text else 0


def source(width: int) -> str:
    """Write the loop x = x a + a for twelve vectors in LLVM's language."""
    v = f"<{width} x double>"
    each = range(SUMS)
    ends = [f"  %s{k} = fadd {v} %{'y0' if k == 1 else f's{k - 1}'}, %y{k}" for k in each if k]
    return "\n".join(
        [
            f"declare {v} @llvm.fma.v{width}f64({v}, {v}, {v})",
            "define double @peak(i64 %n, double %a) {",
            "begin:",
            f"  %one = insertelement {v} zeroinitializer, double %a, i32 0",
            f"  %all = shufflevector {v} %one, {v} zeroinitializer, <{width} x i32> zeroinitializer",
            "  br label %loop",
            "loop:",
            "  %i = phi i64 [0, %begin], [%next, %loop]",
            *(f"  %x{k} = phi {v} [%all, %begin], [%y{k}, %loop]" for k in each),
            *(f"  %y{k} = call {v} @llvm.fma.v{width}f64({v} %x{k}, {v} %all, {v} %all)" for k in each),
            "  %next = add i64 %i, 1",
            "  %more = icmp ult i64 %next, %n",
            "  br i1 %more, label %loop, label %end",
            "end:",
            *ends,
            f"  %sum = extractelement {v} %s{SUMS - 1}, i32 0",
            "  ret double %sum",
            "}",
        ]
    )


def compiled(target: Target | None = None) -> tuple[Callable[[], object], float] | None:
    """Return a call that does nothing but multiply-adds, and how many operations it does (two each)."""
    width = lanes(target)
    if not width:
        return None
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(source(width)), (target or native()).machine())
    engine.finalize_object()
    prototype = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_int64, ctypes.c_double)
    loop = prototype(engine.get_function_address("peak"))

    def call(keep: object = engine) -> float:  # the engine owns the code: it must live as long
        return float(loop(STEPS, 0.5))

    return call, 2.0 * SUMS * width * STEPS
