"""An existing Dask cluster (extra `distributed`).

Futures are passed on by hand: those of `Client.get_executor` stay undone for ever when the connection breaks while a result
is being fetched, and the bare ones are not for `concurrent.futures.wait`.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import re
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, final

from stoop.errors import CampaignError, StoopError
from stoop.parallel.plan import Task
from stoop.parallel.pool import Hands
from stoop.parallel.task import Report

_ADDRESS: Final = re.compile(r"(tcp|tls|ws|wss)://(?:\[([^\s/\[\]]+)\]|([^\s/:\[\]]+)):(\d{1,5})")
_PORTS: Final = range(1, 1 << 16)
_AGAIN = 0.2  #: s between knocks at the door of a scheduler
_LOOK = 2.0  #: s between questions to the scheduler
_SAFE: Final = "what is done is safe"


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

    Raises
    ------
    CampaignError
        It is no such address.
    """

    address: str
    timeout: float = 10.0

    def __post_init__(self) -> None:
        found = _ADDRESS.fullmatch(self.address)
        if found is None or int(found[4]) not in _PORTS:
            raise CampaignError(
                f"scheduler {self.address!r}: is no address; give tcp://HOST:PORT as dask scheduler prints it"
            )

    @contextmanager
    def open(self) -> Iterator[Hands]:
        """Return the workers.

        Raises
        ------
        CampaignError
            The scheduler cannot be reached, or the extra is not installed.
        """
        make = _client_class()
        with _no_tracebacks():
            hands = _Cluster(self._connect(make), self.address, self.timeout)
            try:
                yield hands
            finally:
                hands.drop()

    def _connect(self, make: type[Any]) -> Any:
        try:
            self._await_scheduler()
            return _made(make, self.address, self.timeout)
        except Exception as error:  # a stranger's answer may be anything, a lack of memory included
            raise CampaignError(
                f"scheduler {self.address}: cannot be reached ({_first_line(error)}); check the address, and that "
                "dask scheduler runs there"
            ) from error

    def _await_scheduler(self) -> None:
        """Wait until the scheduler answers.

        Dask's client is not made before: one that fails leaves threads behind, which complain later, and it waits for
        ever where something else than a scheduler listens.
        """
        end = time.monotonic() + self.timeout
        while True:
            try:
                return self._knock(max(end - time.monotonic(), _AGAIN))
            except OSError:
                if time.monotonic() + _AGAIN > end:
                    raise
            time.sleep(_AGAIN)

    def _knock(self, patience: float) -> None:
        """Connect once; over plain TCP a scheduler speaks first."""
        found = _ADDRESS.fullmatch(self.address)
        assert found is not None  # noqa: S101 - see above
        with socket.create_connection((found[2] or found[3], int(found[4])), patience) as door:
            if found[1] == "tcp" and not door.recv(1):
                raise ConnectionResetError("what listens there hangs up")


def _made(make: type[Any], address: str, timeout: float) -> Any:
    """Return a client; one that fails would try to close itself when it is forgotten, in vain and aloud."""
    client: Any = object.__new__(make)
    try:
        client.__init__(address, timeout=timeout, set_as_default=False)
    except BaseException:
        client.status = "closed"
        raise
    return client


def _client_class() -> type[Any]:
    try:
        from distributed import Client
    except ImportError:
        raise CampaignError(
            "a Dask scheduler needs the package distributed; pip install 'stoop[distributed]'"
        ) from None
    made: type[Any] = Client
    return made


@contextmanager
def _no_tracebacks() -> Iterator[None]:
    """Keep what Dask's client logs about a lost scheduler to itself: the campaign says it in one line."""
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


@final
class _Cluster:
    def __init__(self, client: Any, address: str, timeout: float) -> None:
        self._client, self._address, self._timeout = client, address, timeout
        self._link = (
            client.scheduler_comm
        )  # another one after a reconnection, and then our tasks are forgotten
        self._perform = _messenger()
        self._looked, self._threads, self._silent = -_LOOK, 0, False

    def width(self) -> int:
        self._look()
        return 2 * max(self._threads, 1)

    def submit(self, task: Task) -> Future[Report]:
        self._check()
        asked = self._client.submit(self._perform, task.work, task.text, task.stops, pure=False)
        future: Future[Report] = Future()
        asked.add_done_callback(functools.partial(_pass_on, future))
        return future

    def judge(self, error: BaseException) -> StoopError | None:
        from distributed import KilledWorker

        if isinstance(error, KilledWorker):
            return None
        if isinstance(error, CancelledError) or self._is_gone():
            return self._gone()
        if isinstance(error, OSError):  # the connection broke while the result was fetched
            return None
        return CampaignError(f"cluster {self._address}: {_first_line(error)}; {_SAFE}, start again")

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

    def _is_gone(self) -> bool:
        return self._client.status != "running" or self._client.scheduler_comm is not self._link

    def _check(self) -> None:
        if self._is_gone():
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
            f"scheduler {self._address}: lost; {_SAFE}: start the same command again when it is back"
        )


def _pass_on(future: Future[Report], asked: Any) -> None:
    """Settle a future as Dask's one was settled, whatever fetching its result brings."""
    try:
        future.set_result(asked.result())
    except Exception as error:
        future.set_exception(error)
    except BaseException:  # asyncio's cancellation is none of the driver's exceptions
        future.set_exception(CancelledError())


def _messenger() -> Callable[[str, str, list[int | None]], Report]:
    """Return a function that travels whole, as an inner one does, not as the name of something to import.

    A worker without the package cannot even unpickle such a name: it dies, and its successor, too.
    """

    def call(work: str, text: str, stops: list[int | None]) -> Report:
        try:
            from stoop.parallel.task import perform
        except (ImportError, AttributeError) as error:
            what = f"its worker has no stoop, or another version ({error}); install the same as here"
            return {"worker": "", "environment": {}, "results": [], "failure": what, "trace": ""}
        return perform(work, text, stops)

    return call


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
