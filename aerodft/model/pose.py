"""Where the camera is and where it looks, with one joint covariance."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from aerodft.model.arrays import FloatArray, FloatLike, IntArray, read_only
from aerodft.model.camera import Zoom
from aerodft.model.status import Status

_TRAILING = {"position_enu_m": (3,), "wxyz": (4,), "cov": (6, 6), "velocity_enu_mps": (3,), "rate_cam_radps": (3,)}


def _zeros(*shape: int) -> FloatArray:
    return read_only(np.zeros(shape))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pose:
    """``enu_SE3_cam``: the camera in the station's ENU frame; batch-first.

    Attributes:
        position_enu_m: ``(..., 3)``; up is the height above the measured (ground or water) plane.
        wxyz: ``(..., 4)`` unit quaternion ``enu_SO3_cam``; camera axes x right, y down, z forward.
        cov: ``(..., 6, 6)``: position (ENU, m^2), then a small rotation in camera axes (rad^2). Never Euler angles.
        lens_cov: ``(..., 6, m)`` covariance of those errors with the intrinsics', where one calibration found both;
            else no columns.
        velocity_enu_mps: ``(..., 3)``, for the effect of a time offset.
        rate_cam_radps: ``(..., 3)`` angular rate in camera axes, for the effect of a time offset.
        time_std_s: ``(...)`` standard deviation of the image's stamp against the telemetry's.
    """

    position_enu_m: FloatArray
    wxyz: FloatArray
    cov: FloatArray = field(default_factory=lambda: _zeros(6, 6))
    lens_cov: FloatArray = field(default_factory=lambda: _zeros(6, 0))
    velocity_enu_mps: FloatArray = field(default_factory=lambda: _zeros(3))
    rate_cam_radps: FloatArray = field(default_factory=lambda: _zeros(3))
    time_std_s: FloatLike = 0.0

    def __post_init__(self) -> None:
        for name, trailing in _TRAILING.items():
            object.__setattr__(self, name, read_only(getattr(self, name), trailing=trailing))

    def rows(self, rows: IntArray | int) -> "Pose":
        """Some of ``(n,)`` poses by their indices ``(m,)``, or a single one; what is one for all of them stays so."""
        axes = {"lens_cov": 2, **{name: len(trailing) for name, trailing in _TRAILING.items()}}
        columns = {name: getattr(self, name) for name in axes}
        taken = {name: each[rows] if each.ndim > axes[name] else each for name, each in columns.items()}
        return Pose(**taken, time_std_s=np.broadcast_to(self.time_std_s, len(self.wxyz))[rows])

    @staticmethod
    def joined(poses: Sequence["Pose"]) -> "Pose":
        """Single poses, or ``(n,)``, ``(m,)``, ..., as one ``(n + m + ...,)``.

        Where only some were found together with a lens, the others' covariances with it are 0.
        """
        columns = max((pose.lens_cov.shape[-1] for pose in poses), default=0)
        shapes = {**_TRAILING, "lens_cov": (6, columns), "time_std_s": ()}
        ends = np.cumsum([0, *(pose.wxyz.size // 4 for pose in poses)]).tolist()
        together = {name: np.zeros((ends[-1], *shape)) for name, shape in shapes.items()}
        for pose, start, stop in zip(poses, ends, ends[1:], strict=False):
            for name, values in together.items():
                if name != "lens_cov" or pose.lens_cov.size:
                    values[start:stop] = getattr(pose, name)
        return Pose(**together)


class HeightSource(StrEnum):
    """Where a height above the measured plane came from."""

    RANGEFINDER = "rangefinder"
    TERRAIN = "terrain"
    HOME = "home"
    MANUAL = "manual"
    CALIBRATION = "calibration"


class GimbalSource(StrEnum):
    """Where the camera's attitude came from."""

    GIMBAL_DEVICE = "GIMBAL_DEVICE_ATTITUDE_STATUS"
    MOUNT_ORIENTATION = "MOUNT_ORIENTATION"
    MOUNT_STATUS = "MOUNT_STATUS"
    DATAFLASH_MNT = "MNT"
    FIXED_MOUNT = "fixed"
    MANUAL = "manual"


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseStd:
    """Standard deviations as people say them: small rotations about the camera's x, y, z axes and the vertical."""

    height_agl_m: float = 0.0
    horizontal_m: float = 0.0
    tilt_rad: float = 0.0
    pan_rad: float = 0.0
    roll_rad: float = 0.0
    heading_rad: float = 0.0
    time_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GeoOrigin:
    """The station's fixed ENU origin: a point of the measured plane (WGS84)."""

    lat_rad: float
    lon_rad: float
    alt_msl_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseSample:
    """The camera at one stamp, with where each part came from; ``pose`` is None where ``status`` is not ok.

    ``datum_enu_m`` is the ENU height of what the stated height is counted from: not 0 above ground that is not level.
    ``zoom`` is what the vehicle says of the camera's view, where that is followed; None where its file holds.
    """

    stamp_ns: int
    status: Status
    reasons: tuple[str, ...] = ()
    pose: Pose | None = None
    std: PoseStd = field(default_factory=PoseStd)
    origin: GeoOrigin | None = None
    lat_rad: float | None = None
    lon_rad: float | None = None
    alt_msl_m: float | None = None
    height_source: HeightSource | None = None
    height_datum: str | None = None
    datum_enu_m: float = 0.0
    height_age_s: float | None = None
    attitude_source: GimbalSource | None = None
    telemetry_age_s: float | None = None
    calibration: str | None = None
    zoom: Zoom | None = None

    @property
    def lat_lon_alt(self) -> tuple[float | None, float | None, float | None]:
        """Latitude, longitude (rad) and altitude (m MSL), None where they are not known."""
        return self.lat_rad, self.lon_rad, self.alt_msl_m

    @property
    def cov(self) -> FloatArray | None:
        """Of the pose."""
        return None if self.pose is None else self.pose.cov
