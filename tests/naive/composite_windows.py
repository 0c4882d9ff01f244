"""Responses from windows of several lengths by the formulas of `stoop.flight.frequency_responses`: dense, at each frequency."""

import numpy as np

from stoop.base.arrays import ComplexArray, FloatArray


def naive_responses(
    u: FloatArray, y: FloatArray, rate: float, lengths: list[float], hertz: FloatArray
) -> list[tuple[ComplexArray, FloatArray, float, FloatArray]]:
    """Return response, its relative random error, degrees of freedom and partial coherence of inputs (n, p) at each frequency."""
    tapers, rows, length = [], [], []
    for seconds in lengths:
        size = round(seconds * rate)
        room = len(y) - size
        count = 1 + int(np.ceil(room / round(0.5 * size)))
        for start in np.unique(np.round(np.linspace(0, room, count)).astype(int)):
            own = slice(int(start), int(start) + size)
            taper = np.zeros(len(y))
            taper[own] = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(size) / size)
            tapers.append(taper / np.linalg.norm(taper))
            rows.append(np.column_stack([u, y]) - np.column_stack([u, y])[own].mean(axis=0))
            length.append(seconds)
    R, time, found = np.array(tapers) @ np.array(tapers).T, np.arange(len(y)) / rate, []
    for f in hertz:
        turn = np.exp(-2j * np.pi * f * time)
        every = np.array([turn @ (h[:, None] * x) for h, x in zip(tapers, rows, strict=True)])
        X, Y = every[:, :-1], every[:, -1]
        error, weight = {}, np.zeros(len(Y))
        for seconds in lengths:
            mine = np.array(length) == seconds
            if seconds * f >= 2.0 and mine.sum() > X.shape[1] + 1:
                left = float(np.linalg.norm(Y[mine] - X[mine] @ np.linalg.lstsq(X[mine], Y[mine])[0]) ** 2)
                averages = mine.sum() ** 2 / np.sum(R[np.ix_(mine, mine)] ** 2)
                error[seconds] = (left / (np.linalg.norm(Y[mine]) ** 2 - left) / averages) ** 0.5
        for seconds, one in error.items():
            mine = np.array(length) == seconds
            weight[mine] = (one / min(error.values())) ** -4 / mine.sum()
        V = np.diag(weight)
        C = np.linalg.inv(X.conj().T @ V @ X)
        H, M = C @ X.conj().T @ V @ Y, V - V @ X @ C @ X.conj().T @ V
        r = Y - X @ H
        variance = (r.conj() @ V @ r / np.trace(M @ R)).real
        covariance = variance * C @ X.conj().T @ V @ R @ V @ X @ C
        freedom = float((2.0 * np.trace(M @ R) ** 2 / np.trace(M @ R @ M @ R)).real)
        explained = np.abs(H) ** 2 / np.diag(C).real
        coherence = explained / (explained + (r.conj() @ V @ r).real)
        found.append((H, np.sqrt(0.5 * np.diag(covariance).real) / np.abs(H), freedom, coherence))
    return found
