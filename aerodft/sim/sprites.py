"""Flat things in space (markers, posts, persons): drawn by tracing rays, so that any lens bends them rightly."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from aerodft.geometry.lens import pixels_from_rays
from aerodft.geometry.rotation import inverse, matrix
from aerodft.model.arrays import FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.model.pose import Pose
from aerodft.sim.shading import Rays, stamp
from aerodft.sim.world import Marker, Walker, Wall, World

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
