"""Where a calibrated camera would see what was observed, and what is left of each observation."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerodft.geometry import EARTH_RADIUS_M, STANDARD_REFRACTION, camera_angles, pixels_from_rays, rays_from_pixels
from aerodft.model import (
    Evidence,
    FloatArray,
    GroundLines,
    GroundPoint,
    Horizon,
    KnownHeight,
    KnownLength,
    Landmark,
    ProjectionModel,
    Px,
    SlantRange,
    Vertical,
)
from calibration.flight import ImagesResult
from calibration.pose import ObservationResidual, Result, State

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mark:
    """One observation in the image.

    Attributes:
        kind: As its table is called in the file.
        name: Its name.
        text: Its name, and what is known of it where that is one number.
        seen_px: ``(k, 2)`` its pixels.
        expected_px: ``(k, 2)`` where the calibrated camera sees them; NaN where it cannot, and where nothing says.
        lines: Which of the pixels are joined.
    """

    kind: str
    name: str
    text: str
    seen_px: FloatArray
    expected_px: FloatArray
    lines: tuple[tuple[int, int], ...] = ()

    @property
    def worst(self) -> int:
        """Index of the pixel that is farthest from where it should be; 0 where no pixel says."""
        off = np.linalg.norm(self.expected_px - self.seen_px, axis=-1)
        return 0 if np.all(np.isnan(off)) else int(np.nanargmax(off))

    @property
    def off_px(self) -> FloatArray:
        """``(2,)`` from that pixel to where it should be, right and down; NaN where nothing says."""
        return np.asarray((self.expected_px - self.seen_px)[self.worst])


def mark_of(state: State, evidence: Evidence) -> Mark:
    """An observation's mark.

    Args:
        state: The calibrated camera.
        evidence: The observation.
    """
    kind, pixels, known = _about(evidence)
    lines: tuple[tuple[int, int], ...] = tuple((first, first + 1) for first in range(0, len(pixels) - 1, 2))
    if isinstance(evidence, Horizon):
        lines = tuple(itertools.pairwise(np.argsort([u for u, _ in pixels]).tolist()))
    return Mark(
        kind=kind,
        name=evidence.name,
        text=f"{evidence.name} {known}" if known else evidence.name,
        seen_px=np.array(pixels, dtype=np.float64),
        expected_px=_expected(state, evidence),
        lines=lines,
    )


def _about(evidence: Evidence) -> tuple[str, tuple[Px, ...], str]:
    """Kind and pixels of a piece of evidence, and the number that is known of it."""
    match evidence:
        case SlantRange(pixel=pixel, range_m=range_m):
            about: tuple[str, tuple[Px, ...], str] = "range", (pixel,), f"{range_m:g} m"
        case KnownLength(pixels=pixels, length_m=length_m):
            about = "length", pixels, f"{length_m:g} m"
        case KnownHeight(base=base, top=top, height_m=height_m):
            about = "height", (base, top), f"{height_m:g} m"
        case GroundLines(first=first, second=second):
            about = "right_angle" if evidence.at_right_angle else "parallel", (*first, *second), ""
        case Vertical(pixels=pixels):
            about = "vertical", pixels, ""
        case Horizon(pixels=several):
            about = "horizon", several, ""
        case Landmark(pixel=pixel) | GroundPoint(pixel=pixel):
            about = "landmark" if isinstance(evidence, Landmark) else "ground", (pixel,), ""
    return about


def _expected(state: State, evidence: Evidence) -> FloatArray:
    """``(k, 2)`` of its pixels; NaN where nothing says."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return _EXPECTED[type(evidence)](state, evidence)


def pixels_of(state: State, points_enu_m: FloatArray) -> FloatArray:
    """Pixels ``(..., 2)`` of points ``(..., 3)``, may be outside the image; NaN where the model sees none.

    The paper's model sees what is below its camera only (its Eq. 2 to 5, the other way round), and nothing exactly
    abreast of it.
    """
    away = points_enu_m - state.position_m
    if state.model is ProjectionModel.PINHOLE:
        return pixels_from_rays(state.camera, away @ state.rotation)
    camera = state.camera
    tilt, _, heading = camera_angles(state.wxyz)
    right = np.cos(heading) * away[..., 0] - np.sin(heading) * away[..., 1]
    ahead = np.sin(heading) * away[..., 0] + np.cos(heading) * away[..., 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        psi = np.where(away[..., 2] < 0, np.arctan(ahead / -away[..., 2]), np.nan)
        phi = np.where(ahead != 0, np.arctan(right / ahead), np.nan)
    u = camera.width_px * (0.5 + phi / camera.hfov_rad)
    v = camera.height_px * (0.5 - (psi - tilt) / camera.vfov_rad)
    return np.stack([u + 0 * v, v + 0 * u], axis=-1)


def ground_of(state: State, pixels_px: FloatArray, elevation_m: float) -> FloatArray:
    """Points ``(..., 3)`` at which pixels ``(..., 2)`` meet the level plane at ``elevation_m``; NaN for a miss."""
    return state.ground_points(pixels_px, elevation_m).points_enu_m


def _rays(state: State, pixels: tuple[Px, ...]) -> FloatArray:
    rays = rays_from_pixels(state.camera, np.array(pixels, dtype=np.float64)) @ state.rotation.T
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def _pixels_along(state: State, rays_enu: FloatArray) -> FloatArray:
    return pixels_from_rays(state.camera, rays_enu @ state.rotation)


def _landmark(state: State, evidence: Landmark) -> FloatArray:
    """A landmark's pixel; of one with an unknown component, that of the possible point nearest to the line of sight."""
    east, north, up = (math.nan if value is None else value for value in evidence.position_m)
    point = np.array([east, north, up])
    unknown = np.isnan(point)
    if np.any(unknown):
        point[unknown] = state.position_m[unknown]
        if state.model is ProjectionModel.PINHOLE:
            sight = _rays(state, (evidence.pixel,))[0]
        else:
            sight = ground_of(state, np.array(evidence.pixel), state.elevation_m) - state.position_m
        across = np.cross(sight, unknown.astype(np.float64))
        # camera + s sight = point + t unknown + r across, for s, t and r: t is angle_rad
        axes = np.stack([sight, -unknown.astype(np.float64), -across], axis=-1)
        if not np.all(np.isfinite(axes)) or np.linalg.matrix_rank(axes) < len(axes):
            return np.full((1, 2), np.nan)
        point[unknown] += np.linalg.solve(axes, point - state.position_m)[1]
    return pixels_of(state, point[None])


def _range(state: State, evidence: SlantRange) -> FloatArray:
    """In the same direction over the ground, as far away as was measured."""
    seen = ground_of(state, np.array([evidence.pixel]), state.elevation_m)
    away = (seen - state.position_m)[:, :2]
    square = evidence.range_m**2 - (float(state.position_m[2]) - state.elevation_m) ** 2
    reach = math.sqrt(square) if square >= 0 else math.nan
    point = seen.copy()
    point[:, :2] = state.position_m[:2] + away * reach / np.linalg.norm(away, axis=-1, keepdims=True)
    return pixels_of(state, point)


def _ground_point(state: State, evidence: GroundPoint) -> FloatArray:
    return pixels_of(state, from_foot(state, np.array([evidence.xy_m]), state.elevation_m))


def from_foot(state: State, xy_m: FloatArray, elevation_m: float) -> FloatArray:
    """East, north, up ``(..., 3)`` of points to the right and ahead of the camera's foot ``(..., 2)``."""
    heading = state.value("heading")
    axes = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
    east_north = state.position_m[:2] + xy_m @ axes
    return np.concatenate([east_north, np.full((*east_north.shape[:-1], 1), elevation_m)], axis=-1)


def _length(state: State, evidence: KnownLength) -> FloatArray:
    """Ends of a known length, moved along their line by equal amounts until it fits."""
    ends = ground_of(state, np.array(evidence.pixels), state.elevation_m + evidence.elevation_m)
    middle = ends.mean(axis=0)
    return pixels_of(state, middle + (ends - middle) * evidence.length_m / np.linalg.norm(ends[1] - ends[0]))


def _height(state: State, evidence: KnownHeight) -> FloatArray:
    """The top above the base, which stays."""
    base = ground_of(state, np.array(evidence.base), state.elevation_m)
    top = pixels_of(state, base + evidence.height_m * _UP)
    return np.stack([np.full(2, np.nan), top])


def _vertical(state: State, evidence: Vertical) -> FloatArray:
    """On the vertical through the middle of the two."""
    rays = _rays(state, evidence.pixels)
    normal = np.cross(rays.sum(axis=0), _UP)
    normal /= np.linalg.norm(normal)
    return _pixels_along(state, rays - (rays @ normal)[:, None] * normal)


def _lines(state: State, evidence: GroundLines) -> FloatArray:
    """Two parallel lines, turned about their middles by equal amounts in their level planes."""
    rays = _rays(state, (*evidence.first, *evidence.second))
    level = rays / np.abs(rays[:, 2:])
    if np.any(level[0::2, 2] != level[1::2, 2]):
        return np.full((len(rays), 2), np.nan)  # a level line does not cross the horizon
    along = level[1::2, :2] - level[0::2, :2]
    first, second = np.arctan2(along[:, 1], along[:, 0]).tolist()
    angle_rad = math.pi / 2 if evidence.at_right_angle else 0.0
    turn = ((second - first - angle_rad + math.pi / 2) % math.pi - math.pi / 2) / 2
    turned = [_turned(pair, angle) for pair, angle in ((level[:2], turn), (level[2:], -turn))]
    return _pixels_along(state, np.concatenate(turned))


def _turned(points_m: FloatArray, angle_rad: float) -> FloatArray:
    """Points ``(k, 3)``, turned counterclockwise about the vertical through their middle."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    middle = points_m.mean(axis=0)
    return np.asarray(middle + (points_m - middle) @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]))


def _horizon(state: State, evidence: Horizon) -> FloatArray:
    """Straight above or below, on the horizon; the paper's is a row of the image (its Eq. 3)."""
    above_m = max(float(state.position_m[2]) - state.elevation_m, 0.0)
    dip = math.sqrt(2 * above_m * (1 - STANDARD_REFRACTION) / EARTH_RADIUS_M) if evidence.is_sea else 0.0
    if state.model is ProjectionModel.DFT:
        camera, (tilt, _, _) = state.camera, state.angles_rad
        row_px = camera.height_px * (0.5 - (math.pi / 2 - dip - tilt) / camera.vfov_rad)
        return np.array([(u, row_px) for u, _ in evidence.pixels])
    rays = _rays(state, evidence.pixels)
    rays[:, 2] = -math.tan(dip) * np.linalg.norm(rays[:, :2], axis=-1)
    return _pixels_along(state, rays)


_EXPECTED: dict[type, Callable[..., FloatArray]] = {
    Landmark: _landmark,
    SlantRange: _range,
    GroundPoint: _ground_point,
    KnownLength: _length,
    KnownHeight: _height,
    Vertical: _vertical,
    GroundLines: _lines,
    Horizon: _horizon,
}


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One observation.

    Attributes:
        mark: In the image.
        left: What is left of it.
        values: ``(m,)`` its residuals in standard deviations, independent of each other.
        range_m: From the camera to what was observed, or to the ground that is seen there; NaN where it shows none.
    """

    mark: Mark
    left: ObservationResidual
    values: FloatArray
    range_m: float

    @property
    def sigma(self) -> FloatArray:
        """``(2,)`` its residual in standard deviations, in the direction that it has in the image."""
        length = float(np.linalg.norm(self.mark.off_px))
        return self.mark.off_px * (self.left.sigma / length if length > 0 else 0.0)

    @property
    def is_plane(self) -> bool:
        """Whether the observation has two residuals, right and down, not one."""
        return len(self.values) == 2  # noqa: PLR2004 - dimensions of an image


def rows_of(result: Result | ImagesResult) -> tuple[Row, ...]:
    """All observations in their order, of many images one image after the other."""
    evidence, residuals = result.evidence, result.solution.residuals
    if isinstance(result, ImagesResult):
        states = [result.solution.cameras[image] for image in result.problem.image_of]
    else:
        states = [result.solution.state] * len(evidence)
    rows = []
    for index, (each, state, left) in enumerate(zip(evidence, states, result.left, strict=True)):
        mark, values = mark_of(state, each), residuals.values[residuals.owner == index]
        rows.append(Row(mark, left, values, _range_m(state, each, mark)))
    return tuple(rows)


def _range_m(state: State, evidence: Evidence, mark: Mark) -> float:
    if isinstance(evidence, Landmark):
        east, north, up = evidence.position_m
        if east is not None and north is not None and up is not None:
            return math.dist((east, north, up), state.position_m.tolist())
    seen = ground_of(state, mark.seen_px, state.elevation_m)
    return float(np.linalg.norm(seen - state.position_m, axis=-1).mean())
