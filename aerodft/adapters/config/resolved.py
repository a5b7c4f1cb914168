"""A station back to one self-contained TOML text, and the id of what its numbers depend on."""

import hashlib
import json
from dataclasses import replace
from typing import Any

import tomli_w

from aerodft.adapters.config.bias_tables import bias_document
from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.config.fixed_pose import FixedPose, placed, pose_sample
from aerodft.adapters.config.ground import ground_document, made_ground
from aerodft.adapters.config.inputs import Device, ImageSettings, Stills, Stream, Topics, VideoFile
from aerodft.adapters.config.live_tables import live_document
from aerodft.adapters.config.looked_for import NOT_OF_THE_NUMBERS, ObjectsTable, RiverTable, watch_document
from aerodft.adapters.config.marker_tables import marker_landmarks, markers_document
from aerodft.adapters.config.pose_tables import PoseTable
from aerodft.adapters.config.station import StationConfig
from aerodft.adapters.config.station_tables import (
    ImagesTable,
    LimitsTable,
    ObservationsTable,
    OriginTable,
    ProbeTable,
    RecordTable,
    ZenohTable,
)
from aerodft.adapters.config.tables import keys_of
from aerodft.adapters.config.telemetry_tables import TelemetryTable
from aerodft.adapters.config.units import to_s
from aerodft.model.probe import Probe
from aerodft.service.settings import TelemetrySettings


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
    for table, keys in NOT_OF_THE_NUMBERS.items():
        for key in keys:
            document.get(table, {}).pop(key, None)
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
        document["station"]["origin"] = keys_of(OriginTable, pipeline.origin)
    if pipeline.telemetry is not None:
        document["telemetry"] = _telemetry(pipeline.telemetry, station)
    if station.fixed_pose is not None:
        document["pose"] = _pose(station.fixed_pose)
    if station.ground is not None:
        document["ground"] = ground_document(station.ground, terrain_file)
    document["images"] = {**_images(station.images), "time_std_s": pipeline.time_std_s}
    tolerance = {"match_tolerance_s": to_s(pipeline.match_tolerance_ns)}
    document["observations"] = keys_of(ObservationsTable, station.observations) | tolerance
    document["limits"] = keys_of(LimitsTable, pipeline)
    document["zenoh"] = keys_of(ZenohTable, station.zenoh)
    document["record"] = keys_of(RecordTable, station.record)
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
        document["objects"] = keys_of(ObjectsTable, station.objects)
    if station.river is not None:
        document["river"] = keys_of(RiverTable, station.river)
    return document


def _telemetry(settings: TelemetrySettings, station: StationConfig) -> dict[str, Any]:
    link = {} if station.link is None else keys_of(TelemetryTable, station.link)
    document = link | keys_of(TelemetryTable, settings)
    if station.calibration is None:
        return document
    return document | {"bias": {"calibration_id": station.calibration.id, **bias_document(station.calibration)}}


def _pose(fixed: FixedPose) -> dict[str, Any]:
    document = keys_of(PoseTable, fixed)
    if fixed.covariance:
        del document["std"]
    return document


def _images(settings: ImageSettings) -> dict[str, Any]:
    match settings.source:
        case VideoFile(path=path):
            document = {"video": str(path.absolute())}
        case Stills(folder=folder):
            document = {"stills": str(folder.absolute())}
        case Stream(url=url):
            document = {"stream": url}
        case Device(path=device):
            document = {"device": device}
        case _:
            document = {}
    document |= keys_of(ImagesTable, settings.source) | keys_of(ImagesTable, settings)
    return document | {"time_offset_s": "auto"} if settings.is_auto else document


def _topics(topics: Topics) -> dict[str, Any]:
    stated = {"images": topics.images, "camera": topics.camera}
    named = {key: found[0] for key, found in stated.items() if found}
    return {"mavlink": list(topics.mavlink), **named} if topics.mavlink else named


def _probe(probe: Probe) -> dict[str, Any]:
    document = keys_of(ProbeTable, probe)
    elevation = () if probe.on_top_of is None else ("elevation_m", "elevation_std_m")
    return {key: value for key, value in document.items() if key not in elevation}
