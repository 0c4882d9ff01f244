"""Walk over the messages of a ULog: where the rows of topics are, and where messages go on after damage.

Plain functions over arrays of bytes and numbers, in the part of Python that Numba compiles too
(`stoop.logs.compiled`). Every index is checked against ``end`` before it is used, and each turn of each loop advances by
a byte at least.

A message begins with three bytes: size of the body (uint16, little-endian) and kind (a letter).

References
----------
.. [1] PX4 ULog file format, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from typing import Any

# why a walk returns: the next message may end beyond the buffer; the end was reached exactly; the last message
# ends beyond the end; no message can begin here; a message that the caller handles; no room in the list of rows
MORE, DONE, CUT, DAMAGE, EVENT, FULL = range(6)

# how a message is classified: no message; possible by its header; certain; of a kind that came after this was
# written; longer than what is there
INVALID, POSSIBLE, CERTAIN, NEW_KIND, TOO_LONG = range(5)

HEADER = 3  #: bytes
LOOKAHEAD = 4 * (HEADER + 65535)  #: bytes that classifying a message can take; a body has 65535 at most
CHAIN = 3  #: consecutive messages that are no coincidence
TEXT = 4096  #: bytes of a body at most where its length cannot be checked; a text for the pilot has 127

# counts over the whole file, in an array of int64: dropouts, rows of topics that were not added, and messages of
# unknown kinds, each with the place of the first behind it; then ms lost in dropouts
DROPOUTS, UNKNOWN_TOPICS, UNKNOWN_KINDS, LOST_MS, COUNTS = 0, 2, 4, 6, 7

KINDS = (65, 66, 67, 68, 70, 73, 76, 77, 79, 80, 81, 82, 83)  #: ABCDFILMOPQRS
SYNC = (0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12)


def is_name(buffer: Any, at: int, count: int, end: int) -> bool:
    """Return whether a name or type can begin here: small letters, digits, underscores, colon, as far as there are bytes."""
    for i in range(at, min(at + count, end)):
        byte = int(buffer[i])
        if not (97 <= byte <= 122 or 48 <= byte <= 58 or byte == 95):
            return False
    return True


def is_time(buffer: Any, at: int, end: int) -> bool:
    """Return whether these eight bytes can be a time in us: less than two thousand years."""
    return at + 8 > end or int(buffer[at + 7]) == 0


def data_level(buffer: Any, at: int, size: int, end: int, low: Any, high: Any) -> int:
    """Classify the header of a message of data by the topic it names."""
    if size < 2 or at + 5 > end:
        return 1 if size >= 10 else 0
    topic = int(buffer[at + 3]) | (int(buffer[at + 4]) << 8)
    if high[topic] == 0:
        return 1 if 10 <= size <= TEXT and is_time(buffer, at + 5, end) else 0
    return 2 if low[topic] <= size - 2 <= high[topic] else 0


def sync_level(buffer: Any, at: int, size: int, end: int) -> int:
    """Classify a message of synchronization, whose body is always the same."""
    if size != 8:
        return 0
    if at + 11 > end:
        return 1
    for i in range(8):
        if int(buffer[at + 3 + i]) != SYNC[i]:
            return 0
    return 2


def key_level(buffer: Any, at: int, size: int, end: int, before: int) -> int:
    """Classify a message whose body is `before` bytes, length of the key, key, value."""
    if size < before + 6:
        return 0
    if at + 4 + before > end:
        return 1
    length = int(buffer[at + 3 + before])
    return 1 if 5 <= length < size - before and is_name(buffer, at + 4 + before, 3, end) else 0


def level(buffer: Any, at: int, end: int, low: Any, high: Any) -> int:
    """Classify the header at a place: 0 cannot be one, 1 may be one, 2 is one.

    Parameters
    ----------
    buffer : (n,) uint8
    at, end : place of the header, at + 3 <= end, and end of what is there
    low, high : (65536,) int32, bytes of data that a message of a topic has; high is 0 for an unknown topic
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
    # L, text; C, text with a tag: the level, a digit, then a time before the text
    if kind == 76 or kind == 67:
        least = 9 if kind == 76 else 11
        levelled = at + 4 > end or 48 <= int(buffer[at + 3]) <= 55
        sound = least <= size <= TEXT and levelled
        return 1 if sound and is_time(buffer, at + HEADER + least - 8, end) else 0
    if kind == 79 or kind == 82:  # O, dropout; R, remove a topic
        return 1 if size == 2 else 0
    if kind == 65:  # A, add a topic
        return 1 if 4 <= size <= TEXT and is_name(buffer, at + 6, min(size - 3, 3), end) else 0
    if kind == 70:  # F, format
        return 1 if size >= 4 and is_name(buffer, at + 3, 3, end) else 0
    return 1 if kind == 66 and size >= 40 else 0  # B, flags


def is_chain(buffer: Any, at: int, end: int, low: Any, high: Any) -> bool:
    """Return whether messages begin here: `CHAIN` consecutive ones, or fewer up to the end with a certain one."""
    certain = 0
    for n in range(CHAIN):
        if at == end:
            return certain > 0 or n > 1
        if at + HEADER > end:
            return certain > 0
        found = level(buffer, at, end, low, high)
        size = int(buffer[at]) | (int(buffer[at + 1]) << 8)
        if found == 0 or (found == 1 and size > TEXT):
            return False
        at += HEADER + size
        if at > end:
            return certain > 0
        certain += found - 1
    return True


def seek(buffer: Any, at: int, stop: int, end: int, low: Any, high: Any) -> int:
    """Return the first place of at .. stop where messages begin; stop where there is none."""
    while at < stop and at + HEADER <= end:
        if 65 <= buffer[at + 2] <= 83 and is_chain(buffer, at, end, low, high):
            return at
        at += 1
    return stop


def classify(buffer: Any, at: int, after: int, end: int, low: Any, high: Any) -> int:
    """Classify the message at a place by what follows it; see `INVALID` to `TOO_LONG`."""
    found = level(buffer, at, end, low, high)
    if found == 0:
        kind = int(buffer[at + 2])
        for known in KINDS:
            if kind == known:
                return INVALID
        letter = 65 <= kind <= 90 or 97 <= kind <= 122
        return NEW_KIND if letter and after <= end and is_chain(buffer, after, end, low, high) else INVALID
    if after > end:
        return TOO_LONG
    if found == 1 and after + HEADER <= end and level(buffer, after, end, low, high) == 0:
        # no message follows: it is none if one begins inside it
        return POSSIBLE if seek(buffer, at + 1, after, end, low, high) == after else INVALID
    return CERTAIN if found == 2 else POSSIBLE


def count(counts: Any, which: int, place: int) -> None:
    """Count something, and note the place of the first."""
    if counts[which] == 0:
        counts[which + 1] = place
    counts[which] += 1


def walk(
    buffer: Any, at: int, end: int, final: bool, offset: int, handled: Any, low: Any, high: Any, slots: Any,
    places: Any, owners: Any, listed: int, counts: Any,
) -> tuple[int, int, int]:  # fmt: skip
    """Step from message to message and list where the rows of wanted topics are.

    Parameters
    ----------
    buffer : (n,) uint8
    at, end : where the next message begins, and the end of what is there
    final : nothing comes after the end
    offset : place of the buffer in the file
    handled : (256,) uint8, 1 for kinds that the caller handles
    low, high : see `level`
    slots : (65536,) int32, number of the stream to which a topic belongs, -1 for one that is not wanted
    places, owners : (m,) int64 and int32, where a row begins, and its stream; written from `listed` on
    listed : rows in the list
    counts : (COUNTS,) int64

    Returns
    -------
    where it stopped, rows in the list, why
    """
    margin = HEADER if final else LOOKAHEAD
    while at + margin <= end:
        kind = int(buffer[at + 2])
        after = at + HEADER + (int(buffer[at]) | (int(buffer[at + 1]) << 8))
        # nearly all messages are rows, and nearly all of those are sound
        if kind == 68 and at + 5 < after <= end:
            topic = int(buffer[at + 3]) | (int(buffer[at + 4]) << 8)
            if low[topic] <= after - at - 5 <= high[topic]:
                if slots[topic] >= 0:
                    if listed == len(places):
                        return at, listed, FULL
                    places[listed] = at + 5
                    owners[listed] = slots[topic]
                    listed += 1
                at = after
                continue
        found = classify(buffer, at, after, end, low, high)
        if found in (INVALID, TOO_LONG):
            return at, listed, CUT if found == TOO_LONG else DAMAGE
        if found != NEW_KIND and handled[kind]:
            return at, listed, EVENT
        if found == NEW_KIND:
            count(counts, UNKNOWN_KINDS, offset + at)
        elif kind == 68:
            count(counts, UNKNOWN_TOPICS, offset + at)
        elif kind == 79:
            count(counts, DROPOUTS, offset + at)
            counts[LOST_MS] += int(buffer[at + 3]) | (int(buffer[at + 4]) << 8)
        at = after
    if not final:
        return at, listed, MORE
    return at, listed, DONE if at == end else CUT


def gather(buffer: Any, places: Any, owners: Any, listed: int, widths: Any, cursors: Any, out: Any) -> int:
    """Copy the rows of the list, each behind the last one of its stream, and return the bytes copied.

    Parameters
    ----------
    buffer : (n,) uint8
    places, owners : where a row begins, and its stream
    listed : rows in the list
    widths : (s,) int64, bytes of a row of a stream
    cursors : (s,) int64, where the next row of a stream goes; advanced
    out : (n,) uint8
    """
    total = 0
    for i in range(listed):
        stream = int(owners[i])
        width = int(widths[stream])
        to = int(cursors[stream])
        at = int(places[i])
        out[to : to + width] = buffer[at : at + width]
        cursors[stream] = to + width
        total += width
    return total
