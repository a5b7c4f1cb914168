"""``aerodft river`` over many images: a recording, or a fixed camera's video."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from aerodft.cli.output import progress_bar
from aerodft.cli.river_document import geo_of, river_frame, width_summary
from aerodft.cli.river_flight_files import write_flight
from aerodft.cli.river_views import View, Views
from aerodft.dft.request import Setup
from aerodft.model.pose import Pose, PoseSample
from aerodft.vision.river import NoRiver, RiverQuestion, RiverStatus
from aerodft.vision.river_reach import Reach, ReachView, measure_reach
from aerodft.vision.water_motion import LaterLook
from aerodft.vision.water_plane import WaterPlane

VIDEO_SUFFIXES: Final = frozenset({".mp4", ".mov", ".mkv", ".avi", ".ts", ".m4v", ".webm", ".mpg", ".mpeg"})
MOST_IMAGES: Final = 60
"""Images that are looked at, unless told otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WaterLevel:
    """Where the water is, and how far it is looked at.

    Attributes:
        elevation_m: Above the plane that heights are of.
        elevation_std_m: Its standard deviation.
        max_range_m: None for the river's own limit.
    """

    elevation_m: float
    elevation_std_m: float
    max_range_m: float | None

    def on(self, setup: Setup) -> Setup:
        """A setup that measures at this level."""
        limit = setup.max_range_m if self.max_range_m is None else self.max_range_m
        return replace(setup, elevation_m=self.elevation_m, elevation_std_m=self.elevation_std_m, max_range_m=limit)


def flight_document(views: Views, level: WaterLevel, question: RiverQuestion, output: Path | None) -> dict[str, Any]:
    """Measure a river over many images; writes the folder where there is one to write.

    Raises:
        InputError: An image cannot be read, or the folder cannot be written.
    """
    asked = [_asked(each, level) for each in views.views]
    with progress_bar("looking at the river", 0, 2 * len(asked)) as advance:
        found = measure_reach(asked, question, advance)
    document = _document(found, views)
    if isinstance(found, Reach) and output is not None:
        write_flight(output, document, found, views.views[0].sample)
    return document


def _asked(view: View, level: WaterLevel) -> ReachView:
    later = None
    if view.later is not None:
        setup = level.on(view.later.setup)
        plane = WaterPlane(setup.camera, _pose(view.later.sample), setup.elevation_m, setup.max_range_m)
        later = LaterLook(plane, view.later.copy, (view.later.sample.stamp_ns - view.sample.stamp_ns) / 1e9)
    return ReachView(level.on(view.setup), _pose(view.sample), view.pixels, later)


def _pose(sample: PoseSample) -> Pose:
    assert sample.pose is not None  # noqa: S101 - views have one, for the type checker
    return sample.pose


def _document(found: Reach | NoRiver, views: Views) -> dict[str, Any]:
    facts = {"looked_at": len(views.views), "with_pixels": views.images, "without_pose": views.refused}
    if isinstance(found, NoRiver):
        return river_frame(found.status, [found.reason], 0.0) | {"images": facts}
    widths, origin = found.found.widths, views.views[0].sample
    used = found.found.images > 0
    told = sum(status is RiverStatus.OK for status in found.status)
    document = river_frame(RiverStatus.OK, _reasons(found), told / len(views.views))
    document["transects"] = [_transect(found, row, origin) for row in range(len(used))]
    document["width_m"] = width_summary(widths, used)
    document["images"] = facts | {"scatter_ratio": found.found.scatter_ratio, "each": list(_images(found, views))}
    return document


def _reasons(found: Reach) -> list[str]:
    many = found.found.scatter_ratio
    return [f"images scatter {many:.1f} times as much as they state: the stds contain it"] if many > 1.5 else []  # noqa: PLR2004 - less is nothing to tell


def _transect(found: Reach, row: int, origin: PoseSample) -> dict[str, Any]:
    widths, images = found.found.widths, int(found.found.images[row])
    answer: dict[str, Any] = dict.fromkeys(("width_m", "std", "ci95", "scatter_m", "points_enu_m", "geo"))
    status = RiverStatus.OUT_OF_IMAGE
    if images:
        points, scatter = widths.points_enu_m[row], found.found.scatter_m[row]
        status = RiverStatus.OK
        answer = {
            "width_m": float(widths.width_m[row]),
            "std": float(widths.std_m[row]),
            "ci95": widths.ci95_m[row].tolist(),
            "scatter_m": float(scatter) if np.isfinite(scatter) else None,
            "points_enu_m": points.tolist(),
            "geo": geo_of(origin, points),
        }
    reason = None if images else "no image shows both banks here"
    return {
        "station_m": float(found.stations_m[row]),
        **answer,
        "images": images,
        "status": str(status),
        "reason": reason,
    }


def _images(found: Reach, views: Views) -> list[dict[str, Any]]:
    rows = zip(views.views, found.status, found.reasons, found.found.drift.tolist(), strict=True)
    return [
        {
            "image": view.index,
            "stamp_ns": str(view.sample.stamp_ns),
            "status": str(status),
            "reason": reason or None,
            "drift": drift if np.isfinite(drift) else None,
        }
        for view, status, reason, drift in rows
    ]
