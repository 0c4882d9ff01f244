"""Verbs of the studies, for the entry point group ``stoop.verbs``; importing this loads none of them."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from typing import Final

from stoop.base.verbs import read_verbs

VERBS: Final = read_verbs(tomllib.loads((files("stoop_studies.cli") / "verbs.toml").read_text("utf-8")))
