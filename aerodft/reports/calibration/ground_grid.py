"""Round metres on the ground as lines in a calibrated camera's image."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.adapters.config import LOCAL
from aerodft.adapters.config.evidence import EvidenceFile, LocalFrame, takes_degrees
from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.geometry import camera_angles, horizon_line, in_image
from aerodft.model import BoolArray, FloatArray, Landmark, ProjectionModel
from aerodft.reports.calibration.marks import from_foot, pixels_of
from calibration.pose import Result, State

GAP: Final = 0.035
"""Lines of one distance are drawn where they are this share of the image's longer side apart, or more."""

_FARTHEST_HEIGHTS = 100.0  # farther ground lies 0.6 degrees below the horizon
_LATTICE = 48  # pixels across the image's longer side from which the extent is found
_POINTS, _BISECTIONS = 193, 24  # along a line
_STEP = 1e-4  # of a line's distance and of the angle along it: for derivatives
_DETAIL = 0.25  # share of the seen ground pixels whose distances are fine enough for the finest lines
_LARGE_M = 10_000.0  # coordinates are not written out in full from here on
_FAR_SHARE = 0.5  # of the camera's height above the landmarks
_WHOLE = 1e-6  # a quotient so close to a whole number is one


@dataclass(frozen=True, slots=True, eq=False)
class GridLine:
    """One line of round metres, as far as it is drawn.

    Attributes:
        pixels_px: ``(k, 2)`` polyline in the image.
        axis: Along which coordinate it is constant, 0 or 1.
        value_m: That coordinate.
        spacing_m: Distance of the lines of its kind; 10 or 100 where it stands out among finer ones.
    """

    pixels_px: FloatArray
    axis: int
    value_m: float
    spacing_m: float


@dataclass(frozen=True, slots=True, eq=False)
class GridAxes:
    """Axes of coordinates on the ground.

    Attributes:
        names: Of the two coordinates.
        elevation_m: Of the plane, in the frame of the calibration.
        to_enu: Coordinates ``(..., 2)`` to points of the plane in that frame ``(..., 3)``.
        from_enu: The other way round.
    """

    names: tuple[str, str]
    elevation_m: float
    to_enu: Callable[[FloatArray], FloatArray]
    from_enu: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Lines of equal coordinates on the ground, seen in the image.

    Attributes:
        axes: What they count from.
        lines: In the image.
        base_m: ``(2,)`` what is taken off both coordinates where they are written beside lines.
    """

    axes: GridAxes
    lines: tuple[GridLine, ...]
    base_m: tuple[float, float]

    def text(self, line: GridLine) -> str:
        """A line's coordinate as it is written beside it."""
        return f"{self.axes.names[line.axis]} {line.value_m - self.base_m[line.axis]:.10g}"

    @property
    def note(self) -> str:
        """Sentence on the axes and their zero."""
        based = [
            f"{name} counts from {base:.0f}" for name, base in zip(self.axes.names, self.base_m, strict=True) if base
        ]
        values: dict[float, set[float]] = {}
        for line in self.lines:
            values.setdefault(line.spacing_m, set()).add(line.value_m)
        several = [f"{spacing:g}" for spacing, drawn in sorted(values.items()) if len(drawn) > 1]
        spacings = several or [f"{spacing:g}" for spacing in sorted(values)]
        farther = f", farther away {', '.join(spacings[1:])} m" if spacings[1:] else ""
        return "; ".join([f"grid every {spacings[0]} m{farther}", *based])


def axes_of(result: Result, found: EvidenceFile) -> GridAxes:
    """The file's own axes where places in the world were observed; else those of the camera's foot."""
    elevation_m, state = grid_elevation_m(result), result.solution.state
    if any(isinstance(each, Landmark) for each in result.problem.known.evidence):
        return map_axes(found.frame, elevation_m)
    heading = state.value("heading")
    to_right_ahead = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])
    return GridAxes(
        names=("X", "Y"),
        elevation_m=elevation_m,
        to_enu=lambda xy_m: from_foot(state, xy_m, elevation_m),
        from_enu=lambda points_m: (points_m[..., :2] - state.position_m[:2]) @ to_right_ahead,
    )


def map_axes(frame: LocalFrame, elevation_m: float) -> GridAxes:
    """Eastings and northings; for places in degrees metres east and north of the frame's zero."""
    in_metres = frame.crs == LOCAL or not takes_degrees(frame.crs)

    def to_enu(coordinates: FloatArray) -> FloatArray:
        height = np.full((*coordinates.shape[:-1], 1), frame.origin[2] + elevation_m)
        in_file = np.concatenate([coordinates, height], axis=-1)
        points = frame.local_m(in_file) if in_metres else in_file.copy()
        points[..., 2] = elevation_m
        return points

    def from_enu(points_m: FloatArray) -> FloatArray:
        return np.asarray((frame.file_coordinates(points_m) if in_metres else points_m)[..., :2])

    return GridAxes(names=("E", "N"), elevation_m=elevation_m, to_enu=to_enu, from_enu=from_enu)


def grid_elevation_m(result: Result) -> float:
    """The ground's; or the middle of the landmarks' heights where nobody stated the ground and these are far from it.

    Heights above the sea, say, when what was left out in the file is how high the ground is.
    """
    known, state = result.problem.known, result.solution.state
    heights = [
        each.position_m[2] for each in known.evidence if isinstance(each, Landmark) and each.position_m[2] is not None
    ]
    if not heights or "elevation" in result.problem.unknowns.names:
        return state.elevation_m
    middle = float(np.median(heights))
    camera = float(state.position_m[2])
    is_far = min(heights) - state.elevation_m > _FAR_SHARE * abs(camera - middle)
    return middle if is_far else state.elevation_m


def ground_grid(state: State, axes: GridAxes) -> Grid:
    """Lines of round metres, coarser ones alone where fine ones would be too close in the image.

    Args:
        state: The calibrated camera.
        axes: What the metres count from.

    Returns:
        The lines, clipped at the image's border, where the lens model ends, and before the horizon; none where the
        image shows no ground.
    """
    seen, metres_per_px, finest_per_px = _lattice(state, axes.elevation_m)
    if not len(seen):
        return Grid(axes, (), (0.0, 0.0))
    gap_px = GAP * max(state.camera.width_px, state.camera.height_px)
    coordinates = axes.from_enu(seen)
    extent = float(np.max(np.ptp(coordinates, axis=0)))
    spacings = _spacings(gap_px * float(np.quantile(metres_per_px, _DETAIL)), extent)
    lines: list[GridLine] = []
    base_m = _base_m(coordinates[metres_per_px * gap_px <= 2 * spacings[0]])
    for spacing, coarser in zip(spacings, (*spacings[1:], math.inf), strict=True):
        near = coordinates[finest_per_px * gap_px <= 2 * spacing]
        if len(near):
            low, high = near.min(axis=0) - spacing, near.max(axis=0) + spacing
            for axis in (0, 1):
                for value in _multiples(low[axis], high[axis], spacing, coarser):
                    line = _Line(state, axes, axis, value, spacing)
                    pieces = line.pieces(float(low[1 - axis]), float(high[1 - axis]), gap_px)
                    lines += [GridLine(piece, axis, value, spacing) for piece in pieces]
    return Grid(axes, tuple(lines), base_m)


def _base_m(coordinates: FloatArray) -> tuple[float, float]:
    """Thousands of metres that large coordinates have in common near the camera."""
    east, north = coordinates.min(axis=0).tolist()
    first, second = (1000.0 * math.floor(each / 1000.0) if abs(each) >= _LARGE_M else 0.0 for each in (east, north))
    return first, second


def _lattice(state: State, elevation_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ground points ``(k, 3)`` seen all over the image, metres per pixel there, and in the finest direction."""
    size = np.array([state.camera.width_px, state.camera.height_px], dtype=np.float64)
    across, down = (np.linspace(0.0, side - 1, max(2, round(_LATTICE * side / max(size)))) for side in size.tolist())
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    ground = state.ground_points(pixels, elevation_m)
    reach = _FARTHEST_HEIGHTS * (float(state.position_m[2]) - elevation_m)
    shown = np.linalg.norm(ground.points_enu_m - state.position_m, axis=-1) <= reach  # false for NaN
    along, across = np.linalg.svd(ground.jac_px[shown, :2], compute_uv=False).T
    return ground.points_enu_m[shown], np.sqrt(along * across), across


def _spacings(finest_m: float, coarsest_m: float) -> tuple[float, ...]:
    """1, 5, 10, 50, ... times a power of ten between two distances, at least one."""
    first, last = (math.floor(math.log10(each)) for each in (finest_m, max(coarsest_m, finest_m)))
    every = [factor * 10.0**power for power in range(first, last + 2) for factor in (1.0, 5.0)]
    fine = [each for each in every if each >= finest_m]
    return tuple(each for each in fine if each <= coarsest_m) or (fine[0],)


def _multiples(low: float, high: float, spacing: float, coarser: float) -> list[float]:
    """Multiples of a spacing that are none of the next one."""
    values = [spacing * number for number in range(math.ceil(low / spacing), math.floor(high / spacing) + 1)]
    return [each for each in values if math.isinf(coarser) or abs(each / coarser - round(each / coarser)) > _WHOLE]


class _Line:
    """A line of one round coordinate, by the angle under which its points are seen from the camera's side."""

    def __init__(self, state: State, axes: GridAxes, axis: int, value_m: float, spacing_m: float) -> None:
        self._state, self._axes, self._axis, self._value = state, axes, axis, value_m
        self._spacing = spacing_m
        foot = axes.from_enu(state.position_m)
        self._nearest = float(foot[1 - axis])
        height = float(state.position_m[2]) - axes.elevation_m
        self._distance = math.hypot(height, value_m - float(foot[axis]))

    def pieces(self, low_m: float, high_m: float, gap_px: float) -> list[FloatArray]:
        """Drawn pieces of the line between two values of the other coordinate, ``(k, 2)`` each."""
        ends = [math.atan((end - self._nearest) / self._distance) for end in (low_m, high_m)]
        angles = np.linspace(ends[0], ends[1], _POINTS)
        shown = self._is_shown(angles, gap_px)
        starts = np.flatnonzero(shown & ~np.concatenate([[False], shown[:-1]]))
        stops = np.flatnonzero(shown & ~np.concatenate([shown[1:], [False]]))
        found = []
        for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
            first = angles[0] if start == 0 else self._edge(angles[start], angles[start - 1], gap_px)
            last = angles[-1] if stop == len(angles) - 1 else self._edge(angles[stop], angles[stop + 1], gap_px)
            found.append(self._pixels(np.concatenate([[first], angles[start : stop + 1], [last]])))
        return found

    def _pixels(self, angles: FloatArray, beside_m: float = 0.0) -> FloatArray:
        along = self._nearest + self._distance * np.tan(angles)
        constant = np.full_like(along, self._value + beside_m)
        both = (constant, along) if self._axis == 0 else (along, constant)
        return pixels_of(self._state, self._axes.to_enu(np.stack(both, axis=-1)))

    def _is_shown(self, angles: FloatArray, gap_px: float) -> BoolArray:
        """In the image, and far enough from the next line of its kind."""
        here, step_m = self._pixels(angles), _STEP * self._distance
        across = (self._pixels(angles, step_m) - here) * (self._spacing / step_m)
        along = self._pixels(angles + _STEP) - here
        with np.errstate(invalid="ignore", divide="ignore"):
            area = np.abs(across[..., 0] * along[..., 1] - across[..., 1] * along[..., 0])
            gap = area / np.linalg.norm(along, axis=-1)
            return np.asarray((gap >= gap_px) & in_image(self._state.camera, here))

    def _edge(self, inside: float, outside: float, gap_px: float) -> float:
        for _ in range(_BISECTIONS):
            middle = (inside + outside) / 2
            if self._is_shown(np.array([middle]), gap_px)[0]:
                inside = middle
            else:
                outside = middle
        return inside


def horizon_px(state: State) -> tuple[FloatArray, ...]:
    """The horizon's polylines ``(k, 2)`` in the image; under the paper's model a row of it."""
    if state.model is ProjectionModel.PINHOLE:
        return horizon_line(state.camera, state.pose)
    camera = state.camera
    tilt, _, _ = camera_angles(state.wxyz)
    row = camera.height_px * (0.5 - (math.pi / 2 - float(tilt)) / camera.vfov_rad)
    line = np.array([[-PIXEL_CENTRE_OFFSET_PX, row], [camera.width_px - PIXEL_CENTRE_OFFSET_PX, row]])
    return (line,) if np.all(in_image(camera, line)) else ()
