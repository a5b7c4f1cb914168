"""Compiled loops of the renderer: intersect every pixel's ray with the plane, and shade it."""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from aerodft.jit import njit, njit_inline
from aerodft.model import FloatArray, ImageArray, IntArray

Rays: TypeAlias = npt.NDArray[np.float32]
Texels: TypeAlias = npt.NDArray[np.int8]

# Tuples, not arrays: their elements stay in registers throughout the loop.
CameraState: TypeAlias = tuple[float, ...]
RiverFrame: TypeAlias = tuple[float, ...]
Appearance: TypeAlias = tuple[float, float, float]
Tiles: TypeAlias = tuple[Texels, Texels, Texels, IntArray]

_FINE_PER_M = 1 / 0.012
_COARSE_PER_M = 1 / 0.192
_WATER_PER_M = 1 / 0.03
_LEVEL_OFFSET = -4.0  # pyramid levels between the two ground textures
_LOG2_TILE_TEXELS = 10
_TILE_TEXELS = 1 << _LOG2_TILE_TEXELS
_LAST_LEVEL = 8
_MIN_DOWN = 1e-3
_NO_SHORE_M = 1e5
_FINE_AMPLITUDE = 0.13 / 32  # of the brightness, by one standard deviation of a texel
_COARSE_AMPLITUDE = 0.12 / 32
_WAVE_AMPLITUDE = 0.09 / 32
_GREEN_AMPLITUDE = 0.45 / 32
HAZE_PER_M2 = 1 / 3000.0**2
SKY = (235.0, 215.0, 190.0)
_SOIL = (84.0, 128.0, 152.0)
_GRASS = (58.0, 122.0, 88.0)
_WATER = (104.0, 82.0, 52.0)


@njit_inline
def _texel(texels: Texels, start: int, level: int, x: float, y: float) -> float:
    """Bilinear value of the level that begins at ``start``, at ``x, y`` (in texels of level 0)."""
    mask, shift = (_TILE_TEXELS >> level) - 1, _LOG2_TILE_TEXELS - level
    scale = 1.0 / (1 << level)
    fx = x * scale - 0.5
    fy = y * scale - 0.5
    left, above = np.floor(fx), np.floor(fy)
    ix, iy = int(left), int(above)
    wx, wy = fx - left, fy - above
    x0, x1 = ix & mask, (ix + 1) & mask
    row0 = start + ((iy & mask) << shift)
    row1 = start + (((iy + 1) & mask) << shift)
    # Unsigned indices skip numba's check for negative ones: a third of the time.
    top = texels[np.uint64(row0 + x0)] * (1 - wx) + texels[np.uint64(row0 + x1)] * wx
    bottom = texels[np.uint64(row1 + x0)] * (1 - wx) + texels[np.uint64(row1 + x1)] * wx
    return float(top + wy * (bottom - top))


@njit_inline
def sample(texels: Texels, starts: IntArray, x: float, y: float, level: float) -> float:
    """Trilinear value at ``x, y`` (in texels of level 0), between the two pyramid levels around ``level``."""
    if level >= _LAST_LEVEL:
        return 0.0
    if level <= 0.0:
        return _texel(texels, 0, 0, x, y)
    below = int(level)
    low = _texel(texels, starts[below], below, x, y)
    return low + (level - below) * (_texel(texels, starts[below + 1], below + 1, x, y) - low)


@njit_inline
def gap_to_bank(a: float, y: float, banks: FloatArray, first: float, spacing: float) -> tuple[float, float]:
    """Distance across to the nearest bank or shore (m, positive in water), and that curve's slope.

    Args:
        a: Station (m).
        y: Across coordinate (m).
        banks: ``(n, 4)`` left bank, right bank, islands' left and right shores (m across) at stations.
        first: First station (m).
        spacing: Of the stations (m).
    """
    position = min(max((a - first) / spacing, 0.0), banks.shape[0] - 1.001)
    index = int(position)
    weight = position - index
    left = banks[index, 0] + weight * (banks[index + 1, 0] - banks[index, 0]) - y
    right = y - banks[index, 1] - weight * (banks[index + 1, 1] - banks[index, 1])
    gap, curve = (left, 0) if left < right else (right, 1)
    if banks[index, 2] < _NO_SHORE_M and banks[index + 1, 2] < _NO_SHORE_M:
        left = y - banks[index, 2] - weight * (banks[index + 1, 2] - banks[index, 2])
        right = banks[index, 3] + weight * (banks[index + 1, 3] - banks[index, 3]) - y
        shore, shore_curve = (left, 2) if left > right else (right, 3)
        if shore < gap:
            gap, curve = shore, shore_curve
    return gap, (banks[index + 1, curve] - banks[index, curve]) / spacing


@njit_inline
def paint_sky(rays: Rays, v: int, u: int, image: ImageArray) -> None:
    """Paint the sky, or black where the lens has no ray."""
    is_seen = rays[v, u, 0] != 0 or rays[v, u, 1] != 0 or rays[v, u, 2] != 0
    for k in range(3):
        image[v, u, k] = np.uint8(SKY[k]) if is_seen else np.uint8(0)


@njit_inline
def trace_ground(
    rays: Rays, v: int, u: int, camera: CameraState, river: RiverFrame
) -> tuple[float, float, float, tuple[float, float, float, float], float, float, float]:
    """Intersect a pixel's ray with the plane.

    Returns:
        Length of the ray in its own units, 0 for the sky; east and north from the camera (m); derivatives of east and
        north by a pixel to the right and by one down; the pixel's footprint (m); along and across coordinates in the
        river (m).
    """
    x, y, z = float(rays[v, u, 0]), float(rays[v, u, 1]), float(rays[v, u, 2])
    up = camera[9] * x + camera[10] * y + camera[11] * z
    if up > -_MIN_DOWN:
        return 0.0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0
    reach = -camera[2] / up
    east = reach * (camera[3] * x + camera[4] * y + camera[5] * z)
    north = reach * (camera[6] * x + camera[7] * y + camera[8] * z)
    right, down = reach * camera[12], reach * camera[13]
    motion = (
        right * (camera[3] + east * camera[15] * camera[9]),
        right * (camera[6] + north * camera[15] * camera[9]),
        down * (camera[4] + east * camera[15] * camera[10]),
        down * (camera[7] + north * camera[15] * camera[10]),
    )
    square = motion[0] * motion[0] + motion[1] * motion[1] + motion[2] * motion[2] + motion[3] * motion[3]
    from_east, from_north = east + camera[0] - river[0], north + camera[1] - river[1]
    along = from_east * river[2] + from_north * river[3]
    across = from_north * river[2] - from_east * river[3]
    return reach, east, north, motion, np.sqrt(0.5 * square), along, across


@njit_inline
def water_fraction(
    along: float,
    across: float,
    motion: tuple[float, float, float, float],
    footprint: float,
    banks: FloatArray,
    river: RiverFrame,
) -> float:
    """Fraction of a pixel that is water."""
    gap, slope = gap_to_bank(along, across, banks, river[4], river[5])
    if abs(gap) > (2.0 + 2.0 * abs(slope)) * footprint:
        return 0.0 if gap < 0 else 1.0
    sine, cosine = river[2], river[3]
    right = slope * (motion[0] * sine + motion[1] * cosine) - (motion[1] * sine - motion[0] * cosine)
    down = slope * (motion[2] * sine + motion[3] * cosine) - (motion[3] * sine - motion[2] * cosine)
    return float(min(max(0.5 + gap / np.hypot(right, down), 0.0), 1.0))


@njit_inline
def _water(tile: Texels, starts: IntArray, along: float, across: float, footprint: float, contrast: float) -> float:
    """Brightness of the water, 1 on average."""
    level = np.log2(footprint * _WATER_PER_M)
    wave = sample(tile, starts, along * _WATER_PER_M, across * _WATER_PER_M, level)
    return 1.0 + contrast * _WAVE_AMPLITUDE * wave


@njit_inline
def _land(
    fine_tile: Texels,
    coarse_tile: Texels,
    starts: IntArray,
    east: float,
    north: float,
    footprint: float,
    contrast: float,
) -> tuple[float, float]:
    """Brightness of the land (1 on average) and its greenness (0 to 1)."""
    level = np.log2(footprint * _FINE_PER_M)
    fine = sample(fine_tile, starts, east * _FINE_PER_M, north * _FINE_PER_M, level)
    level += _LEVEL_OFFSET
    rough = sample(coarse_tile, starts, east * _COARSE_PER_M, north * _COARSE_PER_M, level)
    green = min(max(0.5 + contrast * _GREEN_AMPLITUDE * rough, 0.0), 1.0)
    return 1.0 + contrast * (_FINE_AMPLITUDE * fine + _COARSE_AMPLITUDE * rough), green


@njit_inline
def _mix_pixel(image: ImageArray, v: int, u: int, wet: float, lights: tuple[float, float, float], clear: float) -> None:
    """Mix land (brightness, greenness), water (brightness) and haze into one pixel."""
    land, green, water = lights
    for k in range(3):
        ground = land * (_SOIL[k] + green * (_GRASS[k] - _SOIL[k]))
        colour = ground + wet * (water * _WATER[k] - ground)
        colour = SKY[k] + clear * (colour - SKY[k])
        image[v, u, k] = np.uint8(min(max(colour + 0.5, 0.0), 255.0))


@njit
def shade(
    rays: Rays,
    camera: CameraState,
    river: RiverFrame,
    banks: FloatArray,
    look: Appearance,
    tiles: Tiles,
    image: ImageArray,
) -> tuple[int, int]:
    """Fill ``image`` with sky, land and water; a pixel cut by a bank is mixed by the area on either side.

    Args:
        rays: ``(h, w, 3)`` rays in camera axes; zero where the lens sees nothing.
        camera: Position ENU (m), ``enu_SO3_cam`` matrix by rows, 1 / focal lengths x and y (1/px), time (s),
            1 / height (1/m).
        river: Origin east and north (m), sine and cosine of the azimuth, first station and spacing (m).
        banks: ``(n, 4)``, see ``gap_to_bank``.
        look: Contrast of ground and water, speed of the water (m/s).
        tiles: Fine ground, coarse ground and water texels, and the levels' starts.
        image: ``(h, w, 3)`` BGR, written.

    Returns:
        First row with water and the end of the rows: no other row changes with time.
    """
    first_wet, end_wet = rays.shape[0], 0
    fine_tile, coarse_tile, water_tile, starts = tiles
    for v in range(rays.shape[0]):
        for u in range(rays.shape[1]):
            reach, east, north, motion, footprint, along, across = trace_ground(rays, v, u, camera, river)
            if reach == 0.0:
                paint_sky(rays, v, u, image)
                continue
            east += camera[0]
            north += camera[1]
            wet = water_fraction(along, across, motion, footprint, banks, river)
            land, green, water = 1.0, 0.5, 1.0
            if wet < 1.0:
                land, green = _land(fine_tile, coarse_tile, starts, east, north, footprint, look[0])
            if wet > 0.0:
                first_wet, end_wet = min(first_wet, v), v + 1
                water = _water(water_tile, starts, along - look[2] * camera[14], across, footprint, look[1])
            _mix_pixel(image, v, u, wet, (land, green, water), 1.0 / (1.0 + reach * reach * HAZE_PER_M2))
    return first_wet, end_wet


@njit_inline
def _project(rays: Rays, v: int, u: int, dv: float, du: float, planar: FloatArray) -> tuple[float, float, float]:
    """Coordinates ``planar @ ray`` of the ray ``dv, du`` pixels off a pixel's centre, linear between neighbours."""
    u0, v0 = max(u - 1, 0), max(v - 1, 0)
    u1, v1 = min(u + 1, rays.shape[1] - 1), min(v + 1, rays.shape[0] - 1)
    across, down = du / max(u1 - u0, 1), dv / max(v1 - v0, 1)
    x, y, s = 0.0, 0.0, 0.0
    for k in range(3):
        ray = rays[v, u, k] + across * (rays[v, u1, k] - rays[v, u0, k]) + down * (rays[v1, u, k] - rays[v0, u, k])
        x += planar[0, k] * ray
        y += planar[1, k] * ray
        s += planar[2, k] * ray
    return x, y, s


@njit
def draw_sprite(
    rays: Rays,
    region: tuple[int, int, int, int],
    planar: FloatArray,
    texture: ImageArray,
    samples: int,
    image: ImageArray,
) -> None:
    """Draw a textured rectangle in space over ``image``, each pixel from ``samples`` x ``samples`` rays.

    Args:
        rays: ``(h, w, 3)`` as for ``shade``.
        region: Left, top, right, bottom pixel (half-open) that the rectangle can touch.
        planar: ``(3, 3)`` that takes a ray in camera axes to (x s, y s, s): x, y in [0, 1) on the rectangle, s > 0
            in front of the camera.
        texture: ``(h, w, 4)`` BGR and opacity.
        samples: Rays along each side of a pixel.
        image: ``(h, w, 3)`` BGR, written.
    """
    left, top, right, bottom = region
    rows, columns = texture.shape[0], texture.shape[1]
    for v in range(top, bottom):
        for u in range(left, right):
            blue, green, red, opacity = 0.0, 0.0, 0.0, 0.0
            for j in range(samples):
                for i in range(samples):
                    x, y, s = _project(rays, v, u, (j + 0.5) / samples - 0.5, (i + 0.5) / samples - 0.5, planar)
                    if s > 0 and 0 <= x < s and 0 <= y < s:
                        texel = texture[int(y / s * rows), int(x / s * columns)]
                        blue += float(texel[0]) * texel[3]
                        green += float(texel[1]) * texel[3]
                        red += float(texel[2]) * texel[3]
                        opacity += texel[3]
            weight = 1.0 / (255.0 * samples * samples)
            rest = 1.0 - opacity * weight
            image[v, u, 0] = np.uint8(image[v, u, 0] * rest + blue * weight + 0.5)
            image[v, u, 1] = np.uint8(image[v, u, 1] * rest + green * weight + 0.5)
            image[v, u, 2] = np.uint8(image[v, u, 2] * rest + red * weight + 0.5)
