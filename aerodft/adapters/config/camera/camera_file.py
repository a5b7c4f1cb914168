"""Camera files: TOML to :class:`aerodft.model.camera.Camera`, and back for a self-contained configuration."""

import math
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.camera.library import known_cameras
from aerodft.adapters.config.covariance import COVARIANCE, check_covariance
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.tables import SiAttribute, Table, si_value, unless_zero
from aerodft.errors import located
from aerodft.model import Camera, LensModel

_INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px")
_LENS_ONLY = ("distortion", "lens", "distortion_std")
_PHOTOS = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp"}


class ModeTable(Table):
    """The mode that the file belongs to, as its images' EXIF data have it; what is left out is not compared."""

    device: keys.Text | None = None
    focal_mm: keys.Positive | None = None
    focal_35mm_mm: keys.Positive | None = None
    digital_zoom: keys.Positive | None = None


class CameraTable(Table):
    """A camera, either by its field of view or by its intrinsics."""

    INSTEAD_OF: ClassVar = {"covariance": ("focal_std_px", "principal_point_std_px", "distortion_std")}

    name: keys.Text
    width_px: keys.Count
    height_px: keys.Count
    hfov_deg: keys.FieldOfViewDeg | None = None
    vfov_deg: keys.FieldOfViewDeg | None = None
    fx_px: keys.Focal | None = None
    fy_px: keys.Focal | None = None
    cx_px: keys.Real | None = None
    cy_px: keys.Real | None = None
    lens: Annotated[LensModel, Field(strict=False)] = LensModel.BROWN
    distortion: keys.Many[keys.Real] = ()
    focal_std_px: Annotated[keys.NonNegative, SiAttribute("std.focal_px")] = 0.0
    principal_point_std_px: Annotated[keys.NonNegative, SiAttribute("std.principal_point_px")] = 0.0
    distortion_std: Annotated[keys.Many[keys.NonNegative], SiAttribute("std.distortion", out=unless_zero)] = ()
    covariance: Annotated[keys.Matrix | None, COVARIANCE] = None
    mode: ModeTable | None = None

    @model_validator(mode="after")
    def _one_of_two_ways(self) -> Self:
        stated = self.model_fields_set
        intrinsics = [key for key in _INTRINSICS if key in stated]
        if {"hfov_deg", "vfov_deg"} & stated and intrinsics:
            raise impossible(
                "",
                got=f"a field of view and {intrinsics[0]}",
                expected="either hfov_deg and vfov_deg, or fx_px, fy_px, cx_px, cy_px",
                hint="remove one of the two",
            )
        if intrinsics:
            self._check_intrinsics()
        elif "hfov_deg" not in stated:
            raise impossible(
                "", got="neither field of view nor intrinsics", expected="hfov_deg, or fx_px, fy_px, cx_px, cy_px"
            )
        elif lens := [key for key in _LENS_ONLY if key in stated]:
            raise impossible(
                lens[0],
                got="it beside a field of view",
                expected="intrinsics",
                hint="a distorted lens needs fx_px, fy_px, cx_px, cy_px from a lens calibration",
            )
        size = len(_INTRINSICS) + len(self.distortion)
        check_covariance(self.covariance, size, "fx, fy, cx, cy, distortion")
        return self

    def _check_intrinsics(self) -> None:
        if missing := [key for key in _INTRINSICS if getattr(self, key) is None]:
            raise impossible(missing[0], got="nothing", expected="all of fx_px, fy_px, cx_px, cy_px")
        allowed = self.lens.coefficient_counts
        if len(self.distortion) not in allowed:
            raise impossible(
                "distortion",
                got=f"{len(self.distortion)} coefficients",
                expected=f"{' or '.join(map(str, allowed))} for a {self.lens} lens",
            )
        if len(self.distortion_std) not in {0, len(self.distortion)}:
            got = f"{len(self.distortion_std)} of them"
            raise impossible("distortion_std", got=got, expected=f"{len(self.distortion)}, as many as in distortion")


def load_camera(path: str | Path) -> Camera:
    """Read a camera file, or a photo's EXIF data.

    Args:
        path: A TOML file with ``name``, ``width_px``, ``height_px`` and either ``hfov_deg`` (and ``vfov_deg``; left
            out means square pixels) or ``fx_px``, ``fy_px``, ``cx_px``, ``cy_px`` with ``distortion`` and
            ``lens``; or a photo, of a camera of the library, or whose EXIF data tell its focal length to some percent,
            which its std says.

    Raises:
        ConfigError: Missing file, TOML syntax, unknown key, impossible value.
        InputError: A photo that does not tell its focal length.

    Example:
        >>> import aerodft as ad
        >>> ad.load_camera("configs/cameras/canon-1000d.toml").width_px
        3888
    """
    path = Path(path)
    if path.suffix.lower() in _PHOTOS:
        from aerodft.adapters.images import camera_of_still, facts_of_still  # noqa: PLC0415 - for photos alone

        facts = facts_of_still(path)
        known = [each.camera for each in known_cameras() if each.shows(facts.size_px, facts.mode)]
        return known[0] if len(known) == 1 else camera_of_still(path)
    with located(path):
        return camera_from(parse_toml(read_bytes(path)))


def camera_from(document: dict[str, Any], prefix: str = "") -> Camera:
    """The camera that a camera file's keys describe.

    Args:
        document: Plain values from TOML.
        prefix: Key path of the table in its file, with a trailing dot; empty for the file's root.

    Raises:
        ConfigError: Unknown key, impossible value.
    """
    table = validated(CameraTable, document, prefix)
    if table.hfov_deg is None:
        return si_value(Camera, table)
    width, height, hfov_rad = table.width_px, table.height_px, math.radians(table.hfov_deg)
    vfov_rad = hfov_rad if table.vfov_deg is None else math.radians(table.vfov_deg)
    camera = Camera.from_fov(name=table.name, width_px=width, height_px=height, hfov_rad=hfov_rad, vfov_rad=vfov_rad)
    return si_value(
        Camera,
        table,
        fx_px=camera.fx_px,
        fy_px=camera.fx_px if table.vfov_deg is None else camera.fy_px,
        cx_px=camera.cx_px,
        cy_px=camera.cy_px,
    )


def camera_document(camera: Camera) -> dict[str, Any]:
    """The camera as TOML keys; reading them gives an equal camera."""
    return CameraTable.from_si(camera).to_toml()
