"""The walk over the frames of a blackbox log: bytes to whole numbers, past damage.

A frame is a letter and its fields; neither its length nor a checksum is stored. A frame is whole if the letter of another one,
or the end, follows it. A P frame holds differences from the frames before it: after damage all are lost up to the next I
frame whose loop iteration and time go on.

The walk advances with every step, and each byte is read by a bounded number of frames: time is linear in the size of the file.

Plain functions, in the part of Python that Numba compiles too (`stoop.logs.compiled`); small logs do without.

References
----------
.. [1] Betaflight, src/main/blackbox/blackbox_fielddefs.h and blackbox_encoding.c: encodings, predictors, events.
.. [2] Betaflight, blackbox-tools, src/parser.c: which frames count as whole.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
Integers = npt.NDArray[np.int64]

I, P, S, G, H = range(5)  #: kinds of frames  # noqa: E741
MAX_FIELDS: Final = 256  #: of a frame; those of INAV have some 130
MAX_FRAME: Final = 256  #: bytes, as the firmware's own decoder has it
MAX_ITERATIONS: Final = 5000  #: between two frames that follow each other
MAX_MICROSECONDS: Final = 10_000_000
ENCODINGS: Final = frozenset({0, 1, 3, 6, 7, 8, 9, 10})
PREDICTORS: Final = frozenset(range(12))
# places in `setup`, which holds what the header says
(
    VERSION,
    MIN_THROTTLE,
    VBAT_REF,
    MIN_MOTOR,
    MOTOR,
    ITERATION,
    TIME,
    GPS_TIME,
    HOME,
    I_STEP,
    P_COUNT,
    P_STEP,
) = range(12)
SETUP: Final = 12
# places in `state`
VALID, STARTED, LAST_ITERATION, LAST_TIME, ROLLED, HAS_CANDIDATE, NEXT_ITERATION, NEXT_TIME, HAS_HOME = range(
    9
)
GAPS, GAP_BYTES, UNUSABLE, NO_HOME, CUT, ENDED = range(9, 15)
STATE: Final = 15


def unsigned(data: Bytes, at: int, end: int) -> tuple[int, int]:
    """Return a number of 7 bits a byte, the lowest first, and the place after it; beyond `end` where it is cut."""
    value = 0
    for k in range(5):
        if at >= end:
            return 0, end + 1
        byte = int(data[at])
        at += 1
        value |= (byte & 127) << (7 * k)
        if byte < 128:
            return value & 0xFFFFFFFF, at
    return 0, at


def signed_vb(data: Bytes, at: int, end: int) -> tuple[int, int]:
    """Return a number whose sign stands in its lowest bit, and the place after it."""
    value, at = unsigned(data, at, end)
    return (value >> 1) ^ -(value & 1), at


def little(data: Bytes, at: int, end: int, count: int) -> tuple[int, int]:
    """Return a signed number of some bytes, the lowest first, and the place after it."""
    if at + count > end:
        return 0, end + 1
    value = 0
    for k in range(count):
        value |= int(data[at + k]) << (8 * k)
    return extended(value, 8 * count), at + count


def extended(value: int, bits: int) -> int:
    """Return the signed number that the lowest bits are."""
    value &= (1 << bits) - 1
    return value - (1 << bits) if value >> (bits - 1) else value


def wrapped(value: int, is_signed: int) -> int:
    """Return a number as 32 bits hold it."""
    return extended(value, 32) if is_signed else value & 0xFFFFFFFF


def three(data: Bytes, at: int, end: int, variable: bool, out: Integers) -> int:
    """Read three signed numbers whose widths the first two bits tell; return the place after them."""
    if at >= end:
        return end + 1
    lead, tag = int(data[at]), int(data[at]) >> 6
    if tag == 3:
        at += 1
        for k in range(3):
            out[k], at = little(data, at, end, ((lead >> (2 * k)) & 3) + 1)
        return at
    if at + tag >= end:
        return end + 1
    if tag == 0:
        out[0], out[1], out[2] = extended(lead >> 4, 2), extended(lead >> 2, 2), extended(lead, 2)
        return at + 1
    second = int(data[at + 1])
    if tag == 1:
        if variable:  # 5, 5 and 4 bits
            out[0] = extended(lead >> 1, 5)
            out[1] = extended((lead & 1) << 4 | second >> 4, 5)
        else:
            out[0], out[1] = extended(lead, 4), extended(second >> 4, 4)
        out[2] = extended(second, 4)
        return at + 2
    third = int(data[at + 2])
    if variable:  # 8, 7 and 7 bits
        out[0] = extended((lead & 63) << 2 | second >> 6, 8)
        out[1] = extended((second & 63) << 1 | third >> 7, 7)
        out[2] = extended(third, 7)
    else:
        out[0], out[1], out[2] = extended(lead, 6), extended(second, 6), extended(third, 6)
    return at + 3


def four(data: Bytes, at: int, end: int, version: int, out: Integers) -> int:
    """Read four signed numbers of 0, 4, 8 or 16 bits, whose widths stand in a byte before them; return the place after."""
    if at >= end:
        return end + 1
    widths, at = int(data[at]), at + 1
    if version < 2:  # whole bytes, low byte first; numbers of 4 bits come in pairs
        k = 0
        while k < 4:
            width = widths >> (2 * k) & 3
            if width == 1:
                if at >= end:
                    return end + 1
                out[k] = extended(int(data[at]), 4)
                if k < 3:
                    out[k + 1] = extended(int(data[at]) >> 4, 4)
                k, at = k + 2, at + 1
                continue
            out[k] = 0
            if width:
                out[k], at = little(data, at, end, width - 1)
            k += 1
        return at
    half = 0  # bits of the byte at `at` that were read
    for k in range(4):
        width = widths >> (2 * k) & 3
        bits = 0 if width == 0 else 1 << (width + 1)
        last = at + (half + bits + 7) // 8
        if last > end:
            return end + 1
        value = 0
        for place in range(at, last):
            value = value << 8 | int(data[place])
        out[k] = extended(value >> (8 * (last - at) - half - bits), bits) if bits else 0
        at, half = at + (half + bits) // 8, (half + bits) % 8
    return at + (1 if half else 0)


def skipped(iteration: int, i_step: int, p_count: int, p_step: int) -> int:
    """Return how many iterations after this one are not logged, by the rate of the log."""
    if iteration < 0:
        return 0
    ahead = iteration % i_step + 1
    phase = (ahead + p_count - 1) % p_step
    if ahead >= i_step or phase < p_count:
        return 0
    return min(p_step - phase, i_step - ahead)


def predicted(
    predictor: int, k: int, kind: int, setup: Integers, state: Integers, now: Integers, before: Integers,
    earlier: Integers, home: Integers,
) -> int:  # fmt: skip
    """Return what is to be added to the number of a field."""
    if predictor == 1:
        return int(before[k])
    if predictor == 2:
        return int(2 * before[k] - earlier[k])
    if predictor == 3:
        total = before[k] + earlier[k]
        return int(total // 2 if total >= 0 else -(-total // 2))  # towards zero, as in C
    if predictor == 4:
        return int(setup[MIN_THROTTLE])
    if predictor == 5:
        return int(now[setup[MOTOR]]) if setup[MOTOR] >= 0 and kind <= P else 0
    if predictor in (7, 12):
        return int(home[setup[HOME] + (1 if predictor == 12 else 0)]) if setup[HOME] >= 0 else 0
    if predictor == 8:
        return 1500
    if predictor == 9:
        return int(setup[VBAT_REF])
    if predictor == 10:
        return int(state[LAST_TIME])
    if predictor == 11:
        return int(setup[MIN_MOTOR])
    return 0


def read_group(
    data: Bytes, at: int, end: int, encoding: int, size: int, version: int, part: Integers
) -> int:  # fmt: skip
    """Read a group of `size` numbers, which is one for most encodings, into `part`; return the place after it."""
    if encoding == 1:
        part[0], at = unsigned(data, at, end)
    elif encoding == 3:
        value, at = unsigned(data, at, end)
        part[0] = -extended(value, 14)
    elif encoding in (7, 10):
        at = three(data, at, end, encoding == 10, part)
    elif encoding == 8:
        at = four(data, at, end, version, part)
    elif encoding == 9:
        part[0] = 0
    elif size == 1:
        part[0], at = signed_vb(data, at, end)
    elif at >= end:
        at = end + 1
    else:  # behind a byte that tells which are not zero
        there, at = int(data[at]), at + 1
        for i in range(size):
            part[i] = 0
            if there >> i & 1:
                part[i], at = signed_vb(data, at, end)
    return at


def decode(
    data: Bytes, at: int, end: int, kind: int, fields: Integers, setup: Integers, state: Integers, now: Integers,
    before: Integers, earlier: Integers, home: Integers, part: Integers,
) -> int:  # fmt: skip
    """Read the fields of a frame into `now`; return the place after it, beyond `end` where it is cut.

    fields = number of fields; then predictor, encoding and sign of each, by rows
    """
    count, k = fields[kind, 0, 0], 0
    predictors, encodings, signs = fields[kind, 1], fields[kind, 2], fields[kind, 3]
    while k < count and at <= end:
        encoding, size = encodings[k], 1
        if predictors[k] == 6:  # always one more; nothing is stored
            left_out = skipped(state[LAST_ITERATION], setup[I_STEP], setup[P_COUNT], setup[P_STEP])
            now[k] = wrapped(before[k] + 1 + left_out, signs[k])
            k += 1
            continue
        most = 8 if encoding == 6 else 1
        while size < most and k + size < count and encodings[k + size] == encoding:
            size += 1
        if encoding in (7, 10):
            size = 3
        elif encoding == 8:
            size = 4
        at = read_group(data, at, end, encoding, size, setup[VERSION], part)
        for i in range(min(size, count - k)):
            guess = predicted(predictors[k + i], k + i, kind, setup, state, now, before, earlier, home)
            now[k + i] = wrapped(part[i] + guess, signs[k + i])
        k += size
    return at


def follows(iteration: int, time: int, last_iteration: int, last_time: int) -> bool:
    """Return whether a frame can be the next one after another."""
    return 0 <= iteration - last_iteration < MAX_ITERATIONS and 0 <= time - last_time < MAX_MICROSECONDS


def unrolled(stamp: int, state: Integers) -> int:
    """Return a time of 32 bits as one that goes on after 71 minutes."""
    if state[STARTED]:
        last = state[LAST_TIME] & 0xFFFFFFFF
        if stamp < last and (stamp - last) & 0xFFFFFFFF < MAX_MICROSECONDS:
            state[ROLLED] += 1 << 32
    return int(stamp + state[ROLLED])


def accept(kind: int, now: Integers, setup: Integers, state: Integers) -> bool:
    """Return whether a main frame goes on where the last one ended; an I frame also where the one before it agrees."""
    if kind == P and not state[VALID]:
        state[UNUSABLE] += 1
        return False
    rolled = state[ROLLED]
    now[setup[TIME]] = unrolled(now[setup[TIME]] & 0xFFFFFFFF, state)
    iteration = int(now[setup[ITERATION]]) if setup[ITERATION] >= 0 else 0
    time = int(now[setup[TIME]])
    known = follows(iteration, time, state[LAST_ITERATION], state[LAST_TIME])
    if kind == I and not known:
        known = not state[STARTED] or (
            state[HAS_CANDIDATE] and follows(iteration, time, state[NEXT_ITERATION], state[NEXT_TIME])
        )
        state[HAS_CANDIDATE], state[NEXT_ITERATION], state[NEXT_TIME] = 1, iteration, time
    if not known:
        state[ROLLED] = rolled
        state[VALID] = 0
        state[UNUSABLE] += 1
        return False
    if kind == I:
        state[HAS_CANDIDATE] = 0
    state[VALID], state[STARTED], state[LAST_ITERATION], state[LAST_TIME] = 1, 1, iteration, time
    return True


def kind_of(letter: int) -> int:
    """Return the kind of a frame by its letter: 5 for an event, -1 for none."""
    if letter == 73:
        return I
    if letter == 80:
        return P
    if letter == 83:
        return S
    if letter == 71:
        return G
    if letter == 72:
        return H
    return 5 if letter == 69 else -1


def event(data: Bytes, at: int, end: int, state: Integers, goodbye: Bytes) -> int:
    """Read an event; return the place after it, beyond `end` where it is cut or unknown."""
    if at >= end:
        return end + 1
    kind, at = int(data[at]), at + 1
    if kind in (0, 15, 40):  # beep, disarm, failure of the IMU
        return unsigned(data, at, end)[1]
    if kind in (14, 30):  # resumed: iteration and time; flight mode: new and old
        first, at = unsigned(data, at, end)
        second, at = unsigned(data, at, end)
        if kind == 14 and at <= end:
            state[HAS_CANDIDATE], state[NEXT_ITERATION], state[NEXT_TIME] = 1, first, unrolled(second, state)
        return at
    if kind == 13:  # adjustment in flight
        if at >= end:
            return end + 1
        return at + 5 if data[at] > 127 else signed_vb(data, at + 1, end)[1]
    if kind == 255 and at + goodbye.size <= end:
        for i in range(goodbye.size):
            if data[at + i] != goodbye[i]:
                return end + 1
        state[ENDED] = 1
        return at + goodbye.size
    return end + 1


def skip(start: int, data: Bytes, state: Integers, gaps: Integers) -> int:
    """Return the place of the next letter of a frame, and note the damage before it."""
    at = start + 1
    while at < data.size and kind_of(int(data[at])) < 0:
        at += 1
    last = min(state[GAPS], gaps.shape[0]) - 1
    if last >= 0 and gaps[last, 1] == start:
        gaps[last, 1] = at
    else:
        if last + 1 < gaps.shape[0]:
            gaps[last + 1, 0], gaps[last + 1, 1] = start, at
        state[GAPS] += 1
    state[GAP_BYTES] += at - start
    state[VALID] = 0
    return at


def keep(
    kind: int, setup: Integers, state: Integers, history: Integers, rows: Integers, out: Integers
) -> None:
    """Add a whole frame to the rows, and to what the next ones are predicted by."""
    now, before, earlier, home = history[0], history[1], history[2], history[3]
    place = I if kind == P else kind
    if place == I:
        if not accept(kind, now, setup, state):
            return
        for i in range(now.size):
            earlier[i] = before[i] if kind == P else now[i]
            before[i] = now[i]
    if kind == H:
        for i in range(now.size):
            home[i] = now[i]
        state[HAS_HOME] = 1
    if not state[VALID]:  # its time is that of the main frame before it
        state[UNUSABLE] += 1
        return
    if kind == G and setup[HOME] >= 0 and not state[HAS_HOME]:
        state[NO_HOME] += 1
        return
    for i in range(now.size):
        out[place, rows[place], i + 1] = now[i]
    out[place, rows[place], 0] = state[LAST_TIME]
    if kind == G and setup[GPS_TIME] >= 0:
        out[place, rows[place], 0] = unrolled(now[setup[GPS_TIME]] & 0xFFFFFFFF, state)
    rows[place] += 1


def walk(
    at: int, data: Bytes, fields: Integers, setup: Integers, state: Integers, history: Integers, part: Integers,
    goodbye: Bytes, gaps: Integers, rows: Integers, out: Integers,
) -> int:  # fmt: skip
    """Decode frames until `out` has no room for another, or to the end; return where to go on.

    history = what is read, main frame before, the one before that, home; rows = rows of each kind that are filled
    """
    now, before, earlier, home = history[0], history[1], history[2], history[3]
    while at < data.size and not state[ENDED] and np.max(rows) < out.shape[1]:
        kind, start, after = kind_of(int(data[at])), at, data.size + 1
        limit = min(data.size, start + 1 + MAX_FRAME)
        if kind == 5:
            after = event(data, start + 1, limit, state, goodbye)
        elif kind >= 0 and fields[kind, 0, 0] > 0:
            after = decode(
                data, start + 1, limit, kind, fields, setup, state, now, before, earlier, home, part
            )
        if after <= limit and (after == data.size or state[ENDED] or kind_of(int(data[after])) >= 0):
            at = after
            if kind < 5:
                keep(kind, setup, state, history, rows, out)
            continue
        if kind >= 0 and limit == data.size and after > limit and state[CUT] < 0:
            state[CUT] = start
        at = skip(start, data, state, gaps)
    return at
