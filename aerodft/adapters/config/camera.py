"""Camera files: TOML to :class:`aerodft.model.camera.Camera`, and back for a self-contained configuration."""

import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from aerodft.adapters.config.covariance import as_rows, checked_covariance
from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.tables import (
    Count,
    FieldOfViewDeg,
    Focal,
    Many,
    NonNegative,
    Positive,
    Real,
    Table,
    Text,
    impossible,
)
from aerodft.model.camera import Camera, CameraMode, CameraStd, LensModel

_INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px")
_LENS_ONLY = ("distortion", "lens", "distortion_std")
_STDS = ("focal_std_px", "principal_point_std_px", "distortion_std")
_COEFFICIENTS = {LensModel.BROWN: (0, 4, 5, 8), LensModel.FISHEYE: (0, 4)}


class ModeTable(Table):
    """The mode that the file belongs to, as its images' EXIF data have it; what is left out is not compared."""

    device: Text | None = None
    focal_mm: Positive | None = None
    focal_35mm_mm: Positive | None = None
    digital_zoom: Positive | None = None


class CameraTable(Table):
    """A camera, either by its field of view or by its intrinsics."""

    name: Text
    width_px: Count
    height_px: Count
    hfov_deg: FieldOfViewDeg | None = None
    vfov_deg: FieldOfViewDeg | None = None
    fx_px: Focal | None = None
    fy_px: Focal | None = None
    cx_px: Real | None = None
    cy_px: Real | None = None
    distortion: Annotated[tuple[Real, ...], Field(strict=False)] = ()
    lens: Annotated[LensModel, Field(strict=False)] = LensModel.BROWN
    focal_std_px: NonNegative = 0.0
    principal_point_std_px: NonNegative = 0.0
    distortion_std: Many[NonNegative] = ()
    covariance: Many[Many[Real]] | None = None
    mode: ModeTable | None = None

    @model_validator(mode="after")
    def _one_of_two_ways(self) -> Self:
        given = self.model_fields_set
        intrinsics = [key for key in _INTRINSICS if key in given]
        if self.covariance is not None and (stds := [key for key in _STDS if key in given]):
            raise impossible("covariance", got=f"it beside {stds[0]}", expected="one of the two")
        if {"hfov_deg", "vfov_deg"} & given and intrinsics:
            raise impossible(
                "",
                got=f"a field of view and {intrinsics[0]}",
                expected="either hfov_deg and vfov_deg, or fx_px, fy_px, cx_px, cy_px",
                hint="remove one of the two",
            )
        if intrinsics:
            self._check_intrinsics()
        elif "hfov_deg" not in given:
            raise impossible(
                "", got="neither field of view nor intrinsics", expected="hfov_deg, or fx_px, fy_px, cx_px, cy_px"
            )
        elif lens := [key for key in _LENS_ONLY if key in given]:
            raise impossible(
                lens[0],
                got="it beside a field of view",
                expected="intrinsics",
                hint="a distorted lens needs fx_px, fy_px, cx_px, cy_px from a lens calibration",
            )
        return self

    def _check_intrinsics(self) -> None:
        if missing := [key for key in _INTRINSICS if getattr(self, key) is None]:
            raise impossible(missing[0], got="nothing", expected="all of fx_px, fy_px, cx_px, cy_px")
        allowed = _COEFFICIENTS[self.lens]
        if len(self.distortion) not in allowed:
            raise impossible(
                "distortion",
                got=f"{len(self.distortion)} coefficients",
                expected=f"{' or '.join(map(str, allowed))} for a {self.lens} lens",
            )
        if len(self.distortion_std) not in {0, len(self.distortion)}:
            got = f"{len(self.distortion_std)} of them"
            raise impossible("distortion_std", got=got, expected=f"{len(self.distortion)}, as many as in distortion")


def load_camera(path: Path) -> Camera:
    """Read a camera file.

    Args:
        path: A TOML file with ``name``, ``width_px``, ``height_px`` and either ``hfov_deg`` (and ``vfov_deg``; left
            out means square pixels) or ``fx_px``, ``fy_px``, ``cx_px``, ``cy_px`` with ``distortion`` and ``lens``.

    Raises:
        ConfigError: Missing file, TOML syntax, unknown key, impossible value.
    """
    return camera_from(validated(CameraTable, parse_toml(read_bytes(path), str(path)), str(path)), str(path))


def camera_from(table: CameraTable, where: str, prefix: str = "") -> Camera:
    """The camera that a validated table describes.

    Args:
        table: The table.
        where: The file's name in messages.
        prefix: Key path of the table in its file, with a trailing dot; empty for the file's root.

    Raises:
        ConfigError: Its covariance is none.
    """
    std = CameraStd(
        focal_px=table.focal_std_px,
        principal_point_px=table.principal_point_std_px,
        distortion=table.distortion_std,
    )
    covariance = _covariance(table, where, prefix)
    mode = None if table.mode is None else CameraMode(**table.mode.model_dump())
    width, height = table.width_px, table.height_px
    if table.hfov_deg is None:
        return Camera(
            name=table.name,
            width_px=width,
            height_px=height,
            fx_px=table.fx_px or math.nan,
            fy_px=table.fy_px or math.nan,
            cx_px=math.nan if table.cx_px is None else table.cx_px,
            cy_px=math.nan if table.cy_px is None else table.cy_px,
            lens=table.lens,
            distortion=table.distortion,
            std=std,
            covariance=covariance,
            mode=mode,
        )
    hfov_rad = math.radians(table.hfov_deg)
    vfov_rad = hfov_rad if table.vfov_deg is None else math.radians(table.vfov_deg)
    camera = Camera.from_fov(name=table.name, width_px=width, height_px=height, hfov_rad=hfov_rad, vfov_rad=vfov_rad)
    fy_px = camera.fx_px if table.vfov_deg is None else camera.fy_px
    return replace(camera, std=std, covariance=covariance, fy_px=fy_px, mode=mode)


def _covariance(table: CameraTable, where: str, prefix: str) -> tuple[tuple[float, ...], ...]:
    if table.covariance is None:
        return ()
    size, of = len(_INTRINSICS) + len(table.distortion), "fx, fy, cx, cy, distortion"
    return as_rows(checked_covariance(table.covariance, size, where=where, key=f"{prefix}covariance", of=of))


def camera_document(camera: Camera) -> dict[str, Any]:
    """The camera as TOML keys; reading them gives an equal camera."""
    return {
        "name": camera.name,
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        **{key: getattr(camera, key) for key in _INTRINSICS},
        "lens": str(camera.lens),
        "distortion": list(camera.distortion),
        **_uncertainty(camera),
        **_mode(camera),
    }


def _mode(camera: Camera) -> dict[str, Any]:
    if camera.mode is None:
        return {}
    return {"mode": {key: value for key, value in asdict(camera.mode).items() if value is not None}}


def _uncertainty(camera: Camera) -> dict[str, Any]:
    if camera.covariance:
        return {"covariance": [list(row) for row in camera.covariance]}
    std = camera.std
    bent = {"distortion_std": list(std.distortion)} if std.distortion else {}
    return {"focal_std_px": std.focal_px, "principal_point_std_px": std.principal_point_px, **bent}
