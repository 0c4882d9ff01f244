"""Verbs of the studies, for the entry point group ``stoop.verbs``; importing this loads none of them."""

from __future__ import annotations

from typing import Final

VERBS: Final[dict[str, tuple[str, str]]] = {
    "reproduce": ("stoop_studies.cli.reproduce", "run the PS-GDE paper's experiments and say what holds"),
    "verify": (
        "stoop_studies.cli.verify",
        "measure what stoop claims of its own accuracy, and say what holds",
    ),
    "compare": (
        "stoop_studies.cli.compare",
        "optimizers on the same problems, counted the same way: who is ahead",
    ),
}  #: verb -> its module, one line of help
