"""Requests and empty measurements from observations: pure functions of what was seen, and of the poses."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from aerodft.dft import (
    EDGE_STD_PX,
    PROBE_KINDS,
    MeasurementBatch,
    MeasurementColumn,
    Request,
    Setup,
    Silhouette,
    down_in_image,
    link_requests,
    locate_box,
    locate_outline,
    simplify_outline,
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
    Status,
)

_REASONS: Final = {
    Status.LOST: "it is out of the image, or was not recognised in it",
    Status.NOT_SEEN: "it was looked for in the image, and not seen",
}

Pixels = tuple[tuple[float, float], ...]


def fixed_requests(probes: Sequence[Probe]) -> tuple[Request, ...]:
    """Requests of the probes whose pixels are configured; the others are observed."""
    fixed = (probe for probe in probes if probe.source is PixelSource.FIXED)
    return link_requests(Request(probe=each, pixels=each.pixels, std_px=each.std_px) for each in fixed)


def can_answer(probe: Probe, observation: Observation) -> bool:
    """Whether an observation has the pixels or the outline that a probe needs, or is empty."""
    kind = PROBE_KINDS[probe.kind]
    if observation.is_empty:
        return True
    if not observation.has_outline:
        count = len(observation.pixels)
        return kind.takes_pixels(count) and kind.takes_elevations(probe.elevation_count, count)
    points = kind.object_points
    if points is None or (points.contour and not observation.contour):
        return False
    return points.takes_elevations(probe.elevation_count)


def unseen_batch(
    setup: Setup, poses: PoseBatch, probe: Probe, observations: Sequence[Observation], images: IntArray
) -> MeasurementBatch:
    """Measurements of a probe not found in images ``(n,)``: a status with reasons, and no value."""
    status, reasons, variants = poses.status, dict[int, tuple[str, ...]](), poses.variant_of_each
    code = Status.LOST if probe.source is PixelSource.TRACKED else Status.NOT_SEEN
    for row in np.flatnonzero(status == CODE_OF[Status.OK]).tolist():
        status[row], reasons[row] = CODE_OF[code], (observations[row].unseen or _REASONS[code], *variants[row].reasons)
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
    """Request for observations ``(n,)`` that ``can_answer``.

    Args:
        probe: The probe.
        observations: Of that probe, with equal numbers of pixels and one std; an outline is the only one.
        setup: Camera, model and ground.
        poses: Poses of the images.
    """
    observation, points = observations[0], PROBE_KINDS[probe.kind].object_points
    if points is None or not observation.has_outline:
        pixels = np.array([each.pixels for each in observations], dtype=np.float64)
        return Request(probe=probe, pixels=pixels, std_px=observation.std_px or probe.std_px)
    std_px = observation.std_px or probe.std_px or EDGE_STD_PX
    if points.contour:
        corners = simplify_outline(np.array(observation.contour))
        return Request(probe=probe, pixels=_pairs(corners), std_px=std_px)
    zoomed_setup, sample = zoomed(setup, poses[0])
    silhouette = locate_observation(observation, zoomed_setup.camera, sample.pose, std_px)
    pixels_px, std_px = points.pixels_and_std(silhouette)
    return Request(probe=probe, pixels=_pairs(pixels_px), std_px=std_px)


def locate_observation(observation: Observation, camera: Camera, pose: Pose | None, edge_std_px: float) -> Silhouette:
    """Locate the upright object of an observation from its box or contour."""
    if observation.box is not None:
        left, top, right, bottom = observation.box
        down = down_in_image(camera, pose, np.array([[left, top], [right, bottom]]))
        return locate_box(observation.box, down, edge_std_px)
    return locate_outline(camera, pose, np.array(observation.contour), edge_std_px)


def _pairs(points_px: FloatArray) -> Pixels:
    return tuple((u, v) for u, v in points_px.tolist())
