"""An existing Dask cluster (extra `distributed`)."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, final

from stoop.campaign.errors import CampaignError
from stoop.campaign.plan import Task
from stoop.campaign.pool import Hands
from stoop.campaign.task import Report, perform
from stoop.errors import StoopError

_LOOK = 2.0  #: s between questions to the scheduler
_MISSING: Final = (
    ImportError,
    AttributeError,
)  #: what a worker without the package, or with another one, says


@final
@dataclass(frozen=True)
class Dask:
    """The workers of a Dask scheduler.

    Attributes
    ----------
    address : str
        "tcp://host:port"
    timeout : float, s
        How long to wait for the scheduler.
    """

    address: str
    timeout: float = 10.0

    @contextmanager
    def open(self) -> Iterator[Hands]:
        """Return the workers.

        Raises
        ------
        CampaignError
            The scheduler cannot be reached, or the extra is not installed.
        """
        client = self._connect()
        hands = _Cluster(client, self.address, self.timeout)
        try:
            yield hands
        finally:
            hands.drop()

    def _connect(self) -> Any:
        try:
            from distributed import Client
        except ImportError:
            raise CampaignError(
                "a Dask scheduler needs the package distributed; pip install 'stoop[distributed]'"
            ) from None
        try:
            return Client(self.address, timeout=self.timeout, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise CampaignError(
                f"scheduler {self.address}: cannot be reached ({_first_line(error)}); is the address right, and dask scheduler "
                "running there?"
            ) from error


@final
class _Cluster:
    def __init__(self, client: Any, address: str, timeout: float) -> None:
        self._client, self._address, self._timeout = client, address, timeout
        self._executor = client.get_executor(pure=False)
        self._looked, self._threads, self._silent = -_LOOK, 0, False

    def width(self) -> int:
        self._look()
        return 2 * max(self._threads, 1)

    def submit(self, task: Task) -> Future[Report]:
        self._check()
        future: Future[Report] = self._executor.submit(perform, task.work, task.text, task.stops)
        return future

    def judge(self, error: BaseException) -> StoopError | None:
        from distributed import KilledWorker

        if isinstance(error, KilledWorker):
            return None
        if isinstance(error, CancelledError):
            return self._gone()
        if isinstance(error, _MISSING):
            return CampaignError(
                f"a worker of {self._address}: has no stoop, or another version ({_first_line(error)}); install the same there"
            )
        return CampaignError(
            f"cluster {self._address}: {_first_line(error)}; what is done is safe: start again"
        )

    def note(self) -> str:
        self._check()
        self._look()
        if self._silent:
            return f"waiting for the scheduler {self._address} to answer"
        return "" if self._threads else f"waiting for a worker to join {self._address}"

    def drop(self) -> None:
        """Leave the cluster; it forgets what we asked of it."""
        with contextlib.suppress(Exception):  # whatever state it is in, the campaign's own error counts
            self._client.close(timeout=self._timeout)

    def _check(self) -> None:
        if self._client.status != "running":
            raise self._gone()

    def _look(self) -> None:
        """Count the threads of the workers, now and then."""
        now = time.monotonic()
        if now - self._looked < _LOOK and self._threads:
            return
        self._looked = now
        try:
            self._threads = sum(self._client.nthreads(callback_timeout=self._timeout).values())
            self._silent = False
        except TimeoutError:
            self._silent = True
        except Exception as error:
            raise self._gone() from error

    def _gone(self) -> CampaignError:
        return CampaignError(
            f"scheduler {self._address}: lost; what is done is safe: start the same command again when it is back"
        )


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
