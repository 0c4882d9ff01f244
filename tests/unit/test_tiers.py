"""The tiers: which line decides, which files are left out, and what breaks the rule of the standard tier."""

from __future__ import annotations

import pytest
import tier_rule
import tiers

WORDS = {
    "tests/a.py::test_x": "full",
    "tests/a.py::test_x[2]": "guard",
    "tests/b.py": "full",
    "tests/c.py": "studies",
    "tests/c.py::test_y": "standard",
}


@pytest.mark.parametrize(
    ("test", "tier"),
    [
        ("tests/a.py::test_x", "full"),
        ("tests/a.py::test_x[1]", "full"),
        ("tests/a.py::test_x[2]", "standard"),
        ("tests/a.py::test_y", "standard"),
        ("tests/b.py::test_x[1]", "full"),
        ("tests/c.py::test_y", "standard"),
    ],
)
def test_the_most_specific_line_decides(test: str, tier: str) -> None:
    assert tiers.tier_of(test, WORDS) == tier


def test_files_without_a_test_of_the_tier_are_left_out() -> None:
    out = {tier: [f for f in "abc" if tiers.left_out(f"tests/{f}.py", tier, WORDS)] for tier in tiers.TIERS}
    assert out == {"standard": ["b"], "full": ["c"], "studies": ["b"]}
    assert not any(tiers.left_out(f"tests/{f}.py", "all", WORDS) for f in "abc")


def test_stale_entries_are_named() -> None:
    here = "tests/unit/test_tiers.py"
    words = dict.fromkeys(
        (f"{here}::test_gone", f"{here}::test_x[1]", f"{here}::test_x", "tests/z.py"), "full"
    )
    gone = [f"{here}::test_gone", f"{here}::test_x[1]", "tests/z.py"]
    assert tiers.stale(words, [f"{here}::test_x[2]"]) == gone


def test_the_rule_names_slow_tests_but_neither_guards_nor_cold_ones() -> None:
    own = {
        "tests/a.py::test_x[2]": 9.0,
        "tests/a.py::test_y": 0.71,
        "tests/a.py::test_z": 0.69,
        "tests/d.py::test_w": 3.0,
    }
    lines = list(tier_rule.broken(own, {"tests/d.py::test_w"}, WORDS))
    assert [line.partition(" ")[0] for line in lines] == ["tests/a.py::test_y"]
    many = WORDS | {f"tests/{i}.py::test_x": "guard" for i in range(tiers.GUARDS)}
    assert any("41 guards" in line for line in tier_rule.broken({}, set(), many))


def test_the_words_of_the_list_are_known() -> None:
    assert set(tiers.listed().values()) <= set(tiers.WORDS)
