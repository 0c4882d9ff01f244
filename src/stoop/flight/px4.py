"""PX4 topics -> registry variables, by the ready mapping `stoop/data/mappings/px4.toml`."""

from __future__ import annotations

from stoop.flight import mapped
from stoop.flight.channels import Channels
from stoop.flight.mapping import ready
from stoop.logs import FloatArray, Recording, Stream
from stoop.units import MICROSECOND


def px4_channels(recording: Recording) -> list[Channels]:
    """Pick the registry variables out of a recording of PX4 topics."""
    return mapped.apply(ready("px4"), recording).channels


def px4_notes(recording: Recording) -> list[str]:
    """Say which outputs were left out, because the variables hold those of one instance only."""
    return mapped.apply(ready("px4"), recording).notes


def sample_time(stream: Stream) -> FloatArray:
    """Return when the samples were taken [s], where the topic says so and it can be believed."""
    return mapped.sample_time(stream, "timestamp_sample", MICROSECOND)
