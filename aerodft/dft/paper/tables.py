"""The paper's Tables 1 to 3 and Figures 12 and 14: as printed, and recomputed, with true derivatives of Eq. 4 to 6.

Y. Salih, M. T. Simsim, A. S. Malik: "Distance and Size Measurements of Objects in the Scene from a Single 2D Image".
Percentages stay percentages: they are compared, digit by digit, with what is computed.

The quantization error is that of Section 5.1, the largest change of depth among a pixel's 8 neighbours. Depth is the
slant range Z of Eq. 6 in the paper's own model (``aerodft.dft.equations``); pixels (i, j) as there.

- A neighbour outside the image does not count: it cannot be picked by mistake.
- A neighbour at or above the horizon makes the error infinite: one pixel wrong, and the depth has no bound.
- A pixel outside the image, or itself at or above the horizon, has no depth: its error is NaN.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.conventions import PIXEL_CENTRE_OFFSET_PX
from aerodft.dft import equations
from aerodft.model import BoolArray, Camera, FloatArray

TABLE_1_HEIGHT_M: Final = 10.0
"""Camera height of all cameras in Table 1 and Figure 12."""

MAX_DEPTH_M: Final = 150.0
"""To which every pitch of Table 1 "is adjusted so that the maximum depth of field is 150.0 m"."""

TABLE_2_HEIGHT_M: Final = 10.48
"""Camera height of Table 2 and Figure 14."""

TABLE_2_TILT_RAD: Final = math.radians(67.0)
"""Viewing angle of Table 2 and Figure 14."""

FIGURE_14_ERROR_M: Final = 0.5
"""Quantization error that Section 5.2 reads off Figure 14 for the farthest point of Table 2."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedCamera:
    """A row of Table 1.

    Attributes:
        label: The paper's name of the row.
        camera: Model, image size and field of view.
        tilt_rad: The printed pitch angle, from straight down.
        text_error_m: Quantization error at 150 m in the words of Section 5.1, lowest and highest; None: not mentioned.
    """

    label: str
    camera: Camera
    tilt_rad: float
    text_error_m: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedDepth:
    """A row of Table 2."""

    case: int
    truth_m: float
    depth_m: float
    error_m: float
    error_percent: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintedSensitivity:
    """A row of Table 3.

    Attributes:
        input: What is off.
        error: By how much, in the paper's words.
        delta_psi_rad: The error of the vertical angle that the paper takes it for.
        delta_phi_rad: The error of the rotation angle that the paper takes it for.
        delta_height: The error of the camera height, as a fraction of it.
        percent: Printed errors of X, Y and Z in percent of the camera height.
    """

    input: str
    error: str
    delta_psi_rad: float = 0.0
    delta_phi_rad: float = 0.0
    delta_height: float = 0.0
    percent: tuple[float, float, float]


def _camera(name: str, size_px: tuple[int, int], fov_deg: tuple[float, float]) -> Camera:
    width_px, height_px = size_px
    hfov_rad, vfov_rad = map(math.radians, fov_deg)
    return Camera.from_fov(name=name, width_px=width_px, height_px=height_px, hfov_rad=hfov_rad, vfov_rad=vfov_rad)


TABLE_1: Final = (
    PrintedCamera(
        label="Cam1",
        camera=_camera("Canon 1000D", (3888, 2592), (64.3, 45.3)),
        tilt_rad=math.radians(63.0),
        text_error_m=(0.0, 0.5),
    ),
    PrintedCamera(
        label="Cam2",
        camera=_camera("Samsung SDZ-3750", (704, 576), (55.5, 42.5)),
        tilt_rad=math.radians(64.9),
        text_error_m=(2.0, 2.5),
    ),
    PrintedCamera(
        label="Cam3",
        camera=_camera("Samsung SNB-3000", (640, 480), (35.67, 26.87)),
        tilt_rad=math.radians(72.8),
        text_error_m=(2.0, 2.5),
    ),
    PrintedCamera(
        label="Cam4",
        camera=_camera("D-Link DCS-2120", (320, 240), (49.6, 37.2)),
        tilt_rad=math.radians(67.6),
        text_error_m=(5.0, 5.0),
    ),
    PrintedCamera(
        label="Cam5",
        camera=_camera("Nokia N900", (2584, 1938), (44.9, 33.67)),
        tilt_rad=math.radians(69.4),
        text_error_m=(0.0, 0.5),
    ),
    PrintedCamera(
        label="Cam6", camera=_camera("Logitech webcam", (1600, 1200), (60.0, 45.0)), tilt_rad=math.radians(63.7)
    ),
    PrintedCamera(
        label="Cam7", camera=_camera("Nao robot camera", (640, 480), (27.84, 20.88)), tilt_rad=math.radians(75.8)
    ),
)
"""Table 1, "Data collection using different types of cameras"; N900 is "N900 camera" there."""

TABLE_2: Final = (
    PrintedDepth(case=1, truth_m=17.37, depth_m=17.31, error_m=0.06, error_percent=0.35),
    PrintedDepth(case=2, truth_m=24.94, depth_m=24.77, error_m=0.17, error_percent=0.69),
    PrintedDepth(case=3, truth_m=37.54, depth_m=37.24, error_m=0.30, error_percent=0.80),
    PrintedDepth(case=4, truth_m=49.61, depth_m=48.61, error_m=1.01, error_percent=2.03),
    PrintedDepth(case=5, truth_m=68.84, depth_m=67.24, error_m=1.60, error_percent=2.32),
    PrintedDepth(case=6, truth_m=80.81, depth_m=79.09, error_m=1.71, error_percent=2.12),
    PrintedDepth(case=7, truth_m=105.67, depth_m=102.91, error_m=2.76, error_percent=2.61),
    PrintedDepth(case=8, truth_m=129.92, depth_m=126.92, error_m=3.00, error_percent=2.31),
    PrintedDepth(case=9, truth_m=133.99, depth_m=130.79, error_m=3.20, error_percent=2.39),
    PrintedDepth(case=10, truth_m=144.54, depth_m=140.94, error_m=3.60, error_percent=2.49),
)
"""Table 2, "List of depth of field measurements using DfT and corresponding ground truth measurements"."""

TABLE_3: Final = (
    PrintedSensitivity(
        input="Pitch angle", error="1.00 deg", delta_psi_rad=math.radians(1.0), percent=(1.75, 1.75, 2.48)
    ),
    PrintedSensitivity(input="Camera height", error="1 % of h", delta_height=0.01, percent=(1.00, 1.00, 1.73)),
    PrintedSensitivity(input="x-axis", error="1 % of W", delta_phi_rad=math.radians(2.0), percent=(3.49, 0.00, 3.49)),
    PrintedSensitivity(input="y-axis", error="1 % of H", delta_psi_rad=math.radians(2.0), percent=(3.49, 3.49, 4.94)),
)
"""Table 3, "Error analysis for the proposed method showing maximum possible error"."""

_NEIGHBOURS = np.array([(i, j) for j in (-1, 0, 1) for i in (-1, 0, 1) if i or j], dtype=np.float64)

PSI_RAD: Final = tuple(map(math.radians, (0.0, 30.0, 60.0, 85.0)))
"""Vertical angles at which the true figures are given; Table 3 names none."""

PHI_RAD: Final = (0.0, TABLE_1[0].camera.hfov_rad / 2)
"""Rotation angles of the true figures: the image's middle, and the border of the widest camera of Table 1."""

_NADIR_RAD, _DIAGONAL_RAD = 0.0, math.pi / 4

Percent = tuple[float, float, float]
"""Of X, Y and Z, in percent of the camera height."""

_HALF_DIGIT_M = 0.005
"""Table 2 prints depths to 0.01 m."""

CANON = TABLE_1[0].camera
"""The camera of Table 2 and Figure 14."""


def pixel_depth(camera: Camera, height_m: float, tilt_rad: float, pixels_px: FloatArray) -> FloatArray:
    """Depth Z (m) of pixels ``(..., 2)`` by Eq. 2 to 6, in the image or not; NaN at and above the horizon.

    Raises:
        ValueError: The height is not above 0.
    """
    if not height_m > 0:
        raise ValueError(f"height {height_m} m, must be above 0")
    pixels = np.asarray(pixels_px, dtype=np.float64)
    psi = equations.vertical_angle(pixels[..., 1], tilt_rad, camera.height_px, camera.vfov_rad)
    phi = equations.rotation_angle(pixels[..., 0], camera.width_px, camera.hfov_rad)
    ahead = equations.ground_ahead(height_m, psi)
    return equations.depth(height_m, ahead, equations.ground_right(ahead, phi))


def quantization_error(camera: Camera, height_m: float, tilt_rad: float, pixels_px: FloatArray) -> FloatArray:
    """Largest change of depth among each pixel's 8 neighbours.

    Args:
        camera: Image size and fields of view; the paper's model knows nothing else of a camera.
        height_m: Above the surface that is seen.
        tilt_rad: Of the optical axis from straight down.
        pixels_px: ``(..., 2)`` pixels (i, j), whole or not.

    Returns:
        ``(...)`` m; see the module for infinite and NaN.

    Raises:
        ValueError: The height is not above 0.
    """
    pixels = np.asarray(pixels_px, dtype=np.float64)
    depth = np.where(_inside(camera, pixels), pixel_depth(camera, height_m, tilt_rad, pixels), np.nan)
    around = pixels[..., None, :] + _NEIGHBOURS
    depth_around = pixel_depth(camera, height_m, tilt_rad, around)
    change = np.abs(np.where(np.isnan(depth_around), np.inf, depth_around) - depth[..., None])
    counted = np.where(_inside(camera, around), change, 0.0)
    return np.asarray(np.where(np.isnan(depth), np.nan, counted.max(axis=-1)))


def quantization_column(
    camera: Camera, height_m: float, tilt_rad: float, column_px: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Depth and quantization error down one column.

    Args:
        camera: As for ``quantization_error``.
        height_m: Above the surface that is seen.
        tilt_rad: Of the optical axis from straight down.
        column_px: The column i; None for the middle, W/2, where X = 0.

    Returns:
        ``(H,)`` depth and ``(H,)`` error, m, from the top row (the farthest) to the bottom.

    Raises:
        ValueError: The height is not above 0.
    """
    column = camera.width_px / 2 if column_px is None else column_px
    rows = np.arange(camera.height_px, dtype=np.float64)
    pixels = np.stack([np.full_like(rows, column), rows], axis=-1)
    error = quantization_error(camera, height_m, tilt_rad, pixels)
    return pixel_depth(camera, height_m, tilt_rad, pixels), error


def _inside(camera: Camera, pixels_px: FloatArray) -> BoolArray:
    size = np.array([camera.width_px, camera.height_px])
    low, high = -PIXEL_CENTRE_OFFSET_PX, size - PIXEL_CENTRE_OFFSET_PX
    return np.asarray(np.all((pixels_px >= low) & (pixels_px <= high), axis=-1))


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensitivity:
    """Changes of X, Y and Z by an input's error at one direction of view.

    Attributes:
        psi_rad: Vertical angle.
        phi_rad: Rotation angle.
        derivative_percent: The derivative times the input's error.
        change_percent: The finite change, with the error applied in full.
    """

    psi_rad: float
    phi_rad: float
    derivative_percent: Percent
    change_percent: Percent


@dataclass(frozen=True, slots=True, kw_only=True)
class SensitivityRow:
    """A row of Table 3, computed.

    Attributes:
        printed: The paper's row.
        holds_at: A direction of view at which the printed X and Y are the true changes.
        displacement_percent: Length of the vector of all changes there (X, Y and, where it is the input, h). This is
            what the paper prints for Z: how far the ground point moves, an upper bound of the change of Z.
        true: At every ``PSI_RAD`` and ``PHI_RAD``.
    """

    printed: PrintedSensitivity
    holds_at: Sensitivity
    displacement_percent: float
    true: tuple[Sensitivity, ...]


def table_3() -> tuple[SensitivityRow, ...]:
    """Recompute Table 3, row by row."""
    return tuple(_row(printed) for printed in TABLE_3)


def sensitivity(printed: PrintedSensitivity, psi_rad: float, phi_rad: float) -> Sensitivity:
    """Changes by the errors of a row of Table 3 at one direction of view, Eq. 4 to 6, camera height 1 m."""
    y = math.tan(psi_rad)
    x = y * math.tan(phi_rad)
    z = math.sqrt(1 + x**2 + y**2)
    d_psi, d_phi, d_h = printed.delta_psi_rad, printed.delta_phi_rad, printed.delta_height
    d_y = y * d_h + d_psi / math.cos(psi_rad) ** 2
    d_x = d_y * math.tan(phi_rad) + y * d_phi / math.cos(phi_rad) ** 2
    d_z = (d_h + y * d_y + x * d_x) / z
    change = _point(1 + d_h, psi_rad + d_psi, phi_rad + d_phi) - _point(1.0, psi_rad, phi_rad)
    return Sensitivity(
        psi_rad=psi_rad,
        phi_rad=phi_rad,
        derivative_percent=(100 * d_x, 100 * d_y, 100 * d_z),
        change_percent=(float(100 * change[0]), float(100 * change[1]), float(100 * change[2])),
    )


def _point(height: float, psi_rad: float, phi_rad: float) -> np.ndarray:
    right, ahead = equations.ground_point(height, psi_rad, phi_rad)
    return np.array([right, ahead, equations.depth(height, ahead, right)])


def _row(printed: PrintedSensitivity) -> SensitivityRow:
    # tan(dpsi) is the change of Y / h straight down only; h or phi act through Y = h, so at 45 deg only; and X changes
    # as much as Y only where tan(phi) = 1.
    psi = _NADIR_RAD if printed.delta_psi_rad else _DIAGONAL_RAD
    phi = _NADIR_RAD if printed.delta_phi_rad else _DIAGONAL_RAD
    holds_at = sensitivity(printed, psi, phi)
    return SensitivityRow(
        printed=printed,
        holds_at=holds_at,
        displacement_percent=math.hypot(*holds_at.change_percent[:2], 100 * printed.delta_height),
        true=tuple(sensitivity(printed, psi, phi) for psi in PSI_RAD for phi in PHI_RAD),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraRow:
    """A row of Table 1, computed.

    Attributes:
        printed: The paper's row.
        tilt_for_depth_rad: Pitch at which the top row's middle is 150 m away along the ray, ``Z = 150 m``.
        tilt_for_ahead_rad: Pitch at which it is 150 m ahead on the ground, ``Y = 150 m``.
        depth_at_printed_m: Z of the top row's middle at the printed pitch.
        corner_at_printed_m: Z of the top left corner at the printed pitch.
        error_m: Quantization error at Z = 150 m: of the top row's middle pixel at ``tilt_for_depth_rad``.
        error_outward_m: Quantization error towards one more row above the image.
        depth_of_text_error_m: Where, in the middle column, the error is the highest that the text gives; None where
            the text gives none, or the column stays below it.
    """

    printed: PrintedCamera
    tilt_for_depth_rad: float
    tilt_for_ahead_rad: float
    depth_at_printed_m: float
    corner_at_printed_m: float
    error_m: float
    error_outward_m: float
    depth_of_text_error_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthRow:
    """A row of Table 2, computed; the pixel is not printed, so the point is taken as on the optical axis' column.

    Attributes:
        printed: The paper's row.
        error_m: Printed truth minus printed estimate.
        error_percent: ``error_m`` in percent of the truth.
        psi_rad: Vertical angle that gives the printed estimate by Eq. 4 and 6 with X = 0.
        psi_at_border_rad: Vertical angle if the point were at the image's left or right border.
        row_px: Row j of ``psi_rad`` by Eq. 3.
        row_half_digit_px: How far half of the estimate's last printed digit moves the row.
        depth_m: Z at the nearest whole row.
        quantization_m: Quantization error at that pixel.
        tilt_error_rad: How much larger than printed the pitch would have to be for this estimate to meet the truth.
        pinhole_m: Depth that a pinhole of the same field of view gives for ``row_px``.
    """

    printed: PrintedDepth
    error_m: float
    error_percent: float
    psi_rad: float
    psi_at_border_rad: float
    row_px: float
    row_half_digit_px: float
    depth_m: float
    quantization_m: float
    tilt_error_rad: float
    pinhole_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorCurve:
    """Quantization error down a camera's middle column; ``depth_m`` and ``error_m`` are ``(H,)``, far to near."""

    label: str
    depth_m: FloatArray
    error_m: FloatArray

    def at(self, depth_m: float) -> float | None:
        """Error (m) of the pixel nearest to a depth; None where the column sees nothing so near or so far."""
        if not self.depth_m.min() <= depth_m <= self.depth_m.max() * (1 + 1e-12):
            return None
        return float(self.error_m[np.argmin(np.abs(self.depth_m - depth_m))])


def table_1() -> tuple[CameraRow, ...]:
    """Table 1: the pitch that each camera needs, what the printed one gives, and the error at 150 m."""
    return tuple(_camera_row(printed) for printed in TABLE_1)


def table_2() -> tuple[DepthRow, ...]:
    """Table 2: the vertical angles behind the printed estimates, and what they imply."""
    return tuple(_depth_row(printed) for printed in TABLE_2)


def figure_12() -> tuple[ErrorCurve, ...]:
    """Figure 12: every camera of Table 1, at the pitch with which it reaches 150 m."""
    return tuple(
        _curve(f"{printed.label} {printed.camera.name}", printed.camera, TABLE_1_HEIGHT_M, _tilt_for_depth(printed))
        for printed in TABLE_1
    )


def figure_14() -> ErrorCurve:
    """Figure 14's quantization error: the Canon, 10.48 m high at 67.0 deg; its errors are those of ``table_2``."""
    return _curve(CANON.name, CANON, TABLE_2_HEIGHT_M, TABLE_2_TILT_RAD)


def figure_14_text_depth() -> float:
    """Depth (m) at which Figure 14's quantization error equals the value that Section 5.2 states."""
    return _depth_of_error(figure_14(), FIGURE_14_ERROR_M) or math.nan


def _curve(label: str, camera: Camera, height_m: float, tilt_rad: float) -> ErrorCurve:
    depth, error = quantization_column(camera, height_m, tilt_rad)
    return ErrorCurve(label=label, depth_m=depth, error_m=error)


def _tilt_for_depth(printed: PrintedCamera) -> float:
    return math.acos(TABLE_1_HEIGHT_M / MAX_DEPTH_M) - printed.camera.vfov_rad / 2


def _camera_row(printed: PrintedCamera) -> CameraRow:
    camera, tilt = printed.camera, _tilt_for_depth(printed)
    middle, corner = np.array([camera.width_px / 2, 0.0]), np.zeros(2)
    above = middle - [0.0, 1.0]
    curve = _curve(camera.name, camera, TABLE_1_HEIGHT_M, tilt)
    text = printed.text_error_m
    return CameraRow(
        printed=printed,
        tilt_for_depth_rad=tilt,
        tilt_for_ahead_rad=math.atan(MAX_DEPTH_M / TABLE_1_HEIGHT_M) - camera.vfov_rad / 2,
        depth_at_printed_m=float(pixel_depth(camera, TABLE_1_HEIGHT_M, printed.tilt_rad, middle)),
        corner_at_printed_m=float(pixel_depth(camera, TABLE_1_HEIGHT_M, printed.tilt_rad, corner)),
        error_m=float(quantization_error(camera, TABLE_1_HEIGHT_M, tilt, middle)),
        error_outward_m=float(pixel_depth(camera, TABLE_1_HEIGHT_M, tilt, above)) - MAX_DEPTH_M,
        depth_of_text_error_m=None if text is None else _depth_of_error(curve, text[1]),
    )


def _depth_of_error(curve: ErrorCurve, error_m: float) -> float | None:
    whole = slice(-2, 0, -1)  # near to far, without the border rows, which lack a neighbour
    depth = float(np.interp(error_m, curve.error_m[whole], curve.depth_m[whole], left=math.nan, right=math.nan))
    return None if math.isnan(depth) else depth


def _depth_row(printed: PrintedDepth) -> DepthRow:
    step = CANON.vfov_rad / CANON.height_px
    height, tilt = TABLE_2_HEIGHT_M, TABLE_2_TILT_RAD
    psi = math.acos(height / printed.depth_m)
    ahead_at_border = math.sqrt(printed.depth_m**2 - height**2) * math.cos(CANON.hfov_rad / 2)
    row = CANON.height_px / 2 - (psi - tilt) / step
    pixel = np.array([CANON.width_px / 2, round(row)])
    by_row = printed.depth_m * math.tan(psi) * step
    off_axis = math.atan((CANON.height_px / 2 - row) / CANON.fy_px)
    error = printed.truth_m - printed.depth_m
    return DepthRow(
        printed=printed,
        error_m=error,
        error_percent=100 * error / printed.truth_m,
        psi_rad=psi,
        psi_at_border_rad=math.atan(ahead_at_border / height),
        row_px=row,
        row_half_digit_px=_HALF_DIGIT_M / by_row,
        depth_m=float(pixel_depth(CANON, height, tilt, pixel)),
        quantization_m=float(quantization_error(CANON, height, tilt, pixel)),
        tilt_error_rad=math.acos(height / printed.truth_m) - psi,
        pinhole_m=height / math.cos(tilt + off_axis),
    )
