"""Where the shared flights, check cases and certified problems lie, how long tests take, and which are quick."""

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
from hypothesis import HealthCheck, settings

from stoop.base import notices

if TYPE_CHECKING:
    from playwright.sync_api import Browser

SHARED = Path(os.environ.get("STOOP_SHARED", Path(__file__).parents[2] / "shared"))
LONG_TESTS = Path(__file__).parent / "long_tests.txt"  #: test and seconds; written by scripts/durations.py
LONG_TEXT = 4000  #: characters
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER_ARGUMENTS = [
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
# how fast a busy machine draws is no matter of the code
settings.register_profile("stoop", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("stoop")
seconds: Counter[str] = Counter()  #: test -> time of its call, set-up and clean-up


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


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """In CI a skipped test has failed: nobody would notice that it was not run."""
    report = yield
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
        "--quick", action="store_true", help=f"leave out the tests of {LONG_TESTS.name} and slow ones"
    )
    parser.addoption("--screenshots", metavar="DIR", help="keep pictures of the app, at 1280 and 420 px")
    parser.addoption(
        "--durations-file", metavar="FILE", help="write how many seconds each test took, as JSON"
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With --quick, leave long tests out."""
    if config.getoption("--quick"):
        long = {line.split()[1] for line in LONG_TESTS.read_text("utf-8").splitlines() if line[:1].isdigit()}
        left_out = [i for i in items if i.nodeid.partition("[")[0] in long or i.get_closest_marker("slow")]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [i for i in items if i not in left_out]


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add up the time of a test."""
    seconds[report.nodeid] += report.duration


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the times, once: workers of xdist report theirs to the session that started them."""
    target = session.config.getoption("--durations-file")
    if target and not hasattr(session.config, "workerinput"):
        rounded = {test: round(s, 3) for test, s in seconds.most_common()}
        Path(target).write_text(json.dumps(rounded, indent=0), encoding="utf-8")
