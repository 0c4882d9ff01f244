"""The files of a study in its folder: NAME.html, NAME.csv, NAME-PART.csv, and NAME.sqlite where runs are many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from markupsafe import Markup

from stoop.base.files import check_targets, make_folder, write_files
from stoop.errors import OutputError
from stoop.parallel import Plan
from stoop.parallel.store import forget
from stoop.report.sheet import Code, Section, Sheet, Table, render_sheet, write_sheet
from stoop_studies.findings import CLAIMS_HEAD, Experiment, Findings, Results, Setting, claim_rows

INDEX: Final = "index.html"
GUIDE: Final = "https://stoop-id.readthedocs.io/en/latest/studies.html"
Execute = Callable[[Plan, Path], Results]


@dataclass(frozen=True)
class Suite:
    """What the studies of one verb share: title and lead of their index, and the options of their commands.

    ``options`` gives the words of a command after its ``--seed``.
    """

    verb: str
    title: str
    lead: str
    options: Callable[[Setting], str]

    def command(self, name: str, setting: Setting) -> str:
        """Return the command that makes a page; where it runs and into what folder do not change it."""
        return f"{self.call(name)} --runs {setting.runs} --seed {setting.seed}{self.options(setting)}"

    def call(self, name: str) -> str:
        """Return verb and experiment."""
        return f"stoop {self.verb} {name}"

    def guide(self, name: str) -> str:
        """Return where the documentation says how a study measures and what its columns mean."""
        place = f"{self.verb}-{name}" if self.verb == "reproduce" else name
        return f"How this is measured, and what the columns mean: {GUIDE}#{place}"


def page_path(folder: Path, name: str) -> Path:
    """Return the path of a page."""
    return folder / f"{name}.html"


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
    name, call = experiment.name, suite.call(experiment.name)
    store, page = folder / f"{name}.sqlite", page_path(folder, name)
    tables = {"": f"{name}.csv", **{part: f"{name}-{part}.csv" for part in experiment.parts}}
    make_folder(folder)
    check_targets(folder, (page.name, *tables.values()), overwrite=True)
    if overwrite:
        forget(store)
    elif page.exists() or (any((folder / t).exists() for t in tables.values()) and not store.exists()):
        _check_own(page, call, f" than {call}")
    plan = experiment.plan(setting)
    results = {} if plan is None else execute(plan, store)
    findings = experiment.findings(setting, results)
    # the page first: a table without a page would not be known as ours when the command is given again
    texts = {page.name: render_sheet(findings.sheet(suite.command(name, setting), suite.guide(name)))}
    texts |= {table: findings.part(part) if part else findings.csv for part, table in tables.items()}
    write_files(folder, texts)
    return findings


def _check_own(path: Path, words: str, other: str) -> None:
    """Refuse a page that does not contain our words, or is missing beside its tables."""
    if not (path.is_file() and words in path.read_text(encoding="utf-8", errors="replace")):
        raise OutputError(f"{path}: is of something else{other}; add --overwrite, or choose another folder")


def check_index(suite: Suite, folder: Path, overwrite: bool) -> None:
    """Refuse to replace an index of something else, an OutputError."""
    if (path := folder / INDEX).exists() and not overwrite:
        _check_own(path, suite.title, "")


def write_index(
    suite: Suite, found: Mapping[str, Findings], settings: Sequence[Setting], folder: Path
) -> None:
    """Write the page that leads to all others."""
    sections = []
    for name, findings in found.items():
        # markup of our own: the name of an experiment, and nothing that was read from anywhere
        link = Markup('<a href="{0}.html">{0}.html</a>').format(name)
        table = Table("What it shows", CLAIMS_HEAD, (*claim_rows(findings.claims), ("page", link)))
        sections.append(Section(findings.title, (table,)))
    commands = "\n".join(suite.command(n, s) for n, s in zip(found, settings, strict=True))
    made = Section("Made by", (Code(commands),))
    write_sheet(Sheet(suite.title, suite.lead, (*sections, made)), folder / INDEX)
