"""Cameras that many people have, in their modes: what public facts say of their focal lengths, and how well."""

import csv
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final, Literal

from aerodft.model import Camera, CameraMode, CameraStd

_FILM_DIAGONAL_MM: Final = 43.27
_STDS: Final = {"calibrated": 0.015, "sensor": 0.03, "film": 0.04}
"""Of a focal length, as a share of it, by what it is known from: those for film are whole millimetres."""
_VIDEO_STD: Final = 0.06
"""Of a video's: it is cropped, stabilised and straightened by amounts that makers do not state."""
_CENTRE_STD: Final = 0.005
"""Of the principal point, as a share of the image's width."""


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

    def shows(self, size_px: tuple[int, int], mode: CameraMode) -> bool:
        """Whether a photo of this size and with these EXIF data may be of it."""
        device = "" if self.camera.mode is None else self.camera.mode.device or ""
        is_same_lens = None in (mode.focal_35mm_mm, self.focal_35mm_mm) or (
            abs((mode.focal_35mm_mm or 0.0) - (self.focal_35mm_mm or 0.0)) <= 0.1 * (self.focal_35mm_mm or 0.0)
        )
        is_same = mode.device is not None and mode.device.casefold() == device.casefold() and is_same_lens
        return is_same and self.kind == "photo" and size_px == (self.camera.width_px, self.camera.height_px)


@cache
def known_cameras() -> tuple[KnownCamera, ...]:
    """All of them, photos before videos of each."""
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
