"""``python -m stoop`` is the same as ``stoop``: packages in the folder where it is called are not read."""

import sys
from pathlib import Path

if __name__ == "__main__":
    if not sys.flags.safe_path and Path(sys.path[0]).resolve() != Path(__file__).resolve().parents[1]:
        del sys.path[0]
    from stoop.cli.main import main

    sys.exit(main())
