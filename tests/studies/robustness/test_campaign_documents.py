"""Hostile documents: all files but logs that stoop reads."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from studies.robustness import documents
from studies.robustness.campaign import cases, check
from studies.robustness.documents import DOCUMENTS
from studies.robustness.trials import READ, Child


@pytest.mark.parametrize("kind", DOCUMENTS)
def test_sound_documents_are_read(kind: str, tmp_path: Path) -> None:
    """What is not hostile is no error: else the campaign would try nothing behind the first check."""
    documents.prepare(kind)
    for k, tree in enumerate(DOCUMENTS[kind].sound()):
        (tmp_path / str(k)).mkdir()
        for number in (6, 10, 13):  # what is asked of some only
            assert (
                documents.try_document(tmp_path / str(k), kind, DOCUMENTS[kind].write(tree), number) == READ
            )
            for path in sorted((tmp_path / str(k)).rglob("*"), reverse=True):
                path.rmdir() if path.is_dir() else path.unlink()


@pytest.mark.parametrize("kind", DOCUMENTS)
def test_hostile_documents_end_well(kind: str) -> None:
    """In an error of one line, or they are read; what is read is written and read again."""
    documents.prepare(kind)
    with closing(Child(documents.try_document)) as child:

        @cases(300)
        @given(documents.documents(kind), st.integers(0, 99))
        def ends_well(content: bytes, number: int) -> None:
            check("documents", kind, child(kind, content, number))

        ends_well()
