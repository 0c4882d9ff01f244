"""``python -m stoop`` is the same as ``stoop``."""

from __future__ import annotations

import sys

from stoop.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
