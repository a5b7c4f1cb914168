"""Camera files to :class:`aerodft.model.Camera`, and back; the library of cameras that many people have."""

import csv
import math
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, Self

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from aerodft.adapters.config import keys
from aerodft.adapters.config.camera.formats import read_other_camera
from aerodft.adapters.config.covariance import COVARIANCE, check_covariance
from aerodft.adapters.config.keys import impossible
from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.tables import SiAttribute, Table, si_value, unless_zero
from aerodft.errors import Reason, counted, located
from aerodft.geometry import LENS_MODELS
from aerodft.model import Camera, CameraMode, CameraStd, LensModel

_INTRINSICS = ("fx_px", "fy_px", "cx_px", "cy_px")
_FIELDS_OF_VIEW = ("hfov_deg", "vfov_deg", "dfov_deg")
_LENS_ONLY = ("distortion", "lens", "distortion_std")
_PHOTOS = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp"}

_FILM_DIAGONAL_MM: Final = 43.27
_STDS: Final = {"calibrated": 0.015, "sensor": 0.03, "film": 0.04}
"""Of a focal length, as a share of it, by what it is known from: those for film are whole millimetres."""
_VIDEO_STD: Final = 0.06
"""Of a video's: it is cropped, stabilised and straightened by amounts that makers do not state."""
_SHAPE: Final = 0.01  # of two sizes that differ by rounding alone
_MAX_PIXEL_ASPECT: Final = 1.12
"""Of stated fields of view: analogue video has 1.09, the cameras of the paper's Table 1 up to 1.107. At 1.06 these are
refused, at 1.25 the diagonal of a 4:3 image stated as its horizontal field of view passes."""
_SAME_FOCAL: Final = 0.03  # of two fields of view in whole degrees that are of one lens, as a share
_CENTRE_STD: Final = 0.005
"""Of the principal point, as a share of the image's width."""


class ModeTable(Table):
    """The mode that the file belongs to, as its images' EXIF data have it; what is left out is not compared."""

    device: keys.Text | None = None
    focal_mm: keys.Positive | None = None
    focal_35mm_mm: keys.Positive | None = None
    digital_zoom: keys.Positive | None = None


_LENS_SCHEMA: Final = WithJsonSchema({"enum": list(map(str, LENS_MODELS)), "type": "string"})


def _lens_model(name: object) -> LensModel:
    if not isinstance(name, str) or LensModel(name) not in LENS_MODELS:
        got = f'"{name}"' if isinstance(name, str) else str(name)
        *others, last = map(repr, map(str, LENS_MODELS))
        raise impossible("", got=got, expected=f"one of {', '.join(others)} or {last}")
    return LENS_MODELS[LensModel(name)].model


class CameraTable(Table):
    """A camera, either by its field of view or by its intrinsics."""

    INSTEAD_OF: ClassVar = {"covariance": ("focal_std_px", "principal_point_std_px", "distortion_std")}

    name: keys.Text
    width_px: keys.Count
    height_px: keys.Count
    hfov_deg: keys.FieldOfViewDeg | None = None
    vfov_deg: keys.FieldOfViewDeg | None = None
    dfov_deg: keys.FieldOfViewDeg | None = None
    fx_px: keys.Focal | None = None
    fy_px: keys.Focal | None = None
    cx_px: keys.Real | None = None
    cy_px: keys.Real | None = None
    lens: Annotated[LensModel, PlainValidator(_lens_model), _LENS_SCHEMA] = Field("brown", validate_default=True)
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
        if stated.intersection(_FIELDS_OF_VIEW) and intrinsics:
            raise impossible(
                "",
                got=f"a field of view and {intrinsics[0]}",
                expected="either hfov_deg and vfov_deg, or fx_px, fy_px, cx_px, cy_px",
                hint="remove one of the two",
            )
        if intrinsics:
            self._check_intrinsics()
        elif not {"hfov_deg", "dfov_deg"} & stated:
            raise impossible(
                "",
                got="neither field of view nor intrinsics",
                expected="hfov_deg, dfov_deg, or fx_px, fy_px, cx_px, cy_px",
            )
        elif lens := [key for key in _LENS_ONLY if key in stated]:
            raise impossible(
                lens[0],
                got=Reason("it stands beside a field of view"),
                expected="intrinsics",
                hint="a distorted lens needs fx_px, fy_px, cx_px, cy_px from a lens calibration",
            )
        else:
            self._check_fields_of_view()
        size = len(_INTRINSICS) + len(self.distortion)
        check_covariance(self.covariance, size, "fx, fy, cx, cy, distortion")
        return self

    def _check_fields_of_view(self) -> None:
        if self.dfov_deg is not None:
            if beside := [key for key in ("hfov_deg", "vfov_deg") if getattr(self, key) is not None]:
                expected = "the diagonal field of view, or the other two"
                raise impossible(beside[0], got="it beside dfov_deg", expected=expected)
            return
        if self.hfov_deg is None or self.vfov_deg is None:
            return
        fx_px, fy_px = _focal_px(self.width_px, self.hfov_deg), _focal_px(self.height_px, self.vfov_deg)
        aspect = fy_px / fx_px
        if not 1 / _MAX_PIXEL_ASPECT <= aspect <= _MAX_PIXEL_ASPECT:
            shape = f"{1 / aspect:.2f} times as high as wide" if aspect < 1 else f"{aspect:.2f} times as wide as high"
            got = f"{self.vfov_deg:g} beside hfov_deg = {self.hfov_deg:g}, so pixels {shape}"
            raise impossible("vfov_deg", got=got, expected="pixels that are square", hint=self._likely_field_of_view())

    def _likely_field_of_view(self) -> str:
        """What to write in place of two fields of view that are not those of one focal length."""
        hfov_deg, vfov_deg = self.hfov_deg or 0.0, self.vfov_deg or 0.0
        diagonal_px = math.hypot(self.width_px, self.height_px)
        across_px, down_px = _focal_px(self.width_px, hfov_deg), _focal_px(self.height_px, vfov_deg)
        if hfov_deg == vfov_deg or abs(_focal_px(diagonal_px, hfov_deg) / down_px - 1) < _SAME_FOCAL:
            return f"a diagonal? write dfov_deg = {hfov_deg:g} alone"
        if abs(_focal_px(diagonal_px, vfov_deg) / across_px - 1) < _SAME_FOCAL:
            return f"a diagonal? write dfov_deg = {vfov_deg:g} alone"
        if abs(_focal_px(self.width_px, vfov_deg) / _focal_px(self.height_px, hfov_deg) - 1) < _SAME_FOCAL:
            return f"swapped? write hfov_deg = {vfov_deg:g} and vfov_deg = {hfov_deg:g}"
        return "remove the wrong one, or state pixels of this shape by fx_px, fy_px, cx_px, cy_px"

    def _check_intrinsics(self) -> None:
        if missing := [key for key in _INTRINSICS if getattr(self, key) is None]:
            raise impossible(missing[0], got="nothing", expected="all of fx_px, fy_px, cx_px, cy_px")
        allowed = self.lens.coefficient_counts
        if len(self.distortion) not in allowed:
            raise impossible(
                "distortion",
                got=counted(len(self.distortion), "coefficient"),
                expected=f"{' or '.join(map(str, allowed))} for a {self.lens} lens",
            )
        if len(self.distortion_std) not in {0, len(self.distortion)}:
            got = f"{len(self.distortion_std)} of them"
            raise impossible("distortion_std", got=got, expected=f"{len(self.distortion)}, as many as in distortion")


def _focal_px(size_px: float, fov_deg: float) -> float:
    """Focal length by a full field of view, and the size of the image along it."""
    return size_px / 2 / math.tan(math.radians(fov_deg) / 2)


def load_camera(path: str | Path) -> Camera:
    """Read a camera file, or a photo's EXIF data.

    Args:
        path: A TOML file with ``name``, ``width_px``, ``height_px`` and either ``hfov_deg`` (and ``vfov_deg``; left
            out means square pixels), or ``dfov_deg`` (the diagonal), or ``fx_px``, ``fy_px``, ``cx_px``, ``cy_px`` with
            ``distortion`` and ``lens``; a camera file of ROS (camera_info), OpenCV, Kalibr, Agisoft, OpenDroneMap or
            COLMAP; or a photo: by the calibration in its XMP data, the camera of the library, or the focal length in
            its EXIF data, to some percent, which its std says.

    Raises:
        ConfigError: Missing file, syntax, unknown key, impossible value, or another tool's lens model without an equal.
        InputError: A photo that does not tell its focal length.

    Examples:
        >>> import aerodft as ad
        >>> ad.load_camera("configs/cameras/canon-1000d.toml").width_px
        3888
    """
    path = Path(path)
    if path.suffix.lower() in _PHOTOS:
        from aerodft.adapters.images import camera_of_still, facts_of_still  # noqa: PLC0415 - for photos alone
        from aerodft.adapters.photographs import lens_of_tags, photo_tags  # noqa: PLC0415

        facts = facts_of_still(path)
        if (stated := lens_of_tags(photo_tags(path), facts.mode)) is not None:
            return stated.camera
        known = [each.camera for each in known_cameras() if each.shows(facts.size_px, facts.mode)]
        return known[0] if len(known) == 1 else camera_of_still(path)
    data = read_bytes(path)
    with located(path):
        other = read_other_camera(data, path.stem)
        return camera_from(parse_toml(data) if other is None else other)


def camera_from(document: dict[str, Any], prefix: str = "") -> Camera:
    """The camera that a camera file's keys describe.

    Args:
        document: Plain values from TOML.
        prefix: Key path of the table in its file, with a trailing dot; empty for the file's root.

    Raises:
        ConfigError: Unknown key, impossible value.
    """
    table = validated(CameraTable, document, prefix)
    if table.fx_px is not None:
        return si_value(Camera, table)
    width, height = table.width_px, table.height_px
    if table.dfov_deg is not None:
        fx_px = fy_px = _focal_px(math.hypot(width, height), table.dfov_deg)
    else:
        fx_px = _focal_px(width, table.hfov_deg or 0.0)
        fy_px = fx_px if table.vfov_deg is None else _focal_px(height, table.vfov_deg)
    cx_px, cy_px = (width - 1) / 2, (height - 1) / 2
    return si_value(Camera, table, fx_px=fx_px, fy_px=fy_px, cx_px=cx_px, cy_px=cy_px)


def camera_document(camera: Camera) -> dict[str, Any]:
    """The camera as TOML keys; reading them gives an equal camera."""
    return CameraTable.from_si(camera).to_toml()


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownCamera:
    """One mode of a camera that many people have.

    Attributes:
        name: As it is sold, with the lens where it has several.
        kind: Photos or videos.
        known_from: What the focal length follows from: a published calibration, or focal length and sensor or the focal
            length for 35 mm film as the maker states them.
        source: Who published it.
        focal_35mm_mm: What EXIF data of its photos state, to tell lenses of one device apart; None where unknown.
        camera: The camera, without distortion, with honest stds.
    """

    name: str
    kind: Literal["photo", "video"]
    known_from: str
    source: str
    focal_35mm_mm: float | None
    camera: Camera

    def is_of(self, mode: CameraMode) -> bool:
        """Whether a photo with these EXIF data may be of this device."""
        device = "" if self.camera.mode is None else self.camera.mode.device or ""
        return mode.device is not None and mode.device.casefold() == device.casefold()

    def has_lens_of(self, mode: CameraMode) -> bool:
        """Whether a photo with these EXIF data may be through this lens."""
        return None in (mode.focal_35mm_mm, self.focal_35mm_mm) or (
            abs((mode.focal_35mm_mm or 0.0) - (self.focal_35mm_mm or 0.0)) <= 0.1 * (self.focal_35mm_mm or 0.0)
        )

    def shows(self, size_px: tuple[int, int], mode: CameraMode) -> bool:
        """Whether a photo of this size and with these EXIF data may be of it."""
        is_same = self.is_of(mode) and self.has_lens_of(mode)
        is_whole = self.kind == "photo" and mode.digital_zoom in {None, 1.0}
        return is_same and is_whole and size_px == (self.camera.width_px, self.camera.height_px)

    def resized(self, width_px: int, height_px: int) -> "KnownCamera | None":
        """This video mode at another size of its shape; None for other shapes, and for photos, which are cropped."""
        now = self.camera
        scale = width_px / now.width_px
        if self.kind == "photo" or abs(height_px / now.height_px - scale) > _SHAPE * scale:
            return None
        camera = Camera.of_focal(
            name=f"{self.name}, {self.kind} {width_px}x{height_px}",
            width_px=width_px,
            height_px=height_px,
            focal_px=round(scale * now.fx_px, 1),
            std=CameraStd(
                focal_px=round(scale * now.std.focal_px, 1),
                principal_point_px=round(scale * now.std.principal_point_px, 1),
            ),
            mode=now.mode,
        )
        return replace(self, camera=camera)


@cache
def known_cameras() -> tuple[KnownCamera, ...]:
    """All cameras of the library, photo modes before video modes of each."""
    text = files("aerodft.adapters.config.camera").joinpath("library.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(text.splitlines(), delimiter=";")
    return tuple(
        _known(row, size, kind) for row in rows for kind in ("photo", "video") for size in row[f"{kind}s"].split()
    )


def _known(row: dict[str, str], size: str, kind: Literal["photo", "video"]) -> KnownCamera:
    across, down = map(int, row["aspect"].split(":"))
    focal_35mm_mm = float(row["focal_35mm_mm"]) if row["focal_35mm_mm"] else None
    if row["focal_per_width"]:
        known_from, focal_per_width = "calibrated", float(row["focal_per_width"])
    elif row["sensor_width_mm"]:
        known_from, focal_per_width = "sensor", float(row["focal_mm"]) / float(row["sensor_width_mm"])
    else:
        known_from = "film"
        focal_per_width = float(row["focal_35mm_mm"]) / _FILM_DIAGONAL_MM * math.hypot(across, down) / across
    width_px, height_px = map(int, size.split("x"))
    focal_px = round(focal_per_width * width_px, 1)
    share = _STDS[known_from] if kind == "photo" else _VIDEO_STD
    camera = Camera.of_focal(
        name=f"{row['name']}, {kind} {size}",
        width_px=width_px,
        height_px=height_px,
        focal_px=focal_px,
        std=CameraStd(focal_px=round(share * focal_px, 1), principal_point_px=round(_CENTRE_STD * width_px, 1)),
        mode=CameraMode(device=row["device"]),
    )
    return KnownCamera(
        name=row["name"],
        kind=kind,
        known_from=known_from,
        source=row["source"],
        focal_35mm_mm=focal_35mm_mm,
        camera=camera,
    )
