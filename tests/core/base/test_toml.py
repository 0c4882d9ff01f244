"""Keys of many parts, which Python's parser reads for minutes, told from dots in texts; advice on unknown names."""

import pytest

from stoop.base.text import MOST_LISTED, nearest
from stoop.base.toml import MAX_DEPTH, parse_json, parse_source
from stoop.errors import StoopError

KEY = ".".join("c" * (MAX_DEPTH + 2))


def test_a_key_of_many_parts_is_refused_and_dots_in_texts_are_none() -> None:
    for text in (
        f"{KEY} = 1", f"[{KEY}]", f"a = {{{KEY} = 1}}", f'a = {{b = """x"""", {KEY} = 1, e = ""}}',
        f"a = {{b = '''x'''', {KEY} = 1, e = ''}}", f'a = "#"\n{KEY} = 1',
    ):  # fmt: skip
        with pytest.raises(StoopError, match="parts"):
            parse_source(text, "a.toml", StoopError)
    dots = "." * (MAX_DEPTH + 20)
    for quote in ('"', "'", '"""', "'''"):
        found = parse_source(f"a = [{quote}x{quote}, {quote}{dots}{quote}] # {dots}", "a", StoopError)
        assert found["a"][1] == dots
        if len(quote) == 3:
            ends = f"a = [{quote}x{quote}{quote[:2]}, {quote}{dots}{quote}]"
            assert parse_source(ends, "a", StoopError)["a"] == [f"x{quote[:2]}", dots]


def test_integers_beyond_floats_are_refused() -> None:
    assert parse_json("[1e400, 12]")[1] == 12
    with pytest.raises(ValueError, match="308 digits"):
        parse_json("[" + "1" * 400 + "]")


FEW, MANY = ("Clp", "Clr", "Cmq"), (*(f"name{i}" for i in range(MOST_LISTED)), "rotors.lag", "Clp")


def test_few_names_are_listed_and_of_many_those_that_resemble_it() -> None:
    for name in ("CLP", "CLPP"):
        assert nearest(name, FEW).startswith("did you mean Clp"), "case does not count"
    assert nearest("x", FEW) == "choose from Clp, Clr, Cmq"
    assert nearest("motors_log", MANY, 0.99).startswith(f"the nearest of {len(MANY)} names are rotors.lag, ")
    assert nearest("x", ()) == "choose from none"
