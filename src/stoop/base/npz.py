"""Archives of arrays (.npz) that may come from anywhere: nothing is allocated that the file does not hold."""

from __future__ import annotations

import io
import math
import tokenize
import warnings
import zipfile
from typing import IO, Any

import numpy as np
import numpy.typing as npt


def read_arrays(file: IO[bytes], max_bytes: int) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of an archive by name.

    Parameters
    ----------
    file : binary file
    max_bytes : int
        To which all of it may unfold.

    Raises
    ------
    ValueError, EOFError, OSError, RuntimeError, zipfile.BadZipFile, zlib.error
        It is damaged, unfolds to more, or holds no plain numbers.
    """
    arrays = {}
    with zipfile.ZipFile(file) as archive:
        members = archive.infolist()
        if any(one.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for one in members):
            raise ValueError("packed in a way that NumPy does not use")
        if sum(one.file_size for one in members) > max_bytes:
            raise ValueError(f"unfolds to more than {max_bytes >> 20} MiB")
        for one in members:
            with archive.open(one) as member:  # archive.read unpacks all of it first
                content = member.read(one.file_size)
            arrays[one.filename.removesuffix(".npy")] = _array(content)
    return arrays


def _array(content: bytes) -> npt.NDArray[Any]:
    """Return the array of a .npy file of version 1 or 2, as NumPy writes them."""
    stream = io.BytesIO(content)
    versions = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    read_header = versions.get(np.lib.format.read_magic(stream))
    if read_header is None:
        raise ValueError("an array of an unknown version")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about types that are refused
        try:
            shape, fortran, dtype = read_header(stream)
        except (SyntaxError, ValueError, TypeError, RecursionError, tokenize.TokenError):
            # NumPy reads it as Python, and quotes addresses
            raise ValueError("an array without a readable header") from None
    if dtype.kind not in "biufU":
        raise ValueError(f"an array of {dtype}")
    size = math.prod(shape)
    whole = size * dtype.itemsize == len(content) - stream.tell()
    if min(shape, default=0) < 0 or dtype.itemsize == 0 or not whole:
        raise ValueError(f"an array of another size than {shape}")
    values = np.frombuffer(content, dtype, size, stream.tell()) if size else np.empty(0, dtype)
    return values.reshape(shape, order="F" if fortran else "C").copy(order="K")
