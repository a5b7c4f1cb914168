"""Renderer of the simulated world: traces every pixel's ray to the textured ground.

Sprites (markers, posts, persons) are traced too, so that lens distortion applies to them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.geometry import inverse, matrix, pixels_from_rays, rays_from_pixels
from aerodft.model import Camera, FloatArray, ImageArray, IntArray, Pose
from aerodft.sim.shading import Rays, RiverFrame, Texels, draw_sprite, shade
from aerodft.sim.world import Marker, River, Walker, Wall, World

MARGIN_SCALE = 8 / 6
"""Marker with its white margin against the black square: one module of six on each side."""

_OUTLINE_POINTS = 24
_SAMPLES = 4
_SAMPLES_IF_LARGE = 2
_LARGE_PX = 120_000
_MIN_DETERMINANT = 1e-9
_MODULE_PX = 16


@dataclass(frozen=True, slots=True, eq=False)
class Sprite:
    """A textured rectangle in space.

    Attributes:
        corner_enu_m: The texture's top-left corner, ``(3,)``.
        right_enu_m: Vector to its top-right corner.
        down_enu_m: Vector to its bottom-left corner.
        texture: ``(h, w, 4)`` BGR and opacity.
    """

    corner_enu_m: FloatArray
    right_enu_m: FloatArray
    down_enu_m: FloatArray
    texture: ImageArray

    def distance_m(self, camera_enu_m: FloatArray) -> float:
        """Horizontal distance from the camera to the middle."""
        return float(np.linalg.norm((self.corner_enu_m + self.right_enu_m / 2 - camera_enu_m)[:2]))

    def outline_enu_m(self) -> FloatArray:
        """Points along the edge, ``(n, 3)``."""
        steps = np.linspace(0, 1, _OUTLINE_POINTS, endpoint=False)[:, None]
        right, down = self.right_enu_m, self.down_enu_m
        sides = [steps * right, right + steps * down, right + down - steps * right, down - steps * down]
        return self.corner_enu_m + np.concatenate(sides)


def sprites(world: World, camera_enu_m: FloatArray, time_s: float) -> list[Sprite]:
    """Sprites in painter's order: those on the ground, then upright ones from far to near."""
    flat, walkers = [_marker(marker) for marker in world.markers], [w for w in world.walkers if w.from_s <= time_s]
    flat += [_shadow(walker, world, time_s) for walker in walkers if walker.shadow]
    upright = [_upright(p.ends_enu_m()[0], p.height_m, p.width_m, camera_enu_m, _post_texture()) for p in world.posts]
    upright += [_upright(w.foot_enu_m(time_s), w.height_m, w.width_m, camera_enu_m, _person_texture()) for w in walkers]
    upright += [_wall(wall) for wall in world.walls]
    upright.sort(key=lambda sprite: -sprite.distance_m(camera_enu_m))
    return flat + upright


def draw(image: ImageArray, rays: Rays, camera: Camera, pose: Pose, items: list[Sprite]) -> None:
    """Draw ``items`` in their order onto ``image (h, w, 3)`` as ``camera`` sees them from ``pose``.

    Args:
        image: Written.
        rays: The camera's ray table, see ``shading.shade``.
        camera: The camera.
        pose: Where it is.
        items: Sprites, in order; those out of view are skipped.
    """
    if not items:
        return
    cam_from_enu = matrix(inverse(pose.wxyz))
    outlines = np.stack([sprite.outline_enu_m() for sprite in items]) - pose.position_enu_m
    for sprite, pixels in zip(items, pixels_from_rays(camera, outlines @ cam_from_enu.T), strict=True):
        region = _region(camera, pixels)
        if region is None:
            continue
        axes = np.column_stack([sprite.right_enu_m, sprite.down_enu_m, sprite.corner_enu_m - pose.position_enu_m])
        if abs(np.linalg.det(axes)) < _MIN_DETERMINANT:
            continue
        area = (region[2] - region[0]) * (region[3] - region[1])
        samples = _SAMPLES if area < _LARGE_PX else _SAMPLES_IF_LARGE
        draw_sprite(
            rays,
            region,
            np.asarray(np.linalg.inv(cam_from_enu @ axes), dtype=np.float64),
            sprite.texture,
            samples,
            image,
        )


def _region(camera: Camera, pixels: FloatArray) -> tuple[int, int, int, int] | None:
    """Columns and rows (half-open) that an outline ``(n, 2)`` covers; None if outside the image."""
    finite_pixels = pixels[np.all(np.isfinite(pixels), axis=-1)]
    if len(finite_pixels) == 0:
        return None
    low, high = finite_pixels.min(axis=0), finite_pixels.max(axis=0)
    margin = 2 + (high - low) * (0.0 if len(finite_pixels) == len(pixels) else 0.1)
    size = np.array([camera.width_px, camera.height_px])
    left, top = (int(x) for x in np.floor(np.clip(low - margin, 0, size)))
    right, bottom = (int(x) for x in np.ceil(np.clip(high + margin + 1, 0, size)))
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
    """Shadow of a walker on the plane, from the feet away from the sun."""
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


_TILE_TEXELS = 1024  # texels of a tile's side
_TEXELS_PER_STD = 32  # of a texel; small integers keep the tiles in the processor's cache
_LEVELS = 9  # from 1024 down to 4 texels; the smallest is all but flat
_BANK_STEP_M = 0.25
_BANK_REACH_M = 2500.0
_NOISE_MARGIN_PX = 64
_NO_SHORE_M = 1e6
_MIN_HEIGHT_M = 0.05
_TIME_INDEX = 14  # of the time in a camera's state


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """Model of the sensor.

    Attributes:
        noise_std: Gaussian noise of every channel, in grey levels of 255.
        seed: Seed of the noise.
    """

    noise_std: float = 2.0
    seed: int = 1


class Renderer:
    """Renders ``world`` for ``camera``; deterministic on one machine.

    Args:
        camera: The camera, lens distortion included.
        world: The world.
        imaging: Noise.
    """

    def __init__(self, camera: Camera, world: World, sensor: SensorModel | None = None) -> None:
        self.camera = camera
        self.world = world
        self._sensor = sensor or SensorModel()
        self._rays = _ray_table(camera)
        self._last_state: tuple[float, ...] = ()
        self._background_image: ImageArray | None = None
        self._wet_rows = slice(0)
        self._river, self._banks = _river_tables(world.river)
        fine, starts = _pyramid(3 * world.seed, 5, 0.8)
        coarse, _ = _pyramid(3 * world.seed + 1, 8, 0.7)
        water, _ = _pyramid(3 * world.seed + 2, 6, 0.75)
        self._tiles = (fine, coarse, water, starts)
        size_px = camera.height_px + _NOISE_MARGIN_PX, camera.width_px + _NOISE_MARGIN_PX
        std = self._sensor.noise_std
        self._noise = None if std == 0 else _sensor_noise(self._sensor.seed, *size_px, std)

    def render(self, pose: Pose, time_s: float) -> ImageArray:
        """The sharp image at ``time_s`` of the flight, with noise.

        Args:
            pose: The camera, ``()`` batch; one on the ground is lifted by 5 cm.
            time_s: Seconds since the flight's start; moves water and walkers, picks the noise.

        Returns:
            ``(height, width, 3)`` uint8 BGR; black where the lens model has no inverse.
        """
        return self._with_noise(self._render_without_noise(pose, time_s), time_s)

    def render_exposure(self, poses: Sequence[Pose], times_s: Sequence[float]) -> ImageArray:
        """Mean of images during an exposure (motion blur) with noise of the first time."""
        total = np.zeros((self.camera.height_px, self.camera.width_px, 3), dtype=np.float32)
        for pose, time_s in zip(poses, times_s, strict=True):
            cv2.accumulate(self._render_without_noise(pose, time_s), total)
        return self._with_noise(np.rint(total / len(poses)).astype(np.uint8), times_s[0])

    def _render_without_noise(self, pose: Pose, time_s: float) -> ImageArray:
        camera = self.camera
        image = np.empty((camera.height_px, camera.width_px, 3), dtype=np.uint8)
        east, north, up = pose.position_enu_m
        height = max(up, _MIN_HEIGHT_M)
        rotation = matrix(pose.wxyz).ravel()
        state = (east, north, height, *rotation, 1 / camera.fx_px, 1 / camera.fy_px, time_s, 1 / height)
        self._background(tuple(map(float, state)), image)
        draw(image, self._rays, camera, pose, sprites(self.world, pose.position_enu_m, time_s))
        return image

    def _background(self, state: tuple[float, ...], image: ImageArray) -> None:
        """Draw sky, land and water; for a repeated view only the rows with water."""
        look = self.world.look
        appearance = (look.ground_contrast, look.water_contrast, self.world.river.flow_mps)
        view_state = (*state[:_TIME_INDEX], *state[_TIME_INDEX + 1 :])
        rows = slice(None)
        if self._background_image is not None and view_state == self._last_state:
            np.copyto(image, self._background_image)
            rows = self._wet_rows
        water_rows = shade(self._rays[rows], state, self._river, self._banks, appearance, self._tiles, image[rows])
        if view_state != self._last_state:
            self._background_image = None
        elif self._background_image is None:  # the second render of this view
            self._background_image, self._wet_rows = image.copy(), slice(*water_rows)
        self._last_state = view_state

    def _with_noise(self, image: ImageArray, time_s: float) -> ImageArray:
        if self._noise is None:
            return image
        generator = np.random.default_rng([self._sensor.seed, round(time_s * 1e6) % 2**32])
        down, right = generator.integers(0, _NOISE_MARGIN_PX, 2)
        noise = self._noise[down : down + image.shape[0], right : right + image.shape[1]]
        return np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), dtype=np.uint8)


@lru_cache(maxsize=2)
def _ray_table(camera: Camera) -> Rays:
    """Rays ``(h, w, 3)`` float32, zero where the lens model has no inverse; cached, as it takes a second for 1080p."""
    u, v = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    rays = rays_from_pixels(camera, np.stack([u, v], axis=-1))
    return np.nan_to_num(rays).astype(np.float32)


def _river_tables(river: River) -> tuple[RiverFrame, FloatArray]:
    """River frame (origin, direction, grid), and banks and shores ``(n, 4)``, for ``shade``."""
    along = np.arange(-_BANK_REACH_M, _BANK_REACH_M, _BANK_STEP_M)
    left, right = river.banks_m(along)
    shore_left, shore_right = river.shores_m(along)
    # Without an island both shores are so far to the left that every point is outside.
    table = np.column_stack([left, right, np.nan_to_num(shore_left, nan=_NO_SHORE_M)])
    table = np.column_stack([table, np.nan_to_num(shore_right, nan=_NO_SHORE_M)])
    head = [*river.origin_en_m, np.sin(river.azimuth_rad), np.cos(river.azimuth_rad), along[0], _BANK_STEP_M]
    return tuple(map(float, head)), table


@lru_cache(maxsize=16)
def _pyramid(seed: int, octaves: int, roughness: float) -> tuple[Texels, IntArray]:
    """Sum of smooth noises, each half the size and ``roughness`` times the strength of the one before, as a pyramid.

    A pyramid is a periodic square tile with its mipmap levels, one after the other.

    Args:
        seed: Seed of the tile.
        octaves: Number of octaves from the finest (2 texels) on.
        roughness: 1 for equal strength at every scale; larger forms prevail below 1.

    Returns:
        Values of all levels, of mean 0 and standard deviation ``_TEXELS_PER_STD``, int8 ``(texels,)``; and where each
        level starts ``(_LEVELS,)``.
    """
    generator = np.random.default_rng(seed)
    tile = np.zeros((_TILE_TEXELS, _TILE_TEXELS), dtype=np.float32)
    for octave in range(octaves):
        cells = _TILE_TEXELS // 2 ** (octave + 1)
        coarse = generator.standard_normal((cells, cells)).astype(np.float32)
        wrapped = cv2.copyMakeBorder(coarse, 2, 2, 2, 2, cv2.BORDER_WRAP)
        scale = _TILE_TEXELS // cells
        smooth = cv2.resize(wrapped, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        tile += roughness ** (octaves - 1 - octave) * smooth[2 * scale : -2 * scale, 2 * scale : -2 * scale]
    levels = [np.asarray((tile - tile.mean()) / tile.std(), dtype=np.float32)]
    while len(levels) < _LEVELS:
        half = levels[-1].shape[0] // 2
        levels.append(levels[-1].reshape(half, 2, half, 2).mean(axis=(1, 3)))
    sizes = [level.size for level in levels]
    values = np.concatenate([level.ravel() for level in levels])
    texels = np.rint(np.clip(values * _TEXELS_PER_STD, -127, 127)).astype(np.int8)
    return texels, np.concatenate([[0], np.cumsum(sizes[:-1])]).astype(int)


@lru_cache(maxsize=3)
def _sensor_noise(seed: int, height_px: int, width_px: int, std: float) -> npt.NDArray[np.int16]:
    """Gaussian noise in grey levels, ``(height_px, width_px, 3)``."""
    generator = np.random.default_rng(seed)
    noise: FloatArray = generator.standard_normal((height_px, width_px, 3)) * std
    return np.rint(noise).astype(np.int16)
