"""How many operations one Runge-Kutta step of one candidate takes, counted in the text that LLVM compiles.

The rule: an addition, subtraction, multiplication, division or square root is one operation, so a fused multiply-add counts as
two. Comparisons, choices, magnitudes and changes of sign count as none. What is done once per candidate is left out.
"""

from __future__ import annotations

import re

_OPERATION = re.compile(r" = (?:f(?:add|sub|mul|div)|call) [\w ]*<\d+ x double> (?!@llvm.fabs)")


def operations(text: str) -> int:
    """Return the operations of a pass of the loop over samples; that over stages inside is passed three times."""
    step, stages = _loop(text, "%samples"), _loop(text, "3")
    return _count(step) + 2 * _count(stages)


def _loop(text: str, end: str) -> str:
    """Return the lines of the loop whose index counts up to `end`."""
    found = re.search(rf"%more(\d+) = icmp slt i64 %i\d+, {end}\n", text)
    if found is None:
        raise ValueError(f"no loop to {end}")
    return text[found.end() : text.index(f"\nafter{found[1]}:")]


def _count(text: str) -> int:
    return len(_OPERATION.findall(text))
