"""Damaged logs over all readers: what comes of each is counted, and nothing but an answer of ours counts as one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

from stoop.base.csv_text import Cell
from stoop.report.sheet import Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify.experiment import Samples, Verification
from stoop_studies.verify.readers.child import ROOM, SECONDS, SWELL, prepare, try_all
from stoop_studies.verify.readers.damage import DAMAGES
from stoop_studies.verify.readers.samples import SAMPLES
from stoop_studies.verify.readers.trial import BAD, CONTAINED, FLIGHT, GOOD, GUARD, GUARDED, READ, Series

RUN_CASES: Final = 250  #: of one run
GUARDED_CASES: Final = 1  #: the same with the reader in its own process: each starts an interpreter
APART: Final = " apart"  #: behind the name of a reader: in its own process
OUTCOMES: Final = (*GOOD, *BAD)
HEAD: Final = ("reader", "damage", "cases", *OUTCOMES)
NAMES: Final = {
    "refused": "an error of ours, in one line",
    "listed": "read, and the damage is listed",
    "unnoticed": "read, with other numbers than the sound log, and nothing listed",
    "same": "read, with the very numbers of the sound log",
    "limit": "an error of ours: it asks for more memory than there is",
    CONTAINED: "others' code died or ran on; in a process of its own, this is an error of ours, or a reading",
    "fault": "an exception of another kind, a warning, or a recording that is not what it promises",
    "crash": "the process died",
    "hang": f"more than {SECONDS} s of processor time",
    "memory": f"more than {SWELL >> 20} MiB more than before",
}
WAYS: Final = {
    READ: "the reader",
    FLIGHT: "to a flight",
    GUARD: "the reader, others' code in a process of its own",
}
LEAD: Final = f"""\
Small logs of every kind are damaged at random and read. {RUN_CASES} cases are one run: a process is copied, may take \
{ROOM >> 20} MiB more than it has, and reads one log after the other; when it dies, the log at hand is to blame. Most \
cases ask the reader (by the door of all, `stoop.logs.read`), one in ten goes the whole way to a flight and what `stoop info` \
tells of it; of those with a damaged mapping all do."""
READING: Final = """\
No log has a checksum over its numbers but that of the Crazyflie, packed ones, and HDF5 and Parquet where asked for: a changed \
number elsewhere is another measurement, and a log that ends where a message ends is a shorter log. Such cases are the ones \
that are read without a word."""
PACKED: Final = """\
What is packed (gzip, variables of MATLAB) is opened, damaged inside and packed again in half of the cases, and a Crazyflie's \
checksum is made to fit, so that it is the reader that meets the damage. A quarter of all logs is damaged twice."""


def try_cases(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[dict[str, Any]]:
    """Try the cases of one run; see `stoop.parallel.Run`.

    Parameters
    ----------
    arguments : mapping
        ``case``: a reader, perhaps with `APART`; ``seed``; ``data``: folder of real logs, or empty.
    stops : sequence
        One: nothing is shared.
    """
    reader = str(arguments["case"])
    apart = reader.endswith(APART)
    series = Series(reader.removesuffix(APART), int(arguments["seed"]), apart, str(arguments["data"]))
    result = count_outcomes(series, GUARDED_CASES if apart else RUN_CASES)
    return [result for _ in stops]


def count_outcomes(series: Series, count: int) -> dict[str, Any]:
    """Return ``counts`` of way/damage/outcome, and the cases to look at in ``found``."""
    prepare(series.reader, series.data)
    tried = list(try_all(series, count))
    counts = Counter(f"{one.way}/{one.damage}/{one.outcome}" for one in tried)
    found = [asdict(one) for one in tried if one.outcome in (*BAD, CONTAINED)]
    return {"counts": dict(sorted(counts.items())), "found": found}


class Counts:
    """How many cases ended how, by reader, way and first damage.

    Parameters
    ----------
    samples : mapping
        Case (a reader, perhaps with `APART`) to results of `count_outcomes`.
    """

    def __init__(self, samples: Samples) -> None:
        self.by: Counter[tuple[str, str, str, str]] = Counter()
        for case, results in samples.items():
            for result in results:
                for words, number in result["counts"].items():
                    way, damage, outcome = words.split("/")
                    self.by[case.removesuffix(APART), way, damage, outcome] += number

    def outcomes(self, reader: str = "", way: str = "", damage: str = "") -> Counter[str]:
        """Sum by outcome, over what is not named."""
        total: Counter[str] = Counter()
        for (*place, outcome), number in self.by.items():
            if all(given in ("", own) for given, own in zip((reader, way, damage), place, strict=True)):
                total[outcome] += number
        return total

    def row(self, **only: str) -> tuple[int, ...]:
        """Return cases and outcomes as a table has them."""
        found = self.outcomes(**only)
        return (found.total(), *(found[outcome] for outcome in OUTCOMES))


def show(setting: Setting, samples: Samples) -> Findings:
    """Return what came of the damaged logs."""
    counts = Counts(samples)
    found = tuple(
        (case, *(one[key] for key in ("number", "damage", "outcome", "said")))
        for case in sorted(samples, key=lambda case: f"{case}/")
        for result in samples[case]
        for one in result["found"]
    )
    by_reader = {reader: counts.row(reader=reader) for reader in SAMPLES} | {"all": counts.row()}
    by_damage = {damage: counts.row(damage=damage) for damage in DAMAGES}
    by_way = {words: counts.row(way=way) for way, words in WAYS.items()}
    damages = tuple((name, damage.words) for name, damage in DAMAGES.items())
    return Findings(
        f"{counts.outcomes().total():,} damaged logs over all readers",
        LEAD,
        tuple(_claims(counts)),
        (
            Section(
                "By reader",
                (
                    _table("What came of the damaged logs", "reader", by_reader),
                    Table("What the words mean", ("word", "meaning"), tuple(NAMES.items())),
                    Prose(READING),
                ),
            ),
            Section(
                "By damage",
                (
                    _table("By what was done first", "damage", by_damage),
                    Table("What was done", ("damage", "how"), damages),
                    Prose(PACKED),
                ),
            ),
            Section("By way", (_table("By what was asked", "way", by_way),)),
            Section("Others' code that died or ran on", (_contained(found),)),
        ),
        HEAD,
        tuple(
            (reader, damage, *counts.row(reader=reader, damage=damage))
            for reader in SAMPLES
            for damage in DAMAGES
        ),
        {"found": (("reader", "case", "damage", "outcome", "said"), found)},
    )


def _claims(counts: Counts) -> Iterator[Claim]:
    total = counts.outcomes()
    for outcome, words in (
        (
            "fault",
            "No case ends in an exception of another kind, a warning, or a recording that breaks its promises",
        ),
        ("crash", "No case ends the process"),
        ("hang", f"No case takes more than {SECONDS} s of processor time"),
        ("memory", f"No case takes more than {SWELL >> 20} MiB"),
    ):
        yield holds(words, not total[outcome], f"{total[outcome]:,} of {total.total():,}")
    yield holds(
        "Others' code that dies or runs on takes nobody along",
        not any(counts.outcomes(reader)[outcome] for reader in GUARDED for outcome in BAD),
        f"{total[CONTAINED]} such cases of {total.total():,}, all of them told in one line, or read, by the reader in its "
        f"own process; {counts.outcomes(way=GUARD).total():,} further cases were read so from the beginning",
    )
    flights = counts.outcomes(way=FLIGHT)
    safe = not any(flights[outcome] for outcome in BAD)
    yield holds("The whole way to a flight is as safe", safe, f"{flights.total():,} cases")


def _table(caption: str, what: str, rows: Mapping[str, tuple[int, ...]]) -> Table:
    lines = tuple((name, *map(str, row)) for name, row in rows.items())
    return Table(caption, (what, "cases", *OUTCOMES), lines)


def _contained(found: Sequence[tuple[Cell, ...]]) -> Table:
    groups = Counter(
        (str(reader), str(said).partition(";")[0])
        for reader, _, _, outcome, said in found
        if outcome == CONTAINED
    )
    lines = tuple((reader, said, str(n)) for (reader, said), n in sorted(groups.items()))
    return Table("By reader and by what happened", ("reader", "what", "cases"), lines)


EXPERIMENT: Final = Verification(
    "readers",
    show,
    runs=29,
    work="stoop_studies.verify.readers.experiment:try_cases",
    cases=(*SAMPLES, *(f"{reader}{APART}" for reader in GUARDED)),
    parts=("found",),
    reads_data=True,
)
