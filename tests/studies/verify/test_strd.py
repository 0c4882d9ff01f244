"""Files of NIST StRD's form: a problem of our own whose optimum is known to 30 digits, and files that are wrong."""

import re
from pathlib import Path

import mpmath
import pytest
import sympy as sp

from stoop.errors import StoopError
from stoop_studies.findings import Setting
from stoop_studies.verify.nist import EXPERIMENT, fit_certified
from stoop_studies.verify.strd import read_certified

PAGE = """\
NIST/ITL StRD
Dataset Name:  Own               (Own.dat)

Data:          1 Response Variable  (y)
               1 Predictor Variable (x)
               {n} Observations
               Higher Level of Difficulty

Model:         Miscellaneous Class
               3 Parameters (b1 to b3)

               y = {model}  +  e

          Starting values                  Certified Values

        Start 1     Start 2           Parameter     Standard Deviation
{rows}

Residual Sum of Squares:                    {least}

Data:   y               x
{data}
"""
MODEL = "b1 * [b2+x]**(-1/b3)"
NAMES = {name: sp.Symbol(name, real=True) for name in ("x", "b1", "b2", "b3")}


def own_problem(model: str = MODEL) -> str:
    """Return a file of y = b1 (b2 + x)^(-1 / b3) whose residuals are normal to its derivatives at the certified values.

    These are then the optimum; standard deviations are those of the definition, with 40 digits.
    """
    with mpmath.workdps(40):
        b1, b2, b3 = (mpmath.mpf(v) for v in ("-2523.5", "46.74", "0.93218"))
        x = [mpmath.mpf(7) + mpmath.mpf(i) / 10 for i in range(60)]
        power = [(b2 + v) ** (-1 / b3) for v in x]
        J = mpmath.matrix([[p, -b1 / b3 * p / (b2 + v), b1 * mpmath.log(b2 + v) / b3**2 * p]
                           for v, p in zip(x, power, strict=True)])  # fmt: skip
        e = mpmath.matrix([mpmath.sin(7 * i * i) / 500 for i in range(60)])
        inverse = (J.T * J) ** -1
        e -= J * (inverse * (J.T * e))
        least = (e.T * e)[0]
        deviations = [mpmath.sqrt(least / 57 * inverse[i, i]) for i in range(3)]
        written = [mpmath.nstr(v, 11) for v in (*deviations, least)]
        starts = (("-2000", "-1500"), ("50", "45"), ("0.8", "0.85"))
        rows = [f"  b{i + 1} =   {first}   {second}   {mpmath.nstr(b, 11)}  {written[i]}"
                for i, ((first, second), b) in enumerate(zip(starts, (b1, b2, b3), strict=True))]  # fmt: skip
        pairs = zip(power, e, x, strict=True)
        data = [f"  {mpmath.nstr(b1 * p + own, 25)}  {mpmath.nstr(v, 25)}" for p, own, v in pairs]
    return PAGE.format(n=60, model=model, rows="\n".join(rows), least=written[3], data="\n".join(data))


def test_a_file_that_is_not_among_nists(tmp_path: Path) -> None:
    (tmp_path / "Own.dat").write_text(own_problem())
    fits = [fit_certified(read_certified(tmp_path / "Own.dat"), start) for start in (1, 2)]
    for found in fits:
        assert found["ending"] == "converged"
        assert min(found[f"digits_{what}"] for what in ("parameters", "deviations", "rss")) >= 9.0
    findings = EXPERIMENT.findings(Setting(1, data=tmp_path), {})
    assert all(claim.verdict == "holds" for claim in findings.claims)


WRONG = (
    ("Residual Sum", "Sum", r"is no nonlinear regression of NIST StRD; fetch it again from NIST"),
    ("  b2 =", "  b4 =", "is no nonlinear regression"),
    ("Model:", "Modell:", "states no model that can be read"),
    (MODEL, "b1 * (b2+x", "cannot be used: it is no formula"),
    (MODEL, "b1 * x**b2", "it does not depend on b3"),
    (MODEL, "b1 * b2 * b3 * z", "it names z, which is none of b1, b2, b3, x, pi"),
    (MODEL, "b1 * b2 * b3 * x**99", "it has a power beyond 12"),
    (MODEL, "b1 * b2 * b3 * 9**9**9**9", "it has a power of numbers alone"),
    (MODEL, "b1 * b2 * b3 * exp[exp[99]]", "it has exp of a number"),
    (MODEL, "b1 * b2 * b3 / (1 - 1)", "it has no finite value"),
    (MODEL, "b1 * b2 * b3 * x**(1/0)", "it is no formula"),
    (MODEL, "b1 * b2 * b3 * " + "9" * 400, "it has no finite value"),
    (MODEL, "b1 * b2 * b3 * x.real", "it has something else than numbers"),
    (MODEL, "__import__[b1](b2)", "it has something else than numbers"),
    (MODEL, "b1 * b2 * b3" + " + x" * 400, "it is longer than 1000 characters"),
    (MODEL, "(" * 300 + "b1" + ")" * 300, "it is no formula"),
)


@pytest.mark.parametrize("row", range(len(WRONG)))
def test_a_wrong_file_gets_one_line(tmp_path: Path, row: int) -> None:
    (old, new, says), path, text = WRONG[row], tmp_path / "Own.dat", own_problem()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(StoopError, match=rf"^{re.escape(str(path))}: .*{says}") as raised:
        EXPERIMENT.findings(Setting(1, data=tmp_path), {})
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 350 + len(str(path))
