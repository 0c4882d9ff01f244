"""What a worker does with one task, and what its results depend on beside the plan: versions, processor, sources.

The sources of a work function are its module and what that imports; they are hashed without importing any of it, by
driver and workers, each where it runs. A worker with other sources is refused, and so is a store that other sources made.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib
import importlib.util
import os
import socket
import threading
import traceback
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypedDict

from stoop.base.interrupts import reraise_interrupt
from stoop.base.lazy import places
from stoop.base.packages import packages, tables
from stoop.errors import CampaignError, StoopError
from stoop.parallel.plan import from_text, to_text

#: that compute numbers
LIBRARIES: Final = ("stoop", "numpy", "scipy", "xarray", "pydantic", "pymoo", "cma", "ioh", "pygmo")
#: folders and files of stoop that compute numbers; those of a work function's own count by `work_sources`
ROOMS: Final = (
    "assessment", "base", "data", "estimate", "flight", "kernels", "logs", "optimize", "problem", "results", "simulation",
    "vehicle",
)  # fmt: skip
#: of stoop, what every environment has, or what computes no numbers
_OTHERS: Final = ("parallel", "cli", "report", "errors", "base.files")
EXCLUDED: Final = frozenset(f"stoop.{name}" for name in (*ROOMS, *_OTHERS))
PARSER: Final = threading.Lock()  #: Python 3.11 parses for one thread at a time
BLOCKS: Final = ("body", "orelse", "finalbody", "handlers", "cases")  #: of statements in a statement
Roots = Mapping[str, list[Path]]  #: top-level package or module -> its folders, or its file


class Report(TypedDict):
    """Result of a task; built-in types only, so that it can be read whatever the worker is."""

    worker: str
    environment: dict[str, str]
    results: list[str]  #: canonical texts, one per stop
    failure: str  #: why there are none
    trace: str


def perform(work: str, text: str, stops: Sequence[int | None]) -> Report:
    """Compute one task, "package.module:function" of the arguments in a text; an exception is a failure in the report."""
    name = f"process {os.getpid()} on {socket.gethostname()}"
    here = {**_environment(), **_own_sources((work,))}
    report = Report(worker=name, environment=here, results=[], failure="", trace="")

    def first_line(error: BaseException) -> str:
        return "".join(map(str, error.args[:1])).partition("\n")[0]

    try:
        module, _, function = work.partition(":")
        with reraise_interrupt():  # a search that was interrupted returns its best: no result of this task
            results = getattr(importlib.import_module(module), function)(from_text(text), list(stops))
        if not isinstance(results, list) or len(results) != len(stops):
            raise CampaignError(f"{work} must return a list of {len(stops)} results, one for each stop")
        report["results"] = [to_text(result, f"result {i}") for i, result in enumerate(results)]
    except StoopError as error:
        report["failure"] = first_line(error) or type(error).__name__
    except (Exception, SystemExit) as error:
        report["failure"] = f"{type(error).__name__}: {first_line(error)}"
        report["trace"] = traceback.format_exc()
    return report


def environment(works: Iterable[str] = ()) -> dict[str, str]:
    """Return name and value of everything that results of some work functions depend on beside the plan."""
    return {**_environment(), **work_sources(works)}


@functools.cache
def _environment() -> Mapping[str, str]:
    """Return what all results depend on.

    A library that is not installed is left out: runs that need it report this themselves.
    """
    from importlib import metadata

    from stoop.kernels import environment as compiled

    found = dict(compiled())
    for name in LIBRARIES:
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    found["sources of stoop"] = source_digest(*(Path(__file__).parents[1] / room for room in ROOMS))
    hooks = (str(place).partition(":")[0] for _, table in tables("hooks") for place in table.values())
    found["sources of hooks"] = _hashed(source_files(*hooks))
    return MappingProxyType(found)


def source_digest(*places: Path) -> str:
    """Return one hash of Python and TOML files, and of those in folders; a plan may keep it among its settings."""
    digest = hashlib.sha256()
    for place in places:
        for path in sorted([place] if place.is_file() else _sources(place)):
            digest.update(f"{path.relative_to(place.parent).as_posix()}\n".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _sources(folder: Path) -> list[Path]:
    return [p for p in folder.rglob("*") if p.suffix in (".py", ".toml") and p.is_file()]


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """Return where two environments differ in what both have, long values by name only; empty if they agree."""
    unlike = [(name, a, there[name]) for name, a in here.items() if there.get(name, a) != a]
    shown = (n if max(len(a), len(b)) > 40 else f"{n} {a} here, {b} there" for n, a, b in unlike)
    return ", ".join(shown)


def work_sources(works: Iterable[str]) -> dict[str, str]:
    """Return one entry for an environment per module of some work functions: its name and a hash of its sources.

    Counted are the module, the modules of its top-level package, of `stoop` and of packages `stoop_*` beside it that it
    imports in its text, what they import, and the ``__init__.py`` above each (what only that imports is not). A package that
    is imported as such counts with all of its files: it may import them by names that it computes. Rooms of `stoop` that every
    environment has, or that compute no numbers, are left out. A module without a source file has no entry.
    """
    found = {}
    for module in sorted({work.partition(":")[0] for work in works}):
        if files := source_files(module):
            found[f"sources of {module}"] = _hashed(files)
    return found


def _hashed(files: Mapping[str, bytes]) -> str:
    text = (f"{name}\n{hashlib.sha256(content).hexdigest()}\n" for name, content in sorted(files.items()))
    return hashlib.sha256("".join(text).encode()).hexdigest()


#: hashed once, before the module is imported: those are the sources that a worker runs
_own_sources: Final = functools.cache(work_sources)


def source_files(*modules: str) -> dict[str, bytes]:
    """Return name and content of each file of modules and of what they import."""
    beside = (p.parent.name for p in Path(__file__).parents[2].glob("stoop_*/__init__.py"))
    files, queue, visited = dict[str, bytes](), [*modules], {*EXCLUDED}
    tops = {*(module.partition(".")[0] for module in queue), "stoop", *beside}
    roots = {top: found for top in tops if (found := _roots(top))}
    while queue:
        name = queue.pop()
        if name in visited or any(name.startswith(f"{other}.") for other in EXCLUDED):
            continue
        visited.add(name)
        place = _place(name, roots)
        own: list[tuple[str, Path]] = []
        if place is not None and place.is_file():
            own = [(f"{name}.py", place)]
        elif place is not None:
            own = [(".".join((name, *p.relative_to(place).parts)), p) for p in _sources(place)]
        for key, path in own:
            files[key] = path.read_bytes()
            queue += _imported(key, files[key], roots)
        parts = name.split(".")
        for count in range(1, len(parts)):  # importing a module runs the packages above it
            above = ".".join(parts[:count])
            folder = _place(above, roots)
            if folder is not None and (path := folder / "__init__.py").is_file():
                files.setdefault(f"{above}.__init__.py", path.read_bytes())
    return files


def _roots(top: str) -> list[Path]:
    """Return the file of a top-level module, or the folders of a package."""
    if top in ("", "__main__"):  # the latter is another one in each process
        return []
    spec = None
    with suppress(ImportError, ValueError):
        spec = importlib.util.find_spec(top)
    if spec is None:
        return []
    if spec.submodule_search_locations is not None:
        return [Path(folder) for folder in spec.submodule_search_locations]
    return [Path(spec.origin)] if spec.origin and spec.origin.endswith(".py") else []


def _place(name: str, roots: Roots) -> Path | None:
    """Return the folder of a package or the file of a module; None: it is neither, or of another package."""
    top, *parts = name.split(".")
    for root in roots.get(top, ()):
        folder = root.joinpath(*parts)
        if not parts or folder.is_dir():
            return folder
        if (file := folder.with_suffix(".py")).is_file():
            return file
    return None


def _imported(key: str, content: bytes, roots: Roots) -> list[str]:
    """Return the modules of the roots that a file imports; of a package, the module that is named, or all of it."""
    try:
        with PARSER:
            tree = ast.parse(content if key.endswith(".py") else b"")
    except (SyntaxError, ValueError):  # importing it reports this
        return []
    module = key.removesuffix(".py")
    package, found = module.split(".")[:-1], [_module_of(module, name, roots) for name in _lazy(module)]
    statements = list[ast.AST](tree.body)
    while statements:
        node = statements.pop()
        statements += (child for block in BLOCKS for child in getattr(node, block, ()))
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            near = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join((*near, *filter(None, [node.module])))
            found += [_module_of(base, alias.name, roots) for alias in node.names]
    return [name for name in found if name.partition(".")[0] in roots]


def _module_of(base: str, name: str, roots: Roots) -> str:
    """Return the module that importing a name from a module reads: the one of that name, or the one that holds it."""
    above = _lazy(base).get(name, base)
    return inner if _place(inner := f"{above}.{name}", roots) else above


@functools.cache
def _lazy(module: str) -> Mapping[str, str]:
    """Return name -> module that holds it, of a module that imports its names at their first use: `stoop`, or by its stub."""
    if module == "stoop":
        return {name: place.partition(":")[0] for name, place in packages()["stoop"]["functions"].items()}
    extend, _, group = module.rpartition(".")
    stub = Path(__file__).parents[1] / "extend" / f"{group}.pyi"
    return places(stub) if extend == "stoop.extend" and stub.is_file() else {}
