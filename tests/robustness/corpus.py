"""Hostile files that are committed, one archive a kind, and how each of them ends; ``bomb`` unfold to gigabytes."""

from __future__ import annotations

import csv
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

CORPUS = Path(__file__).with_name("corpus")
MAPPING = "mapping.toml"


@dataclass(frozen=True)
class Case:
    """Some files: what is read of them (empty: the folder), a mapping, how it is asked, how it ended."""

    kind: str
    case: str
    form: str  #: key of `damage.FORMS`
    entry: str
    mapping: str
    way: str
    outcome: str
    changed: Mapping[str, bytes] | None = None

    @property
    def files(self) -> Mapping[str, bytes]:
        if self.changed is not None:
            return self.changed
        kind = self.kind.partition(":")[0]
        archive = {"bomb": "bombs", "document": "documents"}.get(kind, kind)
        with zipfile.ZipFile(CORPUS / f"{archive}.zip") as file:
            found = [name for name in file.namelist() if name.startswith(f"{self.case}/")]
            return {name.partition("/")[2]: file.read(name) for name in found}

    def write(self, folder: Path) -> tuple[Path, Path | None]:
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        return folder / self.entry, folder / self.mapping if self.mapping else None

    def with_file(self, name: str, content: bytes) -> Case:
        return replace(self, changed={**self.files, name: content})


@cache
def cases(kind: str) -> tuple[Case, ...]:
    with (CORPUS / "cases.csv").open(newline="", encoding="utf-8") as file:
        return tuple(Case(**row) for row in csv.DictReader(file) if row["kind"] == kind)


def sound(kind: str) -> tuple[Case, ...]:
    return tuple(case for case in cases(kind) if case.case.startswith("sound"))
