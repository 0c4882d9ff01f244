"""What an experiment leaves in its folder: NAME.html, NAME.csv, NAME-PART.csv, and NAME.sqlite where runs are many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from markupsafe import Markup

from stoop.base.files import write_text_atomic
from stoop.errors import OutputError
from stoop.parallel import Plan
from stoop.parallel.store import forget
from stoop.report.sheet import Code, Prose, Section, Sheet, Table, write_sheet
from stoop_studies.findings import CLAIMS_HEAD, Experiment, Findings, Results, Setting, claim_rows

INDEX: Final = "index.html"
Execute = Callable[[Plan, Path], Results]


@dataclass(frozen=True)
class Suite:
    """What the experiments of one verb share.

    Attributes
    ----------
    verb : str
        As on the command line.
    title, lead : str
        Of the page that leads to all others.
    options : callable
        From a setting to the words of a command after its ``--seed``.
    notes : tuple of Section
        Stand on every page.
    """

    verb: str
    title: str
    lead: str
    options: Callable[[Setting], str]
    notes: tuple[Section, ...] = ()

    def command(self, name: str, setting: Setting) -> str:
        """Return the command that makes a page; where it runs and into what folder do not change it."""
        return f"{self.call(name)} --runs {setting.runs} --seed {setting.seed}{self.options(setting)}"

    def call(self, name: str) -> str:
        """Return verb and experiment."""
        return f"stoop {self.verb} {name}"


def carry_out(
    suite: Suite,
    experiment: Experiment,
    setting: Setting,
    folder: Path,
    execute: Execute,
    overwrite: bool = False,
) -> Findings:
    """Run what is left of an experiment, and write its page and tables.

    Parameters
    ----------
    suite : Suite
    experiment : Experiment
    setting : Setting
    folder : Path
        Made if it is not there.
    execute : callable
        From a plan and the path of its store to results by key.
    overwrite : bool
        Begin anew, and replace files that are of no such experiment.

    Raises
    ------
    StoopError
        The folder cannot be used, or a run failed; nothing is lost.
    """
    name = experiment.name
    store = folder / f"{name}.sqlite"
    tables = {"": f"{name}.csv", **{part: f"{name}-{part}.csv" for part in experiment.parts}}
    _prepare(suite, folder, name, store, [folder / table for table in tables.values()], overwrite)
    plan = experiment.plan(setting)
    results = {} if plan is None else execute(plan, store)
    findings = experiment.findings(setting, results)
    # the page first: a table without a page would not be known as ours when the command is given again
    write_sheet(findings.sheet(suite.command(name, setting), suite.notes), page_path(folder, name))
    for part, table in tables.items():
        write_text_atomic(folder / table, findings.part(part) if part else findings.csv)
    return findings


def page_path(folder: Path, name: str) -> Path:
    """Return where the page lies."""
    return folder / f"{name}.html"


def _prepare(
    suite: Suite, folder: Path, name: str, store: Path, tables: Sequence[Path], overwrite: bool
) -> None:
    """Make the folder; refuse what is not of an earlier run of the experiment, or with ``overwrite`` begin anew."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(f"{folder}: is a file; name a folder") from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}); choose another") from None
    page = page_path(folder, name)
    if overwrite:
        forget(store)
    elif page.exists():
        _check_ours(page, suite.call(name), f" than {suite.call(name)}")
    elif any(table.exists() for table in tables) and not store.exists():
        raise OutputError(_foreign(page, f" than {suite.call(name)}"))


def _check_ours(path: Path, words: str, other: str) -> None:
    """Refuse a file that does not contain our words."""
    if not (path.is_file() and words in path.read_text(encoding="utf-8", errors="replace")):
        raise OutputError(_foreign(path, other))


def _foreign(path: Path, other: str) -> str:
    return f"{path}: is of something else{other}; add --overwrite, or choose another folder"


def check_index(suite: Suite, folder: Path, overwrite: bool) -> None:
    """Refuse an index that is not ours.

    Raises
    ------
    OutputError
        With what to do instead.
    """
    if (path := folder / INDEX).exists() and not overwrite:
        _check_ours(path, suite.title, "")


def write_index(
    suite: Suite, found: Mapping[str, Findings], settings: Sequence[Setting], folder: Path
) -> None:
    """Write the page that leads to all others."""
    sections = []
    for name, findings in found.items():
        # markup of our own: the name of an experiment, and nothing that was read from anywhere
        link = Markup('<a href="{0}.html">{0}.html</a>').format(name)
        table = Table("What it shows", CLAIMS_HEAD, (*claim_rows(findings.claims), ("page", link)))
        sections.append(Section(findings.title, (Prose(findings.lead), table)))
    commands = "\n".join(suite.command(n, s) for n, s in zip(found, settings, strict=True))
    made = Section("Made by", (Code(commands),))
    write_sheet(Sheet(suite.title, suite.lead, (*sections, made)), folder / INDEX)
