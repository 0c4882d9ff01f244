"""Where the shared flights, check cases and certified problems lie, how long tests take, and which belong to which tier."""

from __future__ import annotations

import json
import os
import shutil
import signal
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import tiers
from hypothesis import HealthCheck, settings

from stoop.base import notices

if TYPE_CHECKING:
    from playwright.sync_api import Browser

SHARED = Path(os.environ.get("STOOP_SHARED", Path(__file__).parents[2] / "shared"))
LONG_TEXT = 4000  #: characters
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER_ARGUMENTS = [
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
# how fast a busy machine draws is no matter of the code
settings.register_profile("stoop", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("stoop")
seconds: Counter[str] = Counter()  #: test -> processor time, s, of its set-up, call and clean-up
spent = 0.0  #: processor time, s, of this process and its children until the last report


if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # started in the background of a script
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def _failures_of_detectors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the error of a detector pass, of which a user has a notice."""

    def raised(detector: str, error: Exception) -> notices.Notice:
        raise error

    monkeypatch.setattr(notices, "detector_failed", raised)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of shared data; skip without it, unless in CI, where its absence is a failure."""
    folder = SHARED / "data"
    if not folder.is_dir():
        if os.environ.get("CI"):
            pytest.fail(f"{folder} is missing: in CI the tests on real data must run")
        pytest.skip(f"{folder} is missing: set STOOP_SHARED to the folder that holds data/")
    return folder


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Return Chromium, Debian's or another, that asks for nothing by itself; skip without one, unless in CI."""
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        missing = f"none of {', '.join(BROWSERS)} is installed"
        if os.environ.get("CI"):
            pytest.fail(f"{missing}: in CI pages and app are tested in a browser")
        pytest.skip(missing)
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=program, args=BROWSER_ARGUMENTS)
        yield opened
        opened.close()


def pytest_assertrepr_compare(op: str, left: object, right: object) -> list[str] | None:
    """Name the size of a page in which something is missing or too much: whole, it hides which test failed."""
    if op in ("in", "not in") and isinstance(right, str) and len(right) > LONG_TEXT:
        return [f"{left!r} {op} a text of {len(right)} characters that begins with {right[:40]!r}"]
    return None


def processor_time() -> float:
    """Return the processor time of this process and of its children that have ended, s: a busy machine leaves it as it is."""
    return sum(os.times()[:4])


def pytest_runtest_logstart() -> None:
    """Begin to count the processor time of a test."""
    global spent
    spent = processor_time()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Note the processor time. In CI a skipped test has failed: nobody would notice that it was not run."""
    global spent
    report = yield
    before, spent = spent, processor_time()
    report.processor_time = spent - before
    if os.environ.get("CI") and report.skipped and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        report.longrepr = f"skipped in CI: {report.longrepr}"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """In CI a module that is skipped (an optional dependency is missing) has failed, likewise."""
    report = yield
    if os.environ.get("CI") and report.skipped:
        report.outcome = "failed"
        report.longrepr = f"skipped in CI: {report.longrepr}"
    return report


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of this project."""
    parser.addoption(
        "--tier", choices=tiers.CHOICES, default="all", help="quick: what takes seconds, as tests/long_tests.txt says; "
        "standard: what protects correctness; full: campaigns and distributions, as tests/tiers.txt says (default: all)",
    )  # fmt: skip
    parser.addoption("--screenshots", metavar="DIR", help="keep pictures of the app, at 1280 and 420 px")
    parser.addoption(
        "--durations-file", metavar="FILE", help="write the processor time of each test, s, as JSON"
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the tests of the full tier; leave out those of other tiers than the chosen one; in workers, begin with long files."""
    chosen = config.getoption("--tier")
    long = tiers.listed(tiers.LONG)
    tests = [i.nodeid for i in items]
    tier = tiers.listed(tiers.TIERS)
    found = config.stash[tiers.COLLECTED] = {test: tiers.tier_of(test, tier, long) for test in tests}
    for item in items:
        if found[item.nodeid] == "full":
            item.add_marker(pytest.mark.full)
    config.hook.pytest_deselected(items=[i for i in items if not tiers.runs(chosen, found[i.nodeid])])
    items[:] = [i for i in items if tiers.runs(chosen, found[i.nodeid])]
    if hasattr(config, "workerinput"):  # of xdist: a long file that begins last would keep one worker alone
        total = tiers.seconds_of_files((i.nodeid for i in items), long)
        items.sort(key=lambda i: -total[i.nodeid.partition("::")[0]])


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add up the time of a test; workers of xdist send theirs with the report."""
    seconds[report.nodeid] += getattr(report, "processor_time", 0.0)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the times, once: workers of xdist report theirs to the session that started them."""
    target = session.config.getoption("--durations-file")
    if target and not hasattr(session.config, "workerinput"):
        rounded = {test: round(s, 3) for test, s in seconds.most_common()}
        Path(target).write_text(json.dumps(rounded, indent=0), encoding="utf-8")
