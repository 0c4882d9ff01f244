"""Coverage-guided campaign: choices of a hostile log or document that reach new lines of a reader are kept, and changed further.

    pip install atheris
    python3 scripts/fuzz_readers.py ulog -atheris_runs=20000

What libFuzzer takes may follow (-max_total_time=60). Its bytes are the choices by which tests/robustness
damages the files of its corpus. What ends in anything but an error of ours, or a reading, is left in the working folder
as crash-*.
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
    from robustness.documents import read_document
    from robustness.readers import GUARDED, OURS, read_case
    from robustness.test_fuzzing import damaged_documents, damaged_logs

    from stoop.errors import StoopError

DOCUMENTS = ("vehicle", "maneuver", "geometry", "windows")


def main(reader: str, arguments: list[str]) -> None:
    """Draw and read until told otherwise."""
    strategy = damaged_documents(reader) if reader in DOCUMENTS else damaged_logs(reader)
    ask = read_document if reader in DOCUMENTS else read_case
    warnings.simplefilter("error")  # a user would see them

    @settings(database=None, deadline=None, suppress_health_check=list(HealthCheck))
    @given(strategy)
    def read(drawn) -> None:
        with TemporaryDirectory(prefix="stoop-") as folder, suppress(StoopError):
            ask(Path(folder), drawn)

    atheris.Setup([sys.argv[0], *arguments], read.hypothesis.fuzz_one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    known = (*OURS, *GUARDED[:-2], *DOCUMENTS)
    if len(sys.argv) < 2 or sys.argv[1] not in known:
        sys.exit(f"usage: fuzz_readers.py READER [libFuzzer's options]; readers: {', '.join(known)}")
    main(sys.argv[1], sys.argv[2:])
