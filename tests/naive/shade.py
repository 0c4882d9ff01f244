"""L-SHADE and jSO one member at a time, as the publications describe them, with no piece of the package.

Random numbers are drawn in another order than the package draws them, so only distributions can be compared.
"""

from collections.abc import Callable

import numpy as np


def evaluations_to(  # noqa: C901 - long on purpose: it is read beside the publications
    target: float, cost: Callable[[np.ndarray], float], dimension: int, budget: int, seed: int, *, jso: bool
) -> float:
    """Return how many evaluations it takes to come down to the target; inf if the budget ends first."""
    rng = np.random.default_rng(seed)
    first = round(25 * np.log(dimension) * np.sqrt(dimension)) if jso else 18 * dimension
    entries = 5 if jso else 6
    memory_f = [0.3 if jso else 0.5] * entries
    memory_cr = [0.8 if jso else 0.5] * entries
    people = [rng.random(dimension) for _ in range(first)]
    costs, spent = [], 0
    for x in people:
        costs.append(cost(x))
        spent += 1
        if costs[-1] <= target:
            return spent
    archive: list[np.ndarray] = []
    slot = 0
    while spent < budget:
        share = spent / budget
        order = sorted(range(len(people)), key=lambda i: costs[i])
        best = max(2, round((0.25 * (1 - 0.5 * share) if jso else 0.11) * len(people)))
        trials, used_f, used_cr = [], [], []
        for i, x in enumerate(people):
            k = rng.integers(entries)
            mean_f, mean_cr = memory_f[k], memory_cr[k]
            if jso and k == entries - 1:
                mean_f = mean_cr = 0.9
            cr = 0.0 if mean_cr < 0 else min(1.0, max(0.0, rng.normal(mean_cr, 0.1)))
            f = -1.0
            while f <= 0:
                f = mean_f + 0.1 * rng.standard_cauchy()
            f = min(f, 1.0)
            weight = f
            if jso:
                if share < 0.25:
                    cr = max(cr, 0.7)
                if share < 0.5:
                    cr = max(cr, 0.6)
                if share < 0.6:
                    f = min(f, 0.7)
                weight = f * (0.7 if share < 0.2 else 0.8 if share < 0.4 else 1.2)
            p = order[rng.integers(best)]
            while jso and share < 0.5 and p == i:
                p = order[rng.integers(best)]
            a = i
            while a == i:
                a = int(rng.integers(len(people)))
            b = i
            while b in (i, a):
                b = int(rng.integers(len(people) + len(archive)))
            far = people[b] if b < len(people) else archive[b - len(people)]
            mutant = x + weight * (people[p] - x) + f * (people[a] - far)
            forced = rng.integers(dimension)
            trial = x.copy()
            for j in range(dimension):
                if j == forced or rng.random() <= cr:
                    trial[j] = mutant[j]
                    if mutant[j] < 0:
                        trial[j] = x[j] / 2
                    if mutant[j] > 1:
                        trial[j] = (1 + x[j]) / 2
            trials.append(trial)
            used_f.append(f)
            used_cr.append(cr)
        won: list[tuple[float, float, float]] = []
        for i, trial in enumerate(trials):
            value = cost(trial)
            spent += 1
            if value <= target:
                return spent
            if value < costs[i]:
                won.append((costs[i] - value, used_f[i], used_cr[i]))
                archive.append(people[i])
            if value <= costs[i]:
                people[i], costs[i] = trial, value
        if won:
            gain, f_, cr_ = np.array(won).T
            new_f = (gain * f_**2).sum() / (gain * f_).sum()
            dead = cr_.max() == 0 or (not jso and memory_cr[slot] < 0)
            new_cr = -1.0 if dead else (gain * cr_**2).sum() / (gain * cr_).sum()
            memory_f[slot] = (memory_f[slot] + new_f) / 2 if jso else new_f
            memory_cr[slot] = (memory_cr[slot] + new_cr) / 2 if jso else new_cr
            slot = (slot + 1) % entries
        size = max(4, round(first + (4 - first) * min(1.0, spent / budget)))
        keep = sorted(range(len(people)), key=lambda i: costs[i])[:size]
        people, costs = [people[i] for i in keep], [costs[i] for i in keep]
        while len(archive) > round((1.0 if jso else 2.6) * size):
            archive.pop(int(rng.integers(len(archive))))
    return np.inf
