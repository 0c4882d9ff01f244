"""Coverage-guided damage: logs and documents that reach new lines of a reader are kept, and damaged further.

    pip install atheris
    python3 scripts/fuzz_readers.py ulog -atheris_runs=20000

What libFuzzer takes may follow (-max_total_time=60). The corpus begins with small logs of every kind and with drawn ones. What
ends in anything but an error of ours, or a reading, is left in the working folder as crash-*. `stoop verify robustness` needs
no such help, and counts more.
"""

from __future__ import annotations

import random
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import atheris

with atheris.instrument_imports(
    include=["stoop.logs", "stoop.flight", "stoop.vehicle", "stoop.simulation.maneuver"]
):
    from stoop.errors import StoopError
    from stoop.simulation.maneuver import parse_maneuver
    from stoop.vehicle.builtin import BUILT_IN, builtin_text
    from stoop.vehicle.load import parse_vehicle
    from stoop_studies.robustness.damaged_logs import Sample, damaged, single
    from stoop_studies.robustness.log_grammars import SHARES, Draw
    from stoop_studies.robustness.readers import DRAWN, FLIGHT, READER, ask, in_this_process
    from stoop_studies.robustness.sample_logs import SAMPLES, samples

OURS = 0.5  #: share of logs that are damaged by what knows how they are built; the rest is libFuzzer's own
DRAWN_LOGS = 40  #: of the corpus
GRAMMARS = {"netcdf-3": "netcdf", "netcdf-4": "hdf5"}  #: reader -> its grammar, where that has another name
MANEUVER = b"""duration = 6.0
speed = 15.0
wind = [1.0, 0.0, 0.0]
[[input]]
control = "elevator"
shape = "3211"
start = 1.0
step = 0.3
amplitude = 0.05
"""
Parser = Callable[[str, str], object]
DOCUMENTS: dict[str, tuple[Parser, list[bytes]]] = {
    "maneuver": (parse_maneuver, [MANEUVER]),
    "vehicle": (parse_vehicle, [builtin_text(name).encode() for name in BUILT_IN]),
}  #: kind -> what reads it, and sound ones


def main(reader: str, arguments: list[str]) -> None:
    """Damage and read until told otherwise."""
    if reader in DOCUMENTS:
        parse, texts = DOCUMENTS[reader]
        sound = [single("a.toml", text, "lines") for text in texts]
        corpus = texts
    else:
        sound = [s for s in samples(reader) if len(s.targets) == 1]
        corpus = [s.files[s.targets[0]] for s in sound]
        grammar = GRAMMARS.get(reader, reader)
        for seed in range(DRAWN_LOGS if grammar in DRAWN else 0):
            rng = random.Random(seed)  # noqa: S311  no secret
            drawn = DRAWN[grammar](Draw(rng, rng.choice(SHARES)))
            corpus.append(drawn.files[drawn.entry])

    with TemporaryDirectory(prefix="stoop-") as name, in_this_process():
        folder, place = Path(name) / "corpus", Path(name) / "log"
        folder.mkdir()
        for k, content in enumerate(corpus):
            (folder / str(k)).write_bytes(content)
        written = []
        for k, sample in enumerate(sound):
            (place / str(k)).mkdir(parents=True)
            written.append((sample, *sample.write(place / str(k))))

        warnings.simplefilter("error")  # a user would see them

        def read_log(data: bytes) -> None:
            sample, path, mapping = written[len(data) % len(written)]
            (path.parent / sample.targets[0]).write_bytes(data)
            for way in (READER, FLIGHT) if len(data) % 8 == 0 else (READER,):
                with suppress(StoopError):
                    ask(path, mapping, way)

        def read_document(data: bytes) -> None:
            with suppress(StoopError):
                parse(data.decode("utf-8", "replace"), "a.toml")

        read = read_document if reader in DOCUMENTS else read_log
        atheris.Setup([sys.argv[0], str(folder), *arguments], read, custom_mutator=mutator(sound))
        atheris.Fuzz()


def mutator(sound: list[Sample]) -> Callable[[bytes, int, int], bytes]:
    """Return what damages a log or document: libFuzzer's own damage, or ours with pieces of sound ones."""
    forms = sorted({s.form for s in sound})

    def mutate(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)  # noqa: S311  no secret
        if rng.random() > OURS:
            return bytes(atheris.Mutate(data, most))
        other = rng.choice(sound)
        with suppress(Exception):  # what is packed may not open any more
            return damaged(rng, data, other.files[other.targets[0]], rng.choice(forms))[1][:most]
        return bytes(atheris.Mutate(data, most))

    return mutate


if __name__ == "__main__":
    known = (*SAMPLES, *DOCUMENTS)
    if len(sys.argv) < 2 or sys.argv[1] not in known:
        sys.exit(f"usage: fuzz_readers.py READER [libFuzzer's options]; readers: {', '.join(known)}")
    main(sys.argv[1], sys.argv[2:])
