"""Camera files: TOML to :class:`aerodft.model.camera.Camera`, and back for a self-contained configuration."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.tables import (
    Count,
    FieldOfViewDeg,
    Focal,
    NonNegative,
    Real,
    Table,
    Text,
    impossible,
)
from aerodft.model.camera import Camera, CameraStd, LensModel

_INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px")
_LENS_ONLY = ("distortion", "lens")
_COEFFICIENTS = {LensModel.BROWN: (0, 4, 5, 8), LensModel.FISHEYE: (0, 4)}


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

    @model_validator(mode="after")
    def _one_of_two_ways(self) -> Self:
        given = self.model_fields_set
        intrinsics = [key for key in _INTRINSICS if key in given]
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


def load_camera(path: Path) -> Camera:
    """Read a camera file.

    Args:
        path: A TOML file with ``name``, ``width_px``, ``height_px`` and either ``hfov_deg`` (and ``vfov_deg``; left
            out means square pixels) or ``fx_px``, ``fy_px``, ``cx_px``, ``cy_px`` with ``distortion`` and ``lens``.

    Raises:
        ConfigError: Missing file, TOML syntax, unknown key, impossible value.
    """
    return camera_from(validated(CameraTable, parse_toml(read_bytes(path), str(path)), str(path)))


def camera_from(table: CameraTable) -> Camera:
    """The camera that a validated table describes."""
    std = CameraStd(focal_px=table.focal_std_px, principal_point_px=table.principal_point_std_px)
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
        )
    hfov_rad = math.radians(table.hfov_deg)
    vfov_rad = hfov_rad if table.vfov_deg is None else math.radians(table.vfov_deg)
    camera = Camera.from_fov(name=table.name, width_px=width, height_px=height, hfov_rad=hfov_rad, vfov_rad=vfov_rad)
    return replace(camera, std=std, fy_px=camera.fx_px if table.vfov_deg is None else camera.fy_px)


def camera_document(camera: Camera) -> dict[str, Any]:
    """The camera as TOML keys; reading them gives an equal camera."""
    return {
        "name": camera.name,
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        **{key: getattr(camera, key) for key in _INTRINSICS},
        "lens": str(camera.lens),
        "distortion": list(camera.distortion),
        "focal_std_px": camera.std.focal_px,
        "principal_point_std_px": camera.std.principal_point_px,
    }
