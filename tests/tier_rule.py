"""The rule of the standard tier: what a test may take, and what all of them may take together."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import tiers
from _pytest.runner import runtestprotocol

from stoop.base.cache import cache_folder


class Meter:
    """The processor time of the tests of one process, from one report to the next."""

    def __init__(self) -> None:
        self.cache = cache_folder()
        self.own = 0.0  #: s of the present test, without fixtures that several tests share
        self.pace = tiers.pace()
        self.compiled = False  #: whether kernels were compiled during the present test, by any process
        self.slow: dict[
            str, float
        ] = {}  #: test -> s that it takes, at the reference pace, where that is too much
        self.begin()

    def begin(self) -> None:
        """Begin to count."""
        self.shared = 0.0  #: s since the last report, of fixtures that several tests share
        self.spent = tiers.processor_time()  #: s, at the last report
        self.changed = tiers.changed(self.cache)

    def read(self, report: pytest.TestReport) -> None:
        """Add to the report of a phase its time, s, and whether kernels were compiled."""
        before, self.spent = self.spent, tiers.processor_time()
        changed, self.changed = self.changed, tiers.changed(self.cache)
        first, last = report.when == "setup", report.when == "teardown"
        report.processor_time, report.pace = self.spent - before, self.pace
        report.compiled = changed != self.changed
        self.compiled = report.compiled or (self.compiled and not first)
        if not last:  # the last test of a module ends what several shared
            self.own = report.processor_time - self.shared + (0.0 if first else self.own)
        self.shared = 0.0

    def confirm(self, item: pytest.Item, nextitem: pytest.Item | None, words: Mapping[str, str]) -> None:
        """Run a test that took too long again, twice at most: now modules are imported, and kernels are loaded."""
        if self.compiled or tiers.word_of(item.nodeid, words) != "standard":
            return
        for _ in range(2):
            if self.own / self.pace <= tiers.LIMIT:
                return
            item._initrequest()
            self.begin()
            runtestprotocol(item, nextitem=nextitem, log=False)
            self.pace = tiers.pace()
        if self.own / self.pace > tiers.LIMIT:
            self.slow[item.nodeid] = self.own / self.pace


class Rule:
    """The times of a whole run, and what of them breaks the rule."""

    def __init__(self, tier: str, target: str | None, slow: dict[str, float]) -> None:
        self.tier, self.target = tier, target
        self.words = tiers.listed()
        self.total: Counter[str] = Counter()  #: test -> s
        self.slow = slow  #: test -> s, of those that take too long, in this process and in workers of xdist
        self.compiled = False
        self.stale: set[str] = set()  #: entries of the list that name no test

    def pytest_testnodedown(self, node: Any) -> None:
        """Take what a worker of xdist found."""
        output = getattr(node, "workeroutput", {})
        self.stale |= set(output.get("stale", ()))
        self.slow |= output.get("slow", {})

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add the times of a phase; workers of xdist send them with the report, unless they died."""
        if not hasattr(report, "processor_time"):
            return
        self.total[report.nodeid] += report.processor_time / report.pace
        self.compiled |= report.compiled

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Fail a run that breaks the rule; write the times where they are asked for."""
        if self.target:
            rounded = {test: round(s, 3) for test, s in self.total.most_common()}
            Path(self.target).write_text(json.dumps(rounded, indent=0), encoding="utf-8")
        if session.exitstatus in (0, pytest.ExitCode.NO_TESTS_COLLECTED) and any(self.broken()):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print what breaks the rule."""
        for line in self.broken():
            terminalreporter.write_line(f"RULE: {line}", red=True)

    def broken(self) -> Iterator[str]:
        """Return a line for each stale entry of the list, and for each break of the rule in the standard tier."""
        yield from (
            f"tests/tiers.txt names a test that does not exist: {test}" for test in sorted(self.stale)
        )
        if self.tier == "standard":
            yield from broken(self.slow, self.words)
            if not self.compiled and (total := sum(self.total.values())) > tiers.TOTAL:
                yield f"the standard tests take {total:.0f} s of processor time, at most {tiers.TOTAL:.0f} s are allowed"


def broken(slow: Mapping[str, float], words: Mapping[str, str]) -> Iterator[str]:
    """Return a line for each test that takes too long, and one where there are too many guards."""
    for test, seconds in slow.items():
        yield f"{test} takes {seconds:.2f} s, at most {tiers.LIMIT} s: make it faster, or list it in tests/tiers.txt"
    guards = sum(word == "guard" for word in words.values())
    if guards > tiers.GUARDS:
        yield f"tests/tiers.txt names {guards} guards, at most {tiers.GUARDS} are allowed"
