"""The model's functions are straight-line scalar code, which any compiler of kernels takes (CUDA has the same few)."""

from __future__ import annotations

import ast

from stoop.kernels.emit import emit
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.symbolic import build_model

CALLS = {"sqrt", "fabs", "atan2"}
ARITHMETIC = (
    ast.BinOp, ast.UnaryOp, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.USub, ast.UAdd, ast.Compare, ast.Gt, ast.Lt, ast.NotEq,
    ast.Constant, ast.Name, ast.Load, ast.Store, ast.Call,
)  # fmt: skip


def functions(source: str) -> dict[str, ast.FunctionDef]:
    return {node.name: node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)}


def arithmetic(node: ast.AST) -> bool:
    """Return whether an expression is made of scalars, arithmetic and the few calls."""
    nodes = list(ast.walk(node))
    calls = [n for n in nodes if isinstance(n, ast.Call)]
    return all(isinstance(n, ARITHMETIC) for n in nodes) and all(
        isinstance(n.func, ast.Name) and n.func.id in CALLS and not n.keywords for n in calls
    )


def entry_of(value: ast.AST, arguments: set[str]) -> bool:
    """Return whether an expression is an argument's entry at a fixed place, as ``x[3]``."""
    return (
        isinstance(value, ast.Subscript)
        and isinstance(value.value, ast.Name)
        and value.value.id in arguments
        and isinstance(value.slice, ast.Constant)
    )


def straight(function: ast.FunctionDef) -> bool:
    arguments = {a.arg for a in function.args.args}
    *steps, last = function.body
    assigned = [
        s.targets[0].id for s in steps if isinstance(s, ast.Assign) and isinstance(s.targets[0], ast.Name)
    ]
    return (
        len(assigned) == len(set(assigned)) == len(steps)
        and all(
            entry_of(s.value, arguments) or arithmetic(s.value) for s in steps if isinstance(s, ast.Assign)
        )
        and isinstance(last, ast.Return)
        and isinstance(last.value, ast.Tuple)
        and all(map(arithmetic, last.value.elts))
    )


def test_the_models_functions_are_straight_line_scalar_code() -> None:
    vehicle = resolve_vehicle("twin-boom").reduced("longitudinal")
    made = functions(emit(build_model(vehicle)).source)
    assert list(made)[:4] == ["prepare", "forcing", "derive", "observe"]
    assert set(made) <= {"prepare", "forcing", "derive", "observe", "correct"}
    assert all(straight(f) for f in made.values())
    for body in (
        "    return (x[0] + len(x), )",
        "    a = u[0]\n    a = u[1]\n    return (a, )",
        "    if u[0] > 0.0:\n        return (1.0, )\n    return (2.0, )",
        "    a = u[k]\n    return (a, )",
        "    a = exp(1.0)\n    return (a, )",
    ):
        assert not straight(functions(f"def f(x, u):\n{body}\n")["f"]), "the check sees what is not"
