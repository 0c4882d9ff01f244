"""The compiled time loops work on whole vector registers."""

from __future__ import annotations

import platform
import re
from importlib.resources import files

import pytest

from stoop.kernels import Kernel
from stoop.vehicle import load_vehicle

_ARITHMETIC = r"\bv?(?:add|sub|mul|div|fmadd|fmsub|fnmadd|fnmsub)\d*"


def count(pattern: str, text: str) -> int:
    return len(re.findall(pattern, text))


def step(text: str, packed: str) -> str:
    """Return the basic block of the time step: the one with most packed arithmetic."""
    return max(re.split(r"\n\.?LBB\S+:", text), key=lambda block: count(packed, block))


@pytest.mark.parametrize("per_lane", [False, True])
@pytest.mark.parametrize("entry", ["run_cost", "run_outputs"])
def test_arithmetic_is_packed(pendulum: Kernel, entry: str, per_lane: bool) -> None:
    check(pendulum.assembly(entry, per_lane), 40)


def test_the_six_degrees_of_freedom_are_packed() -> None:
    """With all that might branch: arc tangents, roots, wrapped angles."""
    aircraft = load_vehicle(str(files("stoop") / "data" / "twin_boom.toml"))
    check(aircraft.kernel().assembly(), 600)


def check(text: str, least: int) -> None:
    """Hold the time step to packed arithmetic of the widest registers that the processor has."""
    machine = platform.machine().lower()
    if machine in ("x86_64", "amd64"):
        import llvmlite.binding as llvm

        features = llvm.get_host_cpu_features()
        register = "zmm" if features.get("avx512f") else "ymm" if features.get("avx") else "xmm"
        packed = rf"{_ARITHMETIC}pd\s[^\n]*%{register}"
        block = step(text, packed)
        assert count(packed, block) > least
        assert count(rf"{_ARITHMETIC}sd\s", block) < 10, "only what all lanes share is scalar"
        assert re.search(r"andq\s+\$-64, %rsp", text), "spilled registers lie on cache lines"
    elif machine in ("aarch64", "arm64"):
        assert count(r"\b(?:fadd|fmul|fmla|fsub)\s+v\d+\.2d", text) > least
    else:
        pytest.skip(f"vector instructions of {machine} are not known here")
