"""Advice on a name that is not known."""

from __future__ import annotations

from stoop.base.text import MOST_LISTED, nearest

FEW, MANY = ("Clp", "Clr", "Cmq"), (*(f"name{i}" for i in range(MOST_LISTED)), "rotors.lag", "Clp")


def test_few_names_are_listed_and_of_many_those_that_resemble_it() -> None:
    for name in ("CLP", "CLPP"):
        assert nearest(name, FEW).startswith("did you mean Clp"), "case does not count"
    assert nearest("x", FEW) == "choose from Clp, Clr, Cmq"
    assert nearest("motors_log", MANY, 0.99).startswith(f"the nearest of {len(MANY)} names are rotors.lag, ")
    assert nearest("x", ()) == "choose from none"
