"""The state of a search under way, so that an interrupted one can go on."""

from __future__ import annotations

import hashlib
import time
from pathlib import Path

from stoop.errors import OutputError, StoopError
from stoop.files import write_text_atomic
from stoop.optimize import State, load_state, save_state

INTERVAL = 2.0  #: s between saved states


class Checkpoint:
    """Keeps a search's latest state in the output folder.

    Parameters
    ----------
    folder : Path
    identity : str
        What the resuming call must share: vehicle, windows, optimizer, seed.
    """

    def __init__(self, folder: Path, identity: str) -> None:
        self._state, self._mark = folder / "search.npz", folder / "search.id"
        self._identity = hashlib.sha256(identity.encode()).hexdigest()
        self._kept = -INTERVAL

    def keep(self, state: State) -> None:
        """Save a state, at most every two seconds."""
        if time.monotonic() - self._kept < INTERVAL:
            return
        self._kept = time.monotonic()
        save_state(self._state, state)
        write_text_atomic(self._mark, self._identity)

    def load(self) -> State:
        """Return the saved state.

        Raises
        ------
        OutputError
            There is none, or it belongs to another search.
        """
        if not self._state.exists():
            raise OutputError(f"{self._state.parent}: holds no interrupted search; leave --resume out")
        try:
            same = self._mark.read_text() == self._identity
        except (OSError, UnicodeDecodeError):
            same = False
        if not same:
            raise OutputError(
                f"{self._state.parent}: the interrupted search is another one (vehicle, windows, optimizer or seed "
                "differ); leave --resume out"
            )
        try:
            return load_state(self._state)
        except StoopError as error:
            raise OutputError(f"{error}; leave --resume out") from None

    def forget(self) -> None:
        """Remove the saved state: the search is done."""
        self._state.unlink(missing_ok=True)
        self._mark.unlink(missing_ok=True)
