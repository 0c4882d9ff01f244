"""The rule of the standard tier: what a test may take, and what all of them may take together."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import tiers

from stoop.base.cache import cache_folder


class Meter:
    """The processor time of the tests of one process, from one report to the next."""

    def __init__(self) -> None:
        self.cache = cache_folder()
        self.own = 0.0  #: s of the present test
        self.pace = tiers.pace()
        self.begin()

    def begin(self) -> None:
        """Begin to count."""
        self.shared = 0.0  #: s since the last report, of fixtures that several tests share
        self.spent = tiers.processor_time()  #: s, at the last report
        self.state = tiers.state(self.cache)

    def read(self, report: pytest.TestReport) -> None:
        """Add to the report of a phase its time, s, and whether kernels were compiled or modules imported in it."""
        before, self.spent = self.spent, tiers.processor_time()
        state, self.state = self.state, tiers.state(self.cache)
        report.processor_time = self.spent - before
        own, self.shared = report.processor_time - self.shared, 0.0
        report.own = 0.0 if report.when == "teardown" else own  # the last test ends what several shared
        report.compiled, report.cold = state[0] != self.state[0], state != self.state
        self.own = report.own + (0.0 if report.when == "setup" else self.own)
        if self.own > tiers.LIMIT:
            self.pace = tiers.pace()
        report.pace = self.pace


class Rule:
    """The times of a whole run, and what of them breaks the rule."""

    def __init__(self, tier: str, target: str | None) -> None:
        self.tier, self.target = tier, target
        self.words = tiers.listed()
        self.total: Counter[str] = Counter()  #: test -> s
        self.own: Counter[str] = Counter()  #: test -> s at the reference pace, without shared fixtures
        self.cold: set[str] = set()  #: tests during which kernels were compiled or modules imported
        self.compiled = False
        self.stale: set[str] = set()  #: entries of the list that name no test

    def pytest_testnodedown(self, node: Any) -> None:
        """Take what a worker of xdist found in the list."""
        self.stale |= set(getattr(node, "workeroutput", {}).get("stale", ()))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add the times of a phase; workers of xdist send them with the report, unless they died."""
        if not hasattr(report, "processor_time"):
            return
        self.total[report.nodeid] += report.processor_time / report.pace
        self.own[report.nodeid] += report.own / report.pace
        self.compiled |= report.compiled
        if report.cold:
            self.cold.add(report.nodeid)

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
            yield from broken(self.own, self.cold, self.words)
            if not self.compiled and (total := sum(self.total.values())) > tiers.TOTAL:
                yield f"the standard tests take {total:.0f} s of processor time, at most {tiers.TOTAL:.0f} s are allowed"


def broken(own: Mapping[str, float], cold: set[str], words: Mapping[str, str]) -> Iterator[str]:
    """Return a line for each test that takes too long and is no guard, and one where there are too many guards."""
    for test, seconds in own.items():
        if seconds > tiers.LIMIT and test not in cold and tiers.word_of(test, words) != "guard":
            yield f"{test} took {seconds:.2f} s, at most {tiers.LIMIT} s: make it faster, or list it in tests/tiers.txt"
    guards = sum(word == "guard" for word in words.values())
    if guards > tiers.GUARDS:
        yield f"tests/tiers.txt names {guards} guards, at most {tiers.GUARDS} are allowed"
