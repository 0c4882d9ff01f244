"""Damaged logs over all readers: what comes of each is counted, and nothing but an answer of ours counts as one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from stoop.base.csv_text import Cell
from stoop.parallel import Plan, Run
from stoop.report.sheet import Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, holds
from stoop_studies.verify.readers.child import ROOM, SECONDS, SWELL
from stoop_studies.verify.readers.damage import DAMAGES
from stoop_studies.verify.readers.samples import SAMPLES
from stoop_studies.verify.readers.trial import BAD, CONTAINED, FLIGHT, GOOD, GUARD, GUARDED, READ
from stoop_studies.verify.readers.work import CASES

WORK: Final = "stoop_studies.verify.readers.work:tried"
APART: Final = 1  #: the same with the reader in its own process: each starts an interpreter
HEAD: Final = ("reader", "damage", "cases", *GOOD, *BAD)
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
LEAD: Final = f"""\
Small logs of every kind are damaged at random and read. {CASES} cases are one run: a process is copied, may take \
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
WORDS: Final = {
    "cut": "the end is cut off, anywhere or where a message ends; sometimes the beginning",
    "flip": "1 to 40 bits are turned",
    "overwrite": "random bytes, zeros or ones over a stretch",
    "blow up": "extreme numbers of 1 to 8 bytes, also where sizes and counts stand",
    "resize": "the first bytes of a message, record or line change a little: its size, kind or name",
    "erase": "a stretch is taken out, or whole messages",
    "repeat": "messages are written again, up to a thousand times",
    "swap": "two messages change places",
    "splice": "one log begins, and another goes on",
    "shuffle": "messages follow each other in another order",
    "head": "the first bytes are damaged",
    "garbage": "random bytes follow what the file is known by",
    "words": "odd numbers and words where a text has numbers or names",
}


@dataclass(frozen=True)
class Readers:
    """All readers under damage."""

    name: str = "readers"
    runs: int = 29
    parts: tuple[str, ...] = ("found",)

    def plan(self, setting: Setting) -> Plan:
        """Return some hundred cases of each reader per run, and a few in processes of their own."""
        plain = [
            Run(f"{reader}/{seed:04d}", WORK, _arguments(reader, seed, setting, CASES, False))
            for reader in SAMPLES
            for seed in setting.seeds
        ]
        apart = [
            Run(f"{reader} apart/{seed:04d}", WORK, _arguments(reader, seed, setting, APART, True))
            for reader in GUARDED
            for seed in setting.seeds
        ]
        return Plan(self.name, {"experiment": self.name}, (*plain, *apart))

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what came of them."""
        counts = counted_by_reader(results)
        found = [(key.partition("/")[0], *_told(f)) for key, r in results.items() for f in r["found"]]
        total = sum(sum(c.values()) for c in counts.values())
        return Findings(
            f"{total:,} damaged logs over all readers",
            LEAD,
            claims(counts),
            (
                Section("By reader", (_by_reader(counts), _meaning(), Prose(READING))),
                Section("By damage", (_by_damage(counts), _damages(), Prose(PACKED))),
                Section("By way", (_by_way(counts),)),
                Section("Others' code that died or ran on", (_contained(found),)),
            ),
            HEAD,
            tuple(_rows(counts)),
            {"found": (("reader", "case", "damage", "outcome", "said"), tuple(found))},
        )


Counts = Mapping[str, Counter[tuple[str, str, str]]]  #: reader -> (way, damage, outcome) -> cases


def _arguments(reader: str, seed: int, setting: Setting, cases: int, guarded: bool) -> dict[str, Any]:
    data = "" if setting.data is None else str(setting.data)
    return {"reader": reader, "seed": seed, "cases": cases, "guarded": guarded, "data": data}


def counted_by_reader(results: Results) -> dict[str, Counter[tuple[str, str, str]]]:
    """Sum what came of all runs."""
    counts: dict[str, Counter[tuple[str, str, str]]] = {reader: Counter() for reader in SAMPLES}
    for key, result in results.items():
        reader = key.partition("/")[0].removesuffix(" apart")
        for word, number in result["counts"].items():
            way, damage, outcome = word.split("/")
            counts[reader][way, damage, outcome] += number
    return counts


def claims(counts: Counts) -> tuple[Claim, ...]:
    """Return what is claimed of readers."""
    total = _outcomes(counts.values())
    cases = sum(total.values())
    whole = _cases(counts, FLIGHT)
    apart = _cases(counts, GUARD)
    return (
        *(_none(total, outcome, words) for outcome, words in (
            ("fault", "No case ends in an exception of another kind, a warning, or a recording that breaks its promises"),
            ("crash", "No case ends the process"),
            ("hang", f"No case takes more than {SECONDS} s of processor time"),
            ("memory", f"No case takes more than {SWELL >> 20} MiB"))),
        holds("Others' code that dies or runs on takes nobody along", _is_contained(counts),
              f"{total[CONTAINED]} such cases of {cases:,}, all of them told in one line, or read, by the reader in its own "
              f"process; {apart:,} further cases were read so from the beginning"),
        holds("The whole way to a flight is as safe", not _bad(_outcomes(counts.values(), FLIGHT)), f"{whole:,} cases"),
    )  # fmt: skip


def _none(total: Counter[str], outcome: str, words: str) -> Claim:
    return holds(words, not total[outcome], f"{total[outcome]:,} of {sum(total.values()):,}")


def _is_contained(counts: Counts) -> bool:
    return not any(_bad(_outcomes([counts[reader]])) for reader in GUARDED)


def _bad(outcomes: Counter[str]) -> int:
    return sum(outcomes[outcome] for outcome in BAD)


def _cases(counts: Counts, way: str) -> int:
    return sum(_outcomes(counts.values(), way).values())


def _outcomes(counters: Iterable[Counter[tuple[str, str, str]]], only: str = "") -> Counter[str]:
    """Sum by outcome, over all ways or one, all kinds of damage or one."""
    total: Counter[str] = Counter()
    for counter in counters:
        for (way, damage, outcome), number in counter.items():
            if only in ("", way, damage):
                total[outcome] += number
    return total


def _line(name: str, outcomes: Counter[str]) -> tuple[str, ...]:
    return (name, str(sum(outcomes.values())), *(str(outcomes[o]) for o in (*GOOD, *BAD)))


def _by_reader(counts: Counts) -> Table:
    lines = [_line(reader, _outcomes([counter])) for reader, counter in counts.items()]
    total = _line("all", _outcomes(counts.values()))
    return Table("What came of the damaged logs", ("reader", "cases", *GOOD, *BAD), (*lines, total))


def _by_damage(counts: Counts) -> Table:
    lines = tuple(_line(damage, _outcomes(counts.values(), damage)) for damage in DAMAGES)
    return Table("By what was done first", ("damage", "cases", *GOOD, *BAD), lines)


def _by_way(counts: Counts) -> Table:
    words = {
        READ: "the reader",
        FLIGHT: "to a flight",
        GUARD: "the reader, others' code in a process of its own",
    }
    lines = tuple(_line(words[way], _outcomes(counts.values(), way)) for way in words)
    return Table("By what was asked", ("way", "cases", *GOOD, *BAD), lines)


def _meaning() -> Table:
    return Table("What the words mean", ("word", "meaning"), tuple(NAMES.items()))


def _damages() -> Table:
    return Table("What was done", ("damage", "how"), tuple(WORDS.items()))


def _told(found: Mapping[str, Any]) -> tuple[Cell, ...]:
    return tuple(found[key] for key in ("number", "damage", "outcome", "said"))


def _contained(found: Sequence[tuple[Cell, ...]]) -> Table:
    groups: Counter[tuple[str, str]] = Counter(
        (str(reader), str(said).partition(";")[0])
        for reader, _, _, outcome, said in found
        if outcome == CONTAINED
    )
    lines = tuple((reader, said, str(n)) for (reader, said), n in sorted(groups.items()))
    return Table("By reader and by what happened", ("reader", "what", "cases"), lines)


def _rows(counts: Counts) -> Iterable[tuple[Cell, ...]]:
    for reader, counter in counts.items():
        for damage in DAMAGES:
            outcomes = _outcomes([counter], damage)
            yield (
                reader,
                damage,
                sum(outcomes.values()),
                *(outcomes[o] for o in (*GOOD, *BAD)),
            )


EXPERIMENT: Final = Readers()
