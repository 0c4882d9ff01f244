"""The page: complete, self-contained, and deaf to hostile text."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import re
from html.parser import HTMLParser
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stoop.report.estimates import method_figures
from stoop.report.identification import render
from stoop.results.result import ChannelTrace, ManeuverTrace
from stoop.results.uncertainty import MethodIntervals

VOID = {"meta", "line", "rect", "circle", "path", "br", "hr", "img", "link", "input", "mspace"}


class Page(HTMLParser):
    """Collects elements, attributes and text, and checks that what opens is closed."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.words: list[str] = []
        self.raw: list[tuple[str, str]] = []  # text of scripts and styles
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)
        if tag in ("script", "style"):
            self.raw.append((tag, ""))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("script", "style"):
            self.raw[-1] = (self.raw[-1][0], self.raw[-1][1] + data)
        else:
            self.words.append(data)

    def of(self, tag: str) -> list[str]:
        """Return the contents of all scripts, or of all styles."""
        return [text for name, text in self.raw if name == tag]

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def page(examples: ModuleType) -> Page:
    return Page(render(examples.example()))


@pytest.fixture(scope="module")
def hostile(examples: ModuleType) -> Page:
    names = ("CL0", "CLalpha", "Clp" + examples.HOSTILE)
    return Page(render(examples.example(names, examples.HOSTILE)))


def test_everything_that_opens_is_closed(page: Page, hostile: Page) -> None:
    assert page.open == []
    assert hostile.open == []


def test_it_needs_nothing_from_outside(page: Page) -> None:
    assert not {"link", "img", "iframe", "object", "embed"} & set(page.tags)
    for _, name, value in page.attributes:
        if name in ("href", "src", "xlink:href", "action", "data"):
            assert value.startswith("#")
    css = " ".join(page.of("style"))
    assert "url(" not in css
    assert "@import" not in css


def test_links_lead_somewhere(page: Page) -> None:
    places = {value for _, name, value in page.attributes if name == "id"}
    assert {value[1:] for tag, name, value in page.attributes if tag == "a" and name == "href"} <= places


def test_hostile_text_stays_text(page: Page, hostile: Page) -> None:
    assert hostile.tags.count("script") == page.tags.count("script")
    assert hostile.of("script")[-2:] == page.of("script")[-2:]
    assert not any("<" in data for data in hostile.of("script")[:-3])
    assert not [name for _, name, _ in hostile.attributes if name.startswith("on")]
    assert hostile.text.count("<script>") >= 8


def test_nothing_runs_even_if_it_got_in(page: Page) -> None:
    (policy,) = [
        v for tag, name, v in page.attributes if tag == "meta" and name == "content" and "default-src" in v
    ]
    allowed = policy.partition("script-src")[2].split()
    runs = page.of("script")[-3:]
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in runs]
    assert allowed == [f"'sha256-{digest}'" for digest in digests]
    assert "default-src 'none'" in policy
    assert "unsafe-eval" not in policy


def test_without_histories_nothing_runs(examples: ModuleType) -> None:
    page = Page(render(bare(examples)))
    assert "script" not in page.tags
    assert "contains no scripts" in page.text


def test_what_a_reader_looks_for_is_there(page: Page, examples: ModuleType) -> None:
    for name in examples.NAMES:
        assert name in page.text or any(value == name for _, key, value in page.attributes if key == "title")
    for phrase in (
        "Usable for what was fitted, with reservations",
        "Residuals are colored",
        "flight2, 140–145 s",
        "Prediction: no parameter was fitted here",
        "not identifiable",
        "at its bound",
        "V and alpha are reconstructed from inertial velocity",
        "142.47:142.75",
        "The pitot reads 5.4 m/s too little",
        "wind_n",
        "sha256 9f9f",
        "numpy 2.4.6",
        "stoop identify flight2",
        "✓ better",
    ):
        assert phrase in page.text, phrase
    assert page.tags.count("math") >= 3


def test_drawings_are_described_and_tables_have_heads(page: Page) -> None:
    drawings = page.tags.count("svg")
    described = sum(1 for tag, name, _ in page.attributes if tag == "svg" and name == "aria-label")
    hidden = sum(1 for tag, name, _ in page.attributes if tag == "svg" and name == "aria-hidden")
    assert described + hidden == drawings
    assert described >= 4 * 12 + len("three for the rest")
    assert page.tags.count("th") > page.tags.count("table")


def test_the_same_result_gives_the_same_bytes_and_not_too_many(examples: ModuleType) -> None:
    html = render(examples.example())
    assert html == render(examples.example())
    assert len(html) < 4_000_000


def bare(examples: ModuleType) -> Any:
    whole = examples.example()
    empty = dataclasses.replace(
        whole.result,
        parameters={},
        covariance=type(whole.result.covariance)((), np.empty((0, 0))),
        noise_covariance=type(whole.result.noise_covariance)((), np.empty((0, 0))),
        initial_states=(),
        biases=(),
        wind=(),
        maneuvers=(),
        notices=(),
        versions={},
        inputs={},
    )
    return examples.Shown(result=empty, traces=(), vehicle=SimpleNamespace(name="nothing"))


def test_nothing_to_show(examples: ModuleType) -> None:
    page = Page(render(bare(examples)))
    assert page.open == []
    assert "0 parameters" in page.text


@pytest.mark.parametrize("fault", [np.nan, np.inf, 1e300, -1e17])
def test_a_diverged_simulation_is_still_a_page(examples: ModuleType, fault: float) -> None:
    whole = examples.example(("CL0", "CLalpha"))
    trace = whole.traces[0]
    channels = {
        name: ChannelTrace(one.measured, np.where(np.arange(one.measured.size) > 50, fault, one.simulated))
        for name, one in trace.channels.items()
    }
    channels["q"] = ChannelTrace(np.full(trace.time.size, np.nan), np.full(trace.time.size, np.nan))
    worse = dataclasses.replace(
        whole, traces=(ManeuverTrace(trace.time, channels, trace.inputs), *whole.traces[1:])
    )
    html = render(worse)
    assert Page(html).open == []
    page = Page(html)
    assert not re.search(r"\b(nan|inf)\b", " ".join(page.words))
    assert not re.search(r"\b(NaN|Infinity)\b", " ".join(page.of("script")[:-3]))


def test_one_sample_maneuver(examples: ModuleType) -> None:
    whole = examples.example(("CL0",))
    one = ManeuverTrace(
        np.array([140.0]),
        {"p": ChannelTrace(np.array([0.1]), np.array([0.1]))},
        {"elevator": np.array([0.0])},
    )
    page = Page(render(dataclasses.replace(whole, traces=(one, *whole.traces[1:]))))
    assert page.open == []


def test_mass_and_the_linear_model_stand_there_with_their_errors(examples: ModuleType) -> None:
    text = re.sub(r"<[^>]+>", " ", render(examples.example()))
    text = re.sub(r"\s+", " ", text)
    assert "mass.mass 8.500 kg vehicle file" in text
    assert "mass.inertia.yy 1.18 ± 0.20 kg m² vehicle file" in text
    assert "alpha′ −8.26 ± 0.97 0.934 0" in text
    assert "q′ −42 ± 20 −5.500 ± – −98 ± 31" in text


def test_uncertainty_stands_side_by_side(examples: ModuleType) -> None:
    page = render(examples.example())
    for words in (
        "Uncertainty, by method",
        "block bootstrap",
        "greatest R-hat",
        "What would make it identifiable",
        "Fly more.",
    ):
        assert words in page
    assert page.count('aria-label="CL0: corrected from') == 1
    assert "interval method-profile open" in page or "interval method-other open" in page


def test_counts_are_whole_numbers() -> None:
    one = MethodIntervals({}, {"replicates": 26.0, "failed": 0.0, "rhat": 1.0042})
    assert method_figures(one) == "replicates 26; of them without an optimum 0; greatest R-hat 1.00"


def test_a_result_that_does_not_say_has_no_section_on_uncertainty(examples: ModuleType) -> None:
    one = examples.example()
    bare = dataclasses.replace(one.result, uncertainty={})
    page = render(dataclasses.replace(one, result=bare))
    assert "Uncertainty, by method" not in page


def test_what_is_not_known_of_the_sensitivities_leaves_no_hole_in_a_sentence(examples: ModuleType) -> None:
    full = examples.example()
    seen = dataclasses.replace(full.result.identifiability, singular_values=())
    without = dataclasses.replace(full, result=dataclasses.replace(full.result, identifiability=seen))
    words = "The sensitivities to all unknowns have"
    assert f"{words} " in render(full)
    assert words not in render(without)
    assert "With a multiple correlation of nearly 1" in render(without)
