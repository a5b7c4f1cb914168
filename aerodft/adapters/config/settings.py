"""Validated tables to the settings and values that the inside works with: SI units, radians, nanoseconds."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from aerodft.adapters.config.attitude import attitude_from
from aerodft.adapters.config.covariance import as_rows, checked_covariance
from aerodft.adapters.config.health_tables import health_from, zoom_from
from aerodft.adapters.config.pose_tables import HeightTable, PoseStdTable, PoseTable, TelemetryTable
from aerodft.adapters.config.station import (
    Device,
    FixedPose,
    ImageInput,
    ImageSettings,
    Rate,
    Stills,
    Stream,
    Topics,
    VideoFile,
)
from aerodft.adapters.config.station_tables import ImagesTable, OriginTable, ProbeTable, TopicsTable
from aerodft.adapters.config.units import to_ns
from aerodft.errors import ConfigError
from aerodft.geometry.geodesy import east_north
from aerodft.geometry.ground import Ground
from aerodft.geometry.poses import camera_pose
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.pose import GeoOrigin, GimbalSource, HeightSource, Pose, PoseSample, PoseStd
from aerodft.model.probe import PixelSource, Probe, ProbeKind
from aerodft.model.status import Status
from aerodft.service.footing import footing
from aerodft.service.settings import HeightSettings, TelemetrySettings

_POSITION_STD_M = 2.0
_HEADING_STD_DEG = 2.0
_EDGE_PX = -0.5  # pixel (0, 0) is the centre of the top-left pixel


def telemetry_from(table: TelemetryTable) -> TelemetrySettings:
    """How telemetry becomes a pose."""
    return TelemetrySettings(
        system=table.system,
        component=table.component,
        gimbal=table.gimbal,
        height=_height(table.height),
        attitude=attitude_from(table.attitude, table.horizontal_std_m),
        health=health_from(table.health),
        zoom=zoom_from(table.zoom),
        wait_ns=to_ns(table.wait_s),
    )


def _height(table: HeightTable) -> HeightSettings:
    measured = HeightSettings().order
    by_default = measured if table.manual_m is None else (*measured, HeightSource.MANUAL)
    return HeightSettings(
        order=by_default if table.order is None else tuple(map(HeightSource, table.order)),
        std_m={HeightSource(name): std_m for name, std_m in table.std_m.model_dump().items()},
        home_above_plane_m=table.home_above_plane_m,
        manual_m=table.manual_m,
        min_m=table.min_m,
        max_gap_ns=to_ns(table.max_gap_s),
        rangefinder_gap_ns=to_ns(table.rangefinder_gap_s),
        terrain_gap_ns=to_ns(table.terrain_gap_s),
        terrain_max_distance_m=table.terrain_max_distance_m,
        lean_std_rad=math.radians(table.lean_std_deg),
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
        ConfigError: Height or tilt is not stated, or the covariance is none.
    """
    if table.height_agl_m is None or table.tilt_deg is None:
        raise ConfigError("pose", where=where, got="a calibration", expected="height_agl_m and tilt_deg")
    std = _stated_std(table.std, knows_heading=table.heading_deg is not None, knows_position=table.lat_deg is not None)
    covariance: tuple[tuple[float, ...], ...] = ()
    if table.covariance is not None:
        of = "east, north, up, then rotation about the camera's x, y, z"
        cov = checked_covariance(table.covariance, 6, where=where, key="pose.covariance", of=of)
        covariance, std = as_rows(cov), std_of(cov)
    return FixedPose(
        height_agl_m=table.height_agl_m,
        tilt_rad=math.radians(table.tilt_deg),
        roll_rad=math.radians(table.roll_deg),
        heading_rad=math.radians(table.heading_deg or 0.0),
        lat_rad=None if table.lat_deg is None else math.radians(table.lat_deg),
        lon_rad=None if table.lon_deg is None else math.radians(table.lon_deg),
        alt_msl_m=table.alt_msl_m,
        std=std,
        covariance=covariance,
        lens_covariance=tuple(map(tuple, table.lens_covariance or ())),
        east_m=table.east_m,
        north_m=table.north_m,
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


def std_of(cov: FloatArray) -> PoseStd:
    """What a full covariance ``(6, 6)`` comes to in people's words; the heading is in the three rotations."""
    east, north, up, tilt, pan, roll = np.diag(cov).tolist()
    return PoseStd(
        height_agl_m=math.sqrt(up),
        horizontal_m=math.sqrt((east + north) / 2),
        tilt_rad=math.sqrt(tilt),
        pan_rad=math.sqrt(pan),
        roll_rad=math.sqrt(roll),
    )


def pose_sample(
    fixed: FixedPose, origin: GeoOrigin | None, ground: Ground | None = None, where: str = ""
) -> PoseSample:
    """A fixed camera's pose as the pipeline takes it.

    Args:
        fixed: The pose.
        origin: The station's ENU origin; without one, the camera's foot is the origin.
        ground: What the height is counted from, right below the camera; None for the level plane at 0.
        where: File that the pose is from, for messages.

    Returns:
        A sample with stamp 0, in ENU of ``origin`` where the camera's position is known, else above its own foot.

    Raises:
        ConfigError: There is no ground below the camera.
    """
    origin, east_m, north_m = placed(fixed, origin)
    pose = camera_pose(
        height_agl_m=fixed.height_agl_m,
        tilt_rad=fixed.tilt_rad,
        roll_rad=fixed.roll_rad,
        heading_rad=fixed.heading_rad,
        std=fixed.std,
        east_m=east_m,
        north_m=north_m,
    )
    if ground is not None:
        pose = _on_ground(pose, ground, where)
    datum_m = float(pose.position_enu_m[2]) - fixed.height_agl_m
    if fixed.covariance:
        pose = replace(pose, cov=np.array(fixed.covariance))
    if fixed.lens_covariance:
        pose = replace(pose, lens_cov=np.array(fixed.lens_covariance))
    return PoseSample(
        stamp_ns=0,
        status=Status.OK,
        pose=pose,
        std=fixed.std,
        origin=origin,
        lat_rad=fixed.lat_rad,
        lon_rad=fixed.lon_rad,
        alt_msl_m=fixed.alt_msl_m,
        height_source=HeightSource.CALIBRATION if fixed.calibration else HeightSource.MANUAL,
        height_datum="plane",
        datum_enu_m=datum_m,
        attitude_source=GimbalSource.MANUAL,
        calibration=fixed.calibration,
    )


def _on_ground(pose: Pose, ground: Ground, where: str) -> Pose:
    below = footing(ground, pose.position_enu_m[:2])
    if below.status is not Status.OK:
        hint = "check the position, or set fill_msl_m or radius_m in [ground]"
        raise ConfigError("below the pose", where=where, got=below.what, expected="ground", hint=hint)
    return below.carrying(pose)


def placed(fixed: FixedPose, origin: GeoOrigin | None) -> tuple[GeoOrigin | None, float, float]:
    """Where a fixed camera is: an ENU origin with its east and north (m) there.

    Args:
        fixed: The camera's pose.
        origin: The station's ENU origin; without one, the camera's foot is the origin.

    Returns:
        No origin where the camera's position is unknown.
    """
    if fixed.lat_rad is None or fixed.lon_rad is None:
        return None, fixed.east_m, fixed.north_m
    if origin is None:
        foot_msl_m = None if fixed.alt_msl_m is None else fixed.alt_msl_m - fixed.height_agl_m
        return GeoOrigin(lat_rad=fixed.lat_rad, lon_rad=fixed.lon_rad, alt_msl_m=foot_msl_m), 0.0, 0.0
    east_m, north_m = map(float, east_north(origin, fixed.lat_rad, fixed.lon_rad))
    return origin, east_m, north_m


def images_from(table: ImagesTable, folder: Path) -> ImageSettings:
    """Where images come from; relative paths start from ``folder``."""
    return ImageSettings(
        source=_image_input(table, folder),
        time_offset_s=table.time_offset_s or 0.0,
        time_drift=table.time_drift,
        time_reference_ns=table.time_reference,
        is_auto=table.time_offset_s is None,
    )


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


def topics_from(table: TopicsTable) -> Topics:
    """What the topics of other tools' recordings are."""
    return Topics(
        mavlink=(table.mavlink,) if isinstance(table.mavlink, str) else table.mavlink,
        images=() if table.images is None else (table.images,),
        camera=() if table.camera is None else (table.camera,),
    )


def probes_from(tables: tuple[ProbeTable, ...], camera: Camera, where: str) -> tuple[Probe, ...]:
    """The configured probes.

    Raises:
        ConfigError: A name twice, a fixed pixel outside the camera's image, or a probe on top of what is no height.
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
        if table.on_top_of is not None:
            _check_object(table.on_top_of, tables, f"{where}: probe[{index}].on_top_of")
    return tuple(
        Probe(
            name=table.name,
            kind=table.kind,
            source=_source(table),
            pixels=table.pixels or (),
            std_px=table.std_px,
            elevation_m=table.elevation_m,
            elevation_std_m=table.elevation_std_m,
            on_top_of=table.on_top_of,
            at_ns=table.at,
        )
        for table in tables
    )


def _source(table: ProbeTable) -> PixelSource:
    if table.tracked:
        return PixelSource.TRACKED
    return PixelSource.OBSERVED if table.observed else PixelSource.FIXED


def _check_object(name: str, tables: tuple[ProbeTable, ...], where: str) -> None:
    """Refuse to lie on top of anything but an object that stands on the ground, seen in fixed pixels."""
    found = next((table for table in tables if table.name == name), None)
    if found is None:
        got = f'"{name}", which is not there'
    elif found.kind is not ProbeKind.HEIGHT:
        got = f'"{name}", which measures a {found.kind}'
    elif found.observed or found.tracked:
        got = f'"{name}", of which the pixels are {_source(found)}'
    elif found.on_top_of is not None:
        got = f'"{name}", which lies on top of "{found.on_top_of}"'
    else:
        return
    raise ConfigError("no object", where=where, got=got, expected="a height on the ground with pixels of its own")
