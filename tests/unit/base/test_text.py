"""Advice on a name that is not known."""

from __future__ import annotations

from stoop.base.text import MOST_LISTED, nearest

FEW, MANY = ("Clp", "Clr", "Cmq"), (*(f"name{i}" for i in range(MOST_LISTED)), "rotors.lag", "Clp")


def test_a_name_that_resembles_others_names_them() -> None:
    assert nearest("CLP", FEW).startswith("did you mean Clp"), "case does not count"
    assert nearest("CLPP", FEW).startswith("did you mean Clp")


def test_of_few_names_all_are_listed_and_of_many_the_nearest() -> None:
    assert nearest("x", FEW) == "choose from Clp, Clr, Cmq"
    assert nearest("motors_log", MANY, 0.99).startswith(f"the nearest of {len(MANY)} names are rotors.lag, ")
    assert nearest("x", ()) == "choose from none"
