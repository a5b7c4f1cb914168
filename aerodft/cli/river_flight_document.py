"""What ``aerodft river`` found in many images, as its JSON document."""

from typing import Any, Final

import numpy as np

from aerodft.cli.river_document import (
    blank_transect,
    bounds,
    doubts,
    measured_transect,
    outline_confidence,
    river_frame,
    width_summary,
)
from aerodft.cli.river_views import Views
from aerodft.conventions import SECOND_NS
from aerodft.model.arrays import FloatArray
from aerodft.model.pose import Pose, PoseSample
from aerodft.vision.river import NoRiver, River, RiverStatus
from aerodft.vision.river_banks import hidden_per_metre
from aerodft.vision.river_reach import Reach

_MUCH: Final = 1.5
"""Times as much as they state, from which images' scatter is told."""
_FAR_TOO_MUCH: Final = 10.0
"""Likewise, from which poses are not those of these images: stamps that are 2 s off come to 85."""


def refused_reach(found: NoRiver, views: Views) -> dict[str, Any]:
    """The document of images without an answer."""
    return river_frame(found.status, [found.reason], 0.0) | {"images": _counts(views)}


def reach_document(found: Reach, views: Views) -> dict[str, Any]:
    """The document of a river over many images."""
    used = found.found.images > 0
    seen = [look for look in found.looks if isinstance(look, River)]
    document = river_frame(RiverStatus.OK, [], float(np.median([outline_confidence(look.water) for look in seen])))
    hidden, origin = _hidden(found, views), views.views[0].sample
    document["transects"] = [_transect(found, row, hidden[row], origin) for row in range(len(used))]
    document["width_m"] = width_summary(found.found.widths, used)
    ratio = found.found.scatter_ratio
    document["reasons"] = [
        *scatter_remarks(ratio),
        *doubts([look.water for look in seen]),
        *bounds(document["transects"]),
    ]
    counted = _counts(views) | {"used": len(seen), "used_share": len(seen) / len(views.views), "scatter_ratio": ratio}
    document["images"] = counted | {"each": [_image(found, views, row) for row in range(len(views.views))]}
    return document


def scatter_remarks(ratio: float) -> list[str]:
    """What to think of images that tell other widths than they should."""
    if ratio <= _MUCH:
        return []
    far = "; are their stamps those of the telemetry? aerodft sync tells" if ratio > _FAR_TOO_MUCH else ""
    return [f"images scatter {ratio:.1f} times as much as they state: the stds contain it{far}"]


def _counts(views: Views) -> dict[str, Any]:
    return {"looked_at": len(views.views), "with_pixels": views.images, "without_pose": views.refused}


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


def _hidden(found: Reach, views: Views) -> FloatArray:
    """Water that a metre of growth on each bank hides, ``(n, 2)``, in the mean of the images that measure it."""
    total = np.zeros((len(found.stations_m), 2))
    for view, look in zip(views.views, found.looks, strict=True):
        if isinstance(look, River):
            total[look.rows[look.used]] += hidden_per_metre(_pose(view.sample), look.widths.points_enu_m[look.used])
    return np.asarray(total / np.maximum(found.found.images, 1)[:, None])


def _pose(sample: PoseSample) -> Pose:
    assert sample.pose is not None  # noqa: S101 - views have one, for the type checker
    return sample.pose


def _image(found: Reach, views: Views, row: int) -> dict[str, Any]:
    view, look, drift = views.views[row], found.looks[row], float(found.found.drift[row])
    told: dict[str, Any] = {"status": str(RiverStatus.OK), "reason": None, "confidence": None}
    if isinstance(look, River):
        told["confidence"] = outline_confidence(look.water)
    else:
        told |= {"status": str(look.status), "reason": look.reason}
    return {
        "image": view.index,
        "stamp_ns": str(view.sample.stamp_ns) if views.is_utc else None,
        "since_s": (view.sample.stamp_ns - views.views[0].sample.stamp_ns) / SECOND_NS,
        **told,
        "drift": drift if np.isfinite(drift) else None,
    }
