"""A station back to one self-contained TOML text, and the id of what its numbers depend on."""

import hashlib
import json
from dataclasses import replace
from typing import Any

import tomli_w

from aerodft.adapters.config.attitude import attitude_document
from aerodft.adapters.config.bias_tables import bias_document
from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.config.fixed_pose import FixedPose, placed, pose_sample
from aerodft.adapters.config.ground import ground_document, made_ground
from aerodft.adapters.config.health_tables import health_document, zoom_document
from aerodft.adapters.config.inputs import Device, ImageSettings, Rate, Stills, Stream, Topics, VideoFile
from aerodft.adapters.config.live_tables import live_document
from aerodft.adapters.config.marker_tables import marker_landmarks, markers_document
from aerodft.adapters.config.object_tables import SEEN_ONLY, objects_document
from aerodft.adapters.config.river_tables import river_document
from aerodft.adapters.config.station import StationConfig
from aerodft.adapters.config.units import to_deg, to_s
from aerodft.adapters.config.watch_tables import NOT_OF_THE_NUMBERS, watch_document
from aerodft.adapters.mavlink.signing_settings import SigningSettings
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.model.pose import GeoOrigin, PoseStd
from aerodft.model.probe import PixelSource, Probe
from aerodft.service.settings import HeightSettings, TelemetrySettings


def refreshed(station: StationConfig, where: str = "") -> StationConfig:
    """The station with ``pipeline.ground``, ``.fixed_pose`` and ``.config_id`` made anew from the rest.

    Args:
        station: The station.
        where: File that it is from, for messages.

    Raises:
        InputError: The elevation model cannot be used, or there is no ground below the fixed camera.
        ValueError: The ground needs an origin, and there is none.
    """
    pose, origin = station.fixed_pose, station.pipeline.origin
    place, *foot_m = (origin, 0.0, 0.0) if pose is None else placed(pose, origin)
    ground = made_ground(station.ground, place, (foot_m[0], foot_m[1]))
    fixed = None if pose is None else pose_sample(pose, origin, ground, where)
    current = replace(station, pipeline=replace(station.pipeline, fixed_pose=fixed, ground=ground))
    return replace(current, pipeline=replace(current.pipeline, config_id=config_id(current)))


def config_id(station: StationConfig) -> str:
    """``sha256:...`` of what the numbers depend on: not of ports, folders, or where input comes from.

    A telemetry calibration is left out too: a measurement names it by its own id. An elevation model counts with the
    hash of its bytes.
    """
    document = station_document(station)
    for key in ("zenoh", "record", "topics", "river"):
        document.pop(key, None)
    document["station"].pop("name")
    timing = ("time_offset_s", "time_drift", "time_reference", "time_std_s")
    document["images"] = {key: value for key, value in document["images"].items() if key in timing}
    for key in ("files", "topic"):
        document["observations"].pop(key, None)
    for key in ("connection", "baud", "signing", "bias"):
        document.get("telemetry", {}).pop(key, None)
    document.get("ground", {}).pop("terrain", None)
    document.get("markers", {}).pop("every_s", None)
    for key in NOT_OF_THE_NUMBERS:
        document.get("watch", {}).pop(key, None)
    for key in SEEN_ONLY:
        document.get("objects", {}).pop(key, None)
    text = json.dumps(_as_numbers(document), sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


def _as_numbers(value: Any) -> Any:  # noqa: ANN401 (whatever TOML can hold)
    """Every number as the float that equals it: 50 m and 50.0 m are one height, and so are 0.0 and -0.0."""
    if isinstance(value, dict):
        return {key: _as_numbers(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_as_numbers(each) for each in value]
    return value + 0.0 if isinstance(value, int | float) and not isinstance(value, bool) else value


def resolved_toml(station: StationConfig, *, terrain_file: str | None = None) -> str:
    """One TOML text with camera, calibration and every default written out.

    Reading it with :func:`aerodft.adapters.config.loading.parse_station` gives the same settings to the last bit.

    Args:
        station: The station.
        terrain_file: What an elevation model's file is called beside the text; None for where it is now.
    """
    return tomli_w.dumps(station_document(station, terrain_file))


def station_document(station: StationConfig, terrain_file: str | None = None) -> dict[str, Any]:
    """The station as TOML keys; what is None is left out. ``terrain_file`` as in :func:`resolved_toml`."""
    pipeline = station.pipeline
    document: dict[str, Any] = {
        "station": {"name": pipeline.station, "tick_ms": pipeline.tick_ns // 1_000_000},
        "camera": {**camera_document(pipeline.camera), "model": str(pipeline.model)},
    }
    if pipeline.origin is not None:
        document["station"]["origin"] = _origin(pipeline.origin)
    if pipeline.telemetry is not None:
        document["telemetry"] = _telemetry(pipeline.telemetry, station)
    if station.fixed_pose is not None:
        document["pose"] = _pose(station.fixed_pose)
    if station.ground is not None:
        document["ground"] = ground_document(station.ground, terrain_file)
    document["images"] = {**_images(station.images), "time_std_s": pipeline.time_std_s}
    document["observations"] = {
        "files": [str(file.absolute()) for file in station.observations.files],
        "topic": station.observations.topic,
        "time_offset_s": station.observations.time_offset_s,
        "match_tolerance_s": to_s(pipeline.match_tolerance_ns),
    }
    document["limits"] = _stated(max_range_m=pipeline.max_range_m)
    document["zenoh"] = {
        "enabled": station.zenoh.enabled,
        "listen": station.zenoh.listen,
        "connect": list(station.zenoh.connect),
    }
    document["record"] = {
        "folder": str(station.record.folder),
        "image_hz": station.record.image_hz,
        "video": station.record.video,
        "jpeg_quality": station.record.jpeg_quality,
        "segment_s": station.record.segment_s,
        "segment_mb": station.record.segment_mb,
    }
    if topics := _topics(station.topics):
        document["topics"] = topics
    document["probe"] = [_probe(probe) for probe in pipeline.probes]
    if station.live is not None:
        document |= live_document(station.live, frozenset(each.name for each in marker_landmarks(station.markers)))
    return document | _looked_for(station)


def _looked_for(station: StationConfig) -> dict[str, Any]:
    """The tables of what is looked for in the images."""
    document: dict[str, Any] = {}
    if station.markers is not None:
        document["markers"] = markers_document(station.markers)
    if station.watch is not None:
        document["watch"] = watch_document(station.watch)
    if station.objects is not None:
        document["objects"] = objects_document(station.objects)
    if station.river is not None:
        document["river"] = river_document(station.river)
    return document


def _stated(**values: object) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else to_deg(angle_rad)


def _origin(origin: GeoOrigin) -> dict[str, Any]:
    return _stated(lat_deg=to_deg(origin.lat_rad), lon_deg=to_deg(origin.lon_rad), alt_msl_m=origin.alt_msl_m)


def _telemetry(settings: TelemetrySettings, station: StationConfig) -> dict[str, Any]:
    link, calibration = station.link, station.calibration
    return _stated(
        connection=link.connection if link else None,
        baud=link.baud if link else None,
        signing=_signing(link.signing) if link and link.signing else None,
        system=settings.system,
        component=settings.component,
        gimbal=settings.gimbal,
        wait_s=to_s(settings.wait_ns),
        horizontal_std_m=settings.attitude.std.horizontal_m,
        height=_height(settings.height),
        attitude=attitude_document(settings.attitude),
        health=health_document(settings.health),
        zoom=zoom_document(settings.zoom),
        bias=None if calibration is None else {"calibration_id": calibration.id, **bias_document(calibration)},
    )


def _signing(settings: SigningSettings) -> dict[str, Any]:
    return _stated(
        key_file=str(settings.key_file.absolute()),
        state_file=None if settings.state_file is None else str(settings.state_file.absolute()),
        link_id=settings.link_id,
        accept_unsigned=list(settings.accept_unsigned),
    )


def _height(settings: HeightSettings) -> dict[str, Any]:
    return _stated(
        order=[str(source) for source in settings.order],
        std_m={str(source): std_m for source, std_m in settings.std_m.items()},
        home_above_plane_m=settings.home_above_plane_m,
        manual_m=settings.manual_m,
        min_m=settings.min_m,
        max_gap_s=to_s(settings.max_gap_ns),
        rangefinder_gap_s=to_s(settings.rangefinder_gap_ns),
        terrain_gap_s=to_s(settings.terrain_gap_ns),
        terrain_max_distance_m=settings.terrain_max_distance_m,
        lean_std_deg=to_deg(settings.lean_std_rad),
    )


def _pose(fixed: FixedPose) -> dict[str, Any]:
    return _stated(
        calibration_id=fixed.calibration,
        height_agl_m=fixed.height_agl_m,
        tilt_deg=to_deg(fixed.tilt_rad),
        roll_deg=to_deg(fixed.roll_rad),
        heading_deg=to_deg(fixed.heading_rad),
        lat_deg=_degrees(fixed.lat_rad),
        lon_deg=_degrees(fixed.lon_rad),
        alt_msl_m=fixed.alt_msl_m,
        east_m=fixed.east_m or None,
        north_m=fixed.north_m or None,
        covariance=[list(row) for row in fixed.covariance] or None,
        lens_covariance=[list(row) for row in fixed.lens_covariance] or None,
        std=None if fixed.covariance else _pose_std(fixed.std),
    )


def _pose_std(std: PoseStd) -> dict[str, float]:
    return {
        "height_m": std.height_agl_m,
        "tilt_deg": to_deg(std.tilt_rad),
        "pan_deg": to_deg(std.pan_rad),
        "roll_deg": to_deg(std.roll_rad),
        "heading_deg": to_deg(std.heading_rad),
        "horizontal_m": std.horizontal_m,
    }


def _images(settings: ImageSettings) -> dict[str, Any]:
    match settings.source:
        case VideoFile(path=path, start_ns=start_ns):
            start = None if start_ns is None else unix_ns_to_iso(start_ns)
            document = _stated(video=str(path.absolute()), start=start)
        case Stills(folder=folder, pattern=pattern, utc_offset=utc_offset):
            document = _stated(stills=str(folder.absolute()), pattern=pattern, utc_offset=utc_offset)
        case Stream(url=url):
            document = {"stream": url}
        case Device(path=device):
            document = {"device": device}
        case Rate(rate_hz=rate_hz):
            document = {"rate_hz": rate_hz}
        case None:
            document = {}
    offset = "auto" if settings.is_auto else settings.time_offset_s
    reference_ns = settings.time_reference_ns
    drift = _stated(
        time_drift=settings.time_drift or None,
        time_reference=None if reference_ns is None else unix_ns_to_iso(reference_ns),
    )
    return {**document, "time_offset_s": offset, **drift}


def _topics(topics: Topics) -> dict[str, Any]:
    images, camera = next(iter(topics.images), None), next(iter(topics.camera), None)
    return _stated(mavlink=list(topics.mavlink) or None, images=images, camera=camera)


def _time(stamp_ns: int | None) -> str | None:
    return None if stamp_ns is None else unix_ns_to_iso(stamp_ns)


def _probe(probe: Probe) -> dict[str, Any]:
    pixels = {"pixels": [list(pixel) for pixel in probe.pixels]}
    sources: dict[PixelSource, dict[str, Any]] = {
        PixelSource.FIXED: pixels,
        PixelSource.OBSERVED: {"observed": True},
        PixelSource.TRACKED: {**pixels, "tracked": True, **_stated(at=_time(probe.at_ns))},
    }
    plane = {"elevation_m": probe.elevation_m, "elevation_std_m": probe.elevation_std_m}
    return {
        "name": probe.name,
        "kind": str(probe.kind),
        **sources[probe.source],
        "std_px": probe.std_px,
        **(plane if probe.on_top_of is None else {"on_top_of": probe.on_top_of}),
    }
