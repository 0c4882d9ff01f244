"""A given noise covariance, the inverse of eq. (3)'s Q, from a small CSV."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stoop.errors import IdentificationError

MAX_BYTES = 100_000


def read_covariance(path: Path, channels: Sequence[str]) -> NDArray[np.float64]:
    """Read variances (n_y,) or a covariance (n_y, n_y) in the order of the channels.

    Raises
    ------
    IdentificationError
        Missing, not readable, wrong shape, or not symmetric positive definite.
    """
    wanted = f"one row of {len(channels)} variances, or a {len(channels)} by {len(channels)} matrix, for {', '.join(channels)}"
    try:
        if path.stat().st_size > MAX_BYTES:
            raise IdentificationError(f"{path}: too large for a covariance; write {wanted}")
        matrix = np.loadtxt(path, delimiter=",", ndmin=2, dtype=np.float64)
    except FileNotFoundError:
        raise IdentificationError(f"{path}: no such file; check the name") from None
    except (OSError, ValueError, UnicodeDecodeError):
        raise IdentificationError(f"{path}: cannot be read as numbers; write {wanted}") from None
    if matrix.shape == (1, len(channels)):
        matrix = np.diag(matrix[0])
    if matrix.shape != (len(channels), len(channels)):
        raise IdentificationError(f"{path}: has shape {matrix.shape}; write {wanted}")
    if not (
        np.isfinite(matrix).all() and np.allclose(matrix, matrix.T) and np.linalg.eigvalsh(matrix)[0] > 0.0
    ):
        raise IdentificationError(f"{path}: is not symmetric positive definite; a covariance must be")
    return matrix
