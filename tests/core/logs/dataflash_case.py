"""A small DataFlash log with everything in it, in both forms."""

import numpy as np

from stoop_plan.log_bytes import Table, dataflash_bytes

SAMPLES = 50


def tables(samples: int = SAMPLES, seed: int = 0) -> list[Table]:
    rng = np.random.default_rng(seed)
    stamp = 1_000_000 + 2500 * np.arange(samples)
    twice = np.repeat(stamp, 2)
    gyro = {f"Gyr{axis}": rng.normal(size=2 * samples).astype(np.float32) for axis in "XYZ"}
    angles = {"Roll": rng.uniform(-180, 180, samples), "Yaw": rng.uniform(0, 360, samples)}
    place = {"Lat": rng.uniform(-90, 90, samples), "Alt": rng.uniform(-100, 3000, samples)}
    volts = {"Volt": rng.integers(14_000, 16_800, samples), "Name": [f"pack {k % 2}" for k in range(samples)]}
    half = {"H": np.float16(rng.normal(size=samples)), "D": rng.normal(size=samples)}
    return [
        Table("IMU", "TimeUS,I,GyrX,GyrY,GyrZ", "QBfff", "s#EEE", "F-000",
              {"TimeUS": twice, "I": np.tile([0, 1], samples), **gyro}),
        Table("ATT", "TimeUS,Roll,Yaw", "QcC", "sdh", "FBB", {"TimeUS": stamp + 5, **angles}),
        Table("POS", "TimeUS,Lat,Alt", "QLe", "sDm", "FGB", {"TimeUS": stamp + 6, **place}),
        Table("BAT", "TimeUS,Volt,Name", "QHN", "sv-", "FC-", {"TimeUS": stamp + 7, **volts}),
        Table("MODE", "TimeUS,Mode,Rsn", "QMB", "s--", "F--",
              {"TimeUS": stamp[:2], "Mode": [5, 10], "Rsn": [1, 2]}),
        Table("TST", "TimeUS,H,D,q,i,b", "Qgdqib", "s-----", "F-----",
              {"TimeUS": stamp, **half, "q": -stamp, "i": -np.arange(samples), "b": np.arange(samples) - 128}),
    ]  # fmt: skip


def small_log(samples: int = SAMPLES) -> bytes:
    parameters, said = {"ARSPD_RATIO": 2.0, "INS_POS1_X": -0.05}, ["ArduPlane V4.5.7 (1a2b)", "Hi"]
    return dataflash_bytes(tables(samples), parameters, said)


def as_text(log: list[Table]) -> bytes:
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += [f"FMT, {k + 1}, 50, {t.name}, {t.letters}, {t.columns}" for k, t in enumerate(log)]
    for table in log:
        columns = [table.values[name] for name in table.columns.split(",")]
        for row in zip(*columns, strict=True):
            cells = (x if isinstance(x, str) else repr(np.asarray(x).item()) for x in row)
            lines.append(", ".join([table.name, *cells]))
    return ("\n".join(lines) + "\n").encode()
