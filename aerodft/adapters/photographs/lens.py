"""The camera that a photograph's XMP tells of: calibrated intrinsics, a nominal focal length, or a field of view."""

import math
from dataclasses import dataclass
from typing import Final

from aerodft.adapters.photographs.dialect import TagReader
from aerodft.adapters.photographs.tags import PhotoTags
from aerodft.model import Camera, CameraMode, CameraStd

_DEWARP_COUNT: Final = 9  # fx, fy, cx, cy, k1, k2, p1, p2, k3
_DEWARPED: Final = 1
_SAME_ASPECT: Final = 1.02
_FACTORY_SHARE: Final = 0.003  # 3657.0 px against 3646.9 px of a reconstruction (P4 RTK)
_FACTORY_CENTRE: Final = 0.001  # of the width: 4.5 and 3 px of 5472
_FACTORY_DISTORTION: Final = (0.004, 0.015, 0.0005, 0.0005, 0.01)  # of k1, k2, p1, p2, k3: twice that difference
_NOMINAL_SHARE: Final = 0.015  # 3666.7 px, by focal length and pixel pitch, against 3646.9 px; others are farther off
_FIELD_SHARE: Final = 0.03
_CENTRE: Final = 0.005  # of the width, where nobody states the principal point
_FOCAL_WIDTHS: Final = (0.2, 60.0)  # focal lengths in image widths that there are: 136 to 1 deg across


@dataclass(frozen=True, slots=True)
class StatedLens:
    """A camera by XMP, and which of its values that was."""

    camera: Camera
    source: str


def lens_of_tags(tags: PhotoTags, mode: CameraMode) -> StatedLens | None:
    """The camera by XMP; None where it says nothing of this image's lens.

    What is stated of another image than this one is not used: of one with another aspect (a thermal image with the
    colour camera's calibration), or before a digital zoom.
    """
    if mode.digital_zoom not in (None, 1.0) and (mode.digital_zoom or 0) > 1:
        return None
    return _by_dewarp(tags, mode) or _by_calibrated_focal(tags, mode) or _by_field(tags, mode)


def _by_dewarp(tags: PhotoTags, mode: CameraMode) -> StatedLens | None:
    """The factory's calibration of DJI: ``date;fx,fy,cx,cy,k1,k2,p1,p2,k3``, the centre against the image's."""
    _, _, text = tags.xmp.get("drone-dji:DewarpData", "").rpartition(";")
    values = [_number(part) for part in text.split(",")]
    if len(values) != _DEWARP_COUNT or not all(map(math.isfinite, values)):
        return None
    fx_px, fy_px, cx_px, cy_px, *distortion = values
    scale = _scale(tags, _dji_full_size(tags))
    if scale is None or not _is_focal(scale * fx_px, tags) or not 0.9 < fy_px / fx_px < 1.1:  # noqa: PLR2004
        return None
    is_dewarped = tags.xmp.get("drone-dji:DewarpFlag", "").strip() == str(_DEWARPED)
    camera = Camera(
        name=tags.model or tags.name,
        width_px=tags.width_px,
        height_px=tags.height_px,
        fx_px=scale * fx_px,
        fy_px=scale * fy_px,
        cx_px=(tags.width_px - 1) / 2 + scale * cx_px,
        cy_px=(tags.height_px - 1) / 2 + scale * cy_px,
        distortion=() if is_dewarped else tuple(distortion),
        std=CameraStd(
            focal_px=_FACTORY_SHARE * scale * fx_px,
            principal_point_px=_FACTORY_CENTRE * tags.width_px,
            distortion=() if is_dewarped else _FACTORY_DISTORTION,
        ),
        mode=mode,
    )
    return StatedLens(camera, "the factory's calibration in it (DewarpData)")


def _by_calibrated_focal(tags: PhotoTags, mode: CameraMode) -> StatedLens | None:
    """``CalibratedFocalLength`` in pixels, which is nominal, of DJI or Skydio."""
    reader = TagReader(tags)
    for focal, centre in (
        ("drone-dji:CalibratedFocalLength", "drone-dji:CalibratedOpticalCenter"),
        ("drone-skydio:CalibratedFocalLength/X", "drone-skydio:CalibratedOpticalCenter/"),
    ):
        focal_px = reader.number(focal, 1.0, 1e6)
        if focal_px is None:
            continue
        full = reader.number(f"{centre}X", 1.0, 1e6), reader.number(f"{centre}Y", 1.0, 1e6)
        full_px = None if full[0] is None or full[1] is None else (2 * full[0], 2 * full[1])
        scale = _scale(tags, full_px)
        if scale is None or not _is_focal(scale * focal_px, tags):
            return None
        return StatedLens(
            _of_focal(tags, mode, scale * focal_px, _NOMINAL_SHARE),
            "the nominal focal length in it (CalibratedFocalLength)",
        )
    return None


def _by_field(tags: PhotoTags, mode: CameraMode) -> StatedLens | None:
    """A field of view across, as Teal states it."""
    hfov_deg = TagReader(tags).number("exif:CameraHorizontalFOV", 1.0, 136.0)
    if hfov_deg is None:
        return None
    focal_px = tags.width_px / 2 / math.tan(math.radians(hfov_deg) / 2)
    return StatedLens(_of_focal(tags, mode, focal_px, _FIELD_SHARE), "the field of view in it (CameraHorizontalFOV)")


def _of_focal(tags: PhotoTags, mode: CameraMode, focal_px: float, share: float) -> Camera:
    return Camera.of_focal(
        name=tags.model or tags.name,
        width_px=tags.width_px,
        height_px=tags.height_px,
        focal_px=focal_px,
        std=CameraStd(focal_px=share * focal_px, principal_point_px=_CENTRE * tags.width_px),
        mode=mode,
    )


def _dji_full_size(tags: PhotoTags) -> tuple[float, float] | None:
    reader = TagReader(tags)
    u, v = (reader.number(f"drone-dji:CalibratedOpticalCenter{axis}", 1.0, 1e6) for axis in "XY")
    return None if u is None or v is None else (2 * u, 2 * v)


def _scale(tags: PhotoTags, full_px: tuple[float, float] | None) -> float | None:
    """Size of this image over the one that a calibration is about; None where it is about another image.

    Args:
        tags: The photograph's.
        full_px: Twice the optical centre: about the size of the calibrated image; None where it is not stated.
    """
    width, height = tags.exif.get("ExifImageWidth"), tags.exif.get("ExifImageHeight")
    taken_px = None
    if isinstance(width, float) and isinstance(height, float) and width > 0 and height > 0:
        taken_px = width, height
    calibrated_px = full_px or taken_px or (float(tags.width_px), float(tags.height_px))
    size_px = taken_px or (float(tags.width_px), float(tags.height_px))
    shrunk = tags.width_px / size_px[0]
    if not 1 / _SAME_ASPECT < shrunk * size_px[1] / tags.height_px < _SAME_ASPECT:
        return None  # cropped after it was taken
    scale = size_px[0] / calibrated_px[0]
    if 1 / 1.05 < scale < 1.05:  # noqa: PLR2004 - a centre is not exactly the middle
        scale = 1.0
    elif taken_px is None and not 1 / _SAME_ASPECT < scale * calibrated_px[1] / size_px[1] < _SAME_ASPECT:
        return None
    if size_px[1] > _SAME_ASPECT**3 * scale * calibrated_px[1]:
        return None  # higher than the calibrated image: not a crop of it
    return scale * shrunk


def _is_focal(focal_px: float, tags: PhotoTags) -> bool:
    low, high = _FOCAL_WIDTHS
    return low * tags.width_px <= focal_px <= high * tags.width_px


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
