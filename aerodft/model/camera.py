"""The camera: intrinsics, lens distortion, image size, and how well each is known; and how a vehicle says it zooms."""

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

from aerodft.model.arrays import FloatArray


class LensModel(StrEnum):
    """The distortion models, in OpenCV's definitions."""

    BROWN = "brown"  # k1 k2 p1 p2 [k3 [k4 k5 k6]]: radial, tangential, rational
    FISHEYE = "fisheye"  # k1 k2 k3 k4: equidistant polynomial


_COEFFICIENTS = {LensModel.BROWN: (0, 4, 5, 8), LensModel.FISHEYE: (0, 4)}


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraStd:
    """Standard deviations of the intrinsics; 0 means taken as exact.

    Attributes:
        focal_px: Of fx; fy is off by the same share.
        principal_point_px: Of cx and of cy.
        distortion: Of each coefficient; empty where all are taken as exact.
    """

    focal_px: float = 0.0
    principal_point_px: float = 0.0
    distortion: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMode:
    """How a camera was set, as the EXIF data of its images have it; None for what is not known.

    Attributes:
        device: The camera's name of itself.
        focal_mm: Focal length of its lens.
        focal_35mm_mm: The focal length that gives the same view on 35 mm film.
        digital_zoom: Factor.
    """

    device: str | None = None
    focal_mm: float | None = None
    focal_35mm_mm: float | None = None
    digital_zoom: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A camera in one mode (size, crop, zoom).

    Pixel (0, 0) is the centre of the top-left pixel; the image spans -0.5 to W - 0.5. ``covariance`` is that of fx, fy,
    cx, cy and the distortion coefficients, in rows, as a lens calibration gives it; where it is there, it takes the
    place of ``std``. ``mode`` is what images of another mode are told by, where it is known.
    """

    name: str
    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    lens: LensModel = LensModel.BROWN
    distortion: tuple[float, ...] = ()
    std: CameraStd = field(default_factory=CameraStd)
    covariance: tuple[tuple[float, ...], ...] = ()
    mode: CameraMode | None = None

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError(f"image size {self.width_px} x {self.height_px} px, must be at least 1 x 1")
        if not (self.fx_px > 0 and self.fy_px > 0 and math.isfinite(self.fx_px + self.fy_px)):
            raise ValueError(f"focal lengths {self.fx_px}, {self.fy_px} px, must be finite and above 0")
        if len(self.distortion) not in _COEFFICIENTS[self.lens]:
            raise ValueError(
                f"{len(self.distortion)} distortion coefficients for a {self.lens} lens,"
                f" must be one of {_COEFFICIENTS[self.lens]}"
            )
        wanted = 4 + len(self.distortion)
        if self.covariance and {len(self.covariance), *map(len, self.covariance)} != {wanted}:
            raise ValueError(f"covariance of {len(self.covariance)} rows, must be {wanted} of {wanted}")
        if len(self.std.distortion) not in (0, len(self.distortion)):
            raise ValueError(f"{len(self.std.distortion)} stds of {len(self.distortion)} distortion coefficients")

    @classmethod
    def from_fov(cls, *, name: str, width_px: int, height_px: int, hfov_rad: float, vfov_rad: float) -> "Camera":
        """Build a distortion-free camera from its full fields of view, principal point at the image's centre.

        Raises:
            ValueError: A field of view outside (0, pi).
        """
        if not (0 < hfov_rad < math.pi and 0 < vfov_rad < math.pi):
            raise ValueError(
                f"fields of view {math.degrees(hfov_rad):g} x {math.degrees(vfov_rad):g} deg, must be in (0, 180)"
            )
        return cls(
            name=name,
            width_px=width_px,
            height_px=height_px,
            fx_px=width_px / 2 / math.tan(hfov_rad / 2),
            fy_px=height_px / 2 / math.tan(vfov_rad / 2),
            cx_px=(width_px - 1) / 2,
            cy_px=(height_px - 1) / 2,
        )

    def with_covariance(self, covariance: FloatArray) -> "Camera":
        """The camera with another covariance ``(n, n)`` of its intrinsics; known exactly where that is 0 all over."""
        rows = tuple(map(tuple, covariance.tolist())) if covariance.any() else ()
        return replace(self, std=CameraStd(), covariance=rows)

    def zoomed(self, magnification: float, std: float) -> "Camera":
        """The camera at another focal length: fx and fy times the magnification, the rest as it is.

        Args:
            magnification: Focal length over this one's.
            std: Standard deviation of the magnification; it adds to what is known of fx and fy, which it moves alike.
        """
        focal_px = math.hypot(magnification * self.std.focal_px, std * self.fx_px)
        scales = (magnification, magnification, *(1.0 for _ in self.covariance[2:]))
        moved_px = (std * self.fx_px, std * self.fy_px, *(0.0 for _ in self.covariance[2:]))
        covariance = tuple(
            tuple(a * b * value + c * d for b, d, value in zip(scales, moved_px, row, strict=True))
            for a, c, row in zip(scales, moved_px, self.covariance, strict=False)
        )
        return replace(
            self,
            fx_px=magnification * self.fx_px,
            fy_px=magnification * self.fy_px,
            std=replace(self.std, focal_px=focal_px),
            covariance=covariance,
        )

    @property
    def hfov_rad(self) -> float:
        """Full horizontal field of view of the undistorted pinhole, as the paper's FOV_H."""
        return 2 * math.atan(self.width_px / 2 / self.fx_px)

    @property
    def vfov_rad(self) -> float:
        """Full vertical field of view of the undistorted pinhole, as the paper's FOV_V."""
        return 2 * math.atan(self.height_px / 2 / self.fy_px)


class ZoomSource(StrEnum):
    """The message that a camera's view is known from."""

    CAMERA_SETTINGS = "CAMERA_SETTINGS"
    CAMERA_FOV_STATUS = "CAMERA_FOV_STATUS"
    VIDEO_STREAM_INFORMATION = "VIDEO_STREAM_INFORMATION"


@dataclass(frozen=True, slots=True, kw_only=True)
class Zoom:
    """A camera's focal length at one stamp, against that of its file.

    Attributes:
        magnification: Focal length over that of the file.
        std: Standard deviation of the magnification.
        source: Where it is known from.
    """

    magnification: float
    std: float
    source: ZoomSource
