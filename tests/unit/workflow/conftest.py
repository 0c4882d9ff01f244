"""One finished job and its folder, shared by these tests."""

from pathlib import Path

import pytest

from stoop.flight import Flight
from stoop.vehicle import Vehicle
from stoop.workflow import FittedModel
from stoop.workflow.identification import finish, search


@pytest.fixture(scope="session")
def job(wrong: Vehicle, flight: Flight) -> FittedModel:
    return finish(search(wrong, flight, ["0:20"], ["20:28"], command="stoop identify <here>"))


@pytest.fixture(scope="session")
def folder(job: FittedModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return job.save(tmp_path_factory.mktemp("job") / "result")
