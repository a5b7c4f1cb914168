"""Requests from observations: observed pixels, or points of the object in an observed box or contour."""

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
    Silhouette,
    down_in_image,
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
    ProbeKind,
    Status,
)

_OUTLINE_KINDS: Final = (ProbeKind.POSITION, ProbeKind.RANGE, ProbeKind.BEARING, ProbeKind.HEIGHT, ProbeKind.WIDTH)

_REASONS: Final = {
    Status.LOST: "it is out of the image, or was not recognised in it",
    Status.NOT_SEEN: "it was looked for in the image, and not seen",
}

Pixels = tuple[tuple[float, float], ...]


def can_answer(probe: Probe, observation: Observation) -> bool:
    """Whether an observation has the pixels or the outline that a probe needs, or is empty."""
    kind = probe.kind
    if observation.is_empty:
        return True
    if not observation.has_outline:
        return PROBE_KINDS[kind].takes_pixels(len(observation.pixels))
    return kind in _OUTLINE_KINDS or (kind == ProbeKind.AREA and bool(observation.contour))


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
    observation = observations[0]
    if not observation.has_outline:
        pixels = np.array([each.pixels for each in observations], dtype=np.float64)
        return Request(probe=probe, pixels=pixels, std_px=observation.std_px or probe.std_px)
    std_px = observation.std_px or probe.std_px or EDGE_STD_PX
    if probe.kind == ProbeKind.AREA:
        corners = simplify_outline(np.array(observation.contour))
        return Request(probe=probe, pixels=_pairs(corners), std_px=std_px)
    zoomed_setup, sample = zoomed(setup, poses[0])
    silhouette = locate_observation(observation, zoomed_setup.camera, sample.pose, std_px)
    points, std_px = _PIXELS_OF[probe.kind].pixels_and_std(silhouette)
    return Request(probe=probe, pixels=points, std_px=std_px)


def locate_observation(observation: Observation, camera: Camera, pose: Pose | None, edge_std_px: float) -> Silhouette:
    """Locate the upright object of an observation from its box or contour."""
    if observation.box is not None:
        left, top, right, bottom = observation.box
        down = down_in_image(camera, pose, np.array([[left, top], [right, bottom]]))
        return locate_box(observation.box, down, edge_std_px)
    return locate_outline(camera, pose, np.array(observation.contour), edge_std_px)


@dataclass(frozen=True, slots=True)
class _ObjectPoints:
    """Points of an object that a kind of probe uses, and the pixel errors that matter to it."""

    foot: bool = False
    top: bool = False
    sides: bool = False
    errs_in_depth: bool = False
    errs_sideways: bool = False

    def pixels_and_std(self, seen: Silhouette) -> tuple[Pixels, float]:
        points = [seen.foot_px] * self.foot + [seen.top_px] * self.top + list(seen.sides_px) * self.sides
        stds = [seen.edge_std_px] * self.errs_in_depth + [seen.lateral_std_px] * self.errs_sideways
        return _pairs(np.array(points)), max(stds)


# To first order only pixel errors along the vertical change ranges and heights, and only errors across it bearings.
_PIXELS_OF: Final = {
    ProbeKind.POSITION: _ObjectPoints(foot=True, errs_in_depth=True, errs_sideways=True),
    ProbeKind.RANGE: _ObjectPoints(foot=True, errs_in_depth=True),
    ProbeKind.BEARING: _ObjectPoints(foot=True, errs_sideways=True),
    ProbeKind.HEIGHT: _ObjectPoints(foot=True, top=True, errs_in_depth=True),
    ProbeKind.WIDTH: _ObjectPoints(sides=True, errs_in_depth=True),
}


def _pairs(points_px: FloatArray) -> Pixels:
    return tuple((u, v) for u, v in points_px.tolist())
