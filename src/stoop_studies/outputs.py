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
    """Run what is left of an experiment, and write its page and table.

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
    prepare(suite, folder, experiment, overwrite)
    plan = experiment.plan(setting)
    results = {} if plan is None else execute(plan, _store(folder, experiment.name))
    findings = experiment.findings(setting, results)
    sheet = findings.sheet(suite.command(experiment.name, setting), suite.notes)
    # the page first: a table without a page would not be known as ours when the command is given again
    write_sheet(sheet, page_path(folder, experiment.name))
    write_text_atomic(folder / f"{experiment.name}.csv", findings.csv)
    for part in experiment.parts:
        write_text_atomic(folder / f"{experiment.name}-{part}.csv", findings.part(part))
    return findings


def page_path(folder: Path, name: str) -> Path:
    """Return where the page lies."""
    return folder / f"{name}.html"


def _store(folder: Path, name: str) -> Path:
    return folder / f"{name}.sqlite"


def prepare(suite: Suite, folder: Path, experiment: Experiment, overwrite: bool) -> None:
    """Make the folder; refuse what is not ours, or with ``overwrite`` begin anew.

    Raises
    ------
    OutputError
        The folder is a file, cannot be made, or holds files of something else.
    """
    name = experiment.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(f"{folder}: is a file; name a folder") from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}); choose another") from None
    if overwrite:
        forget(_store(folder, name))
    elif not _ours(suite, folder, experiment):
        raise OutputError(
            f"{page_path(folder, name)}: is of something else than {suite.call(name)}; "
            "add --overwrite, or choose another folder"
        )


def _ours(suite: Suite, folder: Path, experiment: Experiment) -> bool:
    """Whether page and tables are missing, or of an earlier run of the experiment."""
    name = experiment.name
    page = page_path(folder, name)
    if page.exists():
        return _says(page, suite.call(name))
    tables = (f"{name}.csv", *(f"{name}-{part}.csv" for part in experiment.parts))
    return not any((folder / t).exists() for t in tables) or _store(folder, name).exists()


def _says(page: Path, words: str) -> bool:
    return page.is_file() and words in page.read_text(encoding="utf-8", errors="replace")


def check_index(suite: Suite, folder: Path, overwrite: bool) -> None:
    """Refuse an index that is not ours.

    Raises
    ------
    OutputError
        With what to do instead.
    """
    path = folder / INDEX
    if path.exists() and not overwrite and not _says(path, suite.title):
        raise OutputError(f"{path}: is of something else; add --overwrite, or choose another folder")


def write_index(
    suite: Suite, found: Mapping[str, Findings], settings: Sequence[Setting], folder: Path
) -> None:
    """Write the page that leads to all others."""
    sections = [_entry(name, f) for name, f in found.items()]
    commands = "\n".join(suite.command(n, s) for n, s in zip(found, settings, strict=True))
    made = Section("Made by", (Code(commands),))
    write_sheet(Sheet(suite.title, suite.lead, (*sections, made)), folder / INDEX)


def _entry(name: str, findings: Findings) -> Section:
    # markup of our own: the name of an experiment, and nothing that was read from anywhere
    link = Markup('<a href="{0}.html">{0}.html</a>').format(name)
    table = Table("What it shows", CLAIMS_HEAD, (*claim_rows(findings.claims), ("page", link)))
    return Section(findings.title, (Prose(findings.lead), table))
