"""Observations to requests: pixels as they are, boxes and contours by where the object that they show stands."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.dft import (
    EDGE_STD_PX,
    PROBE_KINDS,
    MeasurementBatch,
    MeasurementColumn,
    Request,
    Setup,
    Standing,
    corners_of,
    down_in_image,
    standing_box,
    standing_outline,
    zoomed,
)
from aerodft.model import (
    CODE_OF,
    Camera,
    FloatArray,
    IntArray,
    Observation,
    PixelSource,
    Pose,
    PoseBatch,
    Probe,
    ProbeKind,
    Status,
)

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
        return PROBE_KINDS[kind].takes_pixels(len(observation.pixels))
    return kind in _OF_STANDING or (kind == ProbeKind.AREA and bool(observation.contour))


def unseen(
    setup: Setup, poses: PoseBatch, probe: Probe, observations: Sequence[Observation], images: IntArray
) -> MeasurementBatch:
    """What is measured of a probe that was looked for in images ``(n,)`` and not seen: nothing, and why."""
    status, reasons, said = poses.status, dict[int, tuple[str, ...]](), poses.variant_of_each
    why = Status.LOST if probe.source is PixelSource.TRACKED else Status.NOT_SEEN
    for row in np.flatnonzero(status == CODE_OF[Status.OK]).tolist():
        status[row], reasons[row] = CODE_OF[why], (observations[row].unseen or _UNSEEN[why], *said[row].reasons)
    column = MeasurementColumn(PROBE_KINDS[probe.kind].unit, status, reasons, {})
    return MeasurementBatch(
        requests=(Request(probe=probe, pixels=(), std_px=probe.std_px),),
        poses=poses,
        images=images,
        columns=(column,),
        model=setup.model,
        camera=setup.camera.name,
        config=setup.config_id,
    )


def request_of(probe: Probe, observations: Sequence[Observation], setup: Setup, poses: PoseBatch) -> Request:
    """What is asked of the engine for observations ``(n,)`` that can answer.

    Args:
        probe: The probe.
        observations: Of that probe, of as many pixels with one std; an outline comes alone.
        setup: The station's circumstances.
        poses: Of the images.
    """
    seen = observations[0]
    if not seen.has_outline:
        pixels = np.array([each.pixels for each in observations], dtype=np.float64)
        return Request(probe=probe, pixels=pixels, std_px=seen.std_px or probe.std_px)
    std_px = seen.std_px or probe.std_px or EDGE_STD_PX
    if probe.kind == ProbeKind.AREA:
        corners = corners_of(np.array(seen.contour))
        return Request(probe=probe, pixels=_pairs(corners), std_px=std_px)
    zoomed_setup, sample = zoomed(setup, poses[0])
    standing = standing_of(seen, zoomed_setup.camera, sample.pose, std_px)
    points, std_px = _PIXELS_OF[probe.kind].of(standing)
    return Request(probe=probe, pixels=points, std_px=std_px)


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
