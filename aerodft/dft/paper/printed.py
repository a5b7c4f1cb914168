"""Printed inputs and results of the paper: Tables 1 to 3 and the text around them.

Y. Salih, M. T. Simsim, A. S. Malik: "Distance and Size Measurements of Objects in the Scene from a Single 2D Image".
Percentages stay percentages: they are compared, digit by digit, with what is computed.
"""

import math
from dataclasses import dataclass
from typing import Final

from aerodft.model import Camera

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
