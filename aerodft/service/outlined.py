"""Observations to requests: pixels as they are, boxes and contours by where the object that they show stands."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.dft.answers import ImageAnswers
from aerodft.dft.record import no_answer
from aerodft.dft.request import Request, Setup
from aerodft.dft.silhouette import EDGE_STD_PX, Standing, corners_of, down_in_image, standing_box, standing_outline
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.observation import Observation
from aerodft.model.pose import Pose, PoseSample
from aerodft.model.probe import PixelSource, Probe, ProbeKind, takes_pixels
from aerodft.model.status import Status

_OF_STANDING: Final = (ProbeKind.POSITION, ProbeKind.RANGE, ProbeKind.BEARING, ProbeKind.HEIGHT, ProbeKind.WIDTH)

_UNSEEN: Final = {
    Status.LOST: "it is out of the image, or was not recognised in it",
    Status.NOT_SEEN: "it was looked for in the image, and not seen",
}

Pixels = tuple[tuple[float, float], ...]


def can_answer(probe: Probe, observation: Observation) -> bool:
    """Whether what was observed is what a probe measures, or that it was not found."""
    kind = probe.kind
    if observation.is_empty:
        return True
    if not observation.has_outline:
        return takes_pixels(kind, len(observation.pixels))
    return kind in _OF_STANDING or (kind is ProbeKind.AREA and bool(observation.contour))


def unseen(setup: Setup, sample: PoseSample, probe: Probe, observation: Observation) -> ImageAnswers:
    """What is measured of a probe that was looked for and not seen: nothing, and why."""
    answer = no_answer(probe, sample.status, sample.reasons)
    if sample.status is Status.OK:
        status = Status.LOST if probe.source is PixelSource.TRACKED else Status.NOT_SEEN
        answer = no_answer(probe, status, (observation.unseen or _UNSEEN[status], *sample.reasons))
    request = Request(probe=probe, pixels=(), std_px=probe.std_px)
    return ImageAnswers.of(setup, sample, observation.image, (request,), (answer,))


def request_of(probe: Probe, observation: Observation, camera: Camera, pose: Pose | None) -> Request:
    """What is asked of the engine for an observation that can answer.

    Args:
        probe: The probe.
        observation: Of that probe.
        camera: The camera.
        pose: Of the image; None where it has none.
    """
    if not observation.has_outline:
        return Request(probe=probe, pixels=observation.pixels, std_px=observation.std_px or probe.std_px)
    std_px = observation.std_px or probe.std_px or EDGE_STD_PX
    if probe.kind is ProbeKind.AREA:
        return Request(probe=probe, pixels=_pairs(corners_of(np.array(observation.contour))), std_px=std_px)
    seen = standing_of(observation, camera, pose, std_px)
    pixels, std_px = _PIXELS_OF[probe.kind].of(seen)
    return Request(probe=probe, pixels=pixels, std_px=std_px)


def standing_of(observation: Observation, camera: Camera, pose: Pose | None, edge_std_px: float) -> Standing:
    """The object in an observation's box or contour."""
    if observation.box is not None:
        left, top, right, bottom = observation.box
        down = down_in_image(camera, pose, np.array([[left, top], [right, bottom]]))
        return standing_box(observation.box, down, edge_std_px)
    return standing_outline(camera, pose, np.array(observation.contour), edge_std_px)


@dataclass(frozen=True, slots=True)
class _Taken:
    """What one kind of probe takes of an object: some of its points, with the error that matters to it."""

    foot: bool = False
    top: bool = False
    sides: bool = False
    is_moved_by_depth: bool = False
    is_moved_aside: bool = False

    def of(self, seen: Standing) -> tuple[Pixels, float]:
        points = [seen.foot_px] * self.foot + [seen.top_px] * self.top + list(seen.sides_px) * self.sides
        stds = [seen.edge_std_px] * self.is_moved_by_depth + [seen.aside_std_px] * self.is_moved_aside
        return _pairs(np.array(points)), max(stds)


# To first order only a pixel's way along the vertical changes a range or a height, and only that across it a bearing.
_PIXELS_OF: Final = {
    ProbeKind.POSITION: _Taken(foot=True, is_moved_by_depth=True, is_moved_aside=True),
    ProbeKind.RANGE: _Taken(foot=True, is_moved_by_depth=True),
    ProbeKind.BEARING: _Taken(foot=True, is_moved_aside=True),
    ProbeKind.HEIGHT: _Taken(foot=True, top=True, is_moved_by_depth=True),
    ProbeKind.WIDTH: _Taken(sides=True, is_moved_by_depth=True),
}


def _pairs(points_px: FloatArray) -> Pixels:
    return tuple((u, v) for u, v in points_px.tolist())
