"""Damage to pieces of a log, as cables, memory cards and crashes do it."""

import numpy as np

WAYS = ["whole"] * 5 + ["cut", "flipped", "noise"]


def spoil(piece: bytearray, way: str, rng: np.random.Generator) -> None:
    """Cut a piece, flip one of its bits, or put noise behind it; other ways are left to the caller."""
    match way:
        case "cut":
            del piece[int(rng.integers(len(piece))) :]
        case "flipped":
            piece[int(rng.integers(len(piece)))] ^= 1 << int(rng.integers(8))
        case "noise":
            piece += rng.bytes(int(rng.integers(0, 30)))
