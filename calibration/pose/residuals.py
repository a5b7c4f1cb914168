"""Whitened residuals of the evidence at a state, with analytic derivatives.

An observation other than a reprojection (a range, a length, a horizon) is a condition ``g(state, pixels) = known``. Its
residual is ``g`` minus the known value over the first-order std from pixels and from the known value (Sampson error;
Hartley and Zisserman, "Multiple View Geometry", 2nd ed., section 4.2.6). Ranges and lengths, of which there are many,
are computed at once, other conditions one by one.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from aerodft.dft import (
    ELEVATION,
    FOCAL,
    INTRINSICS,
    POSITION,
    PRINCIPAL_POINT,
    PROBE_KINDS,
    ROTATION,
    GroundPoints,
    RayGeometry,
    pixel_directions,
    pixel_rays,
    scalar_jacobians,
    scalars,
    shared_count,
    vertical_angle,
)
from aerodft.geometry import (
    EARTH_RADIUS_M,
    STANDARD_REFRACTION,
    camera_angles,
    cross,
    rays_by_intrinsics,
    rays_with_jacobian,
    reproject,
    skew,
)
from aerodft.model import (
    Evidence,
    EvidenceSet,
    FloatArray,
    GroundLines,
    GroundPoint,
    Horizon,
    KnownHeight,
    KnownLength,
    Landmark,
    Prior,
    ProbeKind,
    ProjectionModel,
    Px,
    SlantRange,
    Vertical,
)
from calibration.descent import Residuals
from calibration.pose.state import BOUNDS, State, Unknowns

OUT_OF_SIGHT = 1e6
"""Residual, in standard deviations, of an observation out of sight: behind the camera, above the horizon.

Larger than of any visible one, otherwise the best state would be one that sees nothing."""

_ANGLES = ("roll", "heading")  # modulo a turn
_SMALL_LEAN_RAD = 1e-4  # below it the lean is taken as its sine, right to 1e-8 of it
_NADIR_STDS = 3.0  # of a tilt's prior: within it of straight down the prior is one of the optical axis


@dataclass(frozen=True, slots=True, eq=False)
class ConditionResidual:
    """Residual of a condition at a state.

    Attributes:
        off: ``(m,)`` computed minus known value.
        jac_shared: ``(m, s)`` by the errors of ``dft.projection``.
        cov: ``(m, m)`` of ``off``, from pixels and known values.
        std_px: Of the pixels, to convert residuals to pixels.
    """

    off: FloatArray
    jac_shared: FloatArray
    cov: FloatArray
    std_px: float


Condition: TypeAlias = Callable[[State], ConditionResidual]


def condition_of(evidence: Evidence) -> Condition:
    """Condition of one observation that is no range or length."""
    return partial(_CONDITIONS[type(evidence)], evidence)


class Distances:
    """All slant ranges to level ground, or all horizontal lengths between points of a level, of a problem.

    Args:
        evidence: Observations of one kind by their indices.

    Attributes:
        owner: ``(k,)`` indices of the observations.
        std_px: ``(k,)`` of their pixels.
    """

    def __init__(self, evidence: Mapping[int, SlantRange] | Mapping[int, KnownLength]) -> None:
        self.owner = np.array(list(evidence), dtype=np.intp)
        self.std_px = np.array([each.std_px for each in evidence.values()], dtype=np.float64)
        self._std_m = np.array([each.std_m for each in evidence.values()], dtype=np.float64)
        pixels, known_m, elevation_m = zip(
            *(
                ((each.pixel,), each.range_m, 0.0)
                if isinstance(each, SlantRange)
                else (each.pixels, each.length_m, each.elevation_m)
                for each in evidence.values()
            ),
            strict=True,
        )
        self._pixels = np.array(pixels, dtype=np.float64)
        self._known_m = np.array(known_m, dtype=np.float64)
        self._elevation_m = np.array(elevation_m, dtype=np.float64)[:, None]

    def residuals(self, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Computed minus known distances ``(k,)``, derivatives by the shared errors ``(k, s)``, and variances ``(k,)``.

        NaN where a ray misses.
        """
        ground = state.ground_points(self._pixels, state.elevation_m + self._elevation_m)
        points = ground.points_enu_m
        is_range = points.shape[1] == 1
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            vectors = points[:, 0] - state.position_m if is_range else (points[:, 1] - points[:, 0]) * [1.0, 1.0, 0.0]
            distance_m = np.sqrt(np.sum(vectors * vectors, axis=-1))
            directions = vectors / distance_m[:, None]
            by_points = directions[:, None] if is_range else np.stack([-directions, directions], axis=1)
            shared = np.einsum("kpi,kpij->kj", by_points, ground.jac_shared)
            if is_range:
                shared[:, POSITION] -= directions
            jac_px = np.einsum("kpi,kpij->kpj", by_points, ground.jac_px)
            variance = self.std_px**2 * np.sum(jac_px * jac_px, axis=(-1, -2)) + self._std_m**2
            return distance_m - self._known_m, shared, variance


def _ground(state: State, pixels: tuple[Px, ...], elevation_m: float) -> GroundPoints:
    """Ground points of pixels on the level plane ``elevation_m`` above the ground."""
    return state.ground_points(np.array(pixels, dtype=np.float64), state.elevation_m + elevation_m)


def _height(evidence: KnownHeight, state: State) -> ConditionResidual:
    pixels = (evidence.base, evidence.top)
    pose, ground, rays = state.pose, _ground(state, pixels, 0.0), None
    geometry = RayGeometry(state.position_m, np.empty((0, 3)), ground.points_enu_m)
    if state.model is ProjectionModel.PINHOLE:
        rays = pixel_directions(pixel_rays(state.camera, np.array(pixels, dtype=np.float64)), pose)
        geometry = RayGeometry(state.position_m, rays.directions_enu, ground.points_enu_m)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        value, by = scalars(PROBE_KINDS[ProbeKind.HEIGHT], state.model, geometry, pose, np.array(state.elevation_m))
        shared, jac_px = scalar_jacobians(by, ground, rays)
    variance = evidence.std_px**2 * float(np.sum(jac_px * jac_px)) + evidence.std_m**2
    residual_m = float(value) - evidence.height_m
    return ConditionResidual(np.array([residual_m]), shared[None], np.array([[variance]]), evidence.std_px)


def _ground_point(evidence: GroundPoint, state: State) -> ConditionResidual:
    """Residual in the ground frame: right and ahead of the camera's foot."""
    _, _, heading = camera_angles(state.wxyz)
    axes = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
    ground = _ground(state, (evidence.pixel,), 0.0)
    offset = ground.points_enu_m[0, :2] - state.position_m[:2]
    jac_shared = ground.jac_shared[0, :2].copy()
    jac_shared[:, :2] -= np.eye(2)
    # The ground frame rotates with the camera's heading, clockwise.
    across = np.array([-offset[1], offset[0]])
    jac_shared[:, ROTATION] -= np.outer(-across, _heading_by_rotation(state))
    jac_px = ground.jac_px[0, :2]
    cov = evidence.std_px**2 * jac_px @ jac_px.T + evidence.std_m**2 * np.eye(2)
    return ConditionResidual(axes @ offset - evidence.xy_m, axes @ jac_shared, axes @ cov @ axes.T, evidence.std_px)


def _heading_by_rotation(state: State) -> FloatArray:
    """Derivative ``(3,)`` of the heading by a small rotation in camera axes: the azimuth of the optical axis."""
    axis = state.rotation[:, 2]
    square = axis[0] ** 2 + axis[1] ** 2
    if square == 0:
        return np.zeros(3)
    by_axis = np.array([axis[1], -axis[0], 0.0]) / square
    return np.asarray(by_axis @ (-state.rotation @ skew(np.array([0.0, 0.0, 1.0]))))


def ground_error_m(state: State, evidence: Evidence) -> float | None:
    """Error of an observation's ground point or range; None where the pixel shows no ground."""
    if isinstance(evidence, SlantRange):
        off, _, _ = Distances({0: evidence}).residuals(state)
    elif isinstance(evidence, GroundPoint):
        off = _ground_point(evidence, state).off
    elif isinstance(evidence, Landmark) and evidence.position_m[2] is not None:
        off = _on_level(evidence, state).off
    else:
        return None
    error_m = float(np.linalg.norm(off))
    return error_m if math.isfinite(error_m) else None


def _landmark(evidence: Landmark, state: State) -> ConditionResidual:
    """Residual of a landmark with an unknown component: distance of ray and line; in the dft model a level plane."""
    if None not in evidence.position_m or (state.model is ProjectionModel.DFT and evidence.position_m[2] is not None):
        return _on_level(evidence, state)
    axis = evidence.position_m.index(None)
    along = np.eye(3)[axis]
    to_line = np.array([0.0 if known is None else known for known in evidence.position_m]) - state.position_m
    rays = _foot_rays(state, evidence.pixel) if state.model is ProjectionModel.DFT else _rays(state, (evidence.pixel,))
    across = cross(rays.enu[0], along)
    size = float(np.linalg.norm(across))
    if not cross(to_line, along) @ across > 0:  # behind the camera
        across = np.full(3, np.nan)
    found = _from_rays(float(across @ to_line) / size, cross(along, to_line)[None] / size, rays, evidence.std_px)
    found.jac_shared[0, POSITION] -= across / size
    variance = float(np.square(across / size) @ np.square(evidence.std_m))
    return replace(found, cov=found.cov + variance)


def _on_level(evidence: Landmark, state: State) -> ConditionResidual:
    east, north, up = evidence.position_m
    ground = _ground(state, (evidence.pixel,), (up or 0.0) - state.elevation_m)
    rows = [axis for axis, known in enumerate((east, north)) if known is not None]
    known = np.array([value for value in (east, north) if value is not None])
    jac_shared = ground.jac_shared[0, rows].copy()
    jac_px, jac_elevation = ground.jac_px[0, rows], ground.jac_shared[0, rows, ELEVATION]
    cov = evidence.std_px**2 * jac_px @ jac_px.T + np.diag(np.square(np.array(evidence.std_m)[rows]))
    cov += evidence.std_m[2] ** 2 * np.outer(jac_elevation, jac_elevation)
    jac_shared[:, ELEVATION] = 0.0  # its own elevation, not the ground's
    return ConditionResidual(ground.points_enu_m[0, rows] - known, jac_shared, cov, evidence.std_px)


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """Rays of pixels in east, north, up ``(k, 3)``, by the shared errors ``(k, 3, s)``, by the pixels ``(k, 3, 2)``."""

    enu: FloatArray
    jac_shared: FloatArray
    jac_px: FloatArray


def _rays(state: State, pixels: tuple[Px, ...]) -> _Rays:
    px = np.array(pixels, dtype=np.float64)
    rays, rotation = rays_with_jacobian(state.camera, px), state.rotation
    jac_intrinsics = rays_by_intrinsics(state.camera, px)
    shared = np.zeros((len(px), 3, INTRINSICS.start + jac_intrinsics.shape[-1]))
    shared[..., ROTATION] = -rotation @ skew(rays.rays_cam)
    shared[..., INTRINSICS] = rotation @ jac_intrinsics
    return _Rays(rays.rays_cam @ rotation.T, shared, rotation @ rays.jac_px)


def _foot_rays(state: State, pixel: Px) -> _Rays:
    """Directions from the camera to ground points, for the dft model, which has no rays; only their azimuths count."""
    ground = _ground(state, (pixel,), 0.0)
    shared = ground.jac_shared.copy()
    shared[:, :, POSITION] -= np.eye(3)
    return _Rays(ground.points_enu_m - state.position_m, shared, ground.jac_px)


def _from_rays(off: float, by_rays: FloatArray, rays: _Rays, std_px: float) -> ConditionResidual:
    """Residual of a condition on rays, from its derivatives ``(k, 3)`` by each of them."""
    shared = np.einsum("ki,kij->j", by_rays, rays.jac_shared)
    jac_px = np.einsum("ki,kij->kj", by_rays, rays.jac_px)
    variance = std_px**2 * float(np.sum(jac_px * jac_px))
    return ConditionResidual(np.array([off]), shared[None], np.array([[variance]]), std_px)


def _vertical(evidence: Vertical, state: State) -> ConditionResidual:
    """Residual of a vertical line: the plane through it and the camera has a level normal."""
    rays = _rays(state, evidence.pixels)
    a, b = rays.enu
    up = np.array([0.0, 0.0, 1.0])
    length = float(np.linalg.norm(cross(a, b)))
    by_rays = np.stack([cross(b, up), cross(up, a)]) / length
    return _from_rays(float(cross(a, b) @ up) / length, by_rays, rays, evidence.std_px)


def _ground_lines(evidence: GroundLines, state: State) -> ConditionResidual:
    """Residual of level lines: where planes through them and the camera intersect a level plane."""
    rays = _rays(state, (*evidence.first, *evidence.second))
    a, b, c, d = rays.enu
    first, second = cross(a, b)[:2], cross(c, d)[:2]
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    if evidence.at_right_angle:
        off, by_first, by_second = first @ second, second, first
    else:
        off = first[0] * second[1] - first[1] * second[0]
        by_first, by_second = np.array([second[1], -second[0]]), np.array([-first[1], first[0]])
    by_first, by_second = np.append(by_first, 0.0), np.append(by_second, 0.0)
    by_rays = np.stack([cross(b, by_first), cross(by_first, a), cross(d, by_second), cross(by_second, c)])
    return _from_rays(float(off) / size, by_rays / size, rays, evidence.std_px)


def _horizon(evidence: Horizon, state: State) -> ConditionResidual:
    """Residual of a horizon: each ray is level, or below by the sea's dip."""
    dip, by_height = _dip(evidence, state)
    if state.model is ProjectionModel.DFT:
        psi_rad, shared, jac_px = _row_angles(state, evidence.pixels)
        off = psi_rad - math.pi / 2 + dip
    else:
        rays = _rays(state, evidence.pixels)
        length = np.linalg.norm(rays.enu, axis=-1)
        off = rays.enu[:, 2] / length + math.sin(dip)
        by_rays = np.array([0.0, 0.0, 1.0]) / length[:, None] - (rays.enu[:, 2] / length**3)[:, None] * rays.enu
        shared = np.einsum("ki,kij->kj", by_rays, rays.jac_shared)
        jac_px = np.einsum("ki,kij->kj", by_rays, rays.jac_px)
        by_height *= math.cos(dip)
    shared[:, 2] += by_height
    shared[:, ELEVATION] -= by_height
    return ConditionResidual(
        off, shared, np.diag(evidence.std_px**2 * np.sum(jac_px * jac_px, axis=-1)), evidence.std_px
    )


def _row_angles(state: State, pixels: tuple[Px, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angles ``(k,)`` by the paper's Eq. 3, derivatives by shared errors ``(k, s)`` and by pixels ``(k, 2)``."""
    camera, (tilt, _, _) = state.camera, state.angles_rad
    down_px = np.array(pixels, dtype=np.float64)[:, 1]
    psi_rad = vertical_angle(down_px, tilt, camera.height_px, camera.vfov_rad)
    jac_px = np.zeros((len(pixels), 2))
    jac_px[:, 1] = -camera.vfov_rad / camera.height_px
    shared = np.zeros((len(pixels), shared_count(camera)))
    shared[:, ROTATION.start] = 1.0
    half_px = camera.height_px / 2
    shared[:, FOCAL.stop - 1] = -(half_px - down_px) / (camera.fy_px**2 + half_px**2)  # field of view: 2 atan(H / 2 f)
    shared[:, PRINCIPAL_POINT] = -jac_px
    return psi_rad, shared, jac_px


def _dip(evidence: Horizon, state: State) -> tuple[float, float]:
    """Dip of the sea's horizon (rad), and its derivative by the camera's height; 0 for a level horizon."""
    if not evidence.is_sea:
        return 0.0, 0.0
    above = max(float(state.position_m[2]) - state.elevation_m, 1e-3)
    dip = math.sqrt(2 * above * (1 - STANDARD_REFRACTION) / EARTH_RADIUS_M)
    return dip, dip / (2 * above)


_CONDITIONS: dict[type, Callable[..., ConditionResidual]] = {
    KnownHeight: _height,
    GroundPoint: _ground_point,
    Landmark: _landmark,
    Vertical: _vertical,
    GroundLines: _ground_lines,
    Horizon: _horizon,
}


class Problem:
    """Evidence and unknowns of one camera, for repeated evaluation.

    Args:
        known: Evidence and priors.
        unknowns: The unknowns.
        model: Projection model.

    Attributes:
        reprojected: ``(k,)`` indices of the observations that are landmarks known in all three dimensions.
    """

    def __init__(self, known: EvidenceSet, unknowns: Unknowns, model: ProjectionModel) -> None:
        self.known = known
        self.unknowns = unknowns
        reprojected = {
            index: each
            for index, each in enumerate(known.evidence)
            if model is ProjectionModel.PINHOLE and isinstance(each, Landmark) and None not in each.position_m
        }
        self.reprojected, points = np.array(list(reprojected), dtype=np.intp), reprojected.values()
        self._owner = np.repeat(self.reprojected, 2)
        self._points_m = np.array([each.position_m for each in points], dtype=np.float64).reshape(-1, 3)
        self._pixels = np.array([each.pixel for each in points], dtype=np.float64).reshape(-1, 2)
        self._std_px = np.array([each.std_px for each in points], dtype=np.float64)
        std_m = np.array([each.std_m for each in points], dtype=np.float64).reshape(-1, 3)
        self._point_cov = np.square(std_m)[:, None] * np.eye(3) if np.any(std_m) else None
        ranges = {index: each for index, each in enumerate(known.evidence) if isinstance(each, SlantRange)}
        lengths = {index: each for index, each in enumerate(known.evidence) if isinstance(each, KnownLength)}
        self._distances = [Distances(each) for each in (ranges, lengths) if each]
        self._conditions: list[tuple[int, Condition]] = [
            (index, condition_of(each))
            for index, each in enumerate(known.evidence)
            if index not in reprojected and index not in ranges and index not in lengths
        ]
        priors = {name: known.priors[name] for name in unknowns.names if name in known.priors}
        self._lean = _lean_prior(priors) if unknowns.has_free_attitude else None
        of_lean = {"tilt", "roll"} if self._lean else set()
        self._priors = [(name, prior) for name, prior in priors.items() if name not in of_lean]

    @property
    def landmarks(self) -> tuple[FloatArray, FloatArray]:
        """World points ``(k, 3)`` and pixels ``(k, 2)`` of the ``reprojected`` landmarks."""
        return self._points_m, self._pixels

    def evaluate(self, state: State) -> Residuals:
        """All residuals at a state."""
        found = self.observed(state, self.unknowns.jac_unknowns(state))
        parts = [] if found is None else [found]
        parts += [self._of_priors(state)] if self._priors else []
        parts += [self._of_lean(state, self._lean)] if self._lean else []
        return Residuals.concatenate(parts)

    def moved(self, state: State, step: FloatArray) -> State | None:
        """The state after a step ``(n,)``; None where no camera can be."""
        try:
            moved = self.unknowns.moved(state, step)
        except ValueError:
            return None
        return moved if all(holds(moved) for holds in BOUNDS.values()) else None

    def observed(self, state: State, by: FloatArray) -> Residuals | None:
        """Residuals of the evidence alone, None without evidence; ``by (s, n)``: camera errors by the unknowns."""
        parts = [self._of_landmarks(state, by)] if len(self.reprojected) else []
        parts += [_residuals_of_distances(each, state, by) for each in self._distances]
        parts += [_residuals_of_condition(index, condition, state, by) for index, condition in self._conditions]
        return Residuals.concatenate(parts) if parts else None

    def _of_landmarks(self, state: State, by: FloatArray) -> Residuals:
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            found = reproject(state.camera, state.position_m, state.rotation, self._points_m)
            off = found.pixels_px - self._pixels
            jac = _chain(found.jac_rotation, by[ROTATION]) - _chain(found.jac_point, by[POSITION])
            if np.any(by[INTRINSICS]):
                jac += _chain(found.jac_intrinsics, by[INTRINSICS])
        std = self._std_px[:, None]
        values, rows, log_std = off / std, jac / std[..., None], np.zeros(off.shape)
        if self._point_cov is not None:
            cov = found.jac_point @ self._point_cov @ found.jac_point.swapaxes(-1, -2)
            cov += np.square(self._std_px)[:, None, None] * np.eye(2)
            root = _whitening(np.where(np.all(np.isfinite(cov), axis=(-1, -2), keepdims=True), cov, np.eye(2)))
            values, rows = (root @ off[..., None])[..., 0], root @ jac
            log_std -= 0.5 * np.log(np.linalg.det(root) * self._std_px**2)[:, None]
        px, blind = off.ravel(), np.isnan(off[:, 0])
        if np.any(blind):
            values[blind], rows[blind], log_std[blind] = OUT_OF_SIGHT, 0.0, 0.0
            px = np.where(np.isnan(px), np.inf, px)
        return Residuals(values.ravel(), rows.reshape(len(px), -1), self._owner, px, log_std.ravel())

    def _of_priors(self, state: State) -> Residuals:
        to_angles = self.unknowns.to_angles(state)
        values, rows = [], []
        for name, prior in self._priors:
            off = state.value(name) - prior.value
            if name in _ANGLES:
                off = (off + np.pi) % (2 * np.pi) - np.pi
            values.append(off / prior.std)
            rows.append(to_angles[self.unknowns.names.index(name)] / prior.std)
        count = len(values)
        return Residuals(np.array(values), np.array(rows), np.full(count, -1), np.zeros(count), np.zeros(count))

    def _of_lean(self, state: State, prior: "_LeanPrior") -> Residuals:
        lean, by_rotation = _lean(state)
        rows = by_rotation @ self.unknowns.jac_unknowns(state)[ROTATION] / prior.std_rad
        nothing = np.zeros(2)
        return Residuals((lean - prior.lean_rad) / prior.std_rad, rows, np.full(2, -1), nothing, nothing)


@dataclass(frozen=True, slots=True, eq=False)
class _LeanPrior:
    """Prior of the optical axis near straight down.

    A tilt is the length of a lean there, and roll and heading turn about one axis. The prior of a tilt is therefore one
    of the lean in both directions, and the roll's says in which.

    Attributes:
        lean_rad: ``(2,)`` towards the image's right and lower edge, as ``_lean``.
        std_rad: Of each.
    """

    lean_rad: FloatArray
    std_rad: float


def _lean_prior(priors: Mapping[str, Prior]) -> _LeanPrior | None:
    """The prior of the lean that priors of tilt and roll are; None where straight down is far from the tilt's."""
    tilt, roll = priors.get("tilt"), priors.get("roll")
    if tilt is None or tilt.value >= _NADIR_STDS * tilt.std:
        return None
    if roll is None:
        return _LeanPrior(np.zeros(2), math.hypot(tilt.value, tilt.std))
    return _LeanPrior(tilt.value * np.array([math.sin(roll.value), math.cos(roll.value)]), tilt.std)


def _lean(state: State) -> tuple[FloatArray, FloatArray]:
    """Lean ``(2,)``: the tilt times the direction of straight down in the image; Jacobian ``(2, 3)`` by a rotation."""
    down_cam = -state.rotation[2]
    cos, sin = float(down_cam[2]), float(np.hypot(down_cam[0], down_cam[1]))
    tilt_rad = math.atan2(sin, cos)
    scale, slope = 1.0, 1 / 3  # limits straight down
    if sin > _SMALL_LEAN_RAD:
        scale, slope = tilt_rad / sin, (1 - tilt_rad * cos / sin) / sin**2
    by_down = np.column_stack([scale * np.eye(2), -slope * down_cam[:2]])
    return scale * down_cam[:2], by_down @ skew(down_cam)


def _chain(many: FloatArray, by: FloatArray) -> FloatArray:
    """Product ``(k, 2, n)`` of Jacobians ``(k, 2, i)`` and ``(i, n)``, as one large product."""
    return np.asarray((many.reshape(-1, len(by)) @ by).reshape(*many.shape[:-1], -1))


def _residuals_of_distances(distances: Distances, state: State, by: FloatArray) -> Residuals:
    off_m, jac_shared, variance = distances.residuals(state)
    std_m = np.sqrt(variance * (1 + 1e-12))
    values, jac_shared = off_m / std_m, jac_shared / std_m[:, None]
    px = distances.std_px * values
    is_out_of_sight = ~(np.isfinite(values) & np.all(np.isfinite(jac_shared), axis=-1))
    if np.any(is_out_of_sight):
        jac_shared[is_out_of_sight], values[is_out_of_sight], px[is_out_of_sight] = 0.0, OUT_OF_SIGHT, np.inf
    return Residuals(values, jac_shared @ by, distances.owner, px, np.zeros(len(px)))


def _residuals_of_condition(index: int, condition: Condition, state: State, by: FloatArray) -> Residuals:
    found = condition(state)
    count = len(found.off)
    is_out_of_sight = not np.all(np.isfinite(found.off)) or not np.all(np.isfinite(found.jac_shared))
    owner = np.full(count, index)
    if is_out_of_sight:
        nothing = np.zeros((count, by.shape[1]))
        return Residuals(np.full(count, OUT_OF_SIGHT), nothing, owner, np.full(count, np.inf), np.zeros(count))
    root = _whitening(found.cov)
    values = root @ found.off
    return Residuals(values, root @ found.jac_shared @ by, owner, found.std_px * values, np.zeros(count))


def _whitening(cov: FloatArray) -> FloatArray:
    """Inverse square roots ``(..., k, k)`` of covariances.

    Regularised, because one direction may be billions of times as uncertain as another (a ray along the ground, a
    landmark right before the lens).
    """
    if cov.shape == (1, 1) and cov[0, 0] > 0:
        return np.asarray(1.0 / np.sqrt(cov + 1e-12 * cov))
    size = np.trace(cov, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(np.linalg.inv(np.linalg.cholesky(cov + 1e-12 * size * np.eye(cov.shape[-1]))))
