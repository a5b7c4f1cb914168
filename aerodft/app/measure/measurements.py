"""Measuring pixels of one image: what is asked for, and the measurements and ground points that answer it."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, TypeAlias, overload

import numpy as np
import numpy.typing as npt

from aerodft import model
from aerodft.adapters.wire.measurement import measurement_payload
from aerodft.app.measure.scene import (
    CameraPose,
    GroundTerms,
    MeasuredSurface,
    image_setup,
    in_range,
    projection_model,
    refuse_other,
)
from aerodft.conventions import LARGEST
from aerodft.dft import PROBE_KINDS, End, Request, Share, advice, at_own_heights, ground_frame_pose, link_requests
from aerodft.dft import measure as measure_batch
from aerodft.dft.maps import GroundMap, ground_covariances
from aerodft.errors import NoAnswerError, UsageError, counted
from aerodft.geometry import distorted_with_jacobian, matrix, pixels_from_rays
from aerodft.model import (
    Camera,
    FloatArray,
    KnownPoint,
    Measurement,
    Pose,
    PoseBatch,
    PoseSample,
    ProbeKind,
    ProjectionModel,
)

Pixels: TypeAlias = Sequence[float] | Sequence[tuple[float, float]] | FloatArray
"""One pixel ``(u, v)``, or several; (0, 0) is the middle of the top-left pixel."""

Ends: TypeAlias = Pixels | Sequence[End] | KnownPoint
"""Pixels, or surveyed points as ``known_points`` gives them, whose pixels and heights are known."""


Elevations: TypeAlias = float | Sequence[float] | FloatArray
"""A height of all points in metres, or one for each of them."""


_PAIRS: Final = "pixels (u, v) of finite numbers"


def _pixels(told: npt.ArrayLike, what: str) -> FloatArray:
    """Pixels ``(..., 2)``; ``what`` has them.

    Raises:
        UsageError: They are no pairs of numbers.
    """
    with suppress(TypeError, ValueError):
        pixels = np.ascontiguousarray(told, dtype=np.float64)
        if pixels.shape[-1:] == (2,) or not pixels.size:
            return pixels if pixels.size else np.empty((0, 2))
    raise UsageError(what, got=repr(told)[:80], expected=_PAIRS)


def _ends(told: Ends, what: str) -> list[End]:
    """The ends of a probe, each a pixel or a surveyed point; ``what`` has them.

    Raises:
        UsageError: One is neither.
    """
    if isinstance(told, KnownPoint):
        return [told]
    if isinstance(told, list | tuple) and any(isinstance(each, KnownPoint) for each in told):
        return [end for each in told for end in _ends(each, what)]
    pixels = _pixels(told, what)  # type: ignore[arg-type]  # no surveyed points
    return [(u, v) for u, v in pixels.reshape(-1, 2).tolist()]


def _elevations(name: str, stated: Elevations, low: float, expected: str) -> float | tuple[float, ...]:
    """An elevation or standard deviation as a number, or a tuple of numbers.

    Raises:
        InputError: One of them is out of range.
        UsageError: It is neither a number nor a sequence of them.
    """
    with suppress(TypeError, ValueError):
        values = np.asarray(stated, dtype=np.float64)
        if values.ndim <= 1:
            for each in np.atleast_1d(values).tolist():
                in_range(name, each, low, LARGEST, expected)
            return tuple(values.tolist()) if values.ndim else float(values)
    raise UsageError(f"`{name}`", got=repr(stated)[:80], expected="a number of metres, or one for each point")


@dataclass(frozen=True, slots=True)
class ImageProbe:
    """A quantity to measure at some pixels of one image.

    Attributes:
        pixels: One ``(u, v)`` or several; (0, 0) is the middle of the top-left pixel, u to the right, v down. In place
            of any may stand a surveyed point (see ``known_points``), which brings its pixel and its height.
        elevation_m: Height of the measured surface above the ground; or one for each point, where these lie at
            different heights (of a river also two: left banks, right banks). Beside surveyed points: of the others.
        name: What the measurement is called; None for the kind and its place among the probes, ``width-1``.
        std_px: Standard deviation of each pixel coordinate.
        elevation_std_m: Standard deviation of the elevation, whose error all points share. Of several elevations each
            has an error of its own: one standard deviation for all of them, or one for each.
        on_top_of: Name of a ``Height`` of the same image: the pixels lie in the level plane through that object's top,
            and ``elevation_m`` does not count.

    Raises:
        UsageError: A pixel is no pair of finite numbers, or there are too few or too many of the kind.
        InputError: A standard deviation is below 0, or an elevation is no finite number.
    """

    kind: ClassVar[ProbeKind]

    pixels: Ends
    elevation_m: Elevations = 0.0
    name: str | None = None
    std_px: float = 1.0
    elevation_std_m: Elevations = 0.0
    on_top_of: str | None = None
    has_surveyed_ends: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        ends = _ends(self.pixels, f"a {self.kind}")
        in_range("std_px", self.std_px, 0.0, LARGEST, "a standard deviation of at least 0")
        elevation_m = _elevations("elevation_m", self.elevation_m, -LARGEST, "m above the ground, finite")
        stds_m = _elevations("elevation_std_m", self.elevation_std_m, 0.0, "a standard deviation of at least 0")
        pairs, elevation_m, stds_m = at_own_heights(self.kind, ends, elevation_m, stds_m)
        if not np.all(np.abs(pairs) <= LARGEST):
            raise UsageError(f"a {self.kind}", got=repr(self.pixels), expected=_PAIRS)
        kind = PROBE_KINDS[self.kind]
        if not kind.takes_pixels(len(pairs)):
            wanted = f"{kind.pixels_wanted} for {self.kind}"
            raise UsageError(f"a {self.kind}", got=counted(len(pairs), "pixel"), expected=wanted)
        if wrong := kind.wrong_elevations(elevation_m, stds_m, len(pairs)):
            wanted = f"{kind.elevations_wanted(len(pairs))} of {self.kind}"
            raise UsageError(f"the elevations of a {self.kind}", got=wrong, expected=wanted)
        if self.on_top_of and (isinstance(elevation_m, tuple) or isinstance(stds_m, tuple)):
            raise UsageError(
                f"the elevations of a {self.kind}", got="them beside `on_top_of`", expected="one of the two"
            )
        is_surveyed = any(isinstance(end, KnownPoint) for end in ends)
        checked = {"pixels": pairs, "elevation_m": elevation_m, "elevation_std_m": stds_m}
        for name, value in {**checked, "has_surveyed_ends": is_surveyed}.items():
            object.__setattr__(self, name, value)


class Position(ImageProbe):
    """Ground point of a pixel; a 95 % ellipse instead of one value.

    Examples:
        >>> Position((1944, 1800), name="ford").pixels
        ((1944.0, 1800.0),)
    """

    kind = ProbeKind.POSITION


class Range(ImageProbe):
    """Slant range from the camera to a pixel's ground point, m.

    Examples:
        >>> Range((1944, 493)).kind
        'range'
    """

    kind = ProbeKind.RANGE


class Distance(ImageProbe):
    """Horizontal distance of two ground points, m.

    Examples:
        >>> Distance([(812, 604.5), (1377, 611)], elevation_m=0.5).elevation_m
        0.5
        >>> Distance([(812, 604.5), (1377, 611)], elevation_m=(0.03, 0.48), elevation_std_m=0.02).elevation_m
        (0.03, 0.48)
        >>> pier = KnownPoint(pixel=(812, 604.5), elevation_m=2.31)
        >>> Distance([pier, (1377, 611)], elevation_m=0.48).elevation_m
        (2.31, 0.48)
    """

    kind = ProbeKind.DISTANCE


class Width(ImageProbe):
    """Horizontal distance of two banks, or of two other edges, m.

    Examples:
        >>> len(Width([(812, 1604), (1377, 1611)]).pixels)
        2
    """

    kind = ProbeKind.WIDTH


class Length(ImageProbe):
    """Horizontal length of the line through 2 to 256 ground points, m; what noise adds is taken off.

    Examples:
        >>> len(Length([(812, 1604), (1100, 1700), (1377, 1611)]).pixels)
        3
    """

    kind = ProbeKind.LENGTH


class Area(ImageProbe):
    """Horizontal area of the polygon of 3 to 256 ground points in their order, m^2.

    Examples:
        >>> len(Area([(1000, 1000), (2000, 1000), (1900, 2000)]).pixels)
        3
    """

    kind = ProbeKind.AREA


class Height(ImageProbe):
    """Height of an upright object, m: the pixel of its base, on the ground, then that of its top.

    Examples:
        >>> mast = Height([(1500, 1500), (1500, 1000)], name="mast")
        >>> Width([(1480, 1000), (1520, 1000)], on_top_of="mast").on_top_of
        'mast'
    """

    kind = ProbeKind.HEIGHT


class Bearing(ImageProbe):
    """Azimuth of a pixel's ray, or from the first to the second ground point, deg clockwise from true north.

    Examples:
        >>> Bearing((1944, 20)).kind
        'bearing'
    """

    kind = ProbeKind.BEARING


class RiverWidth(ImageProbe):
    """Median of the widths between pairs of bank pixels, left then right, m.

    Examples:
        >>> len(RiverWidth([(500, 2000), (1000, 2100), (600, 1800), (1100, 1900)]).pixels)
        4
    """

    kind = ProbeKind.RIVER


def probe(
    kind: str,
    pixels: Ends,
    *,
    elevation_m: Elevations = 0.0,
    name: str | None = None,
    std_px: float = 1.0,
    elevation_std_m: Elevations = 0.0,
    on_top_of: str | None = None,
) -> ImageProbe:
    """A probe of a kind by its name, of any kind in the registry ``dft.PROBE_KINDS``.

    Args:
        kind: Name of the kind, as in station files: ``position``, ``range``, ``distance``, ``width``, ...
        pixels: One ``(u, v)`` or several; (0, 0) is the middle of the top-left pixel, u to the right, v down.
        elevation_m: Height of the measured surface above the ground, or one for each point.
        name: What the measurement is called; None for the kind and its place among the probes.
        std_px: Standard deviation of each pixel coordinate.
        elevation_std_m: Standard deviation of the elevation, or one for each point.
        on_top_of: Name of a ``Height`` of the same image that the pixels lie on top of.

    Raises:
        UsageError: No such kind, a pixel that is no pair of finite numbers, or a wrong number of pixels.
        InputError: A standard deviation is below 0.

    Example:
        >>> import aerodft as ad
        >>> ad.probe("distance", [(812, 604.5), (1377, 611)], name="ford").kind
        'distance'
    """
    if ProbeKind(kind) not in PROBE_KINDS:
        raise UsageError("a probe's kind", got=repr(kind), expected=f"one of {', '.join(PROBE_KINDS)}")
    probe_class = _probe_class(ProbeKind(kind))
    return probe_class(pixels, elevation_m, name, std_px, elevation_std_m, on_top_of)


def probe_classes() -> dict[str, type[ImageProbe]]:
    """The class of each kind in the registry by its name: ``mean-range`` is ``MeanRange``."""
    return {found.__name__: found for found in map(_probe_class, PROBE_KINDS)}


@cache
def _probe_class(kind: ProbeKind) -> type[ImageProbe]:
    """The class of a kind: the one above, which documents it, or a new one."""
    own = next((each for each in ImageProbe.__subclasses__() if each.kind == kind), None)
    return own or type("".join(part.title() for part in kind.split("-")), (ImageProbe,), {"kind": kind})


def _plain(checked: Elevations) -> float | tuple[float, ...]:
    """What ``ImageProbe`` holds once it is checked, for the type checker."""
    return checked if isinstance(checked, float | tuple) else tuple(checked)


def requests_of(probes: Iterable[ImageProbe]) -> tuple[Request, ...]:
    """The engine's requests of the probes of one image, in their order.

    Raises:
        UsageError: Two probes have one name, or ``on_top_of`` names no height that stands on the ground.
    """
    named: dict[str, model.Probe] = {}
    for index, probe in enumerate(probes):
        name = probe.name or f"{probe.kind}-{index + 1}"
        if name in named:
            raise UsageError(f"probe {index + 1}", got=f"the name {name} again", expected="its own name")
        named[name] = model.Probe(
            name=name,
            kind=probe.kind,
            pixels=tuple((u, v) for u, v in np.asarray(probe.pixels).tolist()),
            std_px=probe.std_px,
            elevation_m=0.0 if probe.on_top_of else _plain(probe.elevation_m),
            elevation_std_m=_plain(probe.elevation_std_m),
            on_top_of=probe.on_top_of,
        )
    try:
        return link_requests(Request(probe=probe, pixels=probe.pixels, std_px=probe.std_px) for probe in named.values())
    except ValueError as error:
        raise UsageError("`on_top_of`", got=error) from None


@overload
def measure(
    camera: Camera | None,
    pose: CameraPose | PoseSample | None,
    probes: ImageProbe,
    *,
    model: ProjectionModel | str | None = None,
    ground: GroundTerms = None,
    max_range_m: float | None = None,
    calibration: str | Path | None = None,
) -> Measurement: ...


@overload
def measure(
    camera: Camera | None,
    pose: CameraPose | PoseSample | None,
    probes: Sequence[ImageProbe],
    *,
    model: ProjectionModel | str | None = None,
    ground: GroundTerms = None,
    max_range_m: float | None = None,
    calibration: str | Path | None = None,
) -> list[Measurement]: ...


def measure(
    camera: Camera | None,
    pose: CameraPose | PoseSample | None,
    probes: ImageProbe | Sequence[ImageProbe],
    *,
    model: ProjectionModel | str | None = None,
    ground: GroundTerms = None,
    max_range_m: float | None = None,
    calibration: str | Path | None = None,
) -> Measurement | list[Measurement]:
    """Measure pixels of one image.

    Args:
        camera: The camera, see ``load_camera``; None for that of the calibration.
        pose: Where it was and where it looked; None for the pose of the calibration.
        probes: What to measure: one probe, or several in the same image.
        model: ``"pinhole"`` or the paper's ``"dft"``; None for the calibration's, else the pinhole.
        ground: ``Slope`` or ``ElevationModel``; None for level ground.
        max_range_m: Maximum range in metres; None for no limit.
        calibration: A calibration file: with pose and lens, in place of both; or with what telemetry is off by, which
            is taken from the pose.

    Returns:
        A measurement for one probe, a list for several. Where ``status`` is not ``ok``, ``reasons`` says why, and
        ``value``, ``std`` and ``ci95`` are None. ``value`` and its standard deviation ``std`` are in ``unit``.

    Raises:
        AerodftError: Something is impossible, does not go together, or cannot be read.

    Examples:
        >>> import aerodft as ad
        >>> camera = ad.load_camera("configs/cameras/canon-1000d.toml")
        >>> pose = ad.CameraPose(height_m=10.48, tilt_deg=67, std=ad.PoseStd(height_m=0.1, tilt_deg=0.2))
        >>> width = ad.measure(camera, pose, ad.Width([(812, 1604), (1377, 1611)]))
        >>> f"{width.value:.2f} +- {width.std:.2f} {width.unit}, {width.status}"
        '3.99 +- 0.05 m, ok'
    """
    chosen = None if model is None else projection_model(model)
    surface = MeasuredSurface(max_range_m=max_range_m)
    setup, sample = image_setup(camera, pose, ground=ground, model=chosen, calibration=calibration, surface=surface)
    wanted = (probes,) if isinstance(probes, ImageProbe) else tuple(probes)
    for probe in wanted:
        refuse_other("probes", probe, ImageProbe, "probes, e.g. Width([(812, 1604), (1377, 1611)])")
        if setup.ground is not None and probe.has_surveyed_ends:
            expected = "pixels with `elevation_m` above that ground"
            raise UsageError(f"a {probe.kind} of surveyed points", got="ground that is not level", expected=expected)
    found = measure_batch(setup, PoseBatch.from_samples([sample]), requests_of(wanted))[0]
    return found[0] if isinstance(probes, ImageProbe) else found


@overload
def ground_points(
    camera: Camera,
    pose: CameraPose | PoseSample | Pose,
    pixels: npt.ArrayLike,
    *,
    elevation_m: float = 0.0,
    covariance: Literal[False] = False,
) -> FloatArray: ...


@overload
def ground_points(
    camera: Camera,
    pose: CameraPose | PoseSample | Pose,
    pixels: npt.ArrayLike,
    *,
    elevation_m: float = 0.0,
    covariance: Literal[True],
    elevation_std_m: float = 0.0,
    std_px: float = 1.0,
) -> tuple[FloatArray, FloatArray]: ...


def ground_points(
    camera: Camera,
    pose: CameraPose | PoseSample | Pose,
    pixels: npt.ArrayLike,
    *,
    elevation_m: float = 0.0,
    covariance: bool = False,
    elevation_std_m: float = 0.0,
    std_px: float = 1.0,
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Ground points that pixels show, of level ground; pinhole model.

    Args:
        camera: The camera.
        pose: Where it was and where it looked.
        pixels: ``(..., 2)`` px, in the image or beside it; (0, 0) is the middle of the top-left pixel.
        elevation_m: Height of the measured surface above the ground.
        covariance: Whether covariances are wanted as well.
        elevation_std_m: Standard deviation of the elevation.
        std_px: Standard deviation of each pixel coordinate.

    Returns:
        ``(..., 3)`` in the ground frame, m: X to the right and Y ahead of the camera, Z up, from the point of the
        ground below it; NaN at and above the horizon, and beyond the valid part of the lens. With ``covariance`` also
        ``(..., 3, 3)`` m^2, by first order: each point's from the errors of pose, intrinsics and elevation and from its
        pixel's. All points share the former, so that distances between near points are known better than these
        covariances say (see ``measure``); the pixels' are independent.

    Raises:
        AerodftError: The pose is impossible, or there is none; or ``pixels`` are no pairs.

    Examples:
        >>> import aerodft as ad
        >>> camera = ad.load_camera("configs/cameras/canon-1000d.toml")
        >>> pose = ad.CameraPose(height_m=10.48, tilt_deg=67)
        >>> ad.ground_points(camera, pose, [(1000, 493), (1944, 1296)]).round(1)
        array([[-20.9,  70. ,   0. ],
               [  0. ,  24.7,   0. ]])
        >>> points, covariances = ad.ground_points(camera, pose, [(1944, 1296)], covariance=True)
        >>> covariances.shape
        (1, 3, 3)
    """
    ground, own = _ground_map(camera, pose, float(elevation_m))
    pixels_px = _pixels(pixels, "`pixels`")
    points = ground.points_enu_m(pixels_px)
    if not covariance:
        return points
    in_range("std_px", std_px, 0.0, LARGEST, "a standard deviation of at least 0")
    in_range("elevation_std_m", elevation_std_m, 0.0, LARGEST, "a standard deviation of at least 0")
    found = ground_covariances(camera, own, pixels_px, elevation_m, elevation_std_m, std_px)
    found[np.isnan(points[..., 0])] = np.nan
    return points, found


@overload
def project(
    camera: Camera, pose: CameraPose | PoseSample | Pose, points_m: npt.ArrayLike, *, jacobian: Literal[False] = False
) -> FloatArray: ...


@overload
def project(
    camera: Camera, pose: CameraPose | PoseSample | Pose, points_m: npt.ArrayLike, *, jacobian: Literal[True]
) -> tuple[FloatArray, FloatArray]: ...


def project(
    camera: Camera, pose: CameraPose | PoseSample | Pose, points_m: npt.ArrayLike, *, jacobian: bool = False
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Pixels at which points are seen: what ``ground_points`` does, the other way round; pinhole model.

    Args:
        camera: The camera.
        pose: Where it was and where it looked.
        points_m: ``(..., 3)`` in the ground frame: X to the right and Y ahead of the camera, Z up, from the point of
            the ground below it.
        jacobian: Whether derivatives are wanted as well.

    Returns:
        ``(..., 2)`` px, in the image or beside it; NaN for points behind the camera and beyond the valid part of the
        lens. With ``jacobian`` also ``(..., 2, 3)`` px/m, by the points.

    Raises:
        AerodftError: The pose is impossible, or there is none; or ``points_m`` are no triples.

    Examples:
        >>> import aerodft as ad
        >>> camera = ad.load_camera("configs/cameras/canon-1000d.toml")
        >>> pose = ad.CameraPose(height_m=10.48, tilt_deg=67)
        >>> ad.project(camera, pose, ad.ground_points(camera, pose, [(1000, 493), (1944, 1296)])).round(6)
        array([[1000.,  493.],
               [1944., 1296.]])
    """
    own, points = ground_frame_pose(_pose_of(camera, pose)), _points(points_m)
    axes = matrix(own.wxyz)
    rays = (points - own.position_enu_m) @ axes
    pixels = pixels_from_rays(camera, rays)
    if not jacobian:
        return pixels
    _, by_ray = distorted_with_jacobian(camera, rays)
    return pixels, np.array([[camera.fx_px], [camera.fy_px]]) * (by_ray @ axes.T)


def _points(told: npt.ArrayLike) -> FloatArray:
    """Points ``(..., 3)``.

    Raises:
        UsageError: They are no triples of numbers.
    """
    with suppress(TypeError, ValueError):
        points = np.asarray(told, dtype=np.float64)
        if points.shape[-1:] == (3,):
            return points
    raise UsageError("`points_m`", got=repr(told)[:80], expected="points (x, y, z) in metres")


def _pose_of(camera: Camera, pose: CameraPose | PoseSample | Pose) -> Pose:
    """The pose that an argument has.

    Raises:
        UsageError: It is none, or ``camera`` is no camera.
        NoAnswerError: There is no pose in the sample.
    """
    refuse_other("camera", camera, Camera, "a camera, as `load_camera` reads it from a file")
    refuse_other(
        "pose", pose, (CameraPose, PoseSample, Pose), "a CameraPose, e.g. CameraPose(height_m=40, tilt_deg=30)"
    )
    known = pose.pose() if isinstance(pose, CameraPose) else pose.pose if isinstance(pose, PoseSample) else pose
    if known is None:
        raise NoAnswerError("no pose", got="a pose sample without one")
    return known


def _ground_map(camera: Camera, pose: CameraPose | PoseSample | Pose, elevation_m: float) -> tuple[GroundMap, Pose]:
    """Pixels to the ground frame of a pose, and the pose there."""
    own = ground_frame_pose(_pose_of(camera, pose))
    return GroundMap.at(camera, own, elevation_m), own


def measured_document(measurement: Measurement, budget: Sequence[Share] | None) -> dict[str, Any]:
    """A measurement as ``aerodft.measurement/1``, as ``aerodft measure --json`` prints it.

    Args:
        measurement: The measurement.
        budget: Where its variance comes from, which it then says together with what to improve; None to say neither.
    """
    document = measurement_payload(measurement)
    if budget is not None:
        document["budget"] = [{"source": part.source, "std": part.std, "share": part.share} for part in budget]
        document["advice"] = advice(tuple(budget))
    return document
