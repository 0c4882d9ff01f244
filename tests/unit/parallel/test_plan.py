"""Runs that differ in their stop only are one task."""

from __future__ import annotations

import pytest

from stoop.parallel import CampaignError, Plan, Run
from stoop.parallel.plan import tasks


def test_stops_of_one_prefix_are_one_task_the_earliest_first() -> None:
    runs = [
        Run(f"{seed}/{stop}", "m:f", {"seed": seed}, stop) for stop in (None, 2000, 500) for seed in (1, 2)
    ]
    first, second = tasks([*runs, Run("other", "m:g", {"seed": 1}, 500)])[:2]
    assert (first.text, first.stops) == ('{"seed":1}', [500, 2000, None])
    assert [run.key for run in second.runs] == ["2/500", "2/2000", "2/None"]
    assert len(tasks([*runs, Run("other", "m:g", {"seed": 1}, 500)])) == 3


def test_order_of_arguments_does_not_matter() -> None:
    a, b = Run("a", "m:f", {"x": 1, "y": 2}), Run("b", "m:f", {"y": 2, "x": 1})
    assert a.identity == b.identity
    assert a.identity != Run("a", "m:f", {"x": 1, "y": 2}, 5).identity
    assert a.identity != Run("a", "m:f", {"x": 1.0, "y": 2}).identity


def test_places_of_inputs_are_arguments_and_no_part_of_the_identity() -> None:
    a, b = (Run("a", "m:f", {"content": 1}, places={"log": place}) for place in ("x", "y"))
    assert a.text == '{"content":1,"log":"x"}'
    assert a.identity == b.identity == Run("a", "m:f", {"content": 1}).identity


@pytest.mark.parametrize(
    ("name", "keys", "what"),
    [("p", "aba", "two runs have the key a"), ("p", ["", "b"], "cannot be"), ("p", ["a\n"], "cannot"), ("", "a", "name")],
)  # fmt: skip
def test_keys_are_unique_and_printable(name: str, keys: list[str], what: str) -> None:
    with pytest.raises(CampaignError, match=what):
        Plan(name, {}, tuple(Run(key, "m:f", {"i": i}) for i, key in enumerate(keys)))
