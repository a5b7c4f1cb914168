"""Repeating textures with detail at every scale, as pyramids for the shading loop."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.model.arrays import FloatArray, IntArray

SIZE = 1024
ONE = 32
"""A texel of one standard deviation; small integers keep the tiles in the processor's cache."""
LEVELS = 9
"""From 1024 down to 4 texels; the smallest is all but flat."""


@dataclass(frozen=True, slots=True, eq=False)
class Pyramid:
    """A square tile that repeats, and its halvings, one after the other.

    Attributes:
        texels: All levels' values, around 0 with standard deviation ``ONE``, int8 ``(sum of sizes squared,)``.
        starts: ``(LEVELS,)`` where each level starts.
    """

    texels: npt.NDArray[np.int8]
    starts: IntArray


@lru_cache(maxsize=16)
def pyramid(seed: int, octaves: int, roughness: float) -> Pyramid:
    """Sum of smooth noises, each half the size and ``roughness`` times the strength of the one before.

    Args:
        seed: Same seed, same tile.
        octaves: How many, counted from the finest (2 texels).
        roughness: 1 for the same strength at every scale, below 1 for larger forms to prevail.
    """
    generator = np.random.default_rng(seed)
    tile = np.zeros((SIZE, SIZE), dtype=np.float32)
    for octave in range(octaves):
        cells = SIZE // 2 ** (octave + 1)
        coarse = generator.standard_normal((cells, cells)).astype(np.float32)
        wrapped = cv2.copyMakeBorder(coarse, 2, 2, 2, 2, cv2.BORDER_WRAP)
        scale = SIZE // cells
        smooth = cv2.resize(wrapped, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        tile += roughness ** (octaves - 1 - octave) * smooth[2 * scale : -2 * scale, 2 * scale : -2 * scale]
    levels = [np.asarray((tile - tile.mean()) / tile.std(), dtype=np.float32)]
    while len(levels) < LEVELS:
        half = levels[-1].shape[0] // 2
        levels.append(levels[-1].reshape(half, 2, half, 2).mean(axis=(1, 3)))
    sizes = [level.size for level in levels]
    values = np.concatenate([level.ravel() for level in levels])
    return Pyramid(
        np.rint(np.clip(values * ONE, -127, 127)).astype(np.int8),
        np.concatenate([[0], np.cumsum(sizes[:-1])]).astype(int),
    )


@lru_cache(maxsize=3)
def sensor_noise(seed: int, height_px: int, width_px: int, std: float) -> npt.NDArray[np.int16]:
    """Gaussian noise in grey levels, ``(height_px, width_px, 3)``."""
    generator = np.random.default_rng(seed)
    noise: FloatArray = generator.standard_normal((height_px, width_px, 3)) * std
    return np.rint(noise).astype(np.int16)
