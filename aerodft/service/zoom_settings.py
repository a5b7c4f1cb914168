"""How a vehicle's reports of its camera's view are read."""

import math
from dataclasses import dataclass

from aerodft.conventions import SECOND_NS
from aerodft.model.camera import ZoomSource


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoomSettings:
    """The camera file is the reference: what is followed is the focal length over that of the file.

    Attributes:
        order: The first source that is live wins; none where the camera's file always holds.
        level: Zoom, as a share of its range, at which the camera file holds.
        curve: Zoom and focal length over that at any fixed zoom, ascending, from 0 to 1; empty where it is not known.
        reported_hfov_rad: What the vehicle reports where the camera file holds; None for the file's own.
        hfov_std_rad: Standard deviation of reported fields of view.
        std_per_doubling: Relative standard deviation of the focal length for each doubling against the file's.
        camera: Whose reports count: up to 6 the number of a camera that the autopilot speaks for, from 7 on a camera's
            component id; None where there is one.
        stream: Number of the camera's video stream whose reports count; None for the first heard.
        max_gap_ns: Longest gap between two reports that is interpolated over.
    """

    order: tuple[ZoomSource, ...] = tuple(ZoomSource)
    level: float = 0.0
    curve: tuple[tuple[float, float], ...] = ()
    reported_hfov_rad: float | None = None
    hfov_std_rad: float = math.radians(0.5)
    std_per_doubling: float = 0.02
    camera: int | None = None
    stream: int | None = None
    max_gap_ns: int = 2 * SECOND_NS
