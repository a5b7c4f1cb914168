"""Images of the simulated world, by tracing every pixel's ray to the ground, which repeating textures cover.

Flat things in space (markers, posts, persons) are drawn by tracing rays too, so that any lens bends them rightly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.geometry import inverse, matrix, pixels_from_rays, rays_from_pixels
from aerodft.model import Camera, FloatArray, ImageArray, IntArray, Pose
from aerodft.sim.shading import Rays, RiverFrame, Texels, shade, stamp
from aerodft.sim.world import Marker, River, Walker, Wall, World

MARGIN_SCALE = 8 / 6
"""Marker with its white margin against the black square: one module of six on each side."""

_EDGE_POINTS = 24
_SAMPLES = 4
_FEW_SAMPLES = 2
_LARGE_PX = 120_000
_EDGE_ON = 1e-9
_MODULE_PX = 16


@dataclass(frozen=True, slots=True, eq=False)
class Sprite:
    """A textured rectangle.

    Attributes:
        corner_enu_m: Where the texture's top-left corner is, ``(3,)``.
        right_enu_m: From there to its top-right corner.
        down_enu_m: From there to its bottom-left corner.
        texture: ``(h, w, 4)`` BGR and opacity.
    """

    corner_enu_m: FloatArray
    right_enu_m: FloatArray
    down_enu_m: FloatArray
    texture: ImageArray

    def distance_m(self, camera_enu_m: FloatArray) -> float:
        """From the camera to its middle, on the map."""
        return float(np.linalg.norm((self.corner_enu_m + self.right_enu_m / 2 - camera_enu_m)[:2]))

    def outline_enu_m(self) -> FloatArray:
        """Points around the edge, ``(n, 3)``."""
        steps = np.linspace(0, 1, _EDGE_POINTS, endpoint=False)[:, None]
        right, down = self.right_enu_m, self.down_enu_m
        sides = [steps * right, right + steps * down, right + down - steps * right, down - steps * down]
        return self.corner_enu_m + np.concatenate(sides)


def sprites(world: World, camera_enu_m: FloatArray, time_s: float) -> list[Sprite]:
    """What to draw, in painter's order: what lies on the ground, then what stands, from far to near."""
    lying = [_marker(marker) for marker in world.markers]
    lying += [_shadow(walker, world, time_s) for walker in world.walkers if walker.shadow]
    standing = [_upright(p.ends_enu_m()[0], p.height_m, p.width_m, camera_enu_m, _post_texture()) for p in world.posts]
    standing += [
        _upright(w.foot_enu_m(time_s), w.height_m, w.width_m, camera_enu_m, _person_texture()) for w in world.walkers
    ]
    standing += [_wall(wall) for wall in world.walls]
    standing.sort(key=lambda sprite: -sprite.distance_m(camera_enu_m))
    return lying + standing


def draw(image: ImageArray, rays: Rays, camera: Camera, pose: Pose, things: list[Sprite]) -> None:
    """Draw ``things`` in their order onto ``image (h, w, 3)`` as ``camera`` sees them from ``pose``.

    Args:
        image: Written.
        rays: The camera's ray table, see ``shading.shade``.
        camera: The camera.
        pose: Where it is.
        things: What to draw; those out of view are left out.
    """
    if not things:
        return
    cam_from_enu = matrix(inverse(pose.wxyz))
    outlines = np.stack([thing.outline_enu_m() for thing in things]) - pose.position_enu_m
    for thing, pixels in zip(things, pixels_from_rays(camera, outlines @ cam_from_enu.T), strict=True):
        region = _region(camera, pixels)
        if region is None:
            continue
        axes = np.column_stack([thing.right_enu_m, thing.down_enu_m, thing.corner_enu_m - pose.position_enu_m])
        if abs(np.linalg.det(axes)) < _EDGE_ON:
            continue
        area = (region[2] - region[0]) * (region[3] - region[1])
        samples = _SAMPLES if area < _LARGE_PX else _FEW_SAMPLES
        stamp(
            rays,
            region,
            np.asarray(np.linalg.inv(cam_from_enu @ axes), dtype=np.float64),
            thing.texture,
            samples,
            image,
        )


def _region(camera: Camera, pixels: FloatArray) -> tuple[int, int, int, int] | None:
    """Columns and rows (half-open) that an outline ``(n, 2)`` encloses; None where it is out of the image."""
    seen = pixels[np.all(np.isfinite(pixels), axis=-1)]
    if len(seen) == 0:
        return None
    low, high = seen.min(axis=0), seen.max(axis=0)
    spare = 2 + (high - low) * (0.0 if len(seen) == len(pixels) else 0.1)
    size = np.array([camera.width_px, camera.height_px])
    left, top = (int(x) for x in np.floor(np.clip(low - spare, 0, size)))
    right, bottom = (int(x) for x in np.ceil(np.clip(high + spare + 1, 0, size)))
    return (left, top, right, bottom) if right > left and bottom > top else None


def _marker(marker: Marker) -> Sprite:
    corners = marker.corners_enu_m(MARGIN_SCALE)
    return Sprite(corners[0], corners[1] - corners[0], corners[3] - corners[0], _marker_texture(marker.id))


def _upright(
    foot_enu_m: FloatArray, height_m: float, width_m: float, camera_enu_m: FloatArray, texture: ImageArray
) -> Sprite:
    """A vertical rectangle that faces the camera."""
    away = foot_enu_m[:2] - camera_enu_m[:2]
    distance = float(np.hypot(*away))
    facing = away / distance if distance > 0 else np.array([0.0, 1.0])
    right = np.array([facing[1], -facing[0], 0.0]) * width_m
    down = np.array([0.0, 0.0, -height_m])
    return Sprite(foot_enu_m - down - right / 2, right, down, texture)


def _wall(wall: Wall) -> Sprite:
    start, end = np.append(wall.start_en_m, wall.height_m), np.append(wall.end_en_m, wall.height_m)
    return Sprite(start, end - start, np.array([0.0, 0.0, -wall.height_m]), _wall_texture())


def _shadow(walker: Walker, world: World, time_s: float) -> Sprite:
    """The shadow on the plane, from the feet away from the sun."""
    azimuth = world.look.sun_azimuth_rad
    away = -np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    along = away * walker.height_m / np.tan(world.look.sun_elevation_rad)
    right = np.array([along[1], -along[0], 0.0]) / np.linalg.norm(along) * walker.width_m
    foot = walker.foot_enu_m(time_s)
    return Sprite(foot + along - right / 2, right, -along, _shadow_texture())


@lru_cache(maxsize=64)
def _marker_texture(marker_id: int) -> ImageArray:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    code = cv2.aruco.generateImageMarker(dictionary, marker_id, 6 * _MODULE_PX)
    grey = np.pad(code, _MODULE_PX, constant_values=255)
    opaque = np.full_like(grey, 255)
    return np.stack([grey, grey, grey, opaque], axis=-1)


@lru_cache(maxsize=1)
def _post_texture() -> ImageArray:
    bands = np.array([[(40, 40, 210, 255)], [(235, 235, 235, 255)]] * 4, dtype=np.uint8)
    return np.repeat(bands, 8, axis=0)


@lru_cache(maxsize=1)
def _wall_texture() -> ImageArray:
    bricks = np.full((64, 128, 4), (150, 160, 170, 255), dtype=np.uint8)
    bricks[::16, :, :3] = 120
    return bricks


@lru_cache(maxsize=1)
def _silhouette() -> ImageArray:
    mask = np.zeros((160, 48), dtype=np.uint8)
    cv2.ellipse(mask, (24, 14), (10, 14), 0, 0, 360, 255, -1)
    cv2.ellipse(mask, (24, 62), (22, 38), 0, 0, 360, 255, -1)
    cv2.rectangle(mask, (10, 80), (37, 159), 255, -1)
    return mask


@lru_cache(maxsize=1)
def _person_texture() -> ImageArray:
    mask = _silhouette()
    texture = np.zeros((*mask.shape, 4), dtype=np.uint8)
    texture[:28, :, :3], texture[28:90, :, :3], texture[90:, :, :3] = (120, 150, 200), (30, 60, 220), (60, 40, 30)
    texture[..., 3] = mask
    return texture


@lru_cache(maxsize=1)
def _shadow_texture() -> ImageArray:
    mask = _silhouette()
    texture = np.zeros((*mask.shape, 4), dtype=np.uint8)
    texture[..., 3] = mask // 2
    return texture


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
