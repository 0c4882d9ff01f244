"""Exports of OptiTrack Motive and Vicon: several header lines, y or z up, names per body; and commands in a file beside them."""

from pathlib import Path

import numpy as np
import pytest

from stoop.errors import LogError
from stoop.logs.capture_csv import export_of
from stoop.logs.csv_tables import read_table

RATE = 100.0  #: Hz
ABOUT = "Format Version,1.23,Take Name,Take 1,Export Frame Rate,100,Rotation Type,{},Length Units,{},Coordinate Space,Global"
#: as Motive turns about its y, which is up, by 30 deg: to the left, seen from above
LEFT = (0.0, np.sin(np.radians(15.0)), 0.0, np.cos(np.radians(15.0)))


def motive(bodies: dict[str, int], rotation: str = "Quaternion", unit: str = "Millimeters") -> str:
    """Return an export of bodies that go along x by 1 m/s from their place (m), up by 2 and along z by 3, turned to the left."""
    axes = [*(("X", "Y", "Z", "W") if rotation == "Quaternion" else ("X", "Y", "Z")), "X", "Y", "Z", ""]
    parts = ["Rotation"] * (len(axes) - 4) + ["Position"] * 3 + ["Mean Marker Error"]
    scale = {"Millimeters": 1e3, "Meters": 1.0}[unit]
    names = [f'"{name}"' for name in bodies for _ in axes]
    rows = [ABOUT.format(rotation, unit), "", *(",".join(["", word, *own]) for word, own in (
        ("Type", [*["Rigid Body"] * len(names), *["Rigid Body Marker"] * 3]),
        ("Name", [*names, *['"Quad:Marker1"'] * 3]),
        ("ID", ["1"] * (len(names) + 3)),
        *([("Parent", [""] * (len(names) + 3))] if unit == "Meters" else []),
        ("", [*parts * len(bodies), *["Position"] * 3]),
    )), ",".join(["Frame", "Time (Seconds)", *axes * len(bodies), "X", "Y", "Z"])]  # fmt: skip
    for k in range(300):
        t = k / RATE
        turn = LEFT[: len(axes) - 4]
        rows_of = ((*turn, *(scale * (place + v * t) for v in (1, 2, 3)), 0.1) for place in bodies.values())
        cells = [f"{x:.6f}" for row in rows_of for x in row]
        seen = k % 50 != 7  # else the markers were hidden
        rows.append(",".join([str(k), f"{t:.6f}", *(cells if seen else [""] * len(cells)), "1", "2", "3"]))
    return "\n".join(rows) + "\n"


def vicon(components: str = "RX,RY,RZ,RW,TX,TY,TZ") -> str:
    """Return the same flight of one body, z up and turned to the left about z."""
    values = {"RX": 0.0, "RY": 0.0, "RZ": LEFT[1], "RW": LEFT[3]}
    head = f",,Global Angle Quad:Quad,,,,,,\nFrame,Sub Frame,{components}\n,,,,,,mm,mm,mm"
    rows = ["Objects", f"{RATE:g}", head]
    for k in range(1, 301):
        values |= {"TX": 1e3 * k / RATE, "TY": -3e3 * k / RATE, "TZ": 2e3 * k / RATE}
        rows.append(f"{k},0," + ",".join(f"{values[c]:.6f}" for c in components.split(",")))
    return "\n".join(rows) + "\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "take.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_each_body_has_its_name(tmp_path: Path) -> None:
    columns, _ = read_table(written(tmp_path, motive({"Quad": 0, "Gate": 5})))
    assert columns["Quad.pos_n [m]"][0] == 0.0
    assert columns["Gate.pos_n [m]"][0] == 5.0
    assert len(columns) == 1 + 2 * 7
    alone, _ = read_table(written(tmp_path, motive({"Quad": 0})))
    assert list(alone) == ["time [s]", "pos_n [m]", "pos_e [m]", "pos_d [m]", "qw", "qx", "qy", "qz"]
    assert np.flatnonzero(np.isnan(alone["qw"])).tolist() == list(range(7, 300, 50)), "markers were hidden"
    assert alone["time [s]"][-1] == pytest.approx(2.99)


def test_without_a_quaternion_there_is_no_attitude(tmp_path: Path) -> None:
    bare = ABOUT + "\n\nFrame,Time (Seconds),X\n0,0,1\n"
    for text in (motive({"Quad": 0}, rotation="XYZ"), motive({}), vicon("RX,RY,RZ,TX,TY,TZ"), bare):
        with pytest.raises(LogError, match="with rotations as quaternions") as error:
            read_table(written(tmp_path, text))
        assert "\n" not in str(error.value)
    for text in ("", "t,p\n0,1\n", "Objects\n100\n", "a\nx\n\nFrame,Sub Frame,RX\n1,2,3\n", '"' * 9):
        assert export_of(tmp_path / "x.csv", text.encode()) is None  # another table


def test_lines_that_lack_cells_lack_readings(tmp_path: Path) -> None:
    head, _, rows = motive({"Quad": 0}).partition("Frame,")
    first, *lines = rows.splitlines()
    for cells in (1, 2, 5, 8):
        short = "\n".join(",".join(line.split(",")[:cells]) for line in lines)
        columns, _ = read_table(written(tmp_path, f"{head}Frame,{first}\n{short}\n"))
        assert np.isnan(columns["pos_e [m]"]).all()
        assert np.isnan(columns["time [s]"]).all() == (cells < 2)
