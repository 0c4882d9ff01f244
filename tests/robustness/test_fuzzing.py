import os
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robustness import readers
from robustness.corpus import MAPPING, Case, sound
from robustness.corpus import cases as corpus
from robustness.damage import damaged
from robustness.documents import ASKS, read_document
from robustness.readers import FLIGHT, GUARDED, OURS, READER, read_case
from robustness.trials import BAD, READ, REFUSED, Bounds, Child, Ended, cases, check, try_case

from stoop.errors import LogError

BYTES = {"state": "words", "store": "pages", "flight": "words"}  #: documents that are no text -> form


@st.composite
def damaged_logs(draw, form: str) -> Case:
    """Draw a damaged log, or a damaged mapping of one; one in ten goes on to a flight."""
    found = [case for case in sound(form) if form != "mapping" or case.mapping]
    one = draw(st.sampled_from(found))
    other = draw(st.sampled_from([case for case in found if case.form == one.form]))
    names = ([n for n in case.files if (n == MAPPING) == (form == "mapping")] for case in (one, other))
    name, content = (draw(st.sampled_from(some)) for some in names)
    way = draw(st.sampled_from([READER] * 9 + [FLIGHT]))
    changed = one.with_file(name, draw(damaged(one.files[name], other.files[content], one.form)))
    return Case(**{**vars(changed), "way": way})


@st.composite
def damaged_documents(draw, kind: str) -> Case:
    read = [c for c in corpus(f"document:{kind}") if c.outcome == READ]
    one, other = (draw(st.sampled_from(read)) for _ in "ab")
    content = draw(damaged(one.files[one.entry], other.files[other.entry], BYTES.get(kind, "lines")))
    return Case(**{**vars(one.with_file(one.entry, content)), "way": str(draw(st.integers(0, 99)))})


@pytest.mark.parametrize("form", [*OURS, *GUARDED[:-2]])  # the last are drawn only
def test_damaged_logs_end_well(form: str) -> None:
    """In an error of one line, or they are read. What crashes code of others in C ends well in a process of its own."""
    readers.prepare()
    with closing(Child(read_case)) as child:

        @cases(500)
        @given(damaged_logs(form))
        def ends_well(case: Case) -> None:
            ended = child(case)
            if ended.outcome in BAD and form in GUARDED:  # once more as users do, in a process of its own
                with closing(Child(readers.ask_apart, Bounds(memory=2**40))) as other:
                    ended = other(case)
            check("damaged logs", form, ended)

        ends_well()


@pytest.mark.parametrize("kind", ASKS)
def test_damaged_documents_end_well(kind: str) -> None:
    readers.prepare()
    with closing(Child(read_document)) as child:

        @cases(300)
        @given(damaged_documents(kind))
        def ends_well(case: Case) -> None:
            check("documents", kind, child(case))

        ends_well()


def test_a_crash_a_hang_and_hunger_are_seen_and_the_others_are_tried() -> None:
    def run(_: Path, kind: str) -> str:
        if kind == "crash":
            os.abort()
        while kind == "hang":
            pass
        if kind == "memory":
            np.ones(2**23)
        if kind == "more":
            np.ones(2**28)
        return READ

    with closing(Child(run, Bounds(seconds=0, memory=2**25, address_space=2**29))) as child:
        found = [child(kind).outcome for kind in ("", "crash", "hang", "memory", "", "more")]
    assert found == [READ, "crash", "hang", "memory", READ, "memory"]


def test_a_table_of_a_million_samples_takes_the_memory_of_what_is_kept(tmp_path: Path) -> None:
    count, names = 1_000_000, ("p", "q", "r", "ax", "az")
    table = np.column_stack([np.arange(count) / 25.0, np.random.default_rng(3).standard_normal((count, 5))])
    np.savetxt(tmp_path / "a.csv", table, "%.4f", ",", header=",".join(("t", *names)), comments="")
    rows = [f'{n} = {{column = "{n}", unit = "{"rad/s" if n in "pqr" else "m/s2"}"}}' for n in names]
    mapping = "\n".join(['time = {column = "t", unit = "s"}', "[variables]", *rows])
    content = {"a.csv": (tmp_path / "a.csv").read_bytes(), MAPPING: mapping.encode()}
    kept = 6 * 8 * 2 * count  # bytes: time and five channels, of which the grid has twice as many
    bounds = Bounds(seconds=60, address_space=2**31, memory=kept + 2**29)
    with closing(Child(readers.ask_apart, bounds)) as child:
        assert child(Case("csv", "", "lines", "a.csv", MAPPING, FLIGHT, READ, content)) == Ended(READ)


def test_only_an_error_of_ours_is_no_failure(tmp_path: Path) -> None:
    def run(folder: Path, raised: Exception) -> str:
        (folder / "left").mkdir()
        raise raised

    for error in (ValueError("x"), ZeroDivisionError(), LogError(""), MemoryError()):
        assert try_case(run, tmp_path, error).outcome in BAD
    assert try_case(run, tmp_path, LogError(f"{tmp_path}a.ulg: cut")) == Ended(REFUSED, "a.ulg: cut")
    assert not list(tmp_path.iterdir())
