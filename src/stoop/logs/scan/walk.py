"""ULog headers, one after the other: which messages there are, and where to go on after damage.

Plain functions over arrays of bytes and numbers, in the part of Python that Numba compiles too
(`stoop.logs.scan.compiled`). Every index is held against ``end`` before it is used: what a header claims is
believed only as far as there are bytes. Each turn of each loop goes on by a byte at least.

A header is three bytes: size of the body (uint16, little-endian) and kind (a letter).

References
----------
.. [1] PX4 ULog file format, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from typing import Any

# Reasons to come back to the caller
MORE = 0  #: the next message may end beyond the buffer
DONE = 1  #: the end was reached, exactly
CUT = 2  #: the last message ends beyond the end
DAMAGE = 3  #: no message can begin here
EVENT = 4  #: a message that the caller handles
FULL = 5  #: no room for the next place in the list

HEADER = 3
BODY = 65535  #: bytes of a body at most
LOOKAHEAD = 4 * (HEADER + BODY)  #: bytes that judging a header can take
CHAIN = 3  #: messages in a row that are no accident
TEXT = (
    4096  #: bytes that a body takes at most where its length cannot be checked; a text for the pilot has 127
)

# Sums over the whole file, in an array of int64
DROPOUTS = 0  #: how many; the place of the first is next to it
STRANGERS = 2  #: rows of topics unheard of; likewise
UNKNOWN = 4  #: messages of kinds unheard of; likewise
DROPPED = 6  #: ms lost in dropouts
SUMS = 7

# Verdicts about a message
ILL, LIKELY, SURE, NEW, BEYOND = 0, 1, 2, 3, 4

KINDS = (65, 66, 67, 68, 70, 73, 76, 77, 79, 80, 81, 82, 83)  #: ABCDFILMOPQRS
FIRST, LAST = 65, 83

SYNC = (0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12)


def named(buffer: Any, at: int, count: int, end: int) -> bool:
    """Tell whether a name or type can begin here: small letters, digits, underscores, colon, as far as there are bytes."""
    for i in range(at, min(at + count, end)):
        byte = int(buffer[i])
        if not (97 <= byte <= 122 or 48 <= byte <= 58 or byte == 95):
            return False
    return True


def timely(buffer: Any, at: int, end: int) -> bool:
    """Tell whether these eight bytes can be a time in us: less than two thousand years."""
    return at + 8 > end or int(buffer[at + 7]) == 0


def data_level(buffer: Any, at: int, size: int, end: int, low: Any, high: Any) -> int:
    """Judge the header of a message of data by the topic it names."""
    if size < 2 or at + 5 > end:
        return 1 if size >= 10 else 0
    topic = int(buffer[at + 3]) | (int(buffer[at + 4]) << 8)
    if high[topic] == 0:
        return 1 if 10 <= size <= TEXT and timely(buffer, at + 5, end) else 0
    return 2 if low[topic] <= size - 2 <= high[topic] else 0


def sync_level(buffer: Any, at: int, size: int, end: int) -> int:
    """Judge a message that is there to be found."""
    if size != 8:
        return 0
    if at + 11 > end:
        return 1
    for i in range(8):
        if int(buffer[at + 3 + i]) != SYNC[i]:
            return 0
    return 2


def key_level(buffer: Any, at: int, size: int, end: int, before: int) -> int:
    """Judge a message whose body is bytes before, length of the key, key, value."""
    if size < before + 6:
        return 0
    if at + 4 + before > end:
        return 1
    length = int(buffer[at + 3 + before])
    return 1 if 5 <= length < size - before and named(buffer, at + 4 + before, 3, end) else 0


def text_level(buffer: Any, at: int, size: int, end: int, least: int) -> int:
    """Judge a message for the pilot: its first byte is its importance, a digit, and its last before the text a time."""
    if not least <= size <= TEXT:
        return 0
    grave = at + 4 > end or 48 <= int(buffer[at + 3]) <= 55
    return 1 if grave and timely(buffer, at + HEADER + least - 8, end) else 0


def level(buffer: Any, at: int, end: int, low: Any, high: Any) -> int:
    """Judge the header at a place: 0 cannot be one, 1 may be one, 2 is one.

    Parameters
    ----------
    buffer : (n,) uint8
    at, end : place of the header, at + 3 <= end, and end of what is there
    low, high : (65536,) int32, bytes of data that a message of a topic has; high is 0 for a topic unheard of
    """
    size = int(buffer[at]) | (int(buffer[at + 1]) << 8)
    kind = int(buffer[at + 2])
    if kind == 68:  # D, data
        return data_level(buffer, at, size, end, low, high)
    if kind == 83:  # S, synchronization
        return sync_level(buffer, at, size, end)
    if kind == 73 or kind == 80:  # I, information; P, parameter
        return key_level(buffer, at, size, end, 0)
    if kind == 77 or kind == 81:  # M, information in parts; Q, default of a parameter
        return key_level(buffer, at, size, end, 1)
    if kind == 76 or kind == 67:  # L, text; C, text with a tag
        return text_level(buffer, at, size, end, 9 if kind == 76 else 11)
    return short_level(buffer, at, size, kind, end)


def short_level(buffer: Any, at: int, size: int, kind: int, end: int) -> int:
    """Judge the header of the other kinds."""
    if kind == 79 or kind == 82:  # O, dropout; R, remove a topic
        return 1 if size == 2 else 0
    if kind == 65:  # A, add a topic
        return 1 if 4 <= size <= TEXT and named(buffer, at + 6, min(size - 3, 3), end) else 0
    if kind == 70:  # F, format
        return 1 if size >= 4 and named(buffer, at + 3, 3, end) else 0
    return 1 if kind == 66 and size >= 40 else 0  # B, flags


def chained(buffer: Any, at: int, end: int, low: Any, high: Any) -> bool:
    """Tell whether messages begin here: so many in a row, or fewer up to the end, that it is no accident."""
    sure = 0
    for n in range(CHAIN):
        if at == end:
            return sure > 0 or n > 1
        if at + HEADER > end:
            return sure > 0
        found = level(buffer, at, end, low, high)
        size = int(buffer[at]) | (int(buffer[at + 1]) << 8)
        if found == 0 or (found == 1 and size > TEXT):
            return False
        at += HEADER + size
        if at > end:
            return sure > 0
        sure += found - 1
    return True


def seek(buffer: Any, at: int, stop: int, end: int, low: Any, high: Any) -> int:
    """Return the first place of at .. stop where messages begin; stop where there is none."""
    while at < stop and at + HEADER <= end:
        if FIRST <= buffer[at + 2] <= LAST and chained(buffer, at, end, low, high):
            return at
        at += 1
    return stop


def follows(buffer: Any, at: int, after: int, end: int, low: Any, high: Any) -> bool:
    """Tell whether a message that may be one is one: another follows, or none begins inside it."""
    if after + HEADER > end or level(buffer, after, end, low, high) > 0:
        return True
    return seek(buffer, at + 1, after, end, low, high) == after


def invented(buffer: Any, at: int, after: int, end: int, low: Any, high: Any) -> bool:
    """Tell whether this is a message of a kind that came after this was written: messages go on behind it."""
    kind = int(buffer[at + 2])
    if not (65 <= kind <= 90 or 97 <= kind <= 122) or after > end:
        return False
    for known in KINDS:
        if kind == known:
            return False
    return chained(buffer, after, end, low, high)


def judge(buffer: Any, at: int, after: int, end: int, low: Any, high: Any) -> int:
    """Judge the message at a place with what comes behind it; see `ILL` to `BEYOND`."""
    found = level(buffer, at, end, low, high)
    if found == 0:
        return NEW if invented(buffer, at, after, end, low, high) else ILL
    if after > end:
        return BEYOND
    if found == 1 and not follows(buffer, at, after, end, low, high):
        return ILL
    return SURE if found == 2 else LIKELY


def note(sums: Any, which: int, place: int) -> None:
    """Count something, and remember where it was met first."""
    if sums[which] == 0:
        sums[which + 1] = place
    sums[which] += 1


def remark(buffer: Any, at: int, offset: int, verdict: int, sums: Any) -> None:
    """Count a message that is neither a sound row nor for the caller."""
    kind = int(buffer[at + 2])
    if verdict == NEW:
        note(sums, UNKNOWN, offset + at)
    elif kind == 68:
        note(sums, STRANGERS, offset + at)
    elif kind == 79:
        note(sums, DROPOUTS, offset + at)
        sums[DROPPED] += int(buffer[at + 3]) | (int(buffer[at + 4]) << 8)


def walk(
    buffer: Any, at: int, end: int, final: bool, offset: int, loud: Any, low: Any, high: Any, slots: Any,
    places: Any, owners: Any, count: int, sums: Any,
) -> tuple[int, int, int]:  # fmt: skip
    """Go from message to message, listing where the rows of wanted topics are.

    Parameters
    ----------
    buffer : (n,) uint8
    at, end : where the next message begins, and the end of what is there
    final : nothing comes after the end
    offset : place of the buffer in the file
    loud : (256,) uint8, 1 for kinds that the caller handles
    low, high : see `level`
    slots : (65536,) int32, number of the stream to which a topic belongs, -1 for one that is not wanted
    places, owners : (m,) int64 and int32, where a row begins, and its stream; written from `count` on
    count : rows in the list
    sums : (SUMS,) int64

    Returns
    -------
    where it stopped, rows in the list, why
    """
    margin = HEADER if final else LOOKAHEAD
    while at + margin <= end:
        kind = int(buffer[at + 2])
        after = at + HEADER + (int(buffer[at]) | (int(buffer[at + 1]) << 8))
        if (
            kind == 68 and at + 5 < after <= end
        ):  # nearly all messages are rows, and nearly all of those are sound
            topic = int(buffer[at + 3]) | (int(buffer[at + 4]) << 8)
            if low[topic] <= after - at - 5 <= high[topic]:
                if slots[topic] >= 0:
                    if count == len(places):
                        return at, count, FULL
                    places[count] = at + 5
                    owners[count] = slots[topic]
                    count += 1
                at = after
                continue
        verdict = judge(buffer, at, after, end, low, high)
        if verdict in (ILL, BEYOND):
            return at, count, CUT if verdict == BEYOND else DAMAGE
        if verdict != NEW and loud[kind]:
            return at, count, EVENT
        remark(buffer, at, offset, verdict, sums)
        at = after
    if not final:
        return at, count, MORE
    return at, count, DONE if at == end else CUT


def gather(buffer: Any, places: Any, owners: Any, count: int, widths: Any, cursors: Any, out: Any) -> int:
    """Copy the rows listed, each to where its stream's rows are gathered.

    Parameters
    ----------
    buffer : (n,) uint8
    places, owners : where a row begins, and its stream
    count : rows in the list
    widths : (s,) int64, bytes of a row of a stream
    cursors : (s,) int64, where the next row of a stream goes; moved on
    out : (n,) uint8

    Returns
    -------
    bytes copied
    """
    total = 0
    for i in range(count):
        stream = int(owners[i])
        width = int(widths[stream])
        to = int(cursors[stream])
        at = int(places[i])
        out[to : to + width] = buffer[at : at + width]
        cursors[stream] = to + width
        total += width
    return total
