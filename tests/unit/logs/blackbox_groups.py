"""Encodings of several fields that firmwares write and stoop does not: for logs that tests read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from stoop.exporters.blackbox_bytes import GROUPS, Groups, narrowed

TAG2_3S32, TAG8_4S16, TAG2_3SVARIABLE = 7, 8, 10


def _fits(value: int, bits: int) -> bool:
    return narrowed(value, bits) == value


def _packed(values: Sequence[tuple[int, int]]) -> bytes:
    """Return numbers of some bits each, (number, bits), the highest bits first, filled up to whole bytes."""
    total = size = 0
    for value, bits in values:
        total, size = total << bits | value & (1 << bits) - 1, size + bits
    rest = -size % 8
    return (total << rest).to_bytes((size + rest) // 8, "big")


def tag2_3s32(values: Sequence[int]) -> bytes:
    """Return three numbers of 2, 4 or 6 bits each, or of 1 to 4 bytes."""
    if all(_fits(x, 2) for x in values):
        return _packed([(0, 2), *((x, 2) for x in values)])
    if all(_fits(x, 4) for x in values):
        return _packed([(1, 2), (0, 2), *((x, 4) for x in values)])
    if all(_fits(x, 6) for x in values):
        return _packed([(2, 2), (values[0], 6), (0, 2), (values[1], 6), (0, 2), (values[2], 6)])
    return _wide(values)


def tag2_3svariable(values: Sequence[int]) -> bytes:
    """Return three numbers of 2, 2 and 2, 5, 5 and 4, or 8, 7 and 7 bits, or of 1 to 4 bytes."""
    for tag, widths in enumerate(((2, 2, 2), (5, 5, 4), (8, 7, 7))):
        if all(map(_fits, values, widths)):
            return _packed([(tag, 2), *zip(values, widths, strict=True)])
    return _wide(values)


def _wide(values: Sequence[int]) -> bytes:
    sizes = [next((n for n in (1, 2, 3) if _fits(x, 8 * n)), 4) for x in values]
    lead = 3 << 6 | sum(n - 1 << 2 * k for k, n in enumerate(sizes))
    return bytes([lead]) + b"".join(
        narrowed(x, 32).to_bytes(4, "little", signed=True)[:n] for x, n in zip(values, sizes, strict=True)
    )


def tag8_4s16(values: Sequence[int]) -> bytes:
    """Return four numbers of 0, 4, 8 or 16 bits; those beyond lose their highest bits, as in the firmware."""
    widths = [next(n for n in (0, 4, 8, 16) if n == 16 or (_fits(x, n) if n else x == 0)) for x in values]
    lead = sum({0: 0, 4: 1, 8: 2, 16: 3}[n] << 2 * k for k, n in enumerate(widths))
    return bytes([lead]) + _packed([*zip(values, widths, strict=True)])


ALL_GROUPS: Final[Groups] = {
    **GROUPS, TAG2_3S32: (tag2_3s32, 3), TAG2_3SVARIABLE: (tag2_3svariable, 3), TAG8_4S16: (tag8_4s16, 4),
}  # fmt: skip
