"""Coverage-guided damage: logs that reach new lines of a reader are kept, and damaged further.

    pip install atheris
    python3 scripts/fuzz_readers.py ulog -atheris_runs=20000

What libFuzzer takes may follow (-max_total_time=60). A log that ends in anything but an error of ours, or a recording,
is left in the working folder as crash-*. `stoop verify readers` needs no such help, and counts more.
"""

from __future__ import annotations

import random
import sys
import warnings
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import atheris

with atheris.instrument_imports(include=["stoop.logs", "stoop.flight"]):
    from stoop.errors import StoopError
    from stoop_studies.verify.damaged_logs import damaged
    from stoop_studies.verify.readers import FLIGHT, READ, ask, in_this_process
    from stoop_studies.verify.sample_logs import SAMPLES, samples

OURS = 0.5  #: share of logs that are damaged by what knows how they are built; the rest is libFuzzer's own


def main(reader: str, arguments: list[str]) -> None:
    """Damage and read until told otherwise."""
    single = [s for s in samples(reader) if len(s.targets) == 1]
    forms = sorted({s.form for s in single})

    with TemporaryDirectory(prefix="stoop-") as name, in_this_process():
        corpus, place = Path(name) / "corpus", Path(name) / "log"
        corpus.mkdir()
        place.mkdir()
        for k, sample in enumerate(single):
            (corpus / str(k)).write_bytes(sample.files[sample.targets[0]])
            (place / str(k)).mkdir()
        written = [(sample, *sample.write(place / str(k))) for k, sample in enumerate(single)]

        warnings.simplefilter("error")  # a user would see them

        def mutate(data: bytes, most: int, seed: int) -> bytes:
            rng = random.Random(seed)  # noqa: S311  no secret
            if rng.random() > OURS:
                return atheris.Mutate(data, most)
            other = rng.choice(single)
            with suppress(Exception):  # what is packed may not open any more
                return damaged(rng, data, other.files[other.targets[0]], rng.choice(forms))[1][:most]
            return atheris.Mutate(data, most)

        def read(data: bytes) -> None:
            sample, path, mapping = written[len(data) % len(written)]
            (path.parent / sample.targets[0]).write_bytes(data)
            for way in (READ, FLIGHT) if len(data) % 8 == 0 else (READ,):
                with suppress(StoopError):
                    ask(path, mapping, way)

        atheris.Setup([sys.argv[0], str(corpus), *arguments], read, custom_mutator=mutate)
        atheris.Fuzz()


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in SAMPLES:
        sys.exit(f"usage: fuzz_readers.py READER [libFuzzer's options]; readers: {', '.join(SAMPLES)}")
    main(sys.argv[1], sys.argv[2:])
