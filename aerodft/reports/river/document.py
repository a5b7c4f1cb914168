"""What a river's width came to in one image or in many, as a JSON document."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.dft import Contradiction, RiverWidths
from aerodft.geometry import lat_lon
from aerodft.model import BoolArray, FloatArray, PoseSample
from aerodft.vision.river import (
    ONE_SIDED,
    WHY,
    Islands,
    NoRiver,
    Reach,
    River,
    RiverStatus,
    RiverView,
    WaterMask,
    hidden_per_metre,
)

SCHEMA: Final = "aerodft.river/1"
SIDES: Final = ("left", "right")
_AGREED: Final = 0.9  # overlap of the looks, below which that is said
_ARM: Final = 0.25  # of the water's area: a piece apart from which on it is one

MAX_CONTRADICTION_STDS: Final = 3.0
"""Largest ``Contradiction.stds`` of a reach with a headline.

Simulated flights with right poses come to 0.6, with stamps 0.25 to 2 s off to 4.5 to 9.3, with a focal length 20 % off
to 4.1 to 7.4. Half would refuse a flight whose gimbal lags 0.2 s and whose median holds; twice would accept widths that
are 26 % off."""

_MUCH: Final = 1.5
"""Times as much as they state, from which images' scatter is told."""
_FAR_TOO_MUCH: Final = 10.0
"""Times as much, from which poses are not those of these images: stamps that are 2 s off come to 85."""


@dataclass(frozen=True, slots=True)
class RiverImages:
    """The images of a recording or a video that a river is looked for in.

    Attributes:
        views: Those to look at.
        with_pixels: How many images with pixels there are.
        without_pose: How many of them have no pose, by status.
        is_utc: Whether their stamps are; else they count from the first image.
        computed_from: The recording, the ids of its configuration and calibration, and the changed settings; None for
            a video.
    """

    views: tuple[RiverView, ...]
    with_pixels: int
    without_pose: dict[str, int]
    is_utc: bool
    computed_from: Mapping[str, Any] | None = None


def refusal_document(found: NoRiver, images: RiverImages | None = None) -> dict[str, Any]:
    """The document of one image, or of many, without an answer."""
    document = river_frame(found.status, [found.reason], 0.0)
    document["banks"] = {side: _rounded(line) for side, line in zip(SIDES, found.banks_px, strict=True)}
    if images is None:
        return document
    return document | {"images": _counts(images), "computed_from": images.computed_from}


def river_document(found: River, view: RiverView) -> dict[str, Any]:
    """The document of a river in one image."""
    used = found.used
    status, reasons = RiverStatus.OK, list(view.sample.reasons)
    if not used.any():
        first = found.status[int(found.rows[0])]
        status, reasons = first, [*reasons, WHY[first]]
    document = river_frame(status, reasons, water_confidence(found.water))
    reasons += doubts([found.water])
    document["banks"] = {side: _rounded(line) for side, line in zip(SIDES, found.banks_px, strict=True)}
    document["transects"] = list(_transects(found, view))
    reasons += bounds(document["transects"])
    if used.any():
        document["width_m"] = width_summary(found.widths, used)
    return document


def water_confidence(water: WaterMask) -> float:
    """Overlap of the network's looks, less half of another arm's share."""
    return water.agreement * (1.0 - 0.5 * min(water.apart, 1.0)) if water.apart >= _ARM else water.agreement


def doubts(waters: Sequence[WaterMask]) -> list[str]:
    """What to say of the water of one image or of many, at least one, by their median."""
    agreement, apart = (float(np.median([getattr(water, name) for water in waters])) for name in ("agreement", "apart"))
    said = []
    if agreement < _AGREED:
        what = f"two looks at the water share {100 * agreement:.0f} % of it"
        said.append(f"{what}: the intervals reach to the banks of both; look at the plate, or point at water and land")
    if apart >= _ARM:
        size = f"{100 * apart:.0f} % of its area"
        said.append(f"more water lies apart ({size}): another arm? It is not in the widths")
    return said


def bounds(transects: list[dict[str, Any]]) -> list[str]:
    """What to say of transects whose near bank may hide water."""
    behind = sum(each["bound"] is not None for each in transects)
    if not behind:
        return []
    hides = f"each metre of growth on it hides {ONE_SIDED:g} m of water or more (hidden_m_per_m)"
    return [f"{behind} transects look over their near bank: {hides}, their widths are bounds from below"]


def width_summary(widths: RiverWidths, used: BoolArray) -> dict[str, Any]:
    """The used widths, at least one, in a few numbers."""
    median, std, ci95 = widths.median(used)
    known = widths.width_m[used]
    return {
        "median": median,
        "std": std,
        "ci95": list(ci95),
        "min": float(known.min()),
        "max": float(known.max()),
        "transects": int(used.sum()),
    }


def river_frame(status: RiverStatus, reasons: list[str], confidence: float) -> dict[str, Any]:
    """A document without an answer yet."""
    return {
        "schema": SCHEMA,
        "status": str(status),
        "reasons": reasons,
        "banks": {side: [] for side in SIDES},
        "transects": [],
        "width_m": None,
        "confidence": confidence,
        "files": [],
    }


def _rounded(pixels: FloatArray) -> list[list[float]]:
    rows: list[list[float]] = np.round(pixels, 3).tolist()
    return rows


def blank_transect(station_m: float, status: RiverStatus, reason: str | None) -> dict[str, Any]:
    """A transect without a width: every key that one has, of one image as of many."""
    return {
        "station_m": station_m,
        **dict.fromkeys((*SIDES, "width_m", "std", "ci95", "wetted_m", "wetted_std", "channels", "bound")),
        **dict.fromkeys(("hidden_m_per_m", "points_enu_m", "geo")),
        "status": str(status),
        "reason": reason,
        "bank_std_px": [None, None],
        "images": 0,
        "scatter_m": None,
    }


def measured_transect(
    widths: RiverWidths, row: int, islands: tuple[Islands, int], hidden: FloatArray, sample: PoseSample
) -> dict[str, Any]:
    """What a transect with a width has.

    Args:
        widths: Widths.
        row: Which of them it is.
        islands: What is dry, and which of them it is.
        hidden: ``(2,)`` metres of water that a metre of growth hides on the left and on the right bank.
        sample: Whose place the points are from.
    """
    (dry, at), width, std = islands, float(widths.width_m[row]), float(widths.std_m[row])
    return {
        "width_m": width,
        "std": std,
        "ci95": widths.ci95_m[row].tolist(),
        "wetted_m": width - float(dry.dry_m[at]),
        "wetted_std": math.hypot(std, float(dry.std_m[at])),
        "channels": int(dry.count[at]) + 1,
        "bound": "at_least" if hidden.max() >= ONE_SIDED else None,
        "hidden_m_per_m": hidden.tolist(),
        "points_enu_m": widths.points_enu_m[row].tolist(),
        "geo": geo_of(sample, widths.points_enu_m[row]),
    }


def _transects(found: River, view: RiverView) -> Iterable[dict[str, Any]]:
    measured = {int(row): index for index, row in enumerate(found.rows)}
    hidden = hidden_per_metre(view.pose, found.widths.points_enu_m)
    for row, status in enumerate(found.status):
        index = measured.get(row)
        each = blank_transect(float(found.transects.stations_m[row]), status, WHY.get(status))
        if index is not None and status is RiverStatus.OK:
            each |= measured_transect(found.widths, index, (found.islands, row), hidden[index], view.sample)
            each["images"] = 1
        for column, side in enumerate(SIDES):
            pixel = found.edges.pixels_px[row, column]
            if math.isfinite(pixel[0]):
                each[side], each["bank_std_px"][column] = _rounded(pixel), float(found.edges.std_px[row, column])
        yield each


def geo_of(sample: PoseSample, points_enu_m: FloatArray) -> list[dict[str, float]] | None:
    """Places of points ``(n, 3)``; None where the pose's is not known."""
    if sample.origin is None:
        return None
    places = np.degrees(lat_lon(sample.origin, points_enu_m[:, :2]))
    return [{"lat_deg": float(lat), "lon_deg": float(lon)} for lat, lon in places]


def contradiction_refusal(found: Reach, images: RiverImages) -> NoRiver | None:
    """The refusal of a reach whose images contradict each other beyond their stated errors; None where they do not."""
    stds = found.found.contradiction.stds
    if stds <= MAX_CONTRADICTION_STDS:
        return None
    what = f"the images' widths of one place differ by {stds:.1f} times what their stated errors explain"
    limit = f"{MAX_CONTRADICTION_STDS:g} times are accepted"
    return NoRiver(RiverStatus.CONTRADICTORY, f"{what} ({limit}): {_likely_cause(found.found.contradiction, images)}")


def _likely_cause(contradiction: Contradiction, images: RiverImages) -> str:
    """What may be wrong with images that contradict each other, and what to do."""
    if images.computed_from is None:
        return "the camera was moved or zoomed, or the water rose or fell meanwhile; measure shorter parts of the video"
    if contradiction.cause == "clock":
        what = f"stamps that are about {abs(contradiction.error):.1g} s off explain most of it"
        return f"{what}; `align` finds the video's clock, images.time_offset_s states it"
    if contradiction.cause == "scale":
        side = "short" if contradiction.error < 0 else "long"
        what = f"a focal length that is too {side}, or a wrong height, explains most of it"
        return f"{what}; check the camera file, and `home_above_plane_m`"
    what = "the stamps, the camera's focal length or the height is wrong"
    return f"{what}; `align` finds the video's clock, then check the camera file and `home_above_plane_m`"


def reach_document(found: Reach, images: RiverImages) -> dict[str, Any]:
    """The document of a river over many images; where these contradict each other its status says so."""
    refusal = contradiction_refusal(found, images)
    used = found.found.images > 0
    seen = [look for look in found.looks if isinstance(look, River)]
    status = RiverStatus.OK if refusal is None else refusal.status
    document = river_frame(status, [], float(np.median([water_confidence(look.water) for look in seen])))
    hidden, origin = _hidden(found, images), images.views[0].sample
    document["transects"] = [_transect(found, row, hidden[row], origin) for row in range(len(used))]
    document["width_m"] = width_summary(found.found.widths, used)
    ratio = found.found.scatter_ratio
    document["reasons"] = [
        *([] if refusal is None else [refusal.reason]),
        *scatter_remarks(ratio),
        *doubts([look.water for look in seen]),
        *bounds(document["transects"]),
    ]
    counted = _counts(images) | {"used": len(seen), "used_share": len(seen) / len(images.views), "scatter_ratio": ratio}
    counted["contradiction_stds"] = found.found.contradiction.stds
    document["computed_from"] = images.computed_from
    document["images"] = counted | {"each": [_image(found, images, row) for row in range(len(images.views))]}
    return document


def scatter_remarks(ratio: float) -> list[str]:
    """What to think of images that tell other widths than they should."""
    if ratio <= _MUCH:
        return []
    far = "; are their stamps those of the telemetry? aerodft sync tells" if ratio > _FAR_TOO_MUCH else ""
    return [f"images scatter {ratio:.1f} times as much as they state: the stds contain it{far}"]


def _counts(images: RiverImages) -> dict[str, Any]:
    return {"looked_at": len(images.views), "with_pixels": images.with_pixels, "without_pose": images.without_pose}


def _transect(found: Reach, row: int, hidden: FloatArray, origin: PoseSample) -> dict[str, Any]:
    images, scatter = int(found.found.images[row]), float(found.found.scatter_m[row])
    station = float(found.stations_m[row])
    if not images:
        return blank_transect(station, RiverStatus.OUT_OF_IMAGE, "no image shows both banks here")
    return {
        **blank_transect(station, RiverStatus.OK, None),
        **measured_transect(found.found.widths, row, (found.islands, row), hidden, origin),
        "images": images,
        "scatter_m": scatter if np.isfinite(scatter) else None,
    }


def _hidden(found: Reach, images: RiverImages) -> FloatArray:
    """Water that a metre of growth on each bank hides, ``(n, 2)``, in the mean of the images that measure it."""
    total = np.zeros((len(found.stations_m), 2))
    for view, look in zip(images.views, found.looks, strict=True):
        if isinstance(look, River):
            total[look.rows[look.used]] += hidden_per_metre(view.pose, look.widths.points_enu_m[look.used])
    return np.asarray(total / np.maximum(found.found.images, 1)[:, None])


def _image(found: Reach, images: RiverImages, row: int) -> dict[str, Any]:
    view, look, drift = images.views[row], found.looks[row], float(found.found.drift[row])
    told: dict[str, Any] = {"status": str(RiverStatus.OK), "reason": None, "confidence": None}
    if isinstance(look, River):
        told["confidence"] = water_confidence(look.water)
    else:
        told |= {"status": str(look.status), "reason": look.reason}
    return {
        "image": view.index,
        "stamp_ns": str(view.sample.stamp_ns) if images.is_utc else None,
        "since_s": (view.sample.stamp_ns - images.views[0].sample.stamp_ns) / SECOND_NS,
        **told,
        "drift": drift if np.isfinite(drift) else None,
    }
