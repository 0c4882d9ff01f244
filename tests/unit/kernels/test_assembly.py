"""The compiled time loop works on whole vector registers."""

from __future__ import annotations

import platform
import re

import pytest

from stoop.kernels import Kernel

_PACKED = r"\bv?(?:add|sub|mul|div|fmadd|fmsub|fnmadd|fnmsub)\d*"


def arithmetic(text: str, register: str) -> int:
    """Count packed double arithmetic on a kind of register."""
    return len(re.findall(rf"{_PACKED}pd\s[^\n]*%{register}", text))


def scalar(text: str) -> int:
    return len(re.findall(rf"{_PACKED}sd\s", text))


def test_arithmetic_is_packed(pendulum: Kernel) -> None:
    machine = platform.machine().lower()
    text = pendulum.assembly()
    if machine in ("x86_64", "amd64"):
        import llvmlite.binding as llvm

        features = llvm.get_host_cpu_features()
        register = "zmm" if features.get("avx512f") else "ymm" if features.get("avx") else "xmm"
        assert arithmetic(text, register) > 40
        assert arithmetic(text, register) > 2 * scalar(text)
    elif machine in ("aarch64", "arm64"):
        assert len(re.findall(r"\b(?:fadd|fmul|fmla|fsub)\s+v\d+\.2d", text)) > 40
    else:
        pytest.skip(f"vector instructions of {machine} are not known here")
