"""Hostile inputs over everything that reads them, and runs on a machine that fails: how many cases ended how.

The campaign runs in slices: a run of a surface and a seed is a few hundred cases, and its counts are kept in the store of the
study, so that the same command goes on where it was stopped.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import pandas as pd

from stoop.report.sheet import Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.robustness import readers
from stoop_studies.robustness.damaged_logs import DAMAGES
from stoop_studies.robustness.differential import DIFFERENTIAL, try_differential
from stoop_studies.robustness.disk_full import DISK_FULL, try_disk_full
from stoop_studies.robustness.documents import DOCUMENTS, try_documents
from stoop_studies.robustness.interruptions import INTERRUPTIONS, try_interruptions
from stoop_studies.robustness.readers import Series
from stoop_studies.robustness.round_trips import ROUND_TRIPS, try_round_trips
from stoop_studies.robustness.sample_logs import SAMPLES
from stoop_studies.robustness.trials import BAD, CONTAINED, GOOD, Tried, count_outcomes
from stoop_studies.robustness.verbs import VERBS, try_verbs
from stoop_studies.verify.study import Samples, Verification, page_table, records_of, work

FAILED: Final = "failed"
OUTCOMES: Final = {**GOOD, FAILED: "; ".join(f"{name}: {meaning}" for name, meaning in BAD.items())}
KEYS: Final = ["family", "surface", "damage"]
LEAD: Final = """\
Hostile inputs of every kind that stoop reads. Each case runs in a copy of a process that may take little memory and time; when \
the copy dies, the case at hand is to blame. It must end in an error of one line or in a result that keeps its promises: clocks \
that grow, numbers of one type and length, texts without control characters, files that are whole. Anything else is a failure."""
READING: Final = """\
No log has a checksum over its numbers but that of the Crazyflie, packed ones, and HDF5 and Parquet where asked for: a changed \
number elsewhere is another measurement, and a log that ends where a message ends is a shorter log. Such cases are read \
without a notice."""
PACKED: Final = """\
What is packed (gzip, variables of MATLAB) is opened, damaged inside and packed again in half of the cases, and a Crazyflie's \
checksum is made to fit, so that it is the reader that meets the damage. A quarter of all logs is damaged twice."""


Trials = Callable[[str, int, int], Iterator[Tried]]  #: of a name, a seed and a count


@dataclass(frozen=True)
class Family:
    """Surfaces of one kind: how they are made hostile, and what is claimed of them."""

    procedure: str
    statement: str


@dataclass(frozen=True)
class Surface:
    """What reads hostile input: its family, the cases of one run, and how they are tried (seed, count, folder of data)."""

    family: str
    count: int
    trials: Callable[[int, int, str], Iterator[Tried]]


FAMILIES: Final[Mapping[str, Family]] = {
    "damaged logs": Family(
        "Small logs of every kind, made by stoop's writers and by the libraries of the formats, and beginnings of published "
        "ones, are damaged at random. Most cases call the reader, one in ten goes on to a flight and the summary of "
        "stoop info; all cases with a damaged mapping do.",
        "Damaged logs end in an error of one line, or are read",
    ),
    "drawn logs": Family(
        "Logs are drawn from the grammars of the formats, which were written from the public specifications, with hostile "
        "numbers, names, sizes and clocks in none, 2, 10 or 40 % of all choices. Half go on to a flight.",
        "Drawn logs end in an error of one line, or are read",
    ),
    "readers in a child": Family(
        "Damaged logs whose readers are others' code in C, read as users do: in a process of its own.",
        "Others' code that dies or runs on does not take the process along",
    ),
    "other readers": Family(
        "Drawn and damaged logs are read by stoop and by an independent reader (pyulog, pymavlink, SciPy, h5py, pyarrow, "
        "Python's csv). Where both read a column, its numbers must agree to the bit; what stoop leaves out must be listed.",
        "Where an independent reader succeeds, the numbers are the same",
    ),
    "round trips": Family(
        "Drawn flights and logs are written by stoop's writers and read again: to the bit, or to the digits that a format keeps.",
        "What stoop writes is read as it was",
    ),
    "documents": Family(
        "All other files that stoop reads, drawn from their grammars, or sound ones with values changed, exchanged, repeated and "
        "taken out, or with damaged bytes. What is read is written and read again.",
        "Hostile documents end in an error of one line, or are read",
    ),
    "verbs": Family(
        "Complete commands on hostile flights (constant channels, no input, one or two samples, steps of time that jump, numbers "
        "of any size), vehicles (masses of 1e-9 and 1e9, bounds that touch, 200 free parameters), maneuvers and results. A "
        "command must end with whole files, or with one line of error; what it prints holds no control characters.",
        "Complete commands on hostile inputs do their work, or end in an error of one line",
    ),
    "full disks": Family(
        "Verbs that write, one in each run in turn, on a small file system that is full at some point, half of the time with old "
        "files in place. A verb must end in an error of one line that leaves the old files and nothing half-written, and must "
        "succeed when there is space again.",
        "A full disk costs no file",
    ),
    "kills": Family(
        "Verbs that take long are killed (a fifth by SIGTERM) at random moments or right before the change of a file, and "
        "started again by the same command (an identification with --resume). Files must be whole after each kill, and in the "
        "end those of an undisturbed run to the byte.",
        "A verb that was killed and started again leaves the very files of an undisturbed run",
    ),
}  #: name -> what its cases are; in the order of the page


def _logs(form: str, drawn: bool, guarded: bool, seed: int, count: int, data: str) -> Iterator[Tried]:
    return readers.try_logs(Series(form, seed, drawn, guarded, data), count)


def _full_disks(seed: int, count: int, data: str) -> Iterator[Tried]:
    """Try one verb of a seed: preparing one takes longer than trying it."""
    return try_disk_full(DISK_FULL[seed % len(DISK_FULL)], seed, count)


def _made(family: str, label: str, counts: Mapping[str, int], trials: Trials) -> dict[str, Surface]:
    """Return surfaces that need no data, by name and count."""

    def surface(name: str, count: int) -> Surface:
        return Surface(family, count, lambda seed, cases, _: trials(name, seed, cases))

    return {label.format(name): surface(name, count) for name, count in counts.items()}


SURFACES: Final[Mapping[str, Surface]] = {
    **{name: Surface("damaged logs", 400, partial(_logs, name, False, False)) for name in SAMPLES},
    **{
        f"{name} drawn": Surface("drawn logs", 200, partial(_logs, name, True, False))
        for name in readers.DRAWN
    },
    **{
        f"{name} apart": Surface("readers in a child", 1, partial(_logs, name, False, True))
        for name in readers.GUARDED
    },
    **_made("other readers", "{} twice", dict.fromkeys(DIFFERENTIAL, 50), try_differential),
    **_made("round trips", "{} and back", dict.fromkeys(ROUND_TRIPS, 50), try_round_trips),
    **_made("documents", "{}", dict.fromkeys(DOCUMENTS, 170), try_documents),
    **_made("verbs", "stoop {}", {name: verb.count for name, verb in VERBS.items()}, try_verbs),
    "full disk": Surface("full disks", 2, _full_disks),
    **_made("kills", "{} killed", dict.fromkeys(INTERRUPTIONS, 2), try_interruptions),
}  #: name -> what is tried
SINCE: Final = frozenset({"blackbox", "stoop derivatives", "stoop frequency", "stoop propagate"})
"""Surfaces that are newer than the published counts."""


@work
def try_cases(case: str, seed: int, data: str) -> dict[str, Any]:
    """Try the cases of one run; ``case`` is a surface, ``data`` a folder of real logs, or empty."""
    surface = SURFACES[case]
    return count_outcomes(surface.trials(seed, surface.count, data))


def tabulate(samples: Samples) -> pd.DataFrame:
    """Return how many cases ended how, one column each, by family, surface and damage: `count_outcomes` by case."""
    counts: Counter[tuple[str, str, str, str]] = Counter()
    for name, results in samples.items():
        for result in results:
            for words, number in result["counts"].items():
                _, damage, outcome = words.rsplit("/", 2)
                counts[SURFACES[name].family, name, damage, FAILED if outcome in BAD else outcome] += number
    long = pd.DataFrame([(*key, n) for key, n in counts.items()], columns=[*KEYS, "outcome", "cases"])
    table = (
        long.pivot_table("cases", KEYS, "outcome", "sum")
        .reindex(columns=list(OUTCOMES))
        .fillna(0)
        .astype(int)
    )
    table.insert(0, "cases", table.sum(axis=1))
    return table


def show(setting: Setting, samples: Samples) -> Findings:
    """Return what came of the cases."""
    found = [
        {"surface": name, "seed": seed, **one}
        for name in samples
        for seed, result in zip(setting.seeds, samples[name], strict=True)
        for one in result["found"]
    ]
    groups = Counter(
        (one["surface"], one["message"].partition(";")[0]) for one in found if one["outcome"] == CONTAINED
    )
    contained = tuple((surface, message, str(n)) for (surface, message), n in sorted(groups.items()))
    counts = tabulate(samples)
    families = counts.groupby(level="family").sum()
    families = families.reindex([name for name in FAMILIES if name in families.index])
    logs = counts[counts.index.get_level_values("family") == "damaged logs"]
    damages = logs.groupby(level="damage").sum().reindex(list(DAMAGES), fill_value=0)
    sections = tuple(
        Section(name[0].upper() + name[1:], (Prose(FAMILIES[name].procedure), _family_table(counts, name)))
        for name in families.index
    )
    meanings = Table("What the words mean", ("word", "meaning"), tuple(OUTCOMES.items()))
    done = tuple((name, words) for name, (_, words) in DAMAGES.items())
    findings = Findings.tabulated(
        f"{counts['cases'].sum():,} hostile inputs and interrupted runs",
        LEAD,
        _claims(families),
        (
            Section("All", (_table("By family", families), meanings, Prose(READING))),
            *sections,
            Section(
                "Logs by damage",
                (
                    _table("By what was done first", damages),
                    Table("What was done", ("damage", "how"), done),
                    Prose(PACKED),
                ),
            ),
            Section(
                "Others' code that died or ran on",
                (Table("By surface", ("surface", "what", "cases"), contained),),
            ),
        ),
        records_of(counts.reset_index()),
    )
    head = ("surface", "seed", "number", "way", "damage", "outcome", "message")
    return replace(findings, parts={"found": (head, tuple(tuple(one[key] for key in head) for one in found))})


def _family_table(counts: pd.DataFrame, family: str) -> Table:
    surfaces = counts[counts.index.get_level_values("family") == family].groupby(level="surface").sum()
    return _table(
        f"By what reads it: {family}", surfaces.reindex([name for name in SURFACES if name in surfaces.index])
    )


def _table(caption: str, counts: pd.DataFrame) -> Table:
    """Return a table of counts, without outcomes that no case had; failures are always shown."""
    kept = counts.loc[:, (counts != 0).any() | (counts.columns == FAILED)]
    records = records_of(kept.reset_index())
    return page_table(caption, {name: (name, str) for name in records[0]}, records)


def _claims(families: pd.DataFrame) -> Iterator[Claim]:
    for name, row in families.iterrows():
        yield holds(
            FAMILIES[str(name)].statement,
            not row[FAILED],
            f"{row[FAILED]:,} failures in {row['cases']:,} cases",
        )


EXPERIMENT: Final = Verification(
    "robustness",
    show,
    runs=100,
    work="try_cases",
    cases=tuple(SURFACES),
    parts=("found",),
    reads_data=True,
)
