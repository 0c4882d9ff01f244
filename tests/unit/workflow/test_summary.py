"""What the terminal says of a result."""

from __future__ import annotations

from stoop.base.notices import as_notice
from stoop.results.uncertainty import ParameterIdentifiability
from stoop.workflow.summary import advice_by_doubt


def sight(doubt: str, advice: str) -> ParameterIdentifiability:
    why, what = (as_notice(text, "info") if text else None for text in (doubt, advice))
    return ParameterIdentifiability(1.0, 1.0, 0.5, (), why, () if what is None else (what,))


def test_doubts_stand_under_one_phrase_and_those_of_one_advice_in_one_line() -> None:
    seen = {
        "Cl0": sight("combined", "bank more"),
        "CL0": sight("at its bound", "pull up"),
        "Cn0": sight("combined", "bank more"),
        "CD0": sight("combined", "fly faster"),
        "CLq": sight("", ""),
        "Cmq": sight("no advice", ""),
    }
    assert advice_by_doubt(seen) == {
        "combined": ["Cl0, Cn0: bank more", "CD0: fly faster"],
        "at its bound": ["CL0: pull up"],
    }


def test_without_doubts_nothing_is_said() -> None:
    assert advice_by_doubt({"CLq": sight("", "")}) == {}
