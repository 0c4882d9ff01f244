"""The sources that a work function is made of: its module and what that imports, without importing any of it.

The driver and each worker hash them where they are. A worker with other sources is refused, and so is a store that
other sources have made.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

from stoop.parallel.environment import ROOMS

OWN: Final = "stoop"
SILENT: Final = ("parallel", "cli", "report", "errors", "base.files")  #: of stoop, what makes no numbers
EXCLUDED: Final = frozenset(f"{OWN}.{name.removesuffix('.py')}" for name in (*ROOMS, *SILENT))
Roots = Mapping[str, list[Path]]  #: top-level package or module -> its folders, or its file


def work_sources(works: Iterable[str]) -> dict[str, str]:
    """Return one entry for an environment per module of some work functions: its name and a hash of its sources.

    Counted are the module, the modules of the same top-level package and of `stoop` that it imports wherever in its
    text, what they import, and the ``__init__.py`` above each (what only that imports is not). A package that is imported
    as such counts with all of its files: it may import them by names that it computes. Rooms of `stoop` that every
    environment has, or that make no numbers, are left out. A module without a source file has no entry.

    Parameters
    ----------
    works : iterable of str
        Each "package.module:function".
    """
    modules = sorted({work.partition(":")[0] for work in works})
    return {f"sources of {name}": digest for name in modules if (digest := _digest(name))}


def _digest(module: str) -> str:
    lines = (
        f"{name}\n{hashlib.sha256(text).hexdigest()}\n" for name, text in sorted(reached(module).items())
    )
    text = "".join(lines)
    return hashlib.sha256(text.encode()).hexdigest() if text else ""


def reached(module: str) -> dict[str, bytes]:
    """Return name and content of each file that a module brings in."""
    roots = {top: found for top in (module.partition(".")[0], OWN) if (found := _roots(top))}
    files: dict[str, bytes] = {}
    queue, seen = [module], {*EXCLUDED}
    while queue:
        name = queue.pop()
        if name in seen or any(name.startswith(f"{other}.") for other in EXCLUDED):
            continue
        seen.add(name)
        for key, path in _files(name, roots):
            files[key] = path.read_bytes()
            queue += _imported(key, files[key], roots)
        for key, path in _above(name, roots):
            files.setdefault(key, path.read_bytes())
    return files


def _roots(top: str) -> list[Path]:
    """Return the file of a top-level module, or the folders of a package."""
    if top in ("", "__main__"):  # the latter is another one in each process
        return []
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return []
    if spec is None:
        return []
    if spec.submodule_search_locations is not None:
        return [Path(folder) for folder in spec.submodule_search_locations]
    return [Path(spec.origin)] if spec.origin and spec.origin.endswith(".py") else []


def _above(name: str, roots: Roots) -> Iterator[tuple[str, Path]]:
    """Return the ``__init__.py`` of the packages that a module lies in: importing it runs them."""
    parts = name.split(".")
    for count in range(1, len(parts)):
        folder = _place(".".join(parts[:count]), roots)
        if folder is not None and (path := folder / "__init__.py").is_file():
            yield ".".join((*parts[:count], "__init__.py")), path


def _files(name: str, roots: Roots) -> list[tuple[str, Path]]:
    """Return the file of a module, or all files of a package."""
    place = _place(name, roots)
    if place is None:
        return []
    if place.is_file():
        return [(f"{name}.py", place)]
    found = (p for p in place.rglob("*") if p.suffix in (".py", ".toml") and p.is_file())
    return [(".".join((name, *p.relative_to(place).parts)), p) for p in found]


def _place(name: str, roots: Roots) -> Path | None:
    """Return the folder of a package or the file of a module; None: it is neither, or of another package."""
    top, *parts = name.split(".")
    for root in roots.get(top, ()):
        if not parts:
            return root
        folder = root.joinpath(*parts)
        if folder.is_dir():
            return folder
        if (file := folder.with_suffix(".py")).is_file():
            return file
    return None


def _imported(key: str, content: bytes, roots: Roots) -> list[str]:
    """Return the modules that a file imports from the packages that are followed."""
    if not key.endswith(".py"):
        return []
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError):  # importing it will say so
        return []
    package = key.removesuffix(".py").split(".")[:-1]
    found = [name for node in ast.walk(tree) for name in _named(node, package, roots)]
    return [name for name in found if name.partition(".")[0] in roots]


def _named(node: ast.AST, package: list[str], roots: Roots) -> list[str]:
    """Return what an import statement names: of a package, the module that is asked for, or all of it."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if not isinstance(node, ast.ImportFrom):
        return []
    near = package[: len(package) - node.level + 1] if node.level else []
    base = ".".join((*near, *filter(None, [node.module])))
    inner = [f"{base}.{alias.name}" for alias in node.names]
    return [name if _place(name, roots) else base for name in inner]
