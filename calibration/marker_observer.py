"""Surveyed markers in a station's images, as observations of its landmarks."""

import logging
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.image import Image
from aerodft.model.marker import MarkerSighting, MarkerSurvey, SurveyedMarker, marker_name
from aerodft.model.observation import Observation
from calibration.marker_geometry import SIZE, STDS, apparent_side
from calibration.markers import find_markers

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class CameraPlace:
    """Where a camera is.

    Attributes:
        position_enu_m: ``(3,)`` from the station's origin.
        std_m: Of that, in any direction.
    """

    position_enu_m: FloatArray
    std_m: float


class MarkerObserver:
    """Implements ``service.ports.ImageObserver``.

    Args:
        survey: What to look for, in metres of the station's origin.
        camera: Whose images they are.
        ignore: Ids that are there too, and that nobody has surveyed.
        place_near: Where the camera is when an image is taken, None where nobody knows. With it, what looks much larger
            or smaller than its marker would is told to be something else.
    """

    def __init__(
        self,
        survey: MarkerSurvey,
        camera: Camera,
        ignore: frozenset[int] = frozenset(),
        place_near: Callable[[Image], CameraPlace | None] = lambda _: None,
    ) -> None:
        self._survey = survey
        self._surveyed = survey.by_id
        self._camera = camera
        self._ignore = ignore
        self._place_near = place_near
        self._strangers: Counter[int] = Counter()
        self._false: Counter[int] = Counter()

    @property
    def strangers(self) -> dict[int, int]:
        """In how many images ids were seen that nobody has surveyed, by id."""
        return dict(sorted(self._strangers.items()))

    @property
    def false(self) -> dict[int, int]:
        """In how many images a surveyed id looked much larger or smaller than its marker is, by id."""
        return dict(sorted(self._false.items()))

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """The centre, or the four corners, of each surveyed marker; nothing in an image without pixels.

        An id that is there twice is seen twice: which one is true is for the filter to say.
        """
        if image.pixels is None:
            return ()
        place, seen = self._place_near(image), list[Observation]()
        for each in find_markers(image.pixels(), self._survey, self._camera):
            marker = self._surveyed.get(each.id)
            if marker is None:
                self._count_stranger(each.id, image)
            elif place is not None and _looks_false(marker, each, place, self._camera):
                self._false[each.id] += 1
            else:
                seen += _observations(marker, each, image)
        return tuple(seen)

    def _count_stranger(self, marker: int, image: Image) -> None:
        if marker in self._ignore:
            return
        if marker not in self._strangers:
            text = "image %d shows %s, which is not surveyed; it is not used, and not mentioned again"
            _log.warning(text, image.index, marker_name(marker))
        self._strangers[marker] += 1


def _looks_false(marker: SurveyedMarker, seen: MarkerSighting, place: CameraPlace, camera: Camera) -> bool:
    """Whether it looks larger or smaller than anything of its size could, where it should be."""
    side_m = _side_m(marker)
    if side_m is None:
        return False
    away_m = float(np.linalg.norm(np.mean(marker.points_m, axis=0) - place.position_enu_m))
    angle, angle_std = apparent_side(camera, seen)
    doubt = STDS * math.hypot(angle_std / angle, place.std_m / away_m)
    return abs(math.log(angle * away_m / side_m)) > math.log1p(SIZE) + doubt


def _side_m(marker: SurveyedMarker) -> float | None:
    """Of its black square; None where nobody has measured it."""
    if marker.side_m is not None or len(marker.points_m) == 1:
        return marker.side_m
    corners_m: FloatArray = np.array(marker.points_m)
    return float(np.mean(np.linalg.norm(np.roll(corners_m, -1, axis=0) - corners_m, axis=1)))


def _observations(marker: SurveyedMarker, seen: MarkerSighting, image: Image) -> list[Observation]:
    is_centre = len(marker.points_m) == 1
    pixels = (seen.pixel,) if is_centre else seen.corners
    return [
        Observation.in_image(image, name, (pixel,), std_px=seen.std_px if is_centre else seen.corner_std_px)
        for name, pixel in zip(marker.point_names, pixels, strict=True)
    ]
