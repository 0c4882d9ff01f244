"""Random numbers as a value: the state of a PCG64 stream, kept in an optimizer's state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Stream:
    """Where a stream of random numbers stands (the fields of numpy's PCG64)."""

    state: int
    inc: int
    has_uint32: int
    uinteger: int

    def generator(self) -> np.random.Generator:
        """Return a generator that goes on from here; this value itself does not move."""
        bits = np.random.PCG64(0)
        bits.state = {
            "bit_generator": "PCG64",
            "state": {"state": self.state, "inc": self.inc},
            "has_uint32": self.has_uint32,
            "uinteger": self.uinteger,
        }
        return np.random.Generator(bits)


def from_generator(generator: np.random.Generator) -> Stream:
    """Return where a generator stands."""
    state = generator.bit_generator.state
    return Stream(state["state"]["state"], state["state"]["inc"], state["has_uint32"], state["uinteger"])


def from_seed(seed: int) -> Stream:
    """Return the start of the stream of a seed."""
    return from_generator(np.random.Generator(np.random.PCG64(seed)))
