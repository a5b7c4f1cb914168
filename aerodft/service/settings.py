"""What a station is configured to do, in SI units; ``adapters.config`` makes it from TOML."""

import math
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
    HeightSource,
    MountAxes,
    PoseSample,
    PoseStd,
    Probe,
    ProjectionModel,
    ReportFrame,
    SurveyedLandmark,
    ZoomSource,
)
from aerodft.service.height_sources import HEIGHT_SOURCES


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMotionSettings:
    """What is looked for, and what counts as moved.

    Attributes:
        limit_rad: A camera that looks farther than this from where it looked has moved.
        every_s: Least time between two looks.
        confirm_looks: So many looks in a row must agree.
        lever_arm_m: From the lens to the joint that it turns about, at the most: a bump moves the lens along.
        ignore: Polygons of pixels of the reference image that move by themselves: water, trees, roads.
        reference: The image that the camera's pose is the pose of; None for the first good one.
    """

    limit_rad: float = math.radians(0.2)
    every_s: float = 1.0
    confirm_looks: int = 3
    lever_arm_m: float = 0.2
    ignore: tuple[tuple[tuple[float, float], ...], ...] = ()
    reference: Path | None = None


OBJECTS: Final = "objects"
"""Observations of that name are of whatever moves: an outline each, and one without anything where nothing does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSettings:
    """What is looked for in a fixed camera's images, and how it is followed over the ground.

    Attributes:
        detect: Whether aerodft looks itself; else all outlines come from outside.
        every_s: Least time between two looks; 0 for every image.
        shadows: Whether cast shadows are told from what casts them.
        min_area_px: What covers fewer pixels is noise.
        ignore: Polygons of pixels that move by themselves: water, trees, a road that is of no interest.
        std_px: Of where an outline has its edge.
        speed_mps: How fast objects are in each direction, a standard deviation, before the second look.
        acceleration_mps2: How much an object's velocity changes in a second, a standard deviation.
        confirm_looks: Looks that have to see an object before it is one.
        track_timeout_s: An object that is not seen for so long is given up.
        distances_within_m: Distances are measured between objects that are this close; 0 for none.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthSettings:
    """Limits; what is beyond the first two has no answer, the others are remarked on.

    Attributes:
        heartbeat_ns: Longest silence of the autopilot's HEARTBEAT.
        max_ratio: Largest test ratio of the estimator: innovations over their gates, of which it refuses those above 1.
        gps_ns: Longest silence of the receiver.
        horizontal_std_m: Largest standard deviation of the receiver's position.
        vertical_std_m: Largest standard deviation of the receiver's altitude.
        loss_share: Largest share of the autopilot's frames that may be lost.
        window_ns: Over which the share is counted.
    """

    heartbeat_ns: int = 5 * SECOND_NS
    max_ratio: float = 1.0
    gps_ns: int = 4 * SECOND_NS
    horizontal_std_m: float = 3.0
    vertical_std_m: float = 5.0
    loss_share: float = 0.1
    window_ns: int = 10 * SECOND_NS


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightSettings:
    """Which height is believed, and how much.

    Attributes:
        order: The first source with a value at the stamp wins.
        std_m: Standard deviation per source, where no message brings its own (of a rangefinder), or a larger one (GPS).
        home_above_plane_m: Height of the home point above the measured plane; added to home-relative heights.
        manual_m: The height, where ``manual`` is in the order.
        min_m: Below it the status is ``BELOW_MIN_HEIGHT``.
        max_gap_ns: Longest gap between two samples that is interpolated over, of positions and home-relative heights.
        rangefinder_gap_ns: Longest gap of a rangefinder.
        terrain_gap_ns: Longest gap of a terrain database.
        terrain_max_distance_m: From the vehicle to what a terrain report is about, at most.
        lean_std_rad: Standard deviation of the vehicle's roll and pitch, and of the rangefinder on it.
    """

    order: tuple[HeightSource, ...] = tuple(name for name, reader in HEIGHT_SOURCES.items() if reader.is_live)
    std_m: dict[HeightSource, float] = field(
        default_factory=lambda: {name: reader.std_m for name, reader in HEIGHT_SOURCES.items()}
    )
    home_above_plane_m: float = 0.0
    manual_m: float | None = None
    min_m: float = 1.0
    max_gap_ns: int = 2 * SECOND_NS
    rangefinder_gap_ns: int = SECOND_NS
    terrain_gap_ns: int = 5 * SECOND_NS
    terrain_max_distance_m: float = 150.0
    lean_std_rad: float = math.radians(0.2)


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedMount:
    """A camera's angles against what it is bolted to (front, right, down): intrinsic yaw, pitch, roll."""

    yaw_rad: float
    pitch_rad: float
    roll_rad: float


DEMAND_TILT_STD_RAD: Final = math.radians(1)
"""A gimbal that only says what it was told is known no better."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeSettings:
    """Which attitude is believed, and how much.

    Attributes:
        order: The first source with a value at the stamp wins.
        fixed_mount: The camera against the vehicle; used where ``fixed`` is in the order.
        camera_on_gimbal: The camera against the gimbal's axes; None where they are the same.
        frame: What the gimbals' roll and pitch are against; None to tell it from the data.
        axes: Which servo of a mount carries the other, where roll and pitch are against the vehicle; None to tell it
            from the data.
        is_demand: Whether gimbals report what they were told, not where they are; None to tell it from the data.
        delay_ns: How far behind every report the camera is, as far as that is known; reports count from then.
        lag_ns: How far behind a demand the camera may be, beside that.
        slew_radps: How fast the camera turns to a new demand, at the least.
        std: Standard deviations of tilt, pan, roll, heading and of east and north (heights: ``HeightSettings``).
        max_gap_ns: Longest gap between two samples that is interpolated over.
    """

    order: tuple[GimbalSource, ...] = (
        GimbalSource.GIMBAL_DEVICE,
        GimbalSource.MOUNT_ORIENTATION,
        GimbalSource.MOUNT_STATUS,
        GimbalSource.DATAFLASH_MNT,
    )
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
        """``std``, with the tilt that a demand hides where reports may be demands: it lasts, as a bias does."""
        if self.is_demand is False:
            return self.std
        return replace(self.std, tilt_rad=max(self.std.tilt_rad, DEMAND_TILT_STD_RAD))


@dataclass(frozen=True, slots=True, kw_only=True)
class TelemetrySettings:
    """How telemetry becomes a pose.

    Attributes:
        system: MAVLink system id to follow; None for the first vehicle heard.
        component: Component id of its autopilot, where it has several; None for the first heard.
        gimbal: Up to 6 the number of a gimbal that the autopilot speaks for, from 7 on a gimbal's component id; None
            for the first heard.
        height: Height sources.
        attitude: Attitude sources.
        health: What the vehicle may say of itself.
        zoom: Reports of the camera's view.
        wait_ns: How long after its arrival an image waits for later telemetry before it is called stale.
    """

    system: int | None = None
    component: int | None = None
    gimbal: int | None = None
    height: HeightSettings = field(default_factory=HeightSettings)
    attitude: AttitudeSettings = field(default_factory=AttitudeSettings)
    health: HealthSettings = field(default_factory=HealthSettings)
    zoom: ZoomSettings = field(default_factory=ZoomSettings)
    wait_ns: int = 2 * SECOND_NS


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorStd:
    """Standard deviations of the telemetry's errors, each None where a default applies; axes as in ``PoseStd``."""

    height_m: float | None = None
    horizontal_m: float | None = None
    tilt_rad: float | None = None
    pan_rad: float | None = None
    roll_rad: float | None = None
    heading_rad: float | None = None


DRIFT = ErrorStd(
    height_m=0.02,
    horizontal_m=0.1,
    tilt_rad=math.radians(0.01),
    pan_rad=math.radians(0.01),
    roll_rad=math.radians(0.01),
    heading_rad=math.radians(0.03),
)
"""Random walks per square root of a second: a barometer strays by half a metre in ten minutes, GPS by metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveCalibration:
    """How biases of the telemetry are estimated from landmarks, while the station measures.

    What telemetry states as its standard deviations is for the most part the same error for a whole flight: that part
    is estimated. The rest is new in every image, and stays in every interval.

    Attributes:
        landmarks: What is looked for.
        noise_share: That rest, as a share of each stated standard deviation.
        noise: Standard deviation of single errors, in their own units.
        initial: Standard deviations of the biases before a landmark was seen; None for what is left of the stated ones.
        drift: Random walk of the biases per square root of a second; what was learned fades until ``initial`` is back.
        gate_probability: A landmark farther off than this share of all good ones would be is refused.
        outlier_fraction: Share of observations that are something else than the landmark.
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
    """Everything that the pipeline's numbers depend on, besides its input.

    Attributes:
        station: Name in key expressions.
        camera: The camera.
        probes: What to measure in every image.
        model: Projection model.
        ground: What probes' elevations are counted from; None for the level plane at 0.
        telemetry: None for a fixed camera.
        fixed_pose: The fixed camera's pose; None where telemetry gives it.
        origin: ENU origin; None for the first good fix.
        max_range_m: Farther points are ``BEYOND_RANGE``; None for no limit.
        time_std_s: Standard deviation of image stamps against telemetry stamps.
        match_tolerance_ns: An observation belongs to the image whose stamp is this close.
        tick_ns: The grid of arrival times on which the pipeline advances.
        config_id: ``sha256:...`` of the resolved configuration.
    """

    station: str
    camera: Camera
    probes: tuple[Probe, ...]
    model: ProjectionModel = ProjectionModel.PINHOLE
    ground: Ground | None = None
    telemetry: TelemetrySettings | None = None
    fixed_pose: PoseSample | None = None
    origin: GeoOrigin | None = None
    max_range_m: float | None = None
    time_std_s: float = 0.0
    match_tolerance_ns: int = 20_000_000
    tick_ns: int = 50_000_000
    config_id: str | None = None

    @property
    def setup(self) -> Setup:
        """Camera and ground as they are before any zoom."""
        return Setup(
            camera=self.camera,
            model=self.model,
            ground=self.ground,
            max_range_m=self.max_range_m,
            config_id=self.config_id,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class WaterHints:
    """What a person says of the first image that is looked at; it is carried to the others on the water's plane.

    Attributes:
        water_px: Pixels in the water.
        land_px: Pixels on land.
    """

    water_px: tuple[tuple[float, float], ...] = ()
    land_px: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class RiverLook:
    """How banks are looked for.

    Attributes:
        every_s: Least time between two looks; 0 for every image.
        spacing_m: Of the transects; up to 32 of them, evenly chosen, become one observation.
        seed_px: A pixel in the water of every image; None for the largest water.
        hints: What a person says of the first image.
        max_range_m: Water farther than this is left out; None for 6 camera heights.
    """

    every_s: float = 1.0
    spacing_m: float = 1.0
    seed_px: tuple[float, float] | None = None
    hints: WaterHints = WaterHints()
    max_range_m: float | None = None


RADIO_STATUS: Final = "RADIO_STATUS"  # made by the radio itself, which has no key


@dataclass(frozen=True, slots=True, kw_only=True)
class SigningSettings:
    """How one link is signed.

    Attributes:
        key_file: Holds the key.
        state_file: Where its time stamps are kept; None for beside the key, as ``<key_file>.state``.
        link_id: Of what is sent on it.
        accept_unsigned: Names of messages that pass without a signature.
    """

    key_file: Path
    state_file: Path | None = None
    link_id: int = 0
    accept_unsigned: tuple[str, ...] = (RADIO_STATUS,)
