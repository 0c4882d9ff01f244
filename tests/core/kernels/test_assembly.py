"""The compiled time loops work on whole vector registers."""

import platform
import re
from importlib.resources import files

import llvmlite.binding as llvm
import pytest

from stoop.kernels import Kernel, compiler
from stoop.vehicle import load_vehicle

_ARITHMETIC = r"\bv?(?:add|sub|mul|div|fmadd|fmsub|fnmadd|fnmsub)\d*"


def count(pattern: str, text: str) -> int:
    return len(re.findall(pattern, text))


def test_arithmetic_is_packed(pendulum: Kernel) -> None:
    for entry in ("cost", "cost_per_lane", "outputs", "outputs_per_lane", "windows"):
        check(pendulum.assembly(entry), 20)


@pytest.fixture(scope="module")
def aircraft() -> Kernel:
    """Return six degrees of freedom, with all that might branch: arc tangents, roots, wrapped angles."""
    return load_vehicle(str(files("stoop") / "data" / "twin_boom.toml")).kernel()


def test_the_six_degrees_of_freedom_are_packed(aircraft: Kernel) -> None:
    features = llvm.get_host_cpu_features()
    narrow = features.get("avx") and not features.get("avx512f")
    check(aircraft.assembly(), 250 if narrow else 300)  # AVX2: 292


def test_other_processors_take_whole_registers(aircraft: Kernel) -> None:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    intel = "x86_64-unknown-linux-gnu", r"\bv(?:add|sub|mul|fn?m\w+)sd\s"
    arm = "aarch64-unknown-linux-gnu", r"\bf(?:add|sub|mul|madd)\s+d\d"
    wide = {
        "haswell": r"v\w+pd\s[^\n]*%ymm",
        "skylake-avx512": r"v\w+pd\s[^\n]*%zmm",
        "apple-m1": r"f\w+\s+v\d+\.2d",
    }
    for processor, packed in wide.items():
        triple, scalar = arm if processor == "apple-m1" else intel
        text = aircraft.assembly("cost", compiler.Target(processor, "", triple))
        assert count(packed, text) > 600, processor
        assert count(scalar, text) < 20, f"{processor}: only what all lanes share is scalar"


def check(text: str, least: int) -> None:
    """Hold the time step to packed arithmetic of the widest registers that the processor has."""
    machine = platform.machine().lower()
    if machine in ("x86_64", "amd64"):
        features = llvm.get_host_cpu_features()
        register = "zmm" if features.get("avx512f") else "ymm" if features.get("avx") else "xmm"
        packed = rf"{_ARITHMETIC}pd\s[^\n]*%{register}"
        # the basic block of the time step is that with most packed arithmetic
        block = max(re.split(r"\n\.?LBB\S+:", text), key=lambda block: count(packed, block))
        assert count(packed, block) > least
        assert count(rf"{_ARITHMETIC}sd\s", block) < 10, "only what all lanes share is scalar"
        assert re.search(r"andq\s+\$-(?:64|128), %rsp", text), "spilled registers lie on cache lines"
    elif machine in ("aarch64", "arm64"):
        assert count(r"\b(?:fadd|fmul|fmla|fsub)\s+v\d+\.2d", text) > least
    else:
        pytest.skip(f"vector instructions of {machine} are not known here")
