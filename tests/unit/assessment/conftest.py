"""A fit of the longitudinal aircraft, shared by these tests."""

import pytest

from stoop import Flight, Options, Vehicle
from stoop.estimate.fit import OutputErrorEstimate, fit
from stoop.problem.windows import Window


@pytest.fixture(scope="session")
def pitch(wrong: Vehicle, flight: Flight) -> OutputErrorEstimate:
    found = fit(wrong, {"sim": flight}, [Window("sim", 0.0, 12.0)], Options())
    assert isinstance(found, OutputErrorEstimate)
    return found
