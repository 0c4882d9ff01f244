"""Coverage-guided campaign: choices of a hostile log or document that reach new lines of a reader are kept, and changed further.

    pip install atheris
    python3 scripts/fuzz_readers.py ulog -atheris_runs=20000

What libFuzzer takes may follow (-max_total_time=60). Its bytes are the choices from which the strategies of
tests/studies/robustness draw. What ends in anything but an error of ours, or a reading, is left in the working folder as crash-*.
"""

from __future__ import annotations

import sys
import warnings
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import atheris

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
with atheris.instrument_imports(
    include=["stoop.logs", "stoop.flight", "stoop.vehicle", "stoop.simulation.maneuver"]
):
    from hypothesis import HealthCheck, given, settings
    from studies.robustness import documents, readers
    from studies.robustness.drawn_logs import DRAWN
    from studies.robustness.sample_logs import SAMPLES

    from stoop.errors import StoopError

DOCUMENTS = ("vehicle", "maneuver", "geometry", "windows")


def main(reader: str, arguments: list[str]) -> None:
    """Draw and read until told otherwise."""
    if reader in DOCUMENTS:
        strategy = documents.documents(reader)
    else:
        damaged = readers.damaged_logs(reader).map(lambda log: log[1])
        strategy = damaged | DRAWN[reader] if reader in DRAWN else damaged
    warnings.simplefilter("error")  # a user would see them

    @settings(database=None, deadline=None, suppress_health_check=list(HealthCheck))
    @given(strategy)
    def read(drawn) -> None:
        with TemporaryDirectory(prefix="stoop-") as folder, suppress(StoopError):
            if reader in DOCUMENTS:
                documents.try_document(Path(folder), reader, drawn, 12)
            else:
                readers.try_drawn(Path(folder), drawn, readers.READER)

    atheris.Setup([sys.argv[0], *arguments], read.hypothesis.fuzz_one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    known = (*SAMPLES, *DOCUMENTS)
    if len(sys.argv) < 2 or sys.argv[1] not in known:
        sys.exit(f"usage: fuzz_readers.py READER [libFuzzer's options]; readers: {', '.join(known)}")
    main(sys.argv[1], sys.argv[2:])
