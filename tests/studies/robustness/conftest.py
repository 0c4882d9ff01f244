"""The campaign limits processes, fills disks and kills children as POSIX systems do: elsewhere nothing of it is collected."""

from __future__ import annotations

import sys

collect_ignore_glob = ["test_*.py"] if sys.platform == "win32" else []
