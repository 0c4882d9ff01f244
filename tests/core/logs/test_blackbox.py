"""Blackbox logs: bytes as they are published, an independent decoder, and damage anywhere."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from stoop.errors import LogError
from stoop.logs import blackbox, read
from stoop.logs import blackbox_walk as walk
from stoop.logs.blackbox import parse_blackbox
from stoop_plan import blackbox_bytes as writer
from stoop_plan.blackbox_bytes import Field, Rows, blackbox_bytes

PATH = Path("flight.bbl")
N = 100
HEADER = {"minthrottle": 1070, "maxthrottle": 2000, "vbatref": 2466, "motorOutput": "158,2047", "acc_1G": 2048,
          "motor_poles": 14, "Firmware revision": "Betaflight 4.5.1 (77d01ba3b) STM32F7X2", "Craft name": "test"}  # fmt: skip

FIELDS = (
    Field("loopIteration", False, 0, 1, 6, 9),
    Field("time", False, 0, 1, 2, 0),
    *(Field(f"axisI[{k}]", True, 0, 0, 1, 0) for k in range(3)),
    *(Field(f"rcCommand[{k}]", True, 0, 0, 1, 0) for k in range(4)),
    Field("vbatLatest", False, writer.VBATREF, writer.NEG_14BIT, 1, writer.TAG8_8SVB),
    Field("amperageLatest", True, 0, 0, 1, writer.TAG8_8SVB),
    *(Field(f"gyroADC[{k}]", True, 0, 0, writer.AVERAGE_2) for k in range(3)),
    *(Field(f"accSmooth[{k}]", True, 0, 0, writer.AVERAGE_2) for k in range(3)),
    Field("motor[0]", False, writer.MINMOTOR, 1, writer.AVERAGE_2),
    *(Field(f"motor[{k}]", False, writer.MOTOR_0, 0, writer.AVERAGE_2) for k in range(1, 4)),
    *(Field(f"eRPM[{k}]", False, 0, 1, 1, 0) for k in range(4)),
)  #: as Betaflight has them


def numbers(n: int = N, seed: int = 1) -> dict[str, npt.NDArray[Any]]:
    rng = np.random.default_rng(seed)
    values = {f.name: rng.integers(-3000, 3000, n) // rng.choice([1, 100, 1000, 3000], n) for f in FIELDS}
    values |= {f"motor[{k}]": rng.integers(158, 2048, n) for k in range(4)}
    values |= {f"eRPM[{k}]": rng.integers(0, 3000, n) for k in range(4)}
    values["vbatLatest"] = 2466 - rng.integers(0, 300, n)
    time = 5_000_000 + 1000 * np.arange(n) + rng.integers(0, 9, n)
    return values | {"loopIteration": np.arange(n), "time": time}


def log(n: int = N, seed: int = 1) -> bytes:
    return blackbox_bytes(FIELDS, numbers(n, seed), HEADER, satellites(n))


def satellites(n: int) -> dict[str, Rows]:
    after = np.arange(0, n, 10)
    home = {"GPS_home[0]": np.array([474_000_000]), "GPS_home[1]": np.array([85_000_000])}
    fix = {"GPS_numSat": np.full(after.size, 9), "GPS_coord[0]": 474_000_000 + 100 * after,
           "GPS_coord[1]": 85_000_000 - 7 * after, "GPS_speed": 100 + after}  # fmt: skip
    fields = [Field("GPS_numSat", False, 0, 1), Field("GPS_coord[0]", True, writer.HOME_COORD),
              Field("GPS_coord[1]", True, writer.HOME_COORD), Field("GPS_speed", False, 0, 1)]  # fmt: skip
    return {"H": Rows([Field(n) for n in home], np.zeros(1, np.intp), home), "G": Rows(fields, after, fix)}


def raw(content: bytes) -> dict[str, npt.NDArray[Any]]:
    found = blackbox._session(content, 0, len(content), "log", 10**7)
    assert isinstance(found, blackbox.Session)
    return dict(zip(found.names[walk.I], found.rows[walk.I][:, 1:].T, strict=True))


def head(**fields: str) -> bytes:
    lines = {"Product": "Blackbox flight data recorder by Nicholas Sherlock"}
    return "".join(f"H {k.replace('_', ' ')}:{v}\n" for k, v in (lines | fields).items()).encode()


def test_the_first_version_packs_four_numbers_into_whole_bytes() -> None:
    """A byte of widths, then two numbers of 4 bits in one, low half first; 16 bits low byte first."""
    content = head(
        Data_version="1", Field_I_name="time,a,b,c,d", Field_I_signed="0,1,1,1,1", Field_I_predictor="0,0,0,0,0",
        Field_I_encoding="1,8,8,8,8", Field_P_predictor="2,1,1,1,1", Field_P_encoding="0,0,0,0,0",
    )  # fmt: skip
    found = raw(content + 2 * b"I\x0a\xe5\x21\xff\x34\x12")
    assert [found[name][0] for name in "abcd"] == [1, 2, -1, 0x1234]
    content = head(
        Data_version="2", I_interval="256", P_interval="16", Field_I_name="loopIteration,time", Field_I_signed="0,0",
        Field_I_predictor="0,0", Field_I_encoding="1,1", Field_P_predictor="6,2", Field_P_encoding="9,0",
    )  # fmt: skip
    content += b"I" + writer.unsigned_vb(256) + writer.unsigned_vb(1000)
    content += b"P" + writer.signed_vb(2000) + b"P" + writer.signed_vb(0)
    assert raw(content)["loopIteration"].tolist() == [256, 272, 288]


def test_an_independent_decoder_reads_the_same(tmp_path: Path) -> None:
    known, found = numbers(), raw(log())
    assert all(np.array_equal(found[name], known[name]) for name in known)
    orangebox = pytest.importorskip("orangebox")
    (tmp_path / "a.bbl").write_bytes(blackbox_bytes(FIELDS, known, HEADER))
    parser = orangebox.Parser.load(str(tmp_path / "a.bbl"))
    theirs = np.array([frame.data for frame in parser.frames()])
    assert parser.field_names == list(found)
    assert np.array_equal(theirs, np.column_stack([*found.values()]))


def test_compiled_is_interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of numbers in groups, of all their bits."""
    damaged, rng = bytearray(log(300)), np.random.default_rng(0)
    damaged[9000:9100] = bytes(100)
    groups = head(
        Data_version="2", Field_I_name="time,a,b,c,d,e,f,g,h,i,j", Field_I_signed="0" + ",1" * 10,
        Field_I_predictor="0" + ",0" * 10, Field_I_encoding="1,7,7,7,8,8,8,8,10,10,10",
        Field_P_predictor="2" + ",1" * 10, Field_P_encoding="0" + ",0" * 10,
    )  # fmt: skip
    for k in range(300):
        groups += b"I" + writer.unsigned_vb(1000 * k) + b"".join(b"\xff" + rng.bytes(n) for n in (12, 8, 12))
    slow = [parse_blackbox(PATH, x) for x in (bytes(damaged), groups)]
    assert slow[1].streams["main"].time.size > 290
    monkeypatch.setattr(blackbox, "SMALL", 0)
    for one, content in zip(slow, (bytes(damaged), groups), strict=True):
        fast = parse_blackbox(PATH, content)
        assert fast.defects == one.defects
        for name, stream in one.streams.items():
            assert all(np.array_equal(x, fast.streams[name].columns[k]) for k, x in stream.columns.items())


def test_units() -> None:
    known, recording = numbers(), parse_blackbox(PATH, log())
    main = recording.streams["main"]
    np.testing.assert_allclose(main.time, 1e-6 * known["time"], atol=1e-12)
    expected = {
        "accSmooth[2]": known["accSmooth[2]"] / 2048.0, "gyroADC[0]": known["gyroADC[0]"],
        "motor[1]": (known["motor[1]"] - 48.0) / 1999.0, "eRPM[3]": known["eRPM[3]"] * 100.0 / 7.0,
        "vbatLatest": known["vbatLatest"] / 100.0, "amperageLatest": known["amperageLatest"] / 100.0,
    }  # fmt: skip
    for name, values in expected.items():
        np.testing.assert_allclose(main.columns[name], values, rtol=1e-6, err_msg=name)
    assert recording.units["main"]["eRPM[3]"] == "rpm"
    assert recording.info["firmware"].startswith("Betaflight 4.5.1")
    assert recording.parameters["acc_1G"] == 2048.0
    assert recording.defects == ()
    gps = recording.streams["gps"].columns
    assert gps["GPS_coord[0]"][3] == pytest.approx(47.4003)
    # 3000 units of 1e-7 deg on a sphere of 6371.0088 km
    assert gps["GPS_north"][3] == pytest.approx(6371008.8 * np.radians(3e-4), rel=1e-6)


def test_motors_and_volts_by_version() -> None:
    inav = {"Firmware revision": "INAV 7.1.0 (1) X"}
    for lines, name, logged, share in (
        ({"motorOutput": "1070,2000"}, "motor[0]", 1535, 0.5),
        ({"motorOutput": "48,2047"}, "motor[0]", 0, 0.0),
        ({"motorOutput": "158,1847"}, "motor[0]", 1447, 1399.0 / 1999.0),  # limited to 90 %
        ({"motorOutput": "48,2047"}, "motor[0]", 2047, 1.0),
        ({**inav, "motorOutput": "1070,2000"}, "motor[0]", 2000, 1.0),
        ({"Firmware revision": "Betaflight 4.5.1 x"}, "vbatLatest", 2400, 24.0),
        ({"Firmware revision": "Betaflight 3.5.7 x"}, "vbatLatest", 2400, 240.0),
        (inav, "vbatLatest", 2400, 24.0),
    ):
        content = blackbox_bytes(FIELDS, numbers() | {name: np.full(N, logged)}, HEADER | lines)
        found = parse_blackbox(PATH, content).streams["main"].columns[name]
        np.testing.assert_allclose(found, share, atol=1e-6, err_msg=str(lines))


def test_time_goes_on_after_71_minutes_and_after_a_pause_of_the_log() -> None:
    values = numbers() | {"time": 2**32 - 50_000 + 1000 * np.arange(N)}
    time = parse_blackbox(PATH, blackbox_bytes(FIELDS, values, HEADER)).streams["main"].time
    np.testing.assert_allclose(np.diff(time), 1e-3, atol=1e-9)
    values = numbers()
    values["loopIteration"][50:] += 700
    values["time"][50:] += 700_000
    recording = parse_blackbox(PATH, blackbox_bytes(FIELDS, values, HEADER))
    assert recording.defects == ()
    assert recording.streams["main"].time.size == N
    assert np.max(np.diff(recording.streams["main"].time)) == pytest.approx(0.701, abs=1e-4)
    erased = log().removesuffix(writer.GOODBYE) + b"\xff" * 1000  # flash behind a log without end
    assert parse_blackbox(PATH, erased).streams["main"].time.size >= N - 1


def test_several_logs_of_a_file() -> None:
    later = numbers(seed=2)
    later["time"] = later["time"] + 60_000_000
    anew = blackbox_bytes(FIELDS[:-4], numbers(seed=3), HEADER)
    recording = parse_blackbox(PATH, log() + blackbox_bytes(FIELDS, later, HEADER) + anew)
    time = recording.streams["main"].time
    assert time.size == 3 * N
    assert time[N] - time[0] == pytest.approx(60.0, abs=0.01)
    assert time[2 * N] - time[2 * N - 1] == pytest.approx(10.0)  # its clock began anew
    assert [defect.kind for defect in recording.defects] == ["time order"]
    rotor = recording.streams["main"].columns["eRPM[0]"]
    assert np.isfinite(rotor[: 2 * N]).all()
    assert np.isnan(rotor[2 * N :]).all()  # which the third log does not have
    assert len(recording.info["logs"].splitlines()) == 3


def test_damage_costs_what_builds_on_it() -> None:
    content = bytearray(log())
    place = len(content) // 2
    content[place : place + 60] = bytes(60)
    recording, whole = parse_blackbox(PATH, bytes(content)), numbers()
    main = recording.streams["main"]
    assert {defect.kind for defect in recording.defects} == {"corrupt", "dropout"}
    assert N - writer.INTERVAL - 2 <= main.time.size < N
    at = np.searchsorted(1e-6 * whole["time"], main.time - 1e-9)
    for name in ("gyroADC[0]", "eRPM[2]"):
        scale = 100.0 / 7.0 if name.startswith("eRPM") else 1.0
        np.testing.assert_allclose(main.columns[name], whole[name][at] * scale, rtol=1e-6)


def test_fields_that_take_no_bytes_do_not_fill_memory() -> None:
    """250 fields of no bytes: a frame is one letter."""
    names = ",".join(["time", *(f"x{k}" for k in range(250))])
    zeros, nines = "0" + ",0" * 250, "9" + ",9" * 250
    content = head(
        Field_I_name=names, Field_I_signed=zeros, Field_I_predictor=zeros, Field_I_encoding=nines,
        Field_P_predictor=zeros, Field_P_encoding=nines,
    )  # fmt: skip
    recording = parse_blackbox(PATH, content + b"I" * 60_000)
    assert "more numbers" in " ".join(map(str, recording.defects))


def test_what_cannot_be_read(tmp_path: Path) -> None:
    whole = log()
    for wrong, word in (
        (b"", "not a blackbox log"),
        (whole[:900], "no frame"),
        (whole.replace(b"Field I encoding:1", b"Field I encoding:5"), "unknown encoding"),
        (whole.replace(b",time,", b",tame,"), "no field 'time'"),
        (whole.replace(b"H Field P encoding:9,", b"H Field P encoding:"), "values of encoding"),
    ):
        with pytest.raises(LogError, match=word):
            parse_blackbox(PATH, wrong)
    (tmp_path / "a.csv").write_text(",".join(numbers()) + "\n" + rows(numbers()), encoding="utf-8")
    (tmp_path / "a.csv.toml").write_text('[time]\ncolumn = "time"\nunit = "us"\n')
    assert read(tmp_path / "a.csv").format == "table"  # a mapping with a clock makes it one
    for name in ("a.bbl", "a.BFL", "LOG00001.TXT", "noending"):  # told by its first bytes
        (tmp_path / name).write_bytes(whole)
        assert read(tmp_path / name).format == "blackbox"


def rows(values: dict[str, npt.NDArray[Any]], apart: str = ",") -> str:
    return "\n".join(apart.join(map(str, row)) for row in zip(*values.values(), strict=True)) + "\n"


def explorer(values: dict[str, npt.NDArray[Any]]) -> str:
    lines = ('"Firmware revision","Betaflight 4.5.1 (1) X"', '"acc_1G",2048', '"gyroScale",1.7453292519943295e-8',
             '"motorOutput","158,2047"', '"motor_poles",14', ",".join(f'"{name}"' for name in values))  # fmt: skip
    return "\n".join([*lines, rows(values)])


def decoded(values: dict[str, npt.NDArray[Any]]) -> str:
    units = {"time": "time (us)", "vbatLatest": "vbatLatest (V)", "amperageLatest": "amperageLatest (A)"}
    table = values | {name: values[name] / 100.0 for name in ("vbatLatest", "amperageLatest")}
    return ", ".join(units.get(name, name) for name in table) + "\n" + rows(table, ", ")


@pytest.mark.parametrize(("table", "assumed"), [(explorer, 0), (decoded, 3)])
def test_decoded_tables_are_the_raw_log(table: Any, assumed: int, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(table(numbers()), encoding="utf-8")
    found, known = read(tmp_path / "a.csv"), parse_blackbox(PATH, log())
    assert found.format == "blackbox-csv"
    assert [defect.kind for defect in found.defects] == ["assumed"] * assumed
    np.testing.assert_allclose(found.streams["main"].time, known.streams["main"].time)
    for name, column in known.streams["main"].columns.items():
        theirs = found.streams["main"].columns[name]
        np.testing.assert_allclose(theirs, column, rtol=1e-6, atol=1e-9, err_msg=name)
