"""List the tests that `scripts/test.py quick` leaves out: ``python scripts/durations.py FILE ...``, FILES of all tiers.

``scripts/test.py`` and ``scripts/test.py full`` write these files, with the processor time of each test. Tests are taken
from the quickest on until a share of the whole time is used up; the others are listed with their seconds.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

LIST: Final = Path(__file__).resolve().parents[1] / "tests" / "long_tests.txt"
#: s, processor time of all quick tests together; three workers start and collect besides
QUICK_SECONDS: Final = 90.0


def main(files: Sequence[Path]) -> None:
    """Write the list; parameters of one test stand or fall together."""
    taken: Counter[str] = Counter()
    for test, s in (pair for file in files for pair in json.loads(file.read_text("utf-8")).items()):
        taken[test.partition("[")[0]] += s
    total, long = 0.0, []
    for test, s in reversed(taken.most_common()):
        total += s
        if total > QUICK_SECONDS:
            long.append((s, test))
    lines = [f"{s:.1f} {test}\n" for s, test in sorted(long, key=lambda x: x[1])]
    LIST.write_text(
        "# seconds of processor time and test; from scripts/durations.py\n" + "".join(lines), encoding="utf-8"
    )


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
