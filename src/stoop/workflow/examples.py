"""Examples that come with the package: notebooks, and the vehicle, maneuver and mapping files that they read.

They are the folder `examples` of the repository; a wheel holds it as `stoop/data/examples`.
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Final

from stoop.base.files import check_targets, write_files
from stoop.base.text import nearest
from stoop.errors import StoopError

INDEX: Final = "index.toml"


@dataclass(frozen=True)
class Example:
    """A notebook and the files that it reads.

    Attributes
    ----------
    name : str
    names : tuple of str
        Of its files, the notebook first.
    data : tuple of str
        Folders of public flights that the notebook reads; its text says where they are from.
    """

    name: str
    names: tuple[str, ...]
    data: tuple[str, ...]

    @cached_property
    def title(self) -> str:
        """First heading of the notebook."""
        cells = json.loads(self.content(self.names[0]))["cells"]
        return "".join(cells[0]["source"]).splitlines()[0].removeprefix("# ")

    def content(self, file: str) -> bytes:
        """Return the content of one of its files."""
        return (folder() / file).read_bytes()


def folder() -> Path:
    """Return the folder of the examples: that of the wheel, or in a working copy that of the repository."""
    package = Path(str(files("stoop") / "data" / "examples"))
    return package if package.is_dir() else Path(str(files("stoop"))).parents[1] / "examples"


def examples() -> dict[str, Example]:
    """Return all examples by name, in the order of the gallery.

    Raises
    ------
    StoopError
        This installation has no examples.
    """
    try:
        listed = tomllib.loads((folder() / INDEX).read_text(encoding="utf-8"))["example"]
    except FileNotFoundError:
        raise StoopError(
            f"{folder() / INDEX}: this installation has no examples; install the wheel"
        ) from None
    rows = [(one["name"], one.get("files", ()), one.get("data", ())) for one in listed]
    return {name: Example(name, (f"{name}.ipynb", *files), tuple(data)) for name, files, data in rows}


def example(name: str) -> Example:
    """Return an example by name; a StoopError names the nearest."""
    known = examples()
    if name not in known:
        raise StoopError(f"{name}: there is no example of that name; {nearest(name, known)}")
    return known[name]


def copy(one: Example, target: Path, overwrite: bool = False) -> tuple[Path, ...]:
    """Copy the files of an example into a folder, all or none; return where they are.

    Raises
    ------
    OutputError
        A file is there already, or the folder cannot be written.
    """
    check_targets(target, one.names, overwrite)
    write_files(target, {file: one.content(file) for file in one.names})
    return tuple(target / file for file in one.names)
