"""Tables 1 and 2 and Figures 12 and 14 of the paper, recomputed from its printed inputs."""

import math
from dataclasses import dataclass

import numpy as np

from aerodft.dft.paper.printed import (
    FIGURE_14_ERROR_M,
    MAX_DEPTH_M,
    TABLE_1,
    TABLE_1_HEIGHT_M,
    TABLE_2,
    TABLE_2_HEIGHT_M,
    TABLE_2_TILT_RAD,
    PrintedCamera,
    PrintedDepth,
)
from aerodft.dft.paper.quantization import pixel_depth, quantization_column, quantization_error
from aerodft.model import Camera, FloatArray

_HALF_DIGIT_M = 0.005
"""Table 2 prints depths to 0.01 m."""

CANON = TABLE_1[0].camera
"""The camera of Table 2 and Figure 14."""


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
