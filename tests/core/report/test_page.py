"""The page: complete, self-contained, and deaf to hostile text."""

import base64
import hashlib
import re
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from core.report.conftest import fewer
from naive.identification import HOSTILE, NAMES, Shown, example

from stoop.assessment.covariance import NORMAL_95
from stoop.report.charts import autocorrelation_panels, correlation_map
from stoop.report.estimates import estimates_section, method_figures
from stoop.report.identification import render
from stoop.results.result import ChannelTrace, ManeuverTrace, ParameterEstimate
from stoop.results.uncertainty import MethodIntervals

VOID = {"meta", "line", "rect", "circle", "path", "br", "hr", "img", "link", "input", "mspace"}


class Page(HTMLParser):
    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.words: list[str] = []
        self.raw: list[tuple[str, str]] = []  # text of scripts and styles
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
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
        return [text for name, text in self.raw if name == tag]

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def html(whole: Any) -> str:
    return render(whole)


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def test_it_needs_nothing_from_outside_and_links_lead_somewhere(page: Page) -> None:
    assert not {"link", "img", "iframe", "object", "embed"} & set(page.tags)
    for _, name, value in page.attributes:
        if name in ("href", "src", "xlink:href", "action", "data"):
            assert value.startswith("#")
    assert not re.search(r"url\(|@import", " ".join(page.of("style")))
    places = {value for _, name, value in page.attributes if name == "id"}
    assert {value[1:] for tag, name, value in page.attributes if tag == "a" and name == "href"} <= places


def test_nothing_runs_even_if_it_got_in(page: Page) -> None:
    (policy,) = (v for tag, name, v in page.attributes if (tag, name) == ("meta", "content") and "-src" in v)
    digests = (hashlib.sha256(text.encode()).digest() for text in page.of("script")[-3:])
    allowed = policy.partition("script-src")[2].split()
    assert allowed == [f"'sha256-{base64.b64encode(one).decode()}'" for one in digests]
    assert "default-src 'none'" in policy
    assert "unsafe-eval" not in policy


def test_hostile_text_stays_text(page: Page) -> None:
    hostile = Page(render(fewer(example(("CL0", "CLalpha", "Clp" + HOSTILE), HOSTILE))))
    assert hostile.tags.count("script") == page.tags.count("script")
    assert hostile.of("script")[-2:] == page.of("script")[-2:]
    assert not any("<" in data for data in hostile.of("script")[:-3])
    assert not [name for _, name, _ in hostile.attributes if name.startswith("on")]
    assert hostile.text.count("<script>") >= 8


def test_what_a_reader_looks_for_is_there(html: str, page: Page, whole: Any) -> None:
    titles = {value for _, key, value in page.attributes if key == "title"}
    assert all(name in page.text or name in titles for name in NAMES)
    for phrase in (
        "Usable for what was fitted, with reservations", "Residuals are colored", "flight2, 140–145 s",
        "Prediction: no parameter was fitted here", "not identifiable", "at its bound", "142.47:142.75", "wind_n",
        "V and alpha are reconstructed from inertial velocity", "The pitot reads 5.4 m/s too little",
        "sha256 9f9f", "numpy 2.4.6", "stoop identify flight2", "Uncertainty, by method", "block bootstrap",
        "greatest R-hat", "What would make it identifiable", "Fly more.", "The sensitivities to all unknowns have",
    ):  # fmt: skip
        assert phrase in page.text, phrase
    flat = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html))
    for row in (
        "mass.mass 8.500 kg vehicle file", "mass.inertia.yy 1.18 ± 0.20 kg m² vehicle file",
        "alpha′ −8.26 ± 0.97 0.934 0", "q′ −42 ± 20 −5.500 ± – −98 ± 31",
    ):  # fmt: skip
        assert row in flat
    assert html.count('aria-label="CL0: corrected from') == 1
    assert "interval method-profile open" in html or "interval method-other open" in html
    assert page.tags.count("math") >= 3
    assert page.tags.count("th") > page.tags.count("table")
    drawings = [n for tag, n, _ in page.attributes if tag == "svg" and n in ("aria-label", "aria-hidden")]
    assert len(drawings) == page.tags.count("svg")
    assert drawings.count("aria-label") >= 8
    assert html == render(whole), "the same bytes again"


def test_nothing_to_show_and_what_a_result_does_not_say(whole: Any) -> None:
    result = whole.result
    empty = replace(
        result, parameters={}, covariance=type(result.covariance)((), np.empty((0, 0))), initial_states=(), biases=(),
        noise_covariance=type(result.noise_covariance)((), np.empty((0, 0))), wind=(), maneuvers=(), notices=(),
        versions={}, inputs={}, uncertainty={},
    )  # fmt: skip
    page = Page(render(Shown(result=empty, traces=(), vehicle=SimpleNamespace(name="nothing"))))
    assert "0 parameters" in page.text
    assert "script" not in page.tags
    assert "contains no scripts" in page.text
    assert "Uncertainty, by method" not in page.text
    less = replace(result, identifiability=replace(result.identifiability, singular_values=()))
    html = render(replace(whole, result=less))
    assert "The sensitivities to all unknowns have" not in html
    assert "With a multiple correlation of nearly 1" in html


@pytest.mark.parametrize("fault", [np.nan, np.inf, 1e300, -1e17])
def test_a_diverged_simulation_is_still_a_page(fault: float) -> None:
    shown = fewer(example(("CL0", "CLalpha")))
    trace, late = shown.traces[0], np.arange(shown.traces[0].time.size) > 50
    old = trace.channels.items()
    channels = {n: ChannelTrace(c.measured, np.where(late, fault, c.simulated)) for n, c in old}
    channels["q"] = ChannelTrace(*2 * [np.full(late.size, np.nan)])
    one = ChannelTrace(np.array([0.1]), np.array([0.1]))
    short = ManeuverTrace(np.array([140.0]), {"p": one}, {"elevator": np.array([0.0])})
    page = Page(render(replace(shown, traces=(ManeuverTrace(trace.time, channels, trace.inputs), short))))
    assert not re.search(r"\b(nan|inf)\b", " ".join(page.words))
    assert not re.search(r"\b(NaN|Infinity)\b", " ".join(page.of("script")[:-3]))


def test_counts_are_whole_numbers() -> None:
    one = MethodIntervals({}, {"replicates": 26.0, "failed": 0.0, "rhat": 1.0042})
    assert method_figures(one) == "replicates 26; of them without an optimum 0; greatest R-hat 1.00"


def test_correlations_are_colored_by_their_sign() -> None:
    drawn = correlation_map("abc", np.array([[1.0, 0.9, np.nan], [0.9, 1.0, -0.5], [np.nan, -0.5, 1.0]]))
    cells = re.findall(r'class="(above|below|hole)"[^>]*fill-opacity="([\d.]+)"', drawn)
    assert cells == [("above", "0.81"), ("hole", "1"), ("below", "0.25")]


def test_the_band_of_an_autocorrelation_holds_95_percent_of_white_residuals() -> None:
    """On an axis from -0.6 to 1.05 of 90 px."""
    for samples in (100, 400):
        drawn = autocorrelation_panels({"q": (np.ones(5), 0.1, samples)})["q"]
        (band,) = re.findall(r'd="([^"]*)"[^>]*var\(--band-fit\)', drawn)
        heights = [float(y) for y in re.findall(r"[ML] ?-?[\d.]+ (-?[\d.]+)", band)]
        expected = 2.0 * NORMAL_95 / np.sqrt(samples) / 1.65 * 90.0
        assert max(heights) - min(heights) == pytest.approx(expected, abs=0.3)


def test_an_interval_that_is_not_given_is_drawn_as_wide_as_it_would_be(whole: Any) -> None:
    ends = {"ci95_lower": 2.0 - 0.5 * NORMAL_95, "ci95_upper": 2.0 + 0.5 * NORMAL_95}
    sure = ParameterEstimate(2.0, 0.5, **ends)
    drawn = []
    for one in (sure, replace(sure, identifiable=False)):
        result = replace(whole.result, parameters={"CL0": one})
        table = estimates_section(replace(whole, result=result)).parts[-1]
        drawn.append(str(table.rows[0][4]).replace("unsure", "sure"))
    assert drawn[0] == drawn[1]
