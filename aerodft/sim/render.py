"""Images of the simulated world, by tracing every pixel's ray to the ground, which repeating textures cover."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.geometry.lens import rays_from_pixels
from aerodft.geometry.rotation import matrix
from aerodft.model.arrays import FloatArray, ImageArray, IntArray
from aerodft.model.camera import Camera
from aerodft.model.pose import Pose
from aerodft.sim.river import River
from aerodft.sim.shading import Rays, RiverFrame, Texels, shade
from aerodft.sim.sprites import draw, sprites
from aerodft.sim.world import World

_SIZE = 1024  # texels of a tile's side
_ONE = 32  # a texel of one standard deviation; small integers keep the tiles in the processor's cache
_LEVELS = 9  # from 1024 down to 4 texels; the smallest is all but flat
_BANK_STEP_M = 0.25
_BANK_REACH_M = 2500.0
_NOISE_SLACK_PX = 64
_NO_SHORE_M = 1e6
_LOWEST_M = 0.05
_TIME = 14  # the only number of a camera's state that is not where it is and looks


@dataclass(frozen=True, slots=True, kw_only=True)
class Imaging:
    """How the camera spoils the image.

    Attributes:
        noise_std: Gaussian noise of every channel, in grey levels of 255.
        seed: Of the noise.
    """

    noise_std: float = 2.0
    seed: int = 1


class Renderer:
    """Renders ``world`` as ``camera`` sees it; the same arguments give the same bytes on the same machine.

    Args:
        camera: The camera, lens distortion included.
        world: The world.
        imaging: Noise.
    """

    def __init__(self, camera: Camera, world: World, imaging: Imaging | None = None) -> None:
        self.camera = camera
        self.world = world
        self._imaging = imaging or Imaging()
        self._rays = _ray_table(camera)
        self._place: tuple[float, ...] = ()
        self._still: ImageArray | None = None
        self._wet_rows = slice(0)
        self._river, self._banks = _river_tables(world.river)
        fine, coarse, water = (
            _pyramid(3 * world.seed, 5, 0.8),
            _pyramid(3 * world.seed + 1, 8, 0.7),
            _pyramid(3 * world.seed + 2, 6, 0.75),
        )
        self._tiles = (fine.texels, coarse.texels, water.texels, fine.starts)
        size_px = camera.height_px + _NOISE_SLACK_PX, camera.width_px + _NOISE_SLACK_PX
        std = self._imaging.noise_std
        self._noise = None if std == 0 else _sensor_noise(self._imaging.seed, *size_px, std)

    def render(self, pose: Pose, time_s: float) -> ImageArray:
        """The sharp image at ``time_s`` of the flight, noise included.

        Args:
            pose: The camera, ``()`` batch; one on the ground is lifted by 5 cm.
            time_s: Seconds since the flight's start; moves water and walkers, picks the noise.

        Returns:
            ``(height, width, 3)`` uint8 BGR; black where the lens model has no inverse.
        """
        return self._noisy(self._clean(pose, time_s), time_s)

    def render_exposure(self, poses: Sequence[Pose], times_s: Sequence[float]) -> ImageArray:
        """The mean of the images during an exposure: motion blur; noise is added once, stamped by the first time."""
        total = np.zeros((self.camera.height_px, self.camera.width_px, 3), dtype=np.float32)
        for pose, time_s in zip(poses, times_s, strict=True):
            cv2.accumulate(self._clean(pose, time_s), total)
        return self._noisy(np.rint(total / len(poses)).astype(np.uint8), times_s[0])

    def _clean(self, pose: Pose, time_s: float) -> ImageArray:
        camera = self.camera
        image = np.empty((camera.height_px, camera.width_px, 3), dtype=np.uint8)
        east, north, up = pose.position_enu_m
        height = max(up, _LOWEST_M)
        turn = matrix(pose.wxyz).ravel()
        state = (east, north, height, *turn, 1 / camera.fx_px, 1 / camera.fy_px, time_s, 1 / height)
        self._background(tuple(map(float, state)), image)
        draw(image, self._rays, camera, pose, sprites(self.world, pose.position_enu_m, time_s))
        return image

    def _background(self, state: tuple[float, ...], image: ImageArray) -> None:
        """Sky, land and water, into an image; of a camera that stands still only where there is water."""
        look = self.world.look
        looks = (look.ground_contrast, look.water_contrast, self.world.river.flow_mps)
        place = (*state[:_TIME], *state[_TIME + 1 :])
        rows = slice(None)
        if self._still is not None and place == self._place:
            np.copyto(image, self._still)
            rows = self._wet_rows
        wet = shade(self._rays[rows], state, self._river, self._banks, looks, self._tiles, image[rows])
        if place != self._place:
            self._still = None
        elif self._still is None:  # the second time that it looks from there: it may do so again
            self._still, self._wet_rows = image.copy(), slice(*wet)
        self._place = place

    def _noisy(self, image: ImageArray, time_s: float) -> ImageArray:
        if self._noise is None:
            return image
        generator = np.random.default_rng([self._imaging.seed, round(time_s * 1e6) % 2**32])
        down, right = generator.integers(0, _NOISE_SLACK_PX, 2)
        cut = self._noise[down : down + image.shape[0], right : right + image.shape[1]]
        return np.asarray(cv2.add(image, cut, dtype=cv2.CV_8U), dtype=np.uint8)


@lru_cache(maxsize=2)
def _ray_table(camera: Camera) -> Rays:
    """``(h, w, 3)`` float32; zero where the lens model has no inverse. Kept: a second of work for 1080p."""
    u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    rays = rays_from_pixels(camera, np.stack([u, v], axis=-1))
    return np.nan_to_num(rays).astype(np.float32)


def _river_tables(river: River) -> tuple[RiverFrame, FloatArray]:
    """Origin, direction and grid; banks and shores ``(n, 4)`` as the shading loop takes them."""
    along = np.arange(-_BANK_REACH_M, _BANK_REACH_M, _BANK_STEP_M)
    left, right = river.banks_m(along)
    shore_left, shore_right = river.shores_m(along)
    # Where there is no island, its shores lie where every point is far to the right of the right one.
    table = np.column_stack([left, right, np.nan_to_num(shore_left, nan=_NO_SHORE_M)])
    table = np.column_stack([table, np.nan_to_num(shore_right, nan=_NO_SHORE_M)])
    head = [*river.origin_en_m, np.sin(river.azimuth_rad), np.cos(river.azimuth_rad), along[0], _BANK_STEP_M]
    return tuple(map(float, head)), table


@dataclass(frozen=True, slots=True, eq=False)
class _Pyramid:
    """A square tile that repeats, and its halvings, one after the other.

    Attributes:
        texels: All levels' values, around 0 with standard deviation ``_ONE``, int8 ``(sum of sizes squared,)``.
        starts: ``(_LEVELS,)`` where each level starts.
    """

    texels: Texels
    starts: IntArray


@lru_cache(maxsize=16)
def _pyramid(seed: int, octaves: int, roughness: float) -> _Pyramid:
    """Sum of smooth noises, each half the size and ``roughness`` times the strength of the one before.

    Args:
        seed: Same seed, same tile.
        octaves: How many, counted from the finest (2 texels).
        roughness: 1 for the same strength at every scale, below 1 for larger forms to prevail.
    """
    generator = np.random.default_rng(seed)
    tile = np.zeros((_SIZE, _SIZE), dtype=np.float32)
    for octave in range(octaves):
        cells = _SIZE // 2 ** (octave + 1)
        coarse = generator.standard_normal((cells, cells)).astype(np.float32)
        wrapped = cv2.copyMakeBorder(coarse, 2, 2, 2, 2, cv2.BORDER_WRAP)
        scale = _SIZE // cells
        smooth = cv2.resize(wrapped, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        tile += roughness ** (octaves - 1 - octave) * smooth[2 * scale : -2 * scale, 2 * scale : -2 * scale]
    levels = [np.asarray((tile - tile.mean()) / tile.std(), dtype=np.float32)]
    while len(levels) < _LEVELS:
        half = levels[-1].shape[0] // 2
        levels.append(levels[-1].reshape(half, 2, half, 2).mean(axis=(1, 3)))
    sizes = [level.size for level in levels]
    values = np.concatenate([level.ravel() for level in levels])
    return _Pyramid(
        np.rint(np.clip(values * _ONE, -127, 127)).astype(np.int8),
        np.concatenate([[0], np.cumsum(sizes[:-1])]).astype(int),
    )


@lru_cache(maxsize=3)
def _sensor_noise(seed: int, height_px: int, width_px: int, std: float) -> npt.NDArray[np.int16]:
    """Gaussian noise in grey levels, ``(height_px, width_px, 3)``."""
    generator = np.random.default_rng(seed)
    noise: FloatArray = generator.standard_normal((height_px, width_px, 3)) * std
    return np.rint(noise).astype(np.int16)
