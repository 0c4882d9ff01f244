"""A made-up identification with everything a report can show, and hostile text wherever text comes from files."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.goodness_of_fit import Match, channel_figures, join
from stoop.base.notices import as_notice, notice
from stoop.results.modes import ConditionModes, StateEquations
from stoop.results.result import (
    AirDataTrace,
    ChannelTrace,
    Covariance,
    InitialState,
    ManeuverResult,
    ManeuverTrace,
    NoiseCovariance,
    ParameterEstimate,
    Quantity,
    Result,
    Role,
    SensorBiases,
    WindEstimate,
)
from stoop.results.uncertainty import (
    CorrelatedPair,
    IdentifiabilityAnalysis,
    Interval,
    MethodIntervals,
    NearNullDirection,
    ParameterIdentifiability,
)

HOSTILE = '<script>alert("x")</script>'
UNITS = {
    "V": "m/s", "alpha": "rad", "beta": "rad", "p": "rad/s", "q": "rad/s", "r": "rad/s",
    "phi": "rad", "theta": "rad", "psi": "rad", "ax": "m/s2", "ay": "m/s2", "az": "m/s2",
    "elevator": "rad", "aileron": "rad", "rudder": "rad", "throttle": "1", "airspeed_pitot": "m/s",
}  # fmt: skip
CHANNELS = tuple(UNITS)[:12]
INPUTS = ("elevator", "aileron", "rudder", "throttle")
SIZE = {"V": 1.0, "ax": 1.0, "ay": 2.0, "az": 4.0}
EQUATIONS = (
    r"C_L = C_{L_0} + C_{L_V} \frac{V - V^\ast}{V^\ast} + C_{L_\alpha} (\alpha - \alpha^\ast) "
    r"+ C_{L_q} \frac{q \bar{c}}{2 V} + C_{L_{\delta_e}} \delta_e",
    r"C_m = C_{m_0} + C_{m_\alpha} (\alpha - \alpha^\ast) + C_{m_q} \frac{q \bar{c}}{2 V} + C_{m_{\delta_e}} \delta_e",
    r"C_l = C_{l_0} + C_{l_\beta} \beta + C_{l_p} \frac{p b}{2 V} + C_{l_r} \frac{r b}{2 V} "
    r"+ C_{l_{\delta_a}} \delta_a + C_{l_{\delta_r}} \delta_r",
)
NAMES = (
    *("CL0", "CLV", "CLalpha", "CLq", "CLelevator", "CD0", "CDV", "CDalpha", "CDq", "CDelevator"),
    *("Cm0", "Cmalpha", "Cmq", "Cmelevator", "CQ0", "CQbeta", "CQp", "CQr", "CQrudder"),
    *("Cl0", "Clbeta", "Clp", "Clr", "Claileron", "Clrudder", "Cn0", "Cnbeta", "Cnp", "Cnr"),
    *("Cnaileron", "Cnrudder"),
)


def wave(time: np.ndarray, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.asarray(
        sum(
            random.normal() / k * np.sin(2 * np.pi * k * 0.35 * (time - time[0]) + random.uniform(0, 6))
            for k in range(1, 6)
        )
    )


def maneuver(
    start: float, stop: float, role: Role, seed: int, error: float, cut: bool
) -> tuple[ManeuverResult, ManeuverTrace]:
    random = np.random.default_rng(seed)
    middle = (start + stop) / 2
    spans = [(start, middle), (middle + 0.4, stop)] if cut else [(start, stop)]
    times = [np.arange(round(100 * a), round(100 * b) + 1) / 100 for a, b in spans]
    channels, baselines, figures = {}, {}, {}
    for number, name in enumerate(CHANNELS):
        size = SIZE.get(name, 0.15)
        clean = [size * wave(t, 10 * seed + number) + (22.0 if name == "V" else 0.0) for t in times]
        measured = join([y + 0.05 * size * random.normal(size=len(y)) for y in clean])
        wrong = [size * error * wave(t, 999 + number) for t in times]
        simulated = join([y + e for y, e in zip(clean, wrong, strict=True)])
        channels[name] = ChannelTrace(measured, simulated)
        if name in ("p", "q", "r"):
            baselines[name] = join([0.7 * y + 0.02 for y in clean])
        figures[name] = channel_figures(
            measured, Match(simulated), 100.0, Match(baselines[name]) if name in baselines else None
        )
    inputs = {
        name: join([np.round(0.2 * wave(t, seed + number), 1) for t in times])
        for number, name in enumerate(INPUTS)
    }
    trace = ManeuverTrace(join(times), channels, inputs, baselines)
    return ManeuverResult("flight2", start, stop, role, tuple(spans), figures), trace


def parameter(number: int, names: tuple[str, ...]) -> ParameterEstimate:
    random = np.random.default_rng(number)
    estimate = float(random.normal() * 10 ** random.uniform(-2, 1))
    sigma = abs(estimate) * float(10 ** random.uniform(-2.5, -0.7))
    free = number % 9 == 5
    if free:
        sigma = 3.0 * abs(estimate)
    prior = number % 3 == 0
    start = estimate + 2.0 * sigma * float(random.normal())
    return ParameterEstimate(
        estimate=estimate,
        std_error=sigma,
        ci95_lower=estimate - NORMAL_95 * sigma,
        ci95_upper=estimate + NORMAL_95 * sigma,
        bound_lower=estimate if number == 7 else -10.0 * abs(estimate),
        bound_upper=10.0 * abs(estimate),
        at_bound=number == 7,
        identifiable=not free,
        unit="1" if number % 4 else "1/rad",
        prior_mean=start if prior else float("nan"),
        prior_std=2.0 * sigma if prior else float("nan"),
        start=start,
    )


def methods(parameters: dict[str, ParameterEstimate], hostile: str) -> dict[str, MethodIntervals]:
    """Return five methods: a narrow one, a lopsided one, one that is open to a side, one that looked at three only."""

    def of(lower: float, upper: float, few: bool = False) -> dict[str, Interval]:
        chosen = list(parameters.items())[: 3 if few else None]
        return {
            n: Interval(p.std_error, p.estimate - lower * p.std_error, p.estimate + upper * p.std_error)
            for n, p in chosen
        }

    return {
        "corrected": MethodIntervals(of(1.96, 1.96)),
        "cramer_rao": MethodIntervals(of(0.4, 0.4)),
        "bootstrap": MethodIntervals(of(1.8, 2.1), {"replicates": 1000.0, "refined": 3.0, "failed": 0.0}),
        "posterior": MethodIntervals(of(1.5, 3.0), {"rhat": 1.004}, ("It is lopsided." + hostile,)),
        "profile" + hostile: MethodIntervals(of(1.7, float("nan"), few=True)),
    }


@dataclass(frozen=True, eq=False)
class Shown:
    """What a report reads of a fitted model: `stoop.report.model.Model`, of no vehicle."""

    result: Result
    traces: tuple[ManeuverTrace, ...]
    vehicle: SimpleNamespace
    equations: tuple[str, ...] = ()
    convergence: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    units: Mapping[str, str] = field(default_factory=dict)
    symbols: Mapping[str, str] = field(default_factory=dict)
    air_data: tuple[AirDataTrace, ...] = ()
    command: str = ""
    body: Mapping[str, Quantity] = field(default_factory=dict)


def example(names: tuple[str, ...] = NAMES, hostile: str = "") -> Shown:
    """Return an identification with three fitted maneuvers and one predicted."""
    shapes = [
        maneuver(140.0, 145.0, "fit", 1, 0.06, cut=True),
        maneuver(146.0, 152.0, "fit", 2, 0.10, cut=False),
        maneuver(160.0, 168.3, "fit", 3, 0.04, cut=False),
        maneuver(187.0, 196.0, "validation", 4, 0.30, cut=False),
    ]
    size = len(names)
    factor = np.random.default_rng(7).normal(size=(size, size + 2))
    factor += (
        1.2
        * np.random.default_rng(8).normal(size=(1, size + 2))
        * np.random.default_rng(9).normal(size=(size, 1))
    )
    parameters = {name: parameter(number, names) for number, name in enumerate(names)}
    matrix = factor @ factor.T
    scale = np.array([one.std_error for one in parameters.values()]) / np.sqrt(np.diag(matrix))
    flight_time = np.arange(88.0, 246.0, 0.1)
    result = Result(
        parameters=parameters,
        covariance=Covariance(names, matrix * np.outer(scale, scale)),
        noise_covariance=NoiseCovariance(CHANNELS, np.diag([0.1**2] * 12)),
        initial_states=(
            InitialState(0, 0, 140.0, {"u": Quantity(21.9, 0.2, "m/s"), "w": Quantity(1.2, 0.1, "m/s")}),
            InitialState(0, 1, 142.9, {"u": Quantity(22.3, 0.2, "m/s"), "w": Quantity(0.9, 0.1, "m/s")}),
        ),
        biases=(
            SensorBiases(0, {"p": Quantity(0.0012, 0.0004, "rad/s"), "ax": Quantity(0.11, 0.02, "m/s2")}),
        ),
        wind=(
            WindEstimate(
                "flight2" + hostile,
                {
                    "wind_n": Quantity(2.31, 0.08, "m/s"),
                    "wind_e": Quantity(-4.02, 0.07, "m/s"),
                    "pitot_scale": Quantity(1.02, 0.01),
                    "pitot_offset": Quantity(5.4, 0.2, "m/s"),
                },
                0.31,
                ("The pitot reads 5.4 m/s too little: its zero has drifted.",),
            ),
        ),
        maneuvers=tuple(shape[0] for shape in shapes),
        cost=12345.6,
        trajectories=187.3,
        seconds=2.41,
        seed=1,
        optimizer="ps-gde with Levenberg-Marquardt prey",
        status="converged",
        notices=(
            as_notice("Residuals are colored: the plain Cramer-Rao bound would be 4.1 times too small."),
            as_notice("CDalpha lies on its bound: widen it, or ask why the flight wants more." + hostile),
            notice("air-data-reconstructed", "f" + hostile, channels=("V", "alpha"), method="output error"),
            as_notice("flight2: inputs are missing in 142.47:142.75" + hostile, "info", "flight"),
        ),
        versions={"stoop": "0.1.0", "numpy": "2.4.6", "scipy": "1.17.1" + hostile, "numba": "0.68.1"},
        uncertainty=methods(parameters, hostile),
        trust=("The residuals are colored: trust the corrected errors." + hostile,),
        identifiability=IdentifiabilityAnalysis(
            (3.1, 0.4, 0.002),
            {
                names[0]: ParameterIdentifiability(
                    0.01,
                    0.5,
                    0.9998,
                    names[1:3],
                    as_notice("known only in combination" + hostile),
                    (as_notice("Fly more." + hostile, "info"),),
                )
            },
            (CorrelatedPair(names[0], names[-1], -0.998),),
            (
                NearNullDirection(
                    0.002,
                    {names[0]: 0.5, names[-1]: -0.2},
                    as_notice("They move together." + hostile, "info"),
                ),
            ),
        ),
        modes=(
            ConditionModes(
                (0,),
                "trim",
                22.0,
                150.0,
                0.05,
                (),
                linear=StateEquations(
                    ("alpha", "q" + hostile),
                    ("elevator" + hostile,),
                    ((-8.26, 0.934), (-42.0, -5.5)),
                    ((0.0,), (-98.4,)),
                    ((0.97, 0.0), (20.0, np.nan)),
                    ((0.0,), (31.0,)),
                ),
            ),
        ),
        inputs={"flight2/log_5_actuator_controls_0_0.csv.gz" + hostile: "9f" * 32, "vehicle.toml": "3b" * 32},
    )
    spent = np.array([1.0, 5, 9, 14, 22, 40, 60, 90, 130, 187])
    return Shown(
        result=result,
        traces=tuple(shape[1] for shape in shapes),
        vehicle=SimpleNamespace(name="Altlnt V-tail, 8.5 kg" + hostile),
        equations=(*EQUATIONS, *((hostile, r"\text{" + hostile + "}") if hostile else ())),
        convergence=np.column_stack([spent, 12345.6 + 4e6 * np.exp(-spent / 12)]),
        units=UNITS,
        symbols={"CLalpha": r"C_{L_\alpha}", "Clp": r"C_{l_p}", "alpha": r"\alpha", "beta": r"\beta"}
        | ({"CL0": r"\text{" + hostile + "}"} if hostile else {}),
        air_data=(
            AirDataTrace(
                "flight2" + hostile,
                flight_time,
                {
                    "V": 22 + np.sin(flight_time / 9),
                    "airspeed_pitot": 16.5 + np.sin(flight_time / 9),
                    "alpha": 0.06 + 0.02 * np.sin(flight_time / 3),
                    "beta": 0.03 * np.sin(flight_time / 2),
                },
            ),
        ),
        body={
            "mass.mass": Quantity(8.5, np.nan, "kg"),
            "mass.inertia.yy" + hostile: Quantity(1.18, 0.2, "kg m2"),
        },
        command="stoop identify flight2 --vehicle vtail.toml --maneuver 140:145 --maneuver 146:152 -o out"
        + hostile,
    )
