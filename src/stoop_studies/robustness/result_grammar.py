"""Grammar of result.json, written from docs/result-schema.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from stoop_studies.robustness.document_trees import Node
from stoop_studies.robustness.log_grammars import Draw
from stoop_studies.robustness.node_makers import (
    Maker,
    either,
    flag,
    integer,
    leaf,
    named,
    nothing,
    number,
    row,
    several,
    table,
    text,
)

PARAMETERS: Final = ("CLalpha", "Cmalpha", "Cmq", "Cmelevator", "Clp")
FIELD: Final = either(number(1.0), number(-0.3), number(1.0), nothing())
ESTIMATE: Final = table({"estimate": FIELD, "std_error": FIELD, "ci95_lower": FIELD, "ci95_upper": FIELD})
PARAMETER: Final = table(
    {
        "estimate": number(1.0),
        "std_error": FIELD,
        "ci95_lower": FIELD,
        "ci95_upper": FIELD,
        "bound_lower": FIELD,
        "bound_upper": FIELD,
        "at_bound": flag(),
        "identifiable": flag(),
        "unit": text("1", "1/rad", "kg m2"),
        "prior_mean": FIELD,
        "prior_std": FIELD,
        "start": FIELD,
    }
)
QUANTITY: Final = table({"estimate": FIELD, "std_error": FIELD, "unit": text("1", "m/s")})
NOTICE: Final = either(
    table(
        {
            "code": text("vehicle-file-note", "untyped-warning"),
            "severity": text("warning", "info"),
            "subject": text("a"),
            "values": table({"text": text("Inertia is assumed.")}),
            "message": text("Inertia is assumed."),
        }
    ),
    table(
        {
            "code": text("residuals-colored"),
            "severity": text("info"),
            "subject": text(""),
            "values": table({"samples": number(5.0)}),
            "message": text("b"),
        }
    ),
    table(
        {
            "code": text("of-a-later-version"),
            "severity": text("info"),
            "subject": text(""),
            "values": table({}),
            "message": text("b"),
        }
    ),
    table(
        {
            "code": text("not-identifiable"),
            "severity": text("warning"),
            "subject": text(""),
            "message": text("c"),
            "values": table(
                {"parameters": several(text("CLalpha"), 1, 2), "count": integer(2), "reason": text("d")}
            ),
        }
    ),
)
NOTICES: Final = several(NOTICE, 0, 3)
SENTENCES: Final = several(text("A sentence."), 0, 2)
SHARES: Final = table({"bias": FIELD, "variance": FIELD, "covariance": FIELD})
WHITENESS: Final = table(
    {
        "autocorrelation": FIELD,
        "statistic": FIELD,
        "lags": integer(40),
        "p_value": FIELD,
        "verdict": text("white", "colored", ""),
    }
)
FIGURES: Final = table(
    {"rmse": FIELD, "theil": FIELD, "r2": FIELD},
    {
        "baseline_theil": FIELD,
        "press": FIELD,
        "theil_shares": SHARES,
        "whiteness": WHITENESS,
        "fit_percent": FIELD,
        "noise": FIELD,
        "baseline": table(
            {"rmse": FIELD, "r2": FIELD, "press": FIELD, "theil_shares": SHARES, "whiteness": WHITENESS}
        ),
        "signal_to_noise": FIELD,
        "inside": FIELD,
        "innovations": table({"rms": FIELD, "inside": FIELD, "whiteness": WHITENESS}),
    },
    0.6,
)
CHANNELS_OF: Final = named(("p", "q", "V"), FIGURES)
FITTED: Final = table(
    {
        "flight": text("a"),
        "start": number(5.0),
        "stop": number(50.0),
        "role": text("fit", "validation"),
        "segments": several(row(number(5.0), number(50.0)), 0, 2),
        "channels": CHANNELS_OF,
    },
    {"loading": text("", "heavy")},
)
MODE: Final = table(
    {
        "name": text("phugoid"),
        "real": ESTIMATE,
        "imag": ESTIMATE,
        "frequency": ESTIMATE,
        "damping": ESTIMATE,
        "time_constant": ESTIMATE,
    },
    {
        "method": text("delta", "sampled"),
        "other_character": number(0.1),
        "remark": text("", "A remark."),
        "measured": several(
            table(
                {"maneuver": integer(1)},
                {
                    "start": FIELD,
                    "stop": FIELD,
                    "channels": several(text("q"), 1, 2),
                    "frequency": ESTIMATE,
                    "damping": ESTIMATE,
                    "remark": text("", "B"),
                },
            ),
            0,
            2,
        ),
    },
)
MATRIX: Final = several(several(FIELD, 2, 2), 2, 2)
CONDITION: Final = table(
    {
        "maneuvers": several(integer(1), 1, 2),
        "about": text("trim", "mean state"),
        "airspeed": FIELD,
        "altitude": FIELD,
        "alpha": FIELD,
        "modes": several(MODE, 0, 3),
    },
    {
        "remark": text("", "C"),
        "linear": table(
            {
                "states": row(text("alpha"), text("q")),
                "inputs": row(text("elevator")),
                "A": MATRIX,
                "B": MATRIX,
                "A_std": MATRIX,
                "B_std": MATRIX,
            }
        ),
    },
)
METHOD: Final = table(
    {
        "parameters": named(
            PARAMETERS, table({"std_error": FIELD, "ci95_lower": FIELD, "ci95_upper": FIELD}), len(PARAMETERS)
        )
    },
    {"figures": named(("replicates", "rhat"), FIELD), "notes": SENTENCES},
)
REPEATED: Final = table(
    {
        "maneuvers": several(integer(1), 0, 2),
        "parameters": named(
            PARAMETERS,
            table(
                {"singles": several(table({"estimate": FIELD, "std_error": FIELD, "counted": flag()}), 0, 2)},
                {
                    "mean": FIELD,
                    "std_error": FIELD,
                    "chi_square": FIELD,
                    "degrees": integer(3),
                    "p_value": FIELD,
                    "verdict": text("agree", "scatter", ""),
                },
            ),
        ),
    },
    {"remarks": SENTENCES, "joint": table({"chi_square": FIELD, "degrees": integer(3), "p_value": FIELD})},
)
IDENTIFIABILITY: Final = table(
    {
        "singular_values": several(number(1.0), 0, 3),
        "parameters": named(
            PARAMETERS,
            table(
                {"conditional_std": FIELD, "marginal_std": FIELD, "multiple_correlation": FIELD},
                {
                    "partners": several(text("Cmq"), 0, 2),
                    "doubt": text("", "A doubt."),
                    "advice": text("", "Fly more."),
                },
            ),
        ),
    },
    {
        "pairs": several(table({"first": text("Cmq"), "second": text("Clp"), "correlation": FIELD}), 0, 2),
        "directions": several(
            table({"singular_value": FIELD, "changes": named(PARAMETERS, FIELD)}, {"words": text("", "D")}),
            0,
            2,
        ),
    },
)
EXTENSIONS: Final = table(
    {
        "tested": integer(30),
        "level": FIELD,
        "found": several(
            table(
                {
                    "name": text("Cmx"),
                    "kind": text("term"),
                    "value": FIELD,
                    "std_error": FIELD,
                    "unit": text("1"),
                    "statistic": FIELD,
                    "p_value": FIELD,
                    "gain": FIELD,
                    "line": text("Cmx = 1.0"),
                },
                {
                    "change": FIELD,
                    "beside": FIELD,
                    "rivals": several(text("Cmq"), 0, 2),
                    "moves": named(PARAMETERS, FIELD),
                },
            ),
            0,
            2,
        ),
    },
    {"unresolved": several(text("mass.mass"), 0, 2)},
)
VERDICT: Final = table(
    {
        "grade": text("trusted", "usable", "do not use", ""),
        "uses": several(
            table(
                {"name": text("simulation"), "channels": several(text("q"), 0, 2)},
                {
                    "needs": several(
                        table(
                            {"subject": text("a"), "parameters": several(text("Cmq"), 0, 2)},
                            {"sizes": several(FIELD, 0, 2), "inertia": text("")},
                        ),
                        0,
                        2,
                    ),
                    "justified": flag(),
                    "against": NOTICES,
                },
            ),
            0,
            2,
        ),
    },
    {"reasons": NOTICES, "advice": NOTICES},
)


def _matrix(names: str, labels: tuple[str, ...], more: Mapping[str, Maker]) -> Maker:
    """Return a maker of a covariance with its names, of sizes that fit."""

    def make(draw: Draw) -> Node:
        chosen = draw.rng.sample(labels, draw.rng.randint(1, len(labels)))
        rows = [[FIELD(draw) for _ in chosen] for _ in chosen]
        return table({names: leaf(lambda _: list(chosen)), "matrix": leaf(lambda _: list(rows))}, more)(draw)

    return make


RESULT: Final = table(
    {
        "schema": leaf(lambda _: "stoop-result/1"),
        "parameters": named(PARAMETERS, PARAMETER, len(PARAMETERS)),
        "covariance": _matrix("names", PARAMETERS, {}),
        "noise_covariance": _matrix("channels", ("p", "q", "V"), {"inflation": number(1.0)}),
        "initial_states": several(
            table(
                {
                    "maneuver": integer(0),
                    "segment": integer(1),
                    "time": number(5.0),
                    "values": named(("u", "w"), QUANTITY),
                }
            ),
            0,
            2,
        ),
        "biases": several(table({"maneuver": integer(0), "values": named(("p", "ax"), QUANTITY)}), 0, 2),
        "wind": several(
            table(
                {"flight": text("a"), "values": named(("wind_n", "pitot_scale"), QUANTITY)},
                {"residual_rms": FIELD, "notes": SENTENCES},
            ),
            0,
            2,
        ),
        "maneuvers": several(FITTED, 1, 2),
        "cost": number(100.0),
        "trajectories": number(200.0),
        "seconds": number(2.0),
        "seed": integer(5),
        "optimizer": text("ps-gde-lm"),
        "status": text("converged", "budget", "stalled"),
    },
    {
        "advice": text("", "more"),
        "notices": NOTICES,
        "warnings": SENTENCES,
        "modes": several(CONDITION, 0, 2),
        "repeatability": REPEATED,
        "uncertainty": named(("corrected", "cramer_rao", "bootstrap"), METHOD),
        "trust": SENTENCES,
        "identifiability": IDENTIFIABILITY,
        "extensions": EXTENSIONS,
        "verdict": VERDICT,
        "versions": named(("stoop", "numpy"), text("1.0")),
        "inputs": named(("a.nc", "vehicle.toml"), text("9f")),
        "method": text("output-error", "equation-error"),
    },
    0.6,
)
