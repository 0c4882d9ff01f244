"""The campaign limits processes, fills disks and kills children as POSIX systems do: elsewhere nothing of it is collected."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from hypothesis import settings

collect_ignore_glob = ["test_*.py"] if sys.platform == "win32" else []
settings.register_profile("campaign", settings.get_profile("stoop"), max_examples=10_000)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option of a campaign."""
    parser.addoption("--counts", metavar="FILE", help="write how many hostile cases ended how, as CSV")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the counts."""
    if target := session.config.getoption("--counts", None):
        from studies.robustness.campaign import write_counts

        write_counts(Path(target))
