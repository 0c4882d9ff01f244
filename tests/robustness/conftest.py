"""The campaign limits processes and kills children as POSIX systems do: elsewhere nothing of it is collected."""

import sys

from hypothesis import settings

collect_ignore_glob = ["test_*.py"] if sys.platform == "win32" else []
settings.register_profile("campaign", settings.get_profile("stoop"), derandomize=False, max_examples=10_000)
