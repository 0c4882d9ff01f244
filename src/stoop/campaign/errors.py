"""What can go wrong with a campaign that the user can mend."""

from __future__ import annotations

from stoop.errors import StoopError


class CampaignError(StoopError):
    """A campaign cannot go on: a run fails, workers die, a cluster is out of reach; what is done is safe."""


class WorkerLostError(Exception):
    """A worker ended in the middle of a task, which may well succeed on another one."""
