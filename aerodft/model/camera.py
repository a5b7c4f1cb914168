"""The camera: intrinsics and lens distortion with their uncertainty, image size, and a vehicle's reported zoom."""

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, ClassVar, Self

from aerodft.model.arrays import FloatArray


class LensModel(str):  # noqa: SLOT000 - pickles and copies carry the attributes with the dictionary
    """Name of a model of lens distortion.

    No enumeration: who adds a model to ``geometry.LENS_MODELS`` gives it a name there.

    Attributes:
        coefficients: Names of the coefficients, in their order.
        coefficient_counts: Numbers of coefficients, from the first on, that a lens may have; others are 0.
    """

    coefficients: tuple[str, ...]
    coefficient_counts: tuple[int, ...]
    BROWN: ClassVar["LensModel"]
    FISHEYE: ClassVar["LensModel"]

    def __new__(cls, name: str, coefficients: str = "", counts: tuple[int, ...] = (0,)) -> Self:
        """A name with its coefficients' names, separated by spaces."""
        made = super().__new__(cls, name)
        made.coefficients, made.coefficient_counts = tuple(coefficients.split()), counts
        return made


LensModel.BROWN = LensModel("brown", "k1 k2 p1 p2 k3 k4 k5 k6", (0, 4, 5, 8))  # radial, tangential, rational
LensModel.FISHEYE = LensModel("fisheye", "k1 k2 k3 k4", (0, 4))  # equidistant polynomial


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraStd:
    """Standard deviations of the intrinsics; 0 means taken as exact.

    Attributes:
        focal_px: Of fx; the relative error of fy is the same.
        principal_point_px: Of cx and of cy.
        distortion: Of each coefficient; empty where all are taken as exact.
    """

    focal_px: float = 0.0
    principal_point_px: float = 0.0
    distortion: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMode:
    """Settings of a camera as in its images' EXIF data; None where unknown.

    Attributes:
        device: The camera's model name.
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

    Pixel (0, 0) is the centre of the top-left pixel; the image spans -0.5 to W - 0.5. ``covariance`` is of fx, fy, cx,
    cy and the distortion coefficients, as rows, from a lens calibration; it replaces ``std``. ``mode`` tells images of
    another mode; None where unknown.
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
        if len(self.distortion) not in self.lens.coefficient_counts:
            raise ValueError(
                f"{len(self.distortion)} distortion coefficients for a {self.lens} lens,"
                f" must be one of {self.lens.coefficient_counts}"
            )
        count = 4 + len(self.distortion)
        if self.covariance and {len(self.covariance), *map(len, self.covariance)} != {count}:
            raise ValueError(f"covariance of {len(self.covariance)} rows, must be {count} of {count}")
        if len(self.std.distortion) not in (0, len(self.distortion)):
            raise ValueError(f"{len(self.std.distortion)} stds of {len(self.distortion)} distortion coefficients")

    @classmethod
    def from_fov(cls, *, name: str, width_px: int, height_px: int, hfov_rad: float, vfov_rad: float) -> "Camera":
        """A distortion-free camera from its full fields of view, principal point at the image's centre.

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

    @classmethod
    def of_focal(cls, *, width_px: int, height_px: int, focal_px: float, **more: Any) -> "Camera":  # noqa: ANN401 - of all kinds
        """A camera with square pixels, principal point at the image's centre, and ``more`` of its attributes."""
        u, v = (width_px - 1) / 2, (height_px - 1) / 2
        more |= {"fx_px": focal_px, "fy_px": focal_px, "cx_px": u, "cy_px": v}
        return cls(width_px=width_px, height_px=height_px, **more)

    def with_covariance(self, covariance: FloatArray) -> "Camera":
        """The camera with another covariance ``(n, n)`` of its intrinsics; all zeros: known exactly."""
        rows = tuple(map(tuple, covariance.tolist())) if covariance.any() else ()
        return replace(self, std=CameraStd(), covariance=rows)

    def zoomed(self, magnification: float, std: float) -> "Camera":
        """The camera at another focal length: fx and fy times the magnification, all else unchanged.

        Args:
            magnification: New focal length over this camera's.
            std: Standard deviation of the magnification, an error common to fx and fy; it adds to theirs.
        """
        focal_px = math.hypot(magnification * self.std.focal_px, std * self.fx_px)
        scales = (magnification, magnification, *(1.0 for _ in self.covariance[2:]))
        error_px = (std * self.fx_px, std * self.fy_px, *(0.0 for _ in self.covariance[2:]))
        covariance = tuple(
            tuple(a * b * value + c * d for b, d, value in zip(scales, error_px, row, strict=True))
            for a, c, row in zip(scales, error_px, self.covariance, strict=False)
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
    """The message, subtitles or metadata that report a camera's view."""

    CAMERA_SETTINGS = "CAMERA_SETTINGS"
    CAMERA_FOV_STATUS = "CAMERA_FOV_STATUS"
    VIDEO_STREAM_INFORMATION = "VIDEO_STREAM_INFORMATION"
    SUBTITLES = "subtitles"  # a 35 mm-equivalent focal length
    KLV = "klv"


@dataclass(frozen=True, slots=True, kw_only=True)
class Zoom:
    """A camera's focal length at one stamp, relative to its file's.

    Attributes:
        magnification: Focal length over that of the file.
        std: Standard deviation of the magnification.
        source: The message that reports it.
    """

    magnification: float
    std: float
    source: ZoomSource
