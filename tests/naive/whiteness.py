"""Ljung and Box's statistic as it is printed, one product at a time."""

import math


def naive_ljung_box(residual: object, lags: int) -> float:
    v = [float(x) for x in residual]  # type: ignore[attr-defined]
    there = [not math.isnan(x) for x in v]
    n = sum(there)
    power = sum(x * x for x, ok in zip(v, there, strict=True) if ok)
    q = 0.0
    for k in range(1, lags + 1):
        products = [v[i] * v[i + k] for i in range(len(v) - k) if there[i] and there[i + k]]
        q += (sum(products) / power) ** 2 / len(products)
    return n * (n + 2) * q
