"""Table of log formats: how the files of each are recognized, and which function reads them."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from stoop.logs.recording import Recording

HEAD: Final = 2**16  #: bytes that are examined; the attributes of a netCDF file stand there
HDF5: Final = b"\x89HDF\r\n\x1a\n"
DECODED: Final = re.compile(rb'(^|\n)"?loopIteration"?, *"?time')  #: the fields of a decoded blackbox log
PULSE: Final = b"\xa3\x95"  #: begins each message of a DataFlash log


@dataclass(frozen=True)
class Format:
    """How the files of one format are recognized and read."""

    reader: str  #: "module:function" below `stoop.logs`; imported only when it is needed
    magic: tuple[bytes, ...] = ()  #: first bytes
    endings: tuple[str, ...] = ()  #: of the name, where the content does not tell
    #: in messages, of a format that a library reads in a child process (`stoop.logs.guard`); else empty
    name: str = ""
    package: str = ""  #: of a library that is not among stoop's dependencies
    extra: str = ""
    hdf5_only: bool = False  #: whether only files of HDF5 need the package
    most: int = 0  #: bytes of a file that is read whole before its reader is called; 0: the reader opens it
    remedy: str = ""  #: for an empty file of these

    def function(self) -> Callable[..., Recording]:
        """Return the reader."""
        module, _, name = self.reader.partition(":")
        found: Callable[..., Recording] = getattr(importlib.import_module(f"stoop.logs.{module}"), name)
        return found


FORMATS: Final = {
    "ulog": Format("ulog:read_ulog", (b"ULog\x01\x12\x35",), (".ulg", ".ulog")),
    "dataflash": Format("dataflash:read_dataflash", (PULSE,)),
    # of text, twenty minutes of a busy log
    "dataflash-text": Format("dataflash_text:parse_dataflash_text", (b"FMT,",), most=2**28,
                             remedy="copy it again from the autopilot"),
    # 20 variables at 1 kHz for eleven minutes; a battery lasts seven
    "crazyflie": Format("crazyflie:parse_crazyflie", (b"\xbc\x01", b"\xbc\x02"), (".usd",), most=2**26,
                        remedy="copy it again from the card"),
    # flash holds 2 to 64 MiB, and a card some minutes in that
    "blackbox": Format("blackbox:parse_blackbox", (b"H Product:Blackbox",), (".bbl", ".bfl"), most=2**28,
                       remedy="copy it again from flash or card"),
    "blackbox-csv": Format("blackbox_csv:read_blackbox_csv"),
    "matlab": Format("matlab:parse_matlab", (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"), (".mat",),
                     "MATLAB file", "h5py", "matlab", hdf5_only=True),
    "parquet": Format("parquet:parse_parquet", (b"PAR1",), (".parquet", ".pq"), "Parquet file", "pyarrow", "parquet"),
    "netcdf": Format("netcdf:read_netcdf", (), (".nc", ".cdf")),
    "foreign-netcdf": Format("netcdf:parse_foreign_netcdf", (), (), "netCDF file", "h5py", "matlab", hdf5_only=True),
    "rosbag": Format("rosbag:parse_rosbag", (b"#ROSBAG V", b"\x89MCAP", b"SQLite format 3\0"), (),
                     "ROS bag", "rosbags", "ros"),
}  # fmt: skip
