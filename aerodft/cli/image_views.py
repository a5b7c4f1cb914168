"""Images of a file of evidence as a calibration takes them: each with its poses by telemetry, in the file's frame."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerodft.adapters.config.crs import LOCAL
from aerodft.adapters.config.evidence import EvidenceFile
from aerodft.adapters.config.evidence_frame import LocalFrame
from aerodft.adapters.config.evidence_images import Flight, GivenImage, StatedPose
from aerodft.cli.image_poses import open_telemetry, poses_of, unbroken
from aerodft.errors import ConfigError, InputError, UsageError
from aerodft.geometry.rotation import camera_attitude, from_rotation_vector, matrix, multiply
from aerodft.model.arrays import FloatArray
from aerodft.model.evidence import Landmark, Prior
from aerodft.model.pose import HeightSource, PoseSample, PoseStd
from aerodft.service.settings import TelemetrySettings
from calibration.images_state import Moment, PoseTrack, View, shared_and_new

_REACH_S, _LEAST_STEP_S, _STEPS, _STDS = 2.0, 0.05, 40, 4.0


@dataclass(frozen=True, slots=True, eq=False)
class _Said:
    """What telemetry says of an image."""

    track: PoseTrack
    std: PoseStd
    height_source: HeightSource | None = None


def views_of(
    found: EvidenceFile, telemetry: Path | None, *, is_time_asked: bool
) -> tuple[tuple[View, ...], dict[str, Prior]]:
    """The images, and what is known beforehand of biases, lens and ground.

    Args:
        found: A file of evidence with images.
        telemetry: Log or recording to take the place of the file's.
        is_time_asked: The time offset is unknown: poses are needed around the stamps.

    Raises:
        AerodftError: An image has no pose, or the telemetry cannot be used.
    """
    flight = found.flight
    if flight is None:
        raise ValueError("a file of one image")
    reach_s = _reach_s(flight) if is_time_asked or flight.time is not None else 0.0
    said = _stated(found, flight, reach_s) | _looked_up(found, flight, telemetry, reach_s)
    _check_heights(said, found.path)
    stds = [said[image.name].std for image in flight.images]
    priors, noises = shared_and_new(stds, flight.noise_share, flight.noise)
    if flight.time is not None:
        priors["time"] = flight.time
    views = tuple(
        View(image.name, image.evidence, said[image.name].track, noise)
        for image, noise in zip(flight.images, noises, strict=True)
    )
    return views, priors | found.known.priors


def _reach_s(flight: Flight) -> float:
    if flight.time is None or not flight.time.std:
        return _REACH_S + (0.0 if flight.time is None else abs(flight.time.value))
    return abs(flight.time.value) + _STDS * flight.time.std


def _needs_place(image: GivenImage) -> bool:
    return any(isinstance(each, Landmark) for each in image.evidence)


def _stated(found: EvidenceFile, flight: Flight, reach_s: float) -> dict[str, _Said]:
    said = {}
    for image in flight.images:
        if image.pose is None:
            continue
        for name, key in (("heading", "heading_deg"), ("east", "position_m, or lat_deg and lon_deg")):
            if name not in image.pose.known and _needs_place(image):
                expected = f"{key} by telemetry: landmarks are seen in it"
                raise ConfigError(f'image "{image.name}"', where=found.path, got=f"no {key}", expected=expected)
        said[image.name] = _as_stated(image.pose, flight.settings, reach_s)
    return said


def _as_stated(pose: StatedPose, settings: TelemetrySettings, reach_s: float) -> _Said:
    usual = settings.attitude.std

    def value(name: str) -> float:
        return pose.known.get(name, (0.0, None))[0]

    def std(name: str, otherwise: float) -> float:
        stated = pose.known.get(name, (0.0, None))[1]
        return otherwise if stated is None else stated

    moment = Moment(
        np.array([value("east"), value("north"), value("height")]),
        camera_attitude(value("tilt"), value("roll"), value("heading")),
        np.array(pose.velocity_mps),
        np.array(pose.rate_cam_radps),
    )
    return _Said(
        PoseTrack.steady(moment, reach_s),
        PoseStd(
            height_agl_m=std("height", settings.height.std_m[HeightSource.HOME]),
            horizontal_m=math.hypot(std("east", usual.horizontal_m), std("north", usual.horizontal_m)) / math.sqrt(2),
            tilt_rad=std("tilt", usual.tilt_rad),
            pan_rad=usual.pan_rad,
            roll_rad=std("roll", usual.roll_rad),
            heading_rad=std("heading", usual.heading_rad),
        ),
    )


def _looked_up(found: EvidenceFile, flight: Flight, telemetry: Path | None, reach_s: float) -> dict[str, _Said]:
    images = [image for image in flight.images if image.pose is None]
    path = telemetry or flight.log
    if not images:
        if telemetry is not None:
            raise UsageError("--telemetry", got="images with poses in the file", expected="utc or index in [[image]]")
        return {}
    if path is None:
        expected = 'telemetry = "flight.tlog" at its top, or --telemetry'
        raise ConfigError(f'image "{images[0].name}"', where=found.path, got="no pose", expected=expected)
    origin = flight.origin or found.frame.geo_origin
    opened = open_telemetry(path, flight.settings, origin, says_settings=flight.says_settings)
    if opened.origin is None and any(map(_needs_place, images)):
        expected = f'{{ lat_deg, lon_deg }} of the zero of crs = "{LOCAL}"'
        raise ConfigError("telemetry.origin", where=found.path, got="nothing", expected=expected)
    step_s = max(_LEAST_STEP_S, reach_s / _STEPS)
    count = round(reach_s / step_s)
    offsets_s: FloatArray = np.asarray(np.arange(-count, count + 1) * step_s)
    poses = poses_of(opened, images, offsets_s.tolist())
    return {
        image.name: _as_reported(image, samples, offsets_s, found.frame, path)
        for image, samples in zip(images, poses, strict=True)
    }


def _as_reported(
    image: GivenImage, samples: tuple[PoseSample, ...], offsets_s: FloatArray, frame: LocalFrame, path: Path
) -> _Said:
    middle = samples[len(samples) // 2]
    if middle.pose is None or middle.reasons:
        got = "; ".join((str(middle.status), *middle.reasons))
        hint = "see `aerodft doctor`, and height and attitude in [telemetry]"
        raise InputError(f'image "{image.name}" has no pose', where=path, got=got, hint=hint)
    if middle.lat_rad is None and _needs_place(image):
        expected = "a position: landmarks are seen in it"
        raise InputError(f'image "{image.name}"', where=path, got="no position in the telemetry", expected=expected)
    chosen = unbroken(samples, offsets_s.tolist())
    poses = [pose for pose in (samples[index].pose for index in chosen) if pose is not None]
    turn = from_rotation_vector(np.array([0.0, 0.0, frame.true_heading_rad(0.0) or 0.0]))
    positions = np.array([pose.position_enu_m for pose in poses]) @ matrix(turn).T
    track = PoseTrack(offsets_s[chosen], positions, multiply(turn, np.array([pose.wxyz for pose in poses])))
    return _Said(track, middle.std, middle.height_source)


def _check_heights(said: dict[str, _Said], path: Path) -> None:
    """Refuse heights of two sources, which have two biases."""
    first: dict[HeightSource, str] = {}
    for name, each in said.items():
        if each.height_source is not None:
            first.setdefault(each.height_source, name)
    if len(first) > 1:
        (one, where), (other, there) = list(first.items())[:2]
        got = f"heights by {one} ({where}) and by {other} ({there})"
        hint = 'name one in [telemetry], like height = { order = ["home"] }'
        raise ConfigError("telemetry.height", where=path, got=got, expected="one source, which has one bias", hint=hint)
