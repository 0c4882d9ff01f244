"""What may be said of a flight, in words, with the chance of saying it of a healthy one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from scipy import stats

from stoop.estimate.effectiveness.compare import Assessment

CHANCE: Final = 0.05  #: of accusing any rotor of a healthy flight
APART: Final = (
    6.63  #: difference of squares that tells two explanations apart (1 % point of chi-square, one degree)
)
ODD: Final = 0.01  #: chance below which what is left over counts
SEEN: Final = 0.8  #: how often a loss of the stated least size is seen


@dataclass(frozen=True)
class Verdict:
    """What one flight shows.

    Attributes
    ----------
    kind : str
        "healthy", "weak or mass", "mass", "several" (which rotor cannot be told), "odd" (no single rotor explains it).
    rotors : tuple of str
        Those that are accused.
    chance : float
        How often a healthy flight looks like this or worse.
    words : str
        One sentence.
    """

    kind: str
    rotors: tuple[str, ...]
    chance: float
    words: str


def judge(assessment: Assessment, chance: float = CHANCE) -> Verdict:
    """Decide what may be said of a flight when a healthy one is to be accused with the given chance at most."""
    if assessment.chance > chance:
        return _not_accused(assessment, chance)
    best, named = assessment.suspected, alike(assessment)
    if len(named) > 1:
        words = f"{' or '.join(named)}: which of them cannot be told"
        return Verdict("several", named, assessment.chance, words)
    mass = assessment.mass_near(best.rotor)
    if best.left - mass.left > APART:
        words = f"mass near {best.rotor}, {100.0 * mass.size:.1f} % of the vehicle's: the yaw balance did not change"
        return Verdict("mass", (best.rotor,), assessment.chance, words)
    return Verdict("weak or mass", (best.rotor,), assessment.chance, f"propeller or mass near {best.rotor}")


def alike(assessment: Assessment) -> tuple[str, ...]:
    """Return the rotor whose loss explains most, and after it those that explain it nearly as well; none where none loses."""
    best = assessment.suspected
    if not best.size > 0.0:
        return ()
    rivals = [s for s in assessment.weak if s is not best and s.size > 0.0 and s.left - best.left < APART]
    return best.rotor, *(s.rotor for s in sorted(rivals, key=lambda s: s.left))


def least_seen(assessment: Assessment, chance: float = CHANCE) -> float:
    """Return the loss of thrust of the best-observed rotor that would be seen four times in five."""
    best = min(s.std for s in assessment.weak)
    return needed(assessment.degrees, len(assessment.weak), chance) * best


def needed(degrees: float, rotors: int, chance: float) -> float:
    """Return how many standard errors a loss has that is seen four times in five."""
    t = stats.t(degrees)
    return float(t.isf(chance / rotors) + t.isf(1.0 - SEEN))


def odd(assessment: Assessment, left: float, freedom: int) -> bool:
    """Tell whether what is left over is more than healthy flights leave (Fisher's F)."""
    return bool(stats.f.sf(left / freedom, freedom, assessment.degrees) < ODD)


def _not_accused(assessment: Assessment, chance: float) -> Verdict:
    if odd(assessment, assessment.distance, 4):
        words = "unlike the healthy flights, but no single rotor explains it"
        return Verdict("odd", (), assessment.chance, words)
    words = f"as healthy; a loss below {100.0 * least_seen(assessment, chance):.0f} % would not be seen"
    return Verdict("healthy", (), assessment.chance, words)
