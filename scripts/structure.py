"""Measure the form of the package: ``python scripts/structure.py [--source DIR] [--fit LOG_FOLDER] [--log FILE]``.

Prints lines and files of each room beside its budget, the closure of ``stoop identify``, import cycles, flags of the
vehicle's kind, numeric module constants, helpers with one caller; with ``--fit`` and ``--log`` also how many functions of
stoop run in a plain fit of the V-tail example and in loading a log. Exits with 1 where a room exceeds its budget or an
import cycle is not among those allowed. A feature that needs more lines changes its budget in the same commit.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FLAG = re.compile(
    r"\bhas_rotors\b|\b(?:if|elif|not|and|or|while|bool\() ?(?:\w+\.)*vehicle\.(?:file\.)?rotors?\b(?!\[)|\bvehicle\.hovers\b"
)  #: tests whether a vehicle has rotors
#: package, or room of the core -> lines at most; "stoop" is the whole core
BUDGETS = {
    "stoop": 52912,
    "stoop_analysis": 6466,
    "stoop_app": 4018,
    "stoop_draft": 7304,
    "stoop_export": 7229,
    "stoop_fleet": 3646,
    "stoop_plan": 5252,
    "stoop_studies": 15091,
    "stoop_tune": 4475,
    "api": 57,
    "assessment": 4744,
    "base": 2803,
    "checks": 572,
    "cli": 2000,
    "estimate": 7066,
    "extend": 101,
    "flight": 5243,
    "kernels": 2736,
    "logs": 5121,
    "optimize": 2660,
    "parallel": 1272,
    "prediction": 624,
    "problem": 1987,
    "reconstruction": 823,
    "report": 3127,
    "results": 1355,
    "simulation": 2226,
    "strategy": 1450,
    "vehicle": 4430,
    "workflow": 2362,
}
#: modules that an allowed import cycle goes through, imports in functions counted: registries that name their entries
REGISTRIES = {"stoop.optimize.registry", "stoop.vehicle.vehicle", "stoop.workflow.fitted_model"}
VTAIL = ("140:145", "146:152", "160:168.3")


def main() -> int:
    """Print every figure."""
    parser = argparse.ArgumentParser(description="Measure the form of the package.")
    parser.add_argument("--source", metavar="DIR", type=Path, default=ROOT / "src")
    parser.add_argument(
        "--fit", metavar="FOLDER", type=Path, help="the V-tail's flight2: profile a plain fit"
    )
    parser.add_argument("--log", metavar="FILE", type=Path, help="a ULog: profile loading it")
    arguments = parser.parse_args()
    source: Path = arguments.source
    modules = {_name(path, source): path for path in source.rglob("*.py")}
    trees = {name: ast.parse(path.read_text("utf-8")) for name, path in modules.items()}
    lines = {name: len(path.read_text("utf-8").splitlines()) for name, path in modules.items()}
    exceeded = _print_rooms(modules, lines)
    graph = {name: set(_imports(name, tree, modules)) for name, tree in trees.items()}
    reached = _closure("stoop.cli.identify", graph) | _closure(
        "stoop.cli.main", {**graph, "stoop.cli.main": set()}
    )
    print(f"closure of stoop identify:   {sum(lines[m] for m in reached)} lines, {len(reached)} files")
    cycles = [c for c in _components(graph) if len(c) > 1]
    print(
        f"import cycles:               {len(cycles)}, {sum(bool(c & REGISTRIES) for c in cycles)} of registries"
    )
    forbidden = [f"import cycle: {', '.join(sorted(c))}" for c in cycles if not c & REGISTRIES]
    product = {
        name: tree for name, tree in trees.items() if name.split(".")[0] == "stoop" and ".study" not in name
    }
    flags = {name: len(FLAG.findall(modules[name].read_text("utf-8"))) for name in product}
    print(
        f"flags of the vehicle's kind: {sum(flags.values())} places in {sum(map(bool, flags.values()))} files"
    )
    print(f"numeric module constants:    {sum(_numeric_constants(tree) for tree in product.values())}")
    single = sum(_single_use(tree) for tree in product.values())
    print(
        f"private helpers used once:   {single} of {sum(1 for t in product.values() for _ in _functions(t))} functions"
    )
    sys.path.insert(0, str(source))
    if arguments.fit:
        _profile_fit(arguments.fit, source)
    if arguments.log:
        _profile_log(arguments.log, source)
    for line in (*exceeded, *forbidden):
        print(f"FAILED {line}")
    return 1 if exceeded or forbidden else 0


def _name(path: Path, source: Path) -> str:
    parts = path.relative_to(source).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _print_rooms(modules: Mapping[str, Path], lines: Mapping[str, int]) -> list[str]:
    """Print lines and files of each package and room; return a sentence for each that exceeds its budget."""
    sizes: Counter[str] = Counter()
    files: Counter[str] = Counter()
    for name in modules:
        top, _, rest = name.partition(".")
        for room in {top, rest.partition(".")[0] if top == "stoop" and rest else top}:
            sizes[room] += lines[name]
            files[room] += 1
    for room in sorted(sizes, key=lambda r: (not r.startswith("stoop"), r)):
        print(f"{room:<16} {sizes[room]:>7} lines {files[room]:>4} files  budget {BUDGETS.get(room, '-'):>6}")
    over = {room: size for room, size in sizes.items() if size > BUDGETS.get(room, size)}
    return [f"{room}: {size} lines, budget {BUDGETS[room]}" for room, size in over.items()]


def _imports(name: str, tree: ast.Module, modules: Mapping[str, Path]) -> Iterator[str]:
    """Yield the modules of the package that a module imports, in functions too, or names in a table."""
    for node in _running(tree):
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name in modules)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                found = full if full in modules else node.module
                if found in modules and found != name:
                    yield found
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            module = node.value.partition(":")[0]
            if module in modules and ":" in node.value and module != name:
                yield module


def _running(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield every node but those for type checkers."""
    for node in ast.iter_child_nodes(tree):
        if not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)):
            yield node
            yield from _running(node)


def _closure(start: str, graph: Mapping[str, set[str]]) -> set[str]:
    reached: set[str] = set()
    queue = [start]
    while queue:
        name = queue.pop()
        if name in graph and name not in reached:
            reached.add(name)
            queue += [*graph[name], *(name.rsplit(".", n)[0] for n in range(1, name.count(".") + 1))]
    return reached


def _components(graph: Mapping[str, set[str]]) -> list[set[str]]:
    """Return the strongly connected components."""
    reach = {name: _reach(name, graph) for name in graph}
    found: list[set[str]] = []
    for name in graph:
        if not any(name in c for c in found):
            found.append({name} | {other for other in reach[name] if name in reach[other]})
    return found


def _reach(start: str, graph: Mapping[str, set[str]]) -> set[str]:
    seen: set[str] = set()
    queue = list(graph[start])
    while queue:
        name = queue.pop()
        if name in graph and name not in seen:
            seen.add(name)
            queue += graph[name]
    return seen


def _numeric_constants(tree: ast.Module) -> int:
    """Return how many names of a module are bound to a number, or to an expression of numbers."""
    found = 0
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            inner = [n for n in ast.walk(node.value) if isinstance(n, ast.expr)]
            numbers = [n for n in inner if isinstance(n, ast.Constant)]
            plain = all(isinstance(n, ast.Constant | ast.BinOp | ast.UnaryOp | ast.Name) for n in inner)
            found += plain and any(
                isinstance(n.value, int | float) and not isinstance(n.value, bool) for n in numbers
            )
    return found


def _functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    yield from (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def _single_use(tree: ast.Module) -> int:
    used = Counter(n.id for n in ast.walk(tree) if isinstance(n, ast.Name))
    used.update(n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute))
    return sum(
        1
        for f in _functions(tree)
        if f.name.startswith("_") and not f.name.startswith("__") and used[f.name] == 1
    )


def _print_profile(title: str, run: Callable[[], Any], source: Path) -> None:
    """Print how many functions of stoop a second run calls: the first one imports and compiles."""
    seen: set[tuple[str, str]] = set()
    prefix = str(source / "stoop")

    def see(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(prefix) and not code.co_name.startswith("<"):
            seen.add((code.co_filename, code.co_qualname))

    run()
    sys.setprofile(see)
    try:
        run()
    finally:
        sys.setprofile(None)
    print(f"functions in {title}: {len(seen)} in {len({file for file, _ in seen})} files")


def _profile_fit(folder: Path, source: Path) -> None:
    import stoop

    vehicle = stoop.load_vehicle(ROOT / "examples" / "vtail.toml")
    flight = stoop.load_flight(folder)
    _print_profile("a plain fit", lambda: stoop.fit(vehicle, flight, VTAIL, validate=["187:196"]), source)


def _profile_log(path: Path, source: Path) -> None:
    import stoop

    _print_profile("loading a log", lambda: stoop.load_flight(path), source)


if __name__ == "__main__":
    sys.exit(main())
