"""Input of the engine: a station's setup, and requests, each a probe with its pixels."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Optional

import numpy as np

from aerodft.geometry import Ground
from aerodft.model import Camera, FloatArray, IntArray, KnownPoint, PoseSample, Probe, ProbeKind, ProjectionModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """Camera, model, ground and limits, common to all measurements of a station.

    Attributes:
        camera: The camera.
        model: Projection model.
        ground: Ground below the probes' elevations; None for the level plane at 0, the dft model's only one.
        elevation_m: Height of the measured surface above the ground for whole images (probes have their own).
        elevation_std_m: Its standard deviation.
        level_std_m: Standard deviation of the water's level, which elevations count from, at one stamp.
        max_range_m: Farther points are ``BEYOND_RANGE``; None for no limit.
        config_id: Named in every measurement.
        points: Surveyed points by name whose heights count from the measured plane, which is level and stays: none
            over other ground, or over water whose level changes.
    """

    camera: Camera
    model: ProjectionModel = ProjectionModel.PINHOLE
    ground: Ground | None = None
    elevation_m: float = 0.0
    elevation_std_m: float = 0.0
    level_std_m: float = 0.0
    max_range_m: float | None = None
    config_id: str | None = None
    points: Mapping[str, KnownPoint] = field(default_factory=dict, hash=False)

    @property
    def surface_std_m(self) -> float:
        """Standard deviation of the measured surface's height, by its elevation and by the water's level."""
        return math.hypot(self.elevation_std_m, self.level_std_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A probe with its pixels in an image or in each of ``n`` images.

    Attributes:
        probe: The probe.
        pixels: ``(q, 2)``, or ``(n, q, 2)`` where each image has its own.
        std_px: Of each pixel coordinate.
        on_top_of: A ``height`` in the same image: the probe lies in the level plane through that object's top.
    """

    probe: Probe
    pixels: tuple[tuple[float, float], ...] | FloatArray
    std_px: float
    on_top_of: Optional["Request"] = None

    @property
    def pixels_px(self) -> FloatArray:
        """The pixels as an array ``(q, 2)`` or ``(n, q, 2)``."""
        return np.asarray(self.pixels, dtype=np.float64)

    @property
    def count(self) -> int:
        """Number of pixels in each image."""
        return len(self.pixels) if isinstance(self.pixels, tuple) else self.pixels.shape[-2]

    def rows(self, rows: IntArray) -> "Request":
        """The request in images ``(m,)`` by their indices."""
        support = None if self.on_top_of is None else self.on_top_of.rows(rows)
        if isinstance(self.pixels, np.ndarray) and self.pixels.ndim > 2:  # noqa: PLR2004 - each image has its own
            return replace(self, pixels=self.pixels[rows], on_top_of=support)
        return self if support is self.on_top_of else replace(self, on_top_of=support)

    def pixels_of(self, row: int) -> tuple[tuple[float, float], ...]:
        """The pixels in one image."""
        if isinstance(self.pixels, tuple):
            return self.pixels
        pixels = self.pixels.reshape(-1, *self.pixels.shape[-2:])
        return tuple((u, v) for u, v in pixels[row if len(pixels) > 1 else 0].tolist())


def zoomed(setup: Setup, sample: PoseSample) -> tuple[Setup, PoseSample]:
    """Setup and sample with the camera zoomed and the water's level as at the sample's stamp, for whole images.

    The covariance of pose and lens errors, where calibrated together, is scaled from the camera file's focal lengths to
    the zoomed ones.
    """
    zoom, pose, level = sample.zoom, sample.pose, sample.level
    if level is not None and not level.is_height_own:
        setup = replace(setup, level_std_m=level.std_m)
    if zoom is None:
        return setup, sample
    setup = replace(setup, camera=setup.camera.zoomed(zoom.magnification, zoom.std))
    if pose is None or not pose.lens_cov.size:
        return setup, sample
    scales = np.ones(pose.lens_cov.shape[1])
    scales[:2] = zoom.magnification
    return setup, replace(sample, pose=replace(pose, lens_cov=pose.lens_cov * scales))


def link_requests(requests: Iterable[Request], heights: Iterable[Request] = ()) -> tuple[Request, ...]:
    """Requests with ``on_top_of`` set to the ``height`` requests that their probes name.

    Args:
        requests: Requests of one image.
        heights: Further ``height`` requests of that image.

    Raises:
        ValueError: There is no such ``height`` in the image, or it is itself on top of another object.
    """
    requests = tuple(requests)
    heights_by_name = {
        request.probe.name: request
        for request in (*heights, *requests)
        if request.probe.kind == ProbeKind.HEIGHT and request.probe.on_top_of is None
    }
    return tuple(_link(request, heights_by_name) for request in requests)


def _link(request: Request, heights_by_name: dict[str, Request]) -> Request:
    name = request.probe.on_top_of
    if name is None:
        return request
    if name not in heights_by_name:
        got = f"got {', '.join(heights_by_name)}" if heights_by_name else "got none"
        raise ValueError(f"probe {request.probe.name} lies on top of {name}: {got}, expected a height on the ground")
    return replace(request, on_top_of=heights_by_name[name])
