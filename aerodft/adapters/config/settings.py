"""Validated tables to the settings and values that the inside works with: SI units, radians, nanoseconds."""

import math
from pathlib import Path

from aerodft.adapters.config.pose_tables import AttitudeTable, HeightTable, PoseStdTable, PoseTable, TelemetryTable
from aerodft.adapters.config.station import (
    Device,
    FixedPose,
    ImageInput,
    ImageSettings,
    Rate,
    Stills,
    Stream,
    VideoFile,
)
from aerodft.adapters.config.station_tables import ImagesTable, OriginTable, ProbeTable
from aerodft.adapters.config.units import to_ns
from aerodft.errors import ConfigError
from aerodft.geometry.geodesy import east_north
from aerodft.geometry.poses import camera_pose
from aerodft.model.camera import Camera
from aerodft.model.pose import GeoOrigin, GimbalSource, HeightSource, PoseSample, PoseStd
from aerodft.model.probe import PixelSource, Probe
from aerodft.model.status import Status
from aerodft.service.settings import AttitudeSettings, FixedMount, HeightSettings, TelemetrySettings

_POSITION_STD_M = 2.0
_HEADING_STD_DEG = 2.0
_EDGE_PX = -0.5  # pixel (0, 0) is the centre of the top-left pixel


def telemetry_from(table: TelemetryTable) -> TelemetrySettings:
    """How telemetry becomes a pose."""
    return TelemetrySettings(
        system=table.system,
        height=_height(table.height),
        attitude=_attitude(table.attitude, table.horizontal_std_m),
        wait_ns=to_ns(table.wait_s),
    )


def _height(table: HeightTable) -> HeightSettings:
    return HeightSettings(
        order=tuple(HeightSource(name) for name in table.order),
        std_m={HeightSource(name): std_m for name, std_m in table.std_m.model_dump().items()},
        home_above_plane_m=table.home_above_plane_m,
        manual_m=table.manual_m,
        min_m=table.min_m,
        max_gap_ns=to_ns(table.max_gap_s),
    )


def _attitude(table: AttitudeTable, horizontal_std_m: float) -> AttitudeSettings:
    mount = table.fixed_mount
    return AttitudeSettings(
        order=tuple(GimbalSource(name) for name in table.order),
        fixed_mount=None
        if mount is None
        else FixedMount(
            yaw_rad=math.radians(mount.yaw_deg),
            pitch_rad=math.radians(mount.pitch_deg),
            roll_rad=math.radians(mount.roll_deg),
        ),
        std=PoseStd(
            horizontal_m=horizontal_std_m,
            tilt_rad=math.radians(table.tilt_std_deg),
            pan_rad=math.radians(table.pan_std_deg),
            roll_rad=math.radians(table.roll_std_deg),
            heading_rad=math.radians(table.heading_std_deg),
        ),
        max_gap_ns=to_ns(table.max_gap_s),
    )


def origin_from(table: OriginTable | None) -> GeoOrigin | None:
    """The station's ENU origin."""
    if table is None:
        return None
    return GeoOrigin(
        lat_rad=math.radians(table.lat_deg), lon_rad=math.radians(table.lon_deg), alt_msl_m=table.alt_msl_m
    )


def fixed_pose_from(table: PoseTable, where: str) -> FixedPose:
    """A fixed camera's stated pose.

    Raises:
        ConfigError: Height or tilt is not stated.
    """
    if table.height_agl_m is None or table.tilt_deg is None:
        raise ConfigError("pose", where=where, got="a calibration", expected="height_agl_m and tilt_deg")
    return FixedPose(
        height_agl_m=table.height_agl_m,
        tilt_rad=math.radians(table.tilt_deg),
        roll_rad=math.radians(table.roll_deg),
        heading_rad=math.radians(table.heading_deg or 0.0),
        lat_rad=None if table.lat_deg is None else math.radians(table.lat_deg),
        lon_rad=None if table.lon_deg is None else math.radians(table.lon_deg),
        alt_msl_m=table.alt_msl_m,
        std=_stated_std(
            table.std, knows_heading=table.heading_deg is not None, knows_position=table.lat_deg is not None
        ),
        calibration=table.calibration_id,
    )


def _stated_std(table: PoseStdTable, *, knows_heading: bool, knows_position: bool) -> PoseStd:
    heading_deg = _HEADING_STD_DEG if knows_heading else 0.0
    horizontal_m = _POSITION_STD_M if knows_position else 0.0
    return PoseStd(
        height_agl_m=table.height_m,
        horizontal_m=horizontal_m if table.horizontal_m is None else table.horizontal_m,
        tilt_rad=math.radians(table.tilt_deg),
        pan_rad=math.radians(table.pan_deg),
        roll_rad=math.radians(table.roll_deg),
        heading_rad=math.radians(heading_deg if table.heading_deg is None else table.heading_deg),
    )


def pose_sample(fixed: FixedPose, origin: GeoOrigin | None) -> PoseSample:
    """A fixed camera's pose as the pipeline takes it.

    Args:
        fixed: The pose.
        origin: The station's ENU origin; without one, the camera's foot is the origin.

    Returns:
        A sample with stamp 0, in ENU of ``origin`` where the camera's position is known, else above its own foot.
    """
    origin, east_m, north_m = _placed(fixed, origin)
    return PoseSample(
        stamp_ns=0,
        status=Status.OK,
        pose=camera_pose(
            height_agl_m=fixed.height_agl_m,
            tilt_rad=fixed.tilt_rad,
            roll_rad=fixed.roll_rad,
            heading_rad=fixed.heading_rad,
            std=fixed.std,
            east_m=east_m,
            north_m=north_m,
        ),
        std=fixed.std,
        origin=origin,
        lat_rad=fixed.lat_rad,
        lon_rad=fixed.lon_rad,
        alt_msl_m=fixed.alt_msl_m,
        height_source=HeightSource.CALIBRATION if fixed.calibration else HeightSource.MANUAL,
        height_datum="plane",
        attitude_source=GimbalSource.MANUAL,
        calibration=fixed.calibration,
    )


def _placed(fixed: FixedPose, origin: GeoOrigin | None) -> tuple[GeoOrigin | None, float, float]:
    """The ENU origin with the camera's east and north (m) in it; no origin where the position is unknown."""
    if fixed.lat_rad is None or fixed.lon_rad is None:
        return None, 0.0, 0.0
    if origin is None:
        foot_msl_m = None if fixed.alt_msl_m is None else fixed.alt_msl_m - fixed.height_agl_m
        return GeoOrigin(lat_rad=fixed.lat_rad, lon_rad=fixed.lon_rad, alt_msl_m=foot_msl_m), 0.0, 0.0
    east_m, north_m = map(float, east_north(origin, fixed.lat_rad, fixed.lon_rad))
    return origin, east_m, north_m


def images_from(table: ImagesTable, folder: Path) -> ImageSettings:
    """Where images come from; relative paths start from ``folder``."""
    return ImageSettings(source=_image_input(table, folder), time_offset_s=table.time_offset_s)


def _image_input(table: ImagesTable, folder: Path) -> ImageInput | None:
    if table.video is not None:
        return VideoFile(path=folder / table.video, start_ns=table.start)
    if table.stills is not None:
        return Stills(folder=folder / table.stills, pattern=table.pattern, utc_offset=table.utc_offset)
    if table.stream is not None:
        return Stream(url=table.stream)
    if table.device is not None:
        return Device(path=table.device)
    return None if table.rate_hz is None else Rate(rate_hz=table.rate_hz)


def probes_from(tables: tuple[ProbeTable, ...], camera: Camera, where: str) -> tuple[Probe, ...]:
    """The configured probes.

    Raises:
        ConfigError: A name twice, or a fixed pixel outside the camera's image.
    """
    names = [table.name for table in tables]
    right_px, bottom_px = camera.width_px + _EDGE_PX, camera.height_px + _EDGE_PX
    for index, table in enumerate(tables):
        if table.name in names[:index]:
            raise ConfigError(
                f"probe[{index}].name", where=where, got=f'"{table.name}" again', expected="a name of its own"
            )
        for u, v in table.pixels or ():
            if not (_EDGE_PX <= u <= right_px and _EDGE_PX <= v <= bottom_px):
                raise ConfigError(
                    f'probe "{table.name}" lies outside the image',
                    where=where,
                    got=f"pixel ({u:g}, {v:g})",
                    expected=f"within (-0.5, -0.5) to ({right_px:g}, {bottom_px:g}) of {camera.name}",
                )
    return tuple(
        Probe(
            name=table.name,
            kind=table.kind,
            source=PixelSource.OBSERVED if table.observed else PixelSource.FIXED,
            pixels=table.pixels or (),
            std_px=table.std_px,
            elevation_m=table.elevation_m,
            elevation_std_m=table.elevation_std_m,
        )
        for table in tables
    )
