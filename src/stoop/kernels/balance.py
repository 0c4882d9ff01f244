"""Whether a model's equations keep the processor busy, or it waits for one result after the other.

A core of today has two multiply-add units that take four cycles each: eight operations are on their way when it
is busy. Equations whose work over longest chain is less than half of that leave it idle more than half of the
time; then two groups of lanes, stage by stage in turn, cost little more than one. Measured on the built-in
aircraft: longitudinal (3.7 operations at a time) 0.67 of the time, lateral (5.1) 0.99, six degrees of freedom
(6.9) 1.06. What a second group costs where it stays empty, in calls of up to eight candidates: 1.3, 2.0 and 2.1 of
the time.
"""

from __future__ import annotations

import ast
from pathlib import Path

BUSY = 8.0  #: operations on their way at once
_LEAVES = {"sqrt": 5.0, "fabs": 0.5, "select": 1.0}  #: how long they take, in multiply-adds


def groups(source: str, name: str) -> int:
    """Return how many groups of lanes, one or two, suit a function of straight-line source code."""
    header = Path(__file__).with_name("runtime.py").read_text()
    tree = ast.parse(f"{header}\n{source}")
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    work, chain = _Walk(functions).function(functions[name])
    return 2 if work < 0.5 * BUSY * chain else 1


class _Walk:
    """Counts the operations of a function, and those of its longest chain."""

    def __init__(self, functions: dict[str, ast.FunctionDef]) -> None:
        self.functions = functions
        self.work = 0.0
        self.ready: dict[str, float] = {}  #: when a name is known, in multiply-adds

    def function(self, node: ast.FunctionDef) -> tuple[float, float]:
        """Return work and longest chain."""
        end = 0.0
        for line in node.body:
            if isinstance(line, ast.Assign) and isinstance(line.targets[0], ast.Name):
                self.ready[line.targets[0].id] = self.end(line.value)
            elif isinstance(line, ast.Return) and line.value is not None:
                end = self.end(line.value)
        return self.work, end

    def end(self, node: ast.AST) -> float:
        """Return when an expression is known."""
        if isinstance(node, ast.Name):
            return self.ready.get(node.id, 0.0)
        begin = max((self.end(child) for child in ast.iter_child_nodes(node)), default=0.0)
        return begin + self._takes(node)

    def _takes(self, node: ast.AST) -> float:
        """Return how long an operation takes, in multiply-adds, and count it."""
        if isinstance(node, ast.BinOp):
            self.work += 1.0
            return 3.0 if isinstance(node.op, ast.Div) else 1.0
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
            return 0.0
        if node.func.id in _LEAVES:
            self.work += 1.0
            return _LEAVES[node.func.id]
        work, chain = _Walk(self.functions).function(self.functions[node.func.id])
        self.work += work
        return chain
