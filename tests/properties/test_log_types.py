"""Every type of a number in DataFlash, ULog and Crazyflie logs at its limits, in bytes by `struct`.

The same bytes are read by pymavlink (DataFlash) and pyulog (ULog); the letters of Crazyflie logs are those of `struct`.
"""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from stoop.logs import crazyflie, dataflash, read

FLOATS = {"e": (-65504.0, 6.103515625e-05), "f": (-3.4028234663852886e38, 1.1754943508222875e-38),
          "d": (-1.7976931348623157e308, 2.2250738585072014e-308)}  # fmt: skip


def limits(code: str) -> tuple[float, float]:
    if code in FLOATS:
        return FLOATS[code]
    bits = 8 * struct.calcsize("<" + code)
    return (0, 2**bits - 1) if code.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


#: ArduPilot, libraries/AP_Logger/LogStructure.h: letter -> C type as a letter of `struct`, and its divisor
DATAFLASH = {
    "b": ("b", 1), "B": ("B", 1), "h": ("h", 1), "H": ("H", 1), "i": ("i", 1), "I": ("I", 1), "q": ("q", 1), "Q": ("Q", 1),
    "f": ("f", 1), "d": ("d", 1), "g": ("e", 1), "c": ("h", 100), "C": ("H", 100), "e": ("i", 100), "E": ("I", 100),
    "L": ("i", 10**7), "M": ("B", 1), "a": ("32h", 1), "n": ("4s", 1), "N": ("16s", 1), "Z": ("64s", 1),
}  # fmt: skip


def dataflash_log() -> bytes:
    log, form = b"", "<2B4s16s64s"
    layouts = [(128, 3 + struct.calcsize(form), b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")]
    for kind, (letter, (code, _)) in enumerate(DATAFLASH.items(), 1):
        size = 3 + struct.calcsize(f"<Q{code}H")
        layouts.append((kind, size, f"K{kind}".encode(), f"Q{letter}H".encode(), b"TimeUS,x,after"))
    for layout in layouts:
        log += b"\xa3\x95\x80" + struct.pack(form, *layout)
    for kind, (code, _) in enumerate(DATAFLASH.values(), 1):
        for time, value in zip((10_000_000, 20_000_000), dataflash_values(code), strict=True):
            log += b"\xa3\x95" + struct.pack(f"<BQ{code}H", kind, time, *value, 513)
    return log


def dataflash_values(code: str) -> tuple[tuple[object, ...], tuple[object, ...]]:
    if code == "32h":
        return (*range(-16, 16),), (*range(32767, 32735, -1),)
    if code.endswith("s"):
        return (b"ab",), (b"c" * int(code[:-1]),)
    least, most = limits(code)
    return (least,), (most,)


def test_every_letter_of_dataflash(tmp_path: Path) -> None:
    from pymavlink.DFReader import DFReader_binary

    assert set(DATAFLASH) == set(dataflash.TYPES)
    (tmp_path / "a.bin").write_bytes(dataflash_log())
    ours = read(tmp_path / "a.bin")
    assert ours.defects == ()
    theirs: dict[str, list[object]] = {}
    with DFReader_binary(str(tmp_path / "a.bin"), True) as reader:
        while (message := reader.recv_msg()) is not None:
            theirs.setdefault(message.get_type(), []).append(message)
    for kind, (letter, (code, divisor)) in enumerate(DATAFLASH.items(), 1):
        stream = ours.streams[f"K{kind}"]
        assert stream.time.tolist() == [10.0, 20.0], letter
        expected = dataflash_values(code)
        assert stream.columns["after"].tolist() == [513.0, 513.0], letter
        if code.endswith("s"):  # a text is no channel, but has its width
            assert {*stream.columns} == {"after"}, letter
            continue
        names = ["x"] if len(expected[0]) == 1 else [f"x[{k}]" for k in range(32)]
        found = np.column_stack([stream.columns[n] for n in names])
        wanted = np.divide(np.array(expected, float), divisor)
        np.testing.assert_allclose(found, wanted, rtol=1e-15, err_msg=letter)
        if letter != "M":  # a signed number in pymavlink
            for row, message in zip(found, theirs[f"K{kind}"], strict=True):
                np.testing.assert_allclose(row, np.ravel(message.x), rtol=1e-15, err_msg=letter)  # type: ignore[attr-defined]


#: docs.px4.io/main/en/dev_log/ulog_file_format.html: type -> letter of `struct`
ULOG = {
    "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i", "uint32_t": "I", "int64_t": "q",
    "uint64_t": "Q", "float": "f", "double": "d", "bool": "?", "char": "c",
}  # fmt: skip


def ulog() -> bytes:
    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<Hc", len(body), kind) + body

    log = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message(b"B", bytes(40))
    inner = "inner:" + "".join(f"{t} {t}_a;" for t in ULOG)
    fields = "".join(f"{t} {t}_b;{t}[2] {t}_c;" for t in ULOG)
    every = f"all:uint64_t timestamp;{fields}inner[2] d;"
    log += message(b"F", inner.encode()) + message(b"F", every.encode())
    log += message(b"A", struct.pack("<BH", 0, 7) + b"all")
    for k, time in enumerate((10_000_000, 20_000_000)):
        body = struct.pack("<HQ", 7, time)
        body += b"".join(struct.pack(f"<3{code}", *[ulog_values(code)[k]] * 3) for code in ULOG.values())
        body += 2 * b"".join(struct.pack(f"<{code}", ulog_values(code)[k]) for code in ULOG.values())
        log += message(b"D", body)
    return log


def ulog_values(code: str) -> tuple[object, object]:
    return {"?": (False, True), "c": (b"a", b"z")}.get(code) or limits(code)


def test_every_type_of_ulog(tmp_path: Path) -> None:
    from pyulog import ULog

    (tmp_path / "a.ulg").write_bytes(ulog())
    ours = read(tmp_path / "a.ulg")
    assert ours.defects == ()
    stream = ours.streams["all"]
    (theirs,) = ULog(str(tmp_path / "a.ulg")).data_list
    assert stream.time.tolist() == [10.0, 20.0]
    assert {*stream.columns} == {*theirs.data} - {"timestamp"}
    for kind, code in ULOG.items():
        wanted = [float(v[0] if isinstance(v, bytes) else v) for v in ulog_values(code)]  # type: ignore[arg-type]
        for name in (f"{kind}_b", f"{kind}_c[0]", f"{kind}_c[1]", f"d[0].{kind}_a", f"d[1].{kind}_a"):
            assert stream.columns[name].tolist() == wanted, name
            assert stream.columns[name].tolist() == theirs.data[name].astype(float).tolist(), name


@pytest.mark.parametrize(("version", "clock", "second"), [(1, "I", 1000), (2, "Q", 1_000_000)])
def test_every_letter_of_crazyflie(version: int, clock: str, second: int, tmp_path: Path) -> None:
    """Bitcraze, "uSD-card log format": the letters are those of Python's struct; at the end the CRC-32 of all before."""
    letters = "bBhHiIqQefd"
    assert set(letters) == set(crazyflie.TYPES)
    log = b"\xbc" + struct.pack("<HHH", version, 1, 9) + b"all\0" + struct.pack("<H", len(letters))
    log += b"".join(f"{k}.x({code})".encode() + b"\0" for k, code in enumerate(letters))
    for k in (0, 1):
        row = [limits(code)[k] for code in letters]
        log += struct.pack(f"<H{clock}{letters}", 9, 10 * (k + 1) * second, *row)
    (tmp_path / "log00").write_bytes(log + struct.pack("<I", zlib.crc32(log)))
    ours = read(tmp_path / "log00")
    assert ours.defects == ()
    assert ours.streams["all"].time.tolist() == [10.0, 20.0]
    found = {name: column.tolist() for name, column in ours.streams["all"].columns.items()}
    assert found == {f"{k}.x": [*map(float, limits(code))] for k, code in enumerate(letters)}
