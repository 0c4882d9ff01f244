"""How often the 95 % bands of frequency responses, and the intervals of equivalent systems, hold the truth.

A short period is excited by one input, or by two that move together, in several maneuvers; noise, white or of low frequency,
stands for gusts and sensors. The truth is the response of the sampled system itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy import signal

from stoop.assessment.covariance import NORMAL_95
from stoop.base.arrays import ComplexArray, FloatArray
from stoop.flight.frequency_responses import FrequencyResponse, Stretch
from stoop_analysis.handling import Known, equivalent_system
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import study

RATE: Final = 50.0  #: Hz
FREQUENCY, DAMPING, ZERO, GAIN = 5.0, 0.5, 1.5, 20.0  #: of the short period: rad/s, 1, 1/s, 1/s2
LAG: Final = 0.2  #: s, of the response to the second input
EXCITATION: Final = 4.0  #: Hz, to which the inputs reach
MIN_COHERENCE: Final = 0.6
SYSTEM_BAND: Final = 20.0  #: rad/s, of the equivalent systems: above it a sampled system is no continuous one
POLE: Final = 0.9  #: of noise of low frequency, from sample to sample
Coefficients = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class Case:
    """What is flown: maneuvers, s, of one input or two with this correlation, beside noise of this size and color."""

    words: str
    maneuvers: tuple[float, ...]
    noise: float  #: standard deviation, of that of the response
    correlation: float | None = None
    colored: bool = False


CASES: Final = {
    "one": Case("one input, 90 s, white noise", (90.0,), 0.1),
    "maneuvers": Case("one input, 4 maneuvers of 20 s, white noise", (20.0,) * 4, 0.1),
    "colored": Case("one input, 90 s, noise of low frequency", (90.0,), 0.2, colored=True),
    "together": Case("two inputs with correlation 0.7, 90 s, white noise", (90.0,), 0.1, 0.7),
    "together-colored": Case(
        "two inputs with correlation 0.7, 2 maneuvers of 60 s, noise of low frequency",
        (60.0,) * 2,
        0.1,
        0.7,
        True,
    ),
}
POOLED: Final = (0.93, 0.97)
MIN_SYSTEMS: Final = 0.90


def systems() -> list[Coefficients]:
    """Return the sampled systems from each input to the output: numerator and denominator."""
    short_period = ([GAIN, GAIN * ZERO], [1.0, 2.0 * DAMPING * FREQUENCY, FREQUENCY**2])
    lag = ([1.0], [LAG, 1.0])
    found = []
    for top, bottom in (short_period, lag):
        b, a, _ = signal.cont2discrete((np.array(top), np.array(bottom)), 1.0 / RATE, "zoh")
        found.append((np.ravel(b), np.ravel(a)))
    return found


def fly(case: Case, rng: np.random.Generator) -> list[Stretch]:
    """Return the maneuvers of one flight."""
    shape = signal.butter(2, EXCITATION, fs=RATE, output="sos")
    out = []
    for seconds in case.maneuvers:
        n = round(seconds * RATE)
        u = signal.sosfilt(shape, rng.standard_normal((n, 1 if case.correlation is None else 2)), axis=0)
        if case.correlation is not None:
            rho = case.correlation
            u[:, 1] = rho * u[:, 0] + np.sqrt(1.0 - rho**2) * u[:, 1]
        y = sum(signal.lfilter(*both, column) for both, column in zip(systems(), u.T, strict=False))
        noise = rng.standard_normal(n)
        if case.colored:
            noise = signal.lfilter([np.sqrt(1.0 - POLE**2)], [1.0, -POLE], noise)
        out.append(Stretch(RATE, u, (y + case.noise * np.std(y) * noise)[:, None]))
    return out


def truth(one: FrequencyResponse) -> ComplexArray:
    """Return the true response to the input of this name."""
    b, a = systems()[int(one.input)]
    return np.asarray(signal.freqz(b, a, one.frequency / RATE)[1])


@study.work
def estimate(case: str, seed: int) -> dict[str, Any]:
    """Estimate the responses of one flight and count what their bands hold."""
    flown = fly(CASES[case], np.random.default_rng(seed))
    names = [str(i) for i in range(flown[0].inputs.shape[1])]
    found = FrequencyResponse.estimate(flown, names, ["q"])
    points = magnitude = phase = 0
    errors: list[float] = []
    for one in found:
        good, exact = one.coherence >= MIN_COHERENCE, truth(one)
        points += int(good.sum())
        magnitude += int(_holds(one, exact)[good].sum())
        angle = np.arcsin(np.minimum(one.bound, 1.0))
        phase += int((np.abs(np.angle(one.response / exact)) <= angle)[good].sum())
        errors += one.bound[good].tolist()
    alone = FrequencyResponse.estimate(
        [Stretch(RATE, s.inputs[:, :1], s.outputs) for s in flown], ["0"], ["q"]
    )[0]
    good = alone.coherence >= MIN_COHERENCE
    return {
        "points": points, "magnitude": magnitude, "phase": phase, "error": float(np.median(errors)),
        "alone": int(_holds(alone, truth(alone))[good].sum()), "alone_points": int(good.sum()), **_system(found[0]),
    }  # fmt: skip


def _holds(one: FrequencyResponse, exact: ComplexArray) -> Any:
    return np.abs(np.abs(one.response) - np.abs(exact)) <= one.bound * np.abs(one.response)


def _system(one: FrequencyResponse) -> dict[str, bool | None]:
    """Return whether the intervals of the equivalent system hold natural frequency and damping; None without an interval."""
    good = (one.coherence >= MIN_COHERENCE) & (one.frequency < SYSTEM_BAND)
    known = Known(
        one.frequency[good], one.response[good], one.coherence[good], np.zeros((0, int(good.sum())), dtype=complex),
        one.bound[good] / NORMAL_95, one.window[good],
    )  # fmt: skip
    system = equivalent_system(known, one.input, "q")
    out: dict[str, bool | None] = {"frequency": None, "damping": None}
    for name, exact in (("frequency", FREQUENCY), ("damping", DAMPING)) if system else ():
        value = system.parameters[name] if system else None
        if value is not None and np.isfinite(value.ci95_lower):
            out[name] = bool(value.ci95_lower <= exact <= value.ci95_upper)
    return out


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return how often the bands hold, by what is flown."""
    records = [_record(case, samples[case]) for case in CASES]
    weights = [r["points"] for r in records]
    pooled = {n: float(np.average([r[n] for r in records], weights=weights)) for n in ("magnitude", "phase")}
    both = float(np.mean(list(pooled.values())))
    intervals = [float(np.mean([r[n] for r in records])) for n in ("frequency", "damping")]
    together = [r for r in records if CASES[r["case"]].correlation is not None]
    claims: list[Claim] = [
        holds(
            "95 % bands of magnitude and phase hold the truth in 93 to 97 % at a coherence of 0.6 and more",
            POOLED[0] <= both <= POOLED[1],
            f"{100 * both:.1f} % of all; magnitude {100 * pooled['magnitude']:.1f} %, phase {100 * pooled['phase']:.1f} %; "
            f"{100 * min(min(r['magnitude'], r['phase']) for r in records):.1f} to "
            f"{100 * max(max(r['magnitude'], r['phase']) for r in records):.1f} % by what is flown",
        ),
        holds(
            "Where inputs move together, the conditioned responses hold the truth and those to one input alone do not",
            all(r["magnitude"] >= POOLED[0] and r["unconditioned"] < 0.5 for r in together),
            "; ".join(
                f"{100 * r['magnitude']:.1f} % against {100 * r['unconditioned']:.1f} %" for r in together
            ),
        ),
        holds(
            "Intervals of natural frequency and damping of the equivalent system hold the truth in 90 % and more",
            all(x >= MIN_SYSTEMS for x in intervals),
            f"{100 * intervals[0]:.1f} % and {100 * intervals[1]:.1f} %",
        ),
    ]
    return Findings.of("Bands of frequency responses", claims, records)


def _record(case: str, results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    total = {n: sum(r[n] for r in results) for n in ("points", "magnitude", "phase", "alone", "alone_points")}

    def share(name: str) -> float:
        given = [r[name] for r in results if r[name] is not None]
        return float(np.mean(given)) if given else float("nan")

    return {
        "case": case, "flown": CASES[case].words, "flights": len(results), "points": total["points"],
        "magnitude": total["magnitude"] / total["points"], "phase": total["phase"] / total["points"],
        "error": float(np.median([r["error"] for r in results])),
        "unconditioned": total["alone"] / max(total["alone_points"], 1),
        "frequency": share("frequency"), "damping": share("damping"),
    }  # fmt: skip


EXPERIMENT: Final = study.Verification("frequency", show, runs=200, work="estimate", cases=tuple(CASES))
