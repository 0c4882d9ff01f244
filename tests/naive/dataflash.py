"""DataFlash logs through pymavlink, message by message, held against a recording of ours."""

from pathlib import Path

import numpy as np

from stoop.logs import Recording


def same_as_pymavlink(recording: Recording, path: Path) -> int:
    """Compare every number; return how many."""
    from pymavlink import DFReader

    text = path.suffix == ".log"
    theirs: dict[str, list[dict[str, float]]] = {}
    with (DFReader.DFReader_text if text else DFReader.DFReader_binary)(str(path), True) as reader:
        while (message := reader.recv_msg()) is not None:
            number = getattr(message, message.fmt.instance_field) if message.fmt.instance_field else 0
            name = f"{message.get_type()}/{number}" if number else message.get_type()
            theirs.setdefault(name, []).append(message.to_dict())
    compared = 0
    for name, stream in recording.streams.items():
        if stream.time.size != len(theirs[name]):
            continue  # samples out of order were dropped
        np.testing.assert_array_equal(stream.time, [1e-6 * message["TimeUS"] for message in theirs[name]])
        for column, values in stream.columns.items():
            wanted = [float(message[column]) for message in theirs[name]]
            np.testing.assert_allclose(values, wanted, rtol=2e-15 if text else 0.0)
            compared += values.size
    return compared
