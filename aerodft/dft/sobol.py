"""Scrambled Sobol points, the same to the last bit as ``scipy.stats.qmc``'s, without the half second that it loads.

Direction numbers: Joe and Kuo 2008, "Constructing Sobol sequences with better two-dimensional projections". Scrambling:
a random linear map of the binary digits and a digital shift (Matousek 1998).
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from aerodft.model.arrays import FloatArray

Words = npt.NDArray[np.uint32]

_BITS: Final = 30
_PLACES: Final = np.left_shift(np.uint32(1), np.arange(_BITS, dtype=np.uint32))
# Of each dimension from the second on: its primitive polynomial over GF(2), one bit a coefficient, then what its
# direction numbers begin with.
_NUMBERS: Final = """
3 1; 7 1 3; 11 1 3 1; 13 1 1 1; 19 1 1 3 3; 25 1 3 5 13; 37 1 1 5 5 17; 41 1 1 5 5 5; 47 1 1 7 11 19; 55 1 1 5 1 1;
59 1 1 1 3 11; 61 1 3 5 5 31; 67 1 3 3 9 7 49; 91 1 1 1 15 21 21; 97 1 3 1 13 27 49; 103 1 1 1 15 7 5; 109 1 3 1 15
13 25; 115 1 1 5 5 19 61; 131 1 3 7 11 23 15 103; 137 1 3 7 13 13 15 69; 143 1 1 3 13 7 35 63; 145 1 3 5 9 1 25 53;
157 1 3 1 13 9 35 107; 167 1 3 1 5 27 61 31; 171 1 1 5 11 19 41 61; 185 1 3 5 3 3 13 69; 191 1 1 7 13 1 19 1; 193 1
3 7 5 13 19 59; 203 1 1 3 9 25 29 41; 211 1 3 5 13 23 1 55; 213 1 3 7 3 13 59 17; 229 1 3 1 3 5 53 69; 239 1 1 5 5
23 33 13; 241 1 1 7 7 1 61 123; 247 1 1 7 9 13 61 49; 253 1 3 3 5 3 55 33; 285 1 3 1 15 31 13 49 245; 299 1 3 5 15
31 59 63 97; 301 1 3 1 11 11 11 77 249; 333 1 3 1 11 27 43 71 9; 351 1 1 7 15 21 11 81 45; 355 1 3 7 3 25 31 65 79;
357 1 3 1 1 19 11 3 205; 361 1 1 5 9 19 21 29 157; 369 1 3 7 11 1 33 89 185; 391 1 3 3 3 15 9 79 71; 397 1 3 7 11 15
39 119 27; 425 1 1 3 1 11 31 97 225; 451 1 1 1 3 23 43 57 177; 463 1 3 7 7 17 17 37 71; 487 1 3 1 5 27 63 123 213;
501 1 1 3 5 11 43 53 133; 529 1 3 5 5 29 17 47 173 479; 539 1 3 3 11 3 1 109 9 69; 545 1 1 1 5 17 39 23 5 343; 557 1
3 1 5 25 15 31 103 499; 563 1 1 1 11 11 17 63 105 183; 601 1 1 5 11 9 29 97 231 363; 607 1 1 5 15 19 45 41 7 383;
617 1 3 7 7 31 19 83 137 221; 623 1 1 1 3 23 15 111 223 83; 631 1 1 5 13 31 15 55 25 161; 637 1 1 3 13 25 47 39 87
257
"""
MOST_DIMENSIONS: Final = 1 + _NUMBERS.count(";") + 1


def scrambled_sobol(dimensions: int, count: int, seed: int) -> FloatArray:
    """The first points ``(count, dimensions)`` of the sequence in [0, 1).

    Args:
        dimensions: At most ``MOST_DIMENSIONS``.
        count: A power of two, for balance.
        seed: Of the scrambling.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(1)[0])
    shift = rng.integers(0, 2, size=(dimensions, _BITS), dtype=np.uint32) @ _PLACES
    maps = np.tril(rng.integers(0, 2, size=(dimensions, _BITS, _BITS), dtype=np.uint32))
    maps[:, np.arange(_BITS), np.arange(_BITS)] = 1
    digits = _directions(dimensions)[:, :, np.newaxis] >> np.arange(_BITS - 1, -1, -1, dtype=np.uint32) & np.uint32(1)
    words = (digits @ maps.transpose(0, 2, 1) & np.uint32(1)) @ _PLACES[::-1]
    points = np.broadcast_to(shift, (count, dimensions)).copy()
    number = np.arange(count)
    gray = number ^ number >> 1
    for bit in range(max(count - 1, 1).bit_length()):
        points[gray >> bit & 1 == 1] ^= words[:, bit]
    return points.astype(np.float64) * 2.0**-_BITS


def _directions(dimensions: int) -> Words:
    """``(dimensions, 30)`` direction numbers, each a binary fraction of 30 digits."""
    found = np.empty((dimensions, _BITS), dtype=np.uint32)
    found[0] = _PLACES[::-1]
    for row, numbers in zip(found[1:], _NUMBERS.split(";"), strict=False):
        polynomial, *first = map(int, numbers.split())
        degree = len(first)
        directions = [number << (_BITS - 1 - place) for place, number in enumerate(first)]
        for place in range(degree, _BITS):
            word = directions[place - degree] ^ directions[place - degree] >> degree
            for back in range(1, degree):
                word ^= directions[place - back] * (polynomial >> (degree - back) & 1)
            directions.append(word)
        row[:] = directions
    return found
