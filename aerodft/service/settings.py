"""A station's configuration in SI units, as ``adapters.config`` reads it from TOML."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from aerodft.conventions import SECOND_NS
from aerodft.dft import Setup
from aerodft.geometry import Ground
from aerodft.model import (
    Camera,
    GeoOrigin,
    GimbalSource,
    KnownPoint,
    LevelSeries,
    MountAxes,
    PoseSample,
    PoseStd,
    Probe,
    ProjectionModel,
    ReportFrame,
    SurveyedLandmark,
    ZoomSource,
)
from aerodft.service.gimbal_sources import reported_sources
from aerodft.service.height_sources import HeightSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMotionSettings:
    """Settings of the detection of a fixed camera's motion.

    Attributes:
        limit_rad: Rotation above which the camera has moved.
        every_s: Shortest time between two looks.
        confirm_looks: Number of consecutive looks that must agree.
        lever_arm_m: Longest distance from the lens to the joint that it rotates about: a bump moves the lens too.
        ignore: Polygons in the reference image of things that move: water, trees, roads.
        reference: The image taken at the configured pose; None for the first good one.
    """

    limit_rad: float = math.radians(0.2)
    every_s: float = 1.0
    confirm_looks: int = 3
    lever_arm_m: float = 0.2
    ignore: tuple[tuple[tuple[float, float], ...], ...] = ()
    reference: Path | None = None


OBJECTS: Final = "objects"
"""Name of observations of moving objects: an outline each; an empty one where nothing moves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSettings:
    """Settings of detecting moving objects in a fixed camera's images, and of tracking them over the ground.

    Attributes:
        detect: Whether aerodft detects objects; else all outlines come from outside.
        every_s: Shortest time between two looks; 0 for every image.
        shadows: Whether cast shadows are separated from objects.
        min_area_px: Smallest area of a detection.
        ignore: Polygons of pixels without interest: water, trees, a road.
        std_px: Standard deviation of an outline's edge.
        speed_mps: Prior standard deviation of each component of an object's velocity.
        acceleration_mps2: Standard deviation of the change of velocity in a second.
        confirm_looks: Detections that confirm a track.
        track_timeout_s: Time without detection after which a track ends.
        distances_within_m: Distances are measured between objects at most this far apart; 0 for none.
    """

    detect: bool = True
    every_s: float = 0.0
    shadows: bool = True
    min_area_px: int = 60
    ignore: tuple[tuple[tuple[float, float], ...], ...] = ()
    std_px: float = 2.0
    speed_mps: float = 3.0
    acceleration_mps2: float = 0.5
    confirm_looks: int = 3
    track_timeout_s: float = 5.0
    distances_within_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoomSettings:
    """Settings of following a vehicle's reports of its camera's zoom, relative to the camera file.

    Attributes:
        order: Sources in order of preference, the first live one is used; empty: the camera file always applies.
        level: Zoom level, as a fraction of its range, of the camera file.
        curve: Zoom levels from 0 to 1, ascending, with relative focal lengths; empty where unknown.
        reported_hfov_rad: Field of view that is reported at the camera file's zoom; None for the file's own.
        hfov_std_rad: Standard deviation of reported fields of view.
        std_per_doubling: Relative standard deviation of the focal length per doubling from the file's.
        camera: Camera to follow: up to 6 the number of one behind the autopilot, from 7 on a component id; None where
            there is one.
        stream: Number of the camera's video stream to follow; None for the first heard.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthSettings:
    """Limits of the vehicle's health; beyond the first two poses are refused, the others give remarks.

    Attributes:
        heartbeat_ns: Longest silence of the autopilot's HEARTBEAT.
        max_ratio: Largest test ratio of the EKF: innovation over gate, it rejects inputs above 1.
        gps_ns: Longest silence of the receiver.
        horizontal_std_m: Largest standard deviation of the receiver's position.
        vertical_std_m: Largest standard deviation of the receiver's altitude.
        loss_share: Largest fraction of the autopilot's frames that may be lost.
        window_ns: Span over which the fraction is counted.
    """

    heartbeat_ns: int = 5 * SECOND_NS
    max_ratio: float = 1.0
    gps_ns: int = 4 * SECOND_NS
    horizontal_std_m: float = 3.0
    vertical_std_m: float = 5.0
    loss_share: float = 0.1
    window_ns: int = 10 * SECOND_NS


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedMount:
    """A camera's orientation on the body it is fixed to (front, right, down): intrinsic yaw, pitch, roll."""

    yaw_rad: float
    pitch_rad: float
    roll_rad: float


DEMAND_TILT_STD_RAD: Final = math.radians(1)
"""Tilt standard deviation of a gimbal that reports its demanded attitude."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleScale:
    """Factors of the angles that a gimbal source reports: -1 inverts a sign, 100 corrects degrees sent as centidegrees.

    Attributes:
        yaw: Factor of the reported yaw.
        pitch: Factor of the reported pitch.
        roll: Factor of the reported roll.
    """

    yaw: float = 1.0
    pitch: float = 1.0
    roll: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeSettings:
    """Attitude sources in order of preference, and their accuracy.

    Attributes:
        order: The first source with a value at the stamp wins.
        scale: Factors of the angles of gimbal sources that report them with a wrong sign or unit.
        fixed_mount: The camera relative to the vehicle; used where ``fixed`` is in the order.
        camera_on_gimbal: The camera relative to the gimbal's axes; None where these coincide.
        frame: Reference of the gimbals' roll and pitch; None to estimate it from the data.
        axes: Order of a mount's servo axes, where roll and pitch are relative to the vehicle; None to estimate it from
            the data.
        is_demand: Whether gimbals report the demanded attitude, not the actual one; None to estimate it from the data.
        delay_ns: Known delay of the camera behind every report; reports apply from then on.
        lag_ns: Longest further lag of the camera behind a demand.
        slew_radps: Lowest rate at which the camera turns to a new demand.
        std: Standard deviations of tilt, pan, roll, heading and of east and north (heights: ``HeightSettings``).
        max_gap_ns: Longest gap between two samples that is interpolated over.
    """

    order: tuple[GimbalSource, ...] = field(default_factory=reported_sources)
    scale: tuple[tuple[GimbalSource, AngleScale], ...] = ()
    fixed_mount: FixedMount | None = None
    camera_on_gimbal: FixedMount | None = None
    frame: ReportFrame | None = None
    axes: MountAxes | None = None
    is_demand: bool | None = None
    delay_ns: int = 0
    lag_ns: int = 300_000_000
    slew_radps: float = math.radians(60)
    std: PoseStd = field(default_factory=PoseStd)
    max_gap_ns: int = SECOND_NS

    @property
    def lasting_std(self) -> PoseStd:
        """The constant part of ``std``: with the tilt error of demands where reports may be demands."""
        if self.is_demand is False:
            return self.std
        return replace(self.std, tilt_rad=max(self.std.tilt_rad, DEMAND_TILT_STD_RAD))


@dataclass(frozen=True, slots=True, kw_only=True)
class TelemetrySettings:
    """Settings of turning telemetry into poses.

    Attributes:
        system: MAVLink system id to follow; None for the first vehicle heard.
        component: Component id of its autopilot, where it has several; None for the first heard.
        gimbal: Up to 6 the number of a gimbal behind the autopilot, from 7 on a gimbal's component id; None for the
            first heard.
        height: Height sources.
        attitude: Attitude sources.
        health: Limits of the vehicle's health.
        zoom: Reports of the camera's zoom.
        wait_ns: Time that an image waits after its arrival for later telemetry.
        gps_lon_first: Whether a log's places without names have the longitude first; None to tell it by the log.
        columns: Names of a flight table's columns by what they are, unit included; empty for known tools' tables.
    """

    system: int | None = None
    component: int | None = None
    gimbal: int | None = None
    height: HeightSettings = field(default_factory=HeightSettings)
    attitude: AttitudeSettings = field(default_factory=AttitudeSettings)
    health: HealthSettings = field(default_factory=HealthSettings)
    zoom: ZoomSettings = field(default_factory=ZoomSettings)
    wait_ns: int = 2 * SECOND_NS
    gps_lon_first: bool | None = None
    columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorStd:
    """Standard deviations of errors of the telemetry, None for a default; axes as in ``PoseStd``."""

    height_agl_m: float | None = None
    horizontal_m: float | None = None
    tilt_rad: float | None = None
    pan_rad: float | None = None
    roll_rad: float | None = None
    heading_rad: float | None = None


DRIFT = ErrorStd(
    height_agl_m=0.02,
    horizontal_m=0.1,
    tilt_rad=math.radians(0.01),
    pan_rad=math.radians(0.01),
    roll_rad=math.radians(0.01),
    heading_rad=math.radians(0.03),
)
"""Random walks per square root of a second: a barometer drifts by half a metre in ten minutes, GPS by metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveCalibration:
    """Settings of the estimation of telemetry's biases from landmarks while the station measures.

    Most of a stated standard deviation is one error for a whole flight, which is estimated; the rest is independent
    noise from image to image, which stays in every interval.

    Attributes:
        landmarks: Surveyed landmarks.
        noise_share: Standard deviation of the noise as a fraction of each stated standard deviation.
        noise: Standard deviations of the noise, which replace the fraction.
        initial: Prior standard deviations of the biases; None for the stated ones without the noise.
        drift: Random walk of the biases per square root of a second, bounded by ``initial``.
        gate_probability: Probability at which the innovation gate accepts a good observation.
        outlier_fraction: Prior fraction of observations of something else than the landmark.
    """

    landmarks: tuple[SurveyedLandmark, ...]
    noise_share: float = 0.1
    noise: ErrorStd = field(default_factory=ErrorStd)
    initial: ErrorStd = field(default_factory=ErrorStd)
    drift: ErrorStd = DRIFT
    gate_probability: float = 0.999
    outlier_fraction: float = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PipelineSettings:
    """All settings that the pipeline's outputs depend on.

    Attributes:
        station: Name in key expressions.
        camera: The camera.
        probes: Probes to measure in every image.
        model: Projection model.
        ground: Ground below the probes' elevations; None for the level plane at 0.
        level: The water's level, by which the ground is raised; None where it is always 0.
        telemetry: None for a fixed camera.
        fixed_pose: The fixed camera's pose; None where telemetry gives it.
        origin: ENU origin; None for the first good fix.
        max_range_m: Farther points are ``BEYOND_RANGE``; None for no limit.
        time_std_s: Standard deviation of image stamps relative to telemetry stamps.
        match_tolerance_ns: Largest difference between the stamps of an observation and its image.
        tick_ns: The grid of arrival times on which the pipeline advances.
        config_id: ``sha256:...`` of the resolved configuration.
        points: Surveyed points by name; heights above the measured plane.
    """

    station: str
    camera: Camera
    probes: tuple[Probe, ...]
    model: ProjectionModel = ProjectionModel.PINHOLE
    ground: Ground | None = None
    level: LevelSeries | None = None
    telemetry: TelemetrySettings | None = None
    fixed_pose: PoseSample | None = None
    origin: GeoOrigin | None = None
    max_range_m: float | None = None
    time_std_s: float = 0.0
    match_tolerance_ns: int = 20_000_000
    tick_ns: int = 50_000_000
    config_id: str | None = None
    points: Mapping[str, KnownPoint] = field(default_factory=dict, hash=False)

    @property
    def setup(self) -> Setup:
        """The engine's setup, with the camera unzoomed."""
        is_plane_fixed = self.ground is None and self.level is None
        return Setup(
            camera=self.camera,
            model=self.model,
            ground=self.ground,
            max_range_m=self.max_range_m,
            config_id=self.config_id,
            points=self.points if is_plane_fixed else {},
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class WaterHints:
    """Hints by a person on the first image; they are moved to the other images on the water's plane.

    Attributes:
        water_px: Pixels in the water.
        land_px: Pixels on land.
    """

    water_px: tuple[tuple[float, float], ...] = ()
    land_px: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class RiverSettings:
    """Settings of the detection of river banks.

    Attributes:
        every_s: Shortest time between two looks; 0 for every image.
        spacing_m: Spacing of the transects; up to 32 of them, evenly chosen, become one observation.
        seed_px: A pixel in the water of every image; None for the largest water surface.
        hints: Hints on the first image.
        max_range_m: Maximum range of water; None for 6 camera heights.
    """

    every_s: float = 1.0
    spacing_m: float = 1.0
    seed_px: tuple[float, float] | None = None
    hints: WaterHints = WaterHints()
    max_range_m: float | None = None


RADIO_STATUS: Final = "RADIO_STATUS"  # sent by the radio itself, which has no key


@dataclass(frozen=True, slots=True, kw_only=True)
class SigningSettings:
    """MAVLink signing of one link.

    Attributes:
        key_file: File with the key.
        state_file: File with the last signing time stamps; None for ``<key_file>.state``.
        link_id: Link id of sent messages.
        accept_unsigned: Names of messages accepted without a signature.
    """

    key_file: Path
    state_file: Path | None = None
    link_id: int = 0
    accept_unsigned: tuple[str, ...] = (RADIO_STATUS,)
