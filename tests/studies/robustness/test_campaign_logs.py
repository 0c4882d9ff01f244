"""Damaged and drawn logs, read by stoop and beside independent readers; and what stoop writes, read again."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

import pytest
from hypothesis import given
from studies.robustness import differential, readers, round_trips
from studies.robustness.campaign import cases, check
from studies.robustness.drawn_logs import DRAWN
from studies.robustness.readers import BOUNDS, GUARDED
from studies.robustness.sample_logs import SAMPLES
from studies.robustness.trials import Child

UNBOUNDED = replace(BOUNDS, memory=2**40)  #: of others' code, in a process of its own or in ours


@pytest.mark.parametrize("form", SAMPLES)
def test_damaged_logs_end_well(form: str) -> None:
    """In an error of one line, or they are read; one in ten goes on to a flight and the summary of stoop info."""
    readers.prepare()
    with (
        closing(Child(readers.try_damaged)) as child,
        closing(Child(readers.try_damaged, UNBOUNDED)) as apart,
    ):

        @cases(500)
        @given(readers.damaged_logs(form), readers.ways(readers.FLIGHT_SHARES.get(form, 0.1)))
        def ends_well(log, way: str) -> None:
            check("damaged logs", form, readers.contained(form, child, apart, form, *log, way))

        ends_well()


@pytest.mark.parametrize("form", DRAWN)
def test_drawn_logs_end_well(form: str) -> None:
    """In an error of one line, or they are read; half go on to a flight."""
    readers.prepare()
    with closing(Child(readers.try_drawn)) as child, closing(Child(readers.try_drawn, UNBOUNDED)) as apart:

        @cases(300)
        @given(DRAWN[form], readers.ways(0.5))
        def ends_well(log, way: str) -> None:
            check("drawn logs", f"{form} drawn", readers.contained(form, child, apart, log, way))

        ends_well()


@pytest.mark.parametrize("form", [form for form in SAMPLES if form in GUARDED])
def test_others_code_in_a_process_of_its_own(form: str) -> None:
    """Others' code that dies or runs on does not take the process along."""
    readers.prepare()
    with closing(Child(readers.try_damaged, UNBOUNDED)) as child:

        @cases(4)
        @given(readers.damaged_logs(form), readers.ways(0.1))
        def ends_well(log, way: str) -> None:
            check("readers in a child", f"{form} apart", child(form, *log, way, True))

        ends_well()


@pytest.mark.parametrize("form", differential.READERS)
def test_an_independent_reader_finds_the_same_numbers(form: str) -> None:
    readers.prepare()
    differential.prepare()
    with closing(Child(differential.compare_log, UNBOUNDED)) as child:

        @cases(60)
        @given(differential.logs_to_compare(form))
        def ends_well(log) -> None:
            check("other readers", f"{form} twice", child(form, log))

        ends_well()


@pytest.mark.parametrize("name", round_trips.LOGS)
def test_a_log_that_stoop_writes_is_read_as_it_was(name: str) -> None:
    readers.prepare()
    with closing(Child(round_trips.try_log)) as child:

        @cases(40)
        @given(round_trips.LOGS[name])
        def ends_well(log) -> None:
            check("round trips", f"{name} and back", child(*log))

        ends_well()


@pytest.mark.parametrize("ending", round_trips.ENDINGS)
def test_a_flight_that_stoop_writes_is_read_as_it_was(ending: str) -> None:
    readers.prepare()
    with closing(Child(round_trips.try_flight)) as child:

        @cases(40)
        @given(round_trips.flights())
        def ends_well(parts: tuple) -> None:
            check("round trips", f"flight {ending} and back", child(ending, parts))

        ends_well()
