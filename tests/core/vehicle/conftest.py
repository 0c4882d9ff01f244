"""The paper's aircraft as text, so that tests can spoil it."""

from importlib.resources import files

import pytest


@pytest.fixture(scope="session")
def twin_boom() -> str:
    return (files("stoop") / "data" / "twin_boom.toml").read_text()
