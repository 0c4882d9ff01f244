"""Ctrl-C, or SIGTERM: the state of a search is kept, so that it can be resumed, and a finished one is written first."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from stoop.assessment.verdict import CONFIRMED
from stoop.errors import OutputError, StoopError
from stoop.estimate.fit import Options
from stoop.optimize import Outcome, State, load_tagged, save_state
from stoop.strategy import Strategy
from stoop.vehicle import Vehicle

STRATEGY = Strategy.default()
INTERVAL = 2.0  #: s between saved states


def identity(
    vehicle: Vehicle,
    files: Mapping[str, str],
    maneuvers: Sequence[str],
    validate: Sequence[str],
    options: Options,
    strategy: Strategy = STRATEGY,
) -> str:
    """Return what decides the problem and its search, in one hash; when to give up may differ.

    `files` are hashes by name of each flight and mapping. Windows to predict count: nothing is learned about the wind
    there. Of the vehicle count what was freed and fixed, not comments and order of its file.
    """
    noise = None if options.covariance is None else options.covariance.tolist()
    parts = [
        vehicle.structure, vehicle.file.model_dump(mode="json"), dict(files), list(maneuvers), list(validate), noise,
        options.optimizer_name, options.seed, options.method, sorted(strategy.names),
    ]  # fmt: skip
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


class Checkpoint:
    """Keeps a search's latest state in the output folder, with the :func:`identity` of the problem.

    A state that cannot be saved (full disk, folder removed) causes one warning and ends no search.
    """

    def __init__(self, folder: Path, problem: str, warn: Callable[[str], None]) -> None:
        self._path = folder / "search.npz"
        self._problem, self._warn = problem, warn
        self._tried = -INTERVAL
        self._failed = False

    def keep(self, state: State) -> None:
        """Save a state, at most every two seconds."""
        if time.monotonic() - self._tried >= INTERVAL:
            self._tried = time.monotonic()
            self._save(state)

    def keep_last(self, outcome: Outcome) -> None:
        """Save the last whole step of a search that has ended, whatever ended it."""
        if outcome.state is not None:
            with suppress(OSError):
                self._path.parent.mkdir(parents=True, exist_ok=True)
            self._save(outcome.state)

    def forget(self, status: str) -> None:
        """Remove the saved state of a search that has nothing left to do; its result must lie safe."""
        if status in CONFIRMED:
            self._path.unlink(missing_ok=True)

    def load(self) -> State:
        """Return the saved state.

        Raises `OutputError`: there is none, or it belongs to another search.
        """
        if not self._path.exists():
            raise OutputError(f"{self._path.parent}: holds no interrupted search; leave --resume out")
        try:
            state, problem = load_tagged(self._path)
        except StoopError as error:
            raise OutputError(f"{error}; leave --resume out") from None
        if problem != self._problem:
            raise OutputError(
                f"{self._path.parent}: the interrupted search is another one (vehicle, free numbers, flights, mapping, "
                "noise, windows, decisions, method, optimizer or seed differ); leave --resume out"
            )
        return state

    def _save(self, state: State) -> None:
        try:
            save_state(self._path, state, self._problem)
        except OutputError as error:
            if not self._failed:
                self._warn(f"{error}; the search goes on, but cannot be resumed from here")
            self._failed = True
