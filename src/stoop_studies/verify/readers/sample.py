"""What is damaged: a log of one or more files, small, and how its bytes are put together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Sample:
    """A sound log.

    Attributes
    ----------
    files : mapping of str to bytes
        Content by name.
    form : str
        Key of `stoop_studies.verify.readers.forms.FORMS`: how the files that are damaged are built.
    entry : str
        What is read: one of the files, or nothing for their folder.
    victims : tuple of str
        Files that are damaged; none named: all.
    mapping : str
        File that says which column is which variable; empty where a ready mapping serves, or none is needed.
    """

    files: Mapping[str, bytes]
    form: str
    entry: str = ""
    victims: tuple[str, ...] = ()
    mapping: str = ""

    @property
    def targets(self) -> tuple[str, ...]:
        """Files that are damaged."""
        return self.victims or tuple(sorted(self.files))

    def write(self, folder: Path) -> tuple[Path, Path | None]:
        """Write all files; return what is to be read, and the mapping."""
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        return folder / self.entry, folder / self.mapping if self.mapping else None


def single(name: str, content: bytes, form: str, mapping: bytes = b"") -> Sample:
    """Return a log of one file, and perhaps a mapping of its own beside it."""
    beside = {"mapping.toml": mapping} if mapping else {}
    return Sample({name: content, **beside}, form, name, (name,), "mapping.toml" if mapping else "")
