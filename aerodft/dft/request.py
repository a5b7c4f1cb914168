"""What is asked of the engine: the station's circumstances, and one probe with its pixels."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Optional

import numpy as np

from aerodft.geometry import Ground
from aerodft.model import Camera, FloatArray, IntArray, PoseSample, Probe, ProbeKind, ProjectionModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """What all measurements of a station share.

    Attributes:
        camera: The camera.
        model: Projection model.
        ground: What probes' elevations are counted from; None for the level plane at 0. The dft model knows no other.
        elevation_m: Height of the measured surface above the ground for what is no probe: whole images.
        elevation_std_m: Its standard deviation.
        max_range_m: Farther points are ``BEYOND_RANGE``; None for no limit.
        config_id: Named in every measurement.
    """

    camera: Camera
    model: ProjectionModel = ProjectionModel.PINHOLE
    ground: Ground | None = None
    elevation_m: float = 0.0
    elevation_std_m: float = 0.0
    max_range_m: float | None = None
    config_id: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """One probe with the pixels that it has in this image.

    Attributes:
        probe: The probe.
        pixels: ``(q, 2)`` its pixels; ``(n, q, 2)`` where each of ``n`` images has its own.
        std_px: Of each pixel coordinate.
        on_top_of: A ``height`` in the same image: the probe lies in the level plane through that object's top.
    """

    probe: Probe
    pixels: tuple[tuple[float, float], ...] | FloatArray
    std_px: float
    on_top_of: Optional["Request"] = None

    @property
    def pixels_px(self) -> FloatArray:
        """The pixels as an array."""
        return np.asarray(self.pixels, dtype=np.float64)

    @property
    def count(self) -> int:
        """How many pixels it has in each image."""
        return len(self.pixels) if isinstance(self.pixels, tuple) else self.pixels.shape[-2]

    def rows(self, rows: IntArray) -> "Request":
        """The request in some of its images ``(m,)``, by their indices."""
        below = None if self.on_top_of is None else self.on_top_of.rows(rows)
        if isinstance(self.pixels, np.ndarray) and self.pixels.ndim > 2:  # noqa: PLR2004 - each image has its own
            return replace(self, pixels=self.pixels[rows], on_top_of=below)
        return self if below is self.on_top_of else replace(self, on_top_of=below)

    def pixels_of(self, row: int) -> tuple[tuple[float, float], ...]:
        """Its pixels in one image."""
        if isinstance(self.pixels, tuple):
            return self.pixels
        pixels = self.pixels.reshape(-1, *self.pixels.shape[-2:])
        return tuple((u, v) for u, v in pixels[row if len(pixels) > 1 else 0].tolist())


def zoomed(setup: Setup, sample: PoseSample) -> tuple[Setup, PoseSample]:
    """A setup with the camera as it was at a sample's stamp, and the sample; for what looks at whole images.

    Where pose and lens were calibrated together, the covariance of their errors is in pixels of the file's focal
    lengths: it is turned into pixels of the zoomed ones.
    """
    zoom, pose = sample.zoom, sample.pose
    if zoom is None:
        return setup, sample
    setup = replace(setup, camera=setup.camera.zoomed(zoom.magnification, zoom.std))
    if pose is None or not pose.lens_cov.size:
        return setup, sample
    scales = np.ones(pose.lens_cov.shape[1])
    scales[:2] = zoom.magnification
    return setup, replace(sample, pose=replace(pose, lens_cov=pose.lens_cov * scales))


def link_requests(requests: Iterable[Request], heights: Iterable[Request] = ()) -> tuple[Request, ...]:
    """The requests, each with what its probe says that it lies on top of.

    Args:
        requests: Of one image.
        heights: More of the same image, to lie on top of.

    Raises:
        ValueError: There is no such ``height`` in the image, or it lies on top of something itself.
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
