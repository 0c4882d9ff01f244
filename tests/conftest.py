"""Where the shared flights, check cases and certified problems lie, how long tests take, and which belong to which tier."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import tiers
from hypothesis import HealthCheck, settings
from tier_rule import Meter, Rule

from stoop.base import notices

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytest_plugins = ["helpers.aircraft", "helpers.command_line"]
SHARED = Path(os.environ.get("STOOP_SHARED", Path(__file__).parents[2] / "shared"))
LONG_TEXT = 4000  #: characters
WORDS = tiers.listed()
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER_ARGUMENTS = [
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
# how fast a busy machine draws is no matter of the code
settings.register_profile(
    "stoop", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("stoop")
meter = Meter()


if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # started in the background of a script
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def _failures_of_detectors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the error of a detector pass, of which a user has a notice."""

    def raised(detector: str, error: Exception) -> notices.Notice:
        raise error

    monkeypatch.setattr(notices, "detector_failed", raised)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to an empty folder and return it."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


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
def pytest_runtest_protocol(
    item: pytest.Item, nextitem: pytest.Item | None
) -> Generator[None, object, object]:
    """Begin to count with a test; run one of the standard tier again that took too long."""
    meter.begin()
    result = yield
    if item.config.getoption("--tier") == "standard":
        meter.confirm(item, nextitem, WORDS)
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the processor time of a phase to its report. In CI a skipped test has failed: nobody would notice it."""
    report = yield
    meter.read(report)
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


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object]) -> Generator[None, object, object]:
    """Count fixtures that several tests share apart from the test that happens to be the first."""
    before = tiers.processor_time()
    try:
        return (yield)
    finally:
        if fixturedef.scope != "function":
            meter.shared += tiers.processor_time() - before


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of this project."""
    parser.addoption(
        "--tier", choices=(*tiers.TIERS, "all"), default="all",
        help="the tests to run, as tests/tiers.txt has them (default: all)",
    )  # fmt: skip
    parser.addoption(
        "--durations-file", metavar="FILE", help="write the processor time of each test, s, as JSON"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Hold a run of the standard tier to the rule of its times."""
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(
            Rule(config.getoption("--tier"), config.getoption("--durations-file"), meter.slow)
        )


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Send what takes too long to the process that started this worker of xdist."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["slow"] = meter.slow


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Import no file without a test of the chosen tier, unless the command names it."""
    if collection_path.suffix != ".py" or any(
        collection_path == Path(a.partition("::")[0]).resolve() for a in config.args
    ):
        return None
    file = collection_path.relative_to(config.rootpath).as_posix()
    return tiers.left_out(file, config.getoption("--tier"), WORDS) or None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out tests of other tiers than the chosen one, and refuse entries of the list that name no test."""
    part = any("::" in argument for argument in config.args) or config.getoption("lf", False)
    if not part and (gone := tiers.stale(WORDS, [item.nodeid for item in items])):
        if not hasattr(config, "workeroutput"):
            raise pytest.UsageError(f"tests/tiers.txt names tests that do not exist: {', '.join(gone)}")
        config.workeroutput["stale"] = gone  # Rule prints it
    chosen = config.getoption("--tier")
    others = [i for i in items if chosen not in ("all", tiers.tier_of(i.nodeid, WORDS))]
    config.hook.pytest_deselected(items=others)
    items[:] = [i for i in items if i not in set(others)]
