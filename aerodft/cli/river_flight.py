"""``aerodft river`` over many images: a recording, or a fixed camera's video."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from aerodft.cli.output import steps
from aerodft.cli.river_flight_document import reach_document, refused_reach
from aerodft.cli.river_flight_files import write_flight
from aerodft.cli.river_views import View, Views
from aerodft.dft.request import Setup
from aerodft.model.pose import Pose, PoseSample
from aerodft.vision.river import NoRiver, RiverQuestion
from aerodft.vision.river_reach import ReachView, measure_reach
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
    with steps("looking at the river twice in each image", 2 * len(asked)) as advance:
        found = measure_reach(asked, question, advance)
    if isinstance(found, NoRiver):
        return refused_reach(found, views)
    document = reach_document(found, views)
    if output is not None:
        write_flight(output, document, found, views)
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
