"""Command line: run the parts asked for, print one table."""

from __future__ import annotations

import argparse
import importlib
import json
import time
from pathlib import Path

from benchmarks.clock import machine
from benchmarks.table import Row, markdown
from stoop.base.memory import keep_freed_memory

QUICK = ("engine", "accuracy", "startup", "overhead", "paper", "joint")
PARTS = (
    *QUICK,
    "ulog",
    "dataflash",
    "tables",
    "fleet",
    "shooting",
    "bootstrap",
    "pages",
    "jobs",
    "growth",
    "solvers",
    "posterior",
    "corners",
    "tuning",
    "short_windows",
    "bbob",
)  #: the last takes many minutes


def main() -> int:
    """Measure and print; a figure that falls short is a row of the table, not an error."""
    arguments = _arguments()
    keep_freed_memory()  # as the command does
    facts, begun = machine(), time.perf_counter()
    rows: list[Row] = []
    for part in arguments.parts or QUICK:
        print(f"measuring: {part} ...", flush=True)
        rows += importlib.import_module(f"benchmarks.{part}").run()
    facts["took"] = f"{time.perf_counter() - begun:.0f} s"
    print("\n" + markdown(rows) + "\n\n" + "\n".join(f"{k}: {v}" for k, v in facts.items()))
    if arguments.json is not None:
        content = {"machine": facts, "rows": [row.as_json() for row in rows]}
        arguments.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "parts", metavar="PART", nargs="*", help=f"of {', '.join(PARTS)} (default: {', '.join(QUICK)})"
    )
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures there too")
    arguments = parser.parse_args()
    unknown = set(arguments.parts) - set(PARTS)
    if unknown:
        parser.error(f"there is no part '{min(unknown)}'; choose from {', '.join(PARTS)}")
    return arguments


if __name__ == "__main__":
    raise SystemExit(main())
