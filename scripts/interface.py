"""Write the signatures of `import stoop` and of the methods of a fitted model: ``python scripts/interface.py [--check]``.

They are those of the functions in ``data/verbs.toml`` and in the files ``stoop.toml`` of packages, so that editors and mypy see
what is imported at the first use.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

from stoop.base.packages import places

SOURCE = Path(__file__).parents[1] / "src"
HEAD = '"""Written by scripts/interface.py."""\n\n'


def offered(kind: str) -> dict[str, str]:
    """Return the places of functions or methods of the core and of the packages of this repository."""
    return {
        name: place
        for name, place in places(kind).items()
        if (SOURCE / place.replace(":", ".").partition(".")[0]).is_dir()
    }


def names() -> str:
    """Return the names of `import stoop`."""
    known = offered("functions")
    lines = []
    for name, place in known.items():
        module, _, own = place.partition(":")
        lines.append(f"from {module} import {own} as {name}")
    listed = "".join(f'    "{name}",\n' for name in sorted(known))
    return HEAD + "\n".join(sorted(lines)) + f"\n\n__version__: str\n__all__ = [\n{listed}]\n"


def methods() -> str:
    """Return the methods of a fitted model."""
    imported, bodies = set[str](), list[str]()
    for name, place in sorted(offered("methods").items()):
        module, _, own = place.partition(":")
        tree = ast.parse((SOURCE / f"{module.replace('.', '/')}.py").read_text("utf-8"))
        function = next(n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef) and n.name == own)
        function.args.args[0] = ast.arg("self")
        function.args.defaults = [ast.Constant(...) for _ in function.args.defaults]
        function.args.kw_defaults = [d and ast.Constant(...) for d in function.args.kw_defaults]
        imported |= set(_imports(tree, module, function))
        bodies.append(
            f"    def {name}({ast.unparse(function.args)}) -> {ast.unparse(function.returns or ast.Constant(None))}: ..."
        )
    text = (
        "\n".join(sorted(imported)) + "\n\ndef add_methods(model: type) -> None: ...\n\nclass ModelMethods:\n"
    )
    return HEAD + text + "\n".join(bodies) + "\n"


def _imports(tree: ast.Module, module: str, function: ast.FunctionDef) -> list[str]:
    """Return the imports that the annotations of a function need."""
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    annotations = [a.annotation for a in arguments if a.annotation] + [function.returns or ast.Constant(None)]
    used = {n.id for one in annotations for n in ast.walk(one) if isinstance(n, ast.Name)}
    out = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            out += [
                f"from {node.module} import {a.name} as {a.asname or a.name}"
                for a in node.names
                if (a.asname or a.name) in used
            ]
        elif isinstance(node, ast.Import):
            out += [f"import {a.name} as {a.asname}" for a in node.names if a.asname in used]
        elif isinstance(node, ast.ClassDef) and node.name in used:
            out.append(f"from {module} import {node.name} as {node.name}")
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            out += [
                f"from {module} import {t.id} as {t.id}"
                for t in targets
                if isinstance(t, ast.Name) and t.id in used
            ]
    return out


def main() -> int:
    """Write the files; with ``--check`` only say which differ."""
    wanted = {
        SOURCE / "stoop" / "__init__.pyi": names(),
        SOURCE / "stoop" / "workflow" / "model_methods.pyi": methods(),
    }
    differ = [path for path, text in wanted.items() if not path.exists() or path.read_text("utf-8") != text]
    if "--check" in sys.argv[1:]:
        for path in differ:
            print(f"{path}: python scripts/interface.py writes it")
        return int(bool(differ))
    for path in differ:
        path.write_text(wanted[path], encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
