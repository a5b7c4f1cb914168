"""Station files: TOML to :class:`StationConfig`, and back to one self-contained text.

Also the id of what a station's numbers depend on.
"""

import copy
import hashlib
import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomli_w

from aerodft.adapters.config.camera import (
    FixedPose,
    KnownPointTable,
    bias_table,
    biases_from,
    camera_document,
    camera_from,
    fixed_pose_from,
    load_calibration,
    load_camera,
    place_in_enu,
    pose_sample,
)
from aerodft.adapters.config.reading import parse_toml, read_bytes, validated
from aerodft.adapters.config.station.ground import enu_ground, level_series, resolved_ground
from aerodft.adapters.config.station.image_tables import images_from, images_table
from aerodft.adapters.config.station.live_tables import (
    LiveLandmarkTable,
    live_from,
    marker_landmarks,
    marker_settings,
    station_markers_table,
)
from aerodft.adapters.config.station.overrides import NO_SETTINGS, Settings, with_alignment, with_settings
from aerodft.adapters.config.station.probe_tables import probes_from
from aerodft.adapters.config.station.station_config import Link, StationConfig, Topics
from aerodft.adapters.config.station.station_tables import (
    ConfigTable,
    LimitsTable,
    ObservationsTable,
    StationCameraTable,
    StationTable,
    TopicsTable,
)
from aerodft.adapters.config.tables import AnyValue, si_value
from aerodft.adapters.config.telemetry_tables import TelemetryBiasTable, TelemetryTable, telemetry_from
from aerodft.adapters.outputs import outputs_document, outputs_from
from aerodft.adapters.vertical_datums import Altitude
from aerodft.errors import ConfigError, InputError, located, named_in
from aerodft.model import Calibration, Camera, KnownPoint, ProjectionModel
from aerodft.service import LiveCalibration, PipelineSettings, TelemetrySettings

_log = logging.getLogger(__name__)


def load_station(path: Path, *, settings: Settings = NO_SETTINGS, recorded: bytes | None = None) -> StationConfig:
    """Read a station's configuration.

    Args:
        path: A TOML file; camera, calibration, terrain, marker, reference, video and observation files in it are
            relative to its folder.
        settings: Values that replace those of the file.
        recorded: TOML text of the recording that the station computes anew: the alignment of its video is kept.

    Raises:
        ConfigError: Missing file, TOML syntax, unknown key, impossible value, here or in a file that it refers to.
        InputError: The elevation model cannot be used.
    """
    with named_in(path):
        return parse_station(
            read_bytes(path), where=str(path), folder=path.parent, settings=settings, recorded=recorded
        )


def parse_station(
    data: bytes, *, where: str, folder: Path, settings: Settings = NO_SETTINGS, recorded: bytes | None = None
) -> StationConfig:
    """Read the station that the bytes of a configuration file describe.

    Args:
        data: The TOML text.
        where: The file's name in messages.
        folder: What relative paths in it start from.
        settings: As in ``load_station``.
        recorded: As in ``load_station``.

    Raises:
        ConfigError: TOML syntax, unknown key, impossible value, here, in ``settings`` or in a file that is named.
        InputError: The elevation model cannot be used.
    """
    with located(where):
        document = parse_toml(data)
        if recorded is not None:
            document, remark = with_alignment(document, parse_toml(recorded))
            if remark:
                _log.warning("%s: %s", where, remark)
        if not settings:
            return _station(document, where, folder)
    try:
        return _station(with_settings(document, settings), where, folder)
    except InputError as error:
        with located(where):
            _station(copy.deepcopy(document), where, folder)  # fails where the file is wrong, and not the settings
        with located("`settings`"):
            raise error from None


def _station(document: dict[str, Any], where: str, folder: Path) -> StationConfig:
    outputs = outputs_from(document)
    table = validated(ConfigTable, document)
    telemetry, model, lens = table.telemetry, table.camera.model, table.camera
    ground = resolved_ground(table.ground, folder)
    camera = camera_from(lens.contents, "camera.") if lens.file is None else load_camera(folder / lens.file)
    pose, biases = _pose_and_biases(table)
    points: dict[str, KnownPoint] = {}
    if name := (table.pose and table.pose.calibration) or (telemetry and telemetry.calibration):
        camera, pose, biases, points = _calibrated(folder / name, camera, model, is_fixed=telemetry is None)
    elif ground is not None and ground.needs_place and table.pose is not None and table.pose.heading_deg is None:
        expected = "degrees from north, because the ground is laid out on the map"
        raise ConfigError("pose.heading_deg", got="nothing", expected=expected)
    pipeline = si_value(
        PipelineSettings,
        table.station,
        table.limits,
        table.images,
        table.observations,
        camera=camera,
        probes=(),
        model=model,
        telemetry=None if telemetry is None else telemetry_from(telemetry),
    )
    markers, origin = marker_settings(table.markers, pipeline.origin, where, folder), pipeline.origin
    live = live_from(table.live_calibration, table.landmark, marker_landmarks(markers), origin)
    points = _surveyed_points(live) | points | {each.name: si_value(KnownPoint, each) for each in table.known_point}
    probes = probes_from(table.probe, camera, {} if table.ground else points)
    pipeline = replace(pipeline, probes=probes, points=points)
    station = si_value(
        StationConfig,
        table,
        relative_to=folder,
        outputs=outputs,
        pipeline=pipeline,
        link=si_value(Link, telemetry, relative_to=folder) if telemetry and telemetry.connection else None,
        images=images_from(table.images, folder),
        fixed_pose=pose,
        ground=ground,
        calibration=biases,
        live=live,
        markers=markers,
    )
    return with_derived_settings(station)


def _surveyed_points(live: LiveCalibration | None) -> dict[str, KnownPoint]:
    """Heights of a live calibration's landmarks, whose pixels change from image to image."""
    landmarks = () if live is None else live.landmarks
    return {
        each.name: KnownPoint(pixel=None, elevation_m=each.position_enu_m[2], elevation_std_m=each.std_m[2])
        for each in landmarks
    }


def _pose_and_biases(table: ConfigTable) -> tuple[FixedPose | None, Calibration | None]:
    """Camera pose, or biases of the telemetry, that the file itself states; nothing beside a calibration."""
    bias = None if table.telemetry is None else table.telemetry.bias
    if bias is None:
        return None if table.pose is None or table.pose.calibration else fixed_pose_from(table.pose), None
    own = hashlib.sha256(bias.model_dump_json(exclude={"calibration_id"}).encode()).hexdigest()
    return None, biases_from(bias, bias.calibration_id or f"sha256:{own}")


def with_calibration(station: StationConfig, path: Path) -> StationConfig:
    """A station with another calibration: a fixed camera takes its pose, a moving one its biases.

    Args:
        station: The station.
        path: A calibration file.

    Raises:
        ConfigError: The calibration file cannot be read, or lacks the pose or the biases that the station takes.
    """
    pipeline, is_fixed = station.pipeline, station.fixed_pose is not None
    camera, pose, biases, points = _calibrated(path, pipeline.camera, pipeline.model, is_fixed=is_fixed)
    pipeline = replace(pipeline, camera=camera, points={**pipeline.points, **points})
    with located(path):
        return with_derived_settings(replace(station, pipeline=pipeline, fixed_pose=pose, calibration=biases))


def _calibrated(
    path: Path, camera: Camera, model: ProjectionModel, *, is_fixed: bool
) -> tuple[Camera, FixedPose | None, Calibration | None, dict[str, KnownPoint]]:
    """Settings by a calibration file: a fixed camera takes its pose, a moving one its biases; both its landmarks.

    The camera comes with them where its lens was found too; biases alone hold in both projection models.
    """
    found = load_calibration(path)
    with located(path):
        if found.model is not model and (is_fixed or found.camera is not None):
            hint = f'set camera.model = "{found.model}", or calibrate with `model` {model}'
            raise ConfigError("a calibration of another model", got=found.model, expected=model, hint=hint)
        if is_fixed and found.pose is None:
            raise ConfigError("no pose in this calibration", got="[bias] alone", expected="[pose]")
        if not is_fixed and found.pose is not None:
            expected = "[bias] alone for a station with telemetry"
            raise ConfigError("a fixed camera's calibration", got="[pose]", expected=expected)
    return found.camera or camera, found.pose, None if is_fixed else found.biases, found.points


def with_derived_settings(station: StationConfig) -> StationConfig:
    """The station with ``pipeline.ground``, ``.level``, ``.fixed_pose`` and ``.config_id`` made anew from the rest.

    Args:
        station: The station.

    Raises:
        ConfigError: The ground lies on the map, and no one says where the station is; or it ends before the camera.
        InputError: The elevation model cannot be used.
    """
    pose, origin = station.fixed_pose, station.pipeline.origin
    place, *foot_m = (origin, 0.0, 0.0) if pose is None else place_in_enu(pose, origin)
    if station.ground is not None and station.ground.needs_place and place is None:
        key = "ground.terrain" if station.ground.terrain else "ground.point"
        expected = "station.origin = { lat_deg, lon_deg }" if pose is None else "pose.lat_deg and pose.lon_deg"
        raise ConfigError(key, got="no place on the map for the station", expected=expected)
    ground = enu_ground(station.ground, place, (foot_m[0], foot_m[1]))
    fixed = None if pose is None else pose_sample(pose, origin, ground)
    level = level_series(station.ground, Altitude(place or station.pipeline.origin))
    current = replace(station, pipeline=replace(station.pipeline, fixed_pose=fixed, ground=ground, level=level))
    return replace(current, pipeline=replace(current.pipeline, config_id=config_id(current)))


def config_id(station: StationConfig) -> str:
    """``sha256:...`` of what the numbers depend on: not of ports, folders, or where input comes from.

    Left out are outputs, and what the tables mark as ``NOT_IN_CONFIG_ID``. A telemetry calibration is left out too: a
    measurement names it by its own id. An elevation model counts with the hash of its bytes.
    """
    document = station_document(station)
    document = ConfigTable.without_marked({key: document[key] for key in document if key not in station.outputs})
    text = json.dumps(_as_numbers(document), sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


def _as_numbers(value: AnyValue) -> AnyValue:
    """Every number as the float that equals it: 50 m and 50.0 m are one height, and so are 0.0 and -0.0."""
    if isinstance(value, dict):
        return {key: _as_numbers(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_as_numbers(each) for each in value]
    return value + 0.0 if isinstance(value, int | float) and not isinstance(value, bool) else value


def resolved_toml(station: StationConfig, *, terrain_file: str | None = None) -> str:
    """One TOML text with camera, calibration and every default written out.

    Reading it with :func:`parse_station` gives the same settings to the last bit.

    Args:
        station: The station.
        terrain_file: What an elevation model's file is called beside the text; None for where it is now.
    """
    return tomli_w.dumps(station_document(station, terrain_file))


def station_document(station: StationConfig, terrain_file: str | None = None) -> dict[str, Any]:
    """The station as TOML keys; what is None is left out. ``terrain_file`` as in :func:`resolved_toml`."""
    pipeline, live = station.pipeline, station.live
    ground = station.ground
    if ground is not None and ground.terrain is not None and terrain_file is not None:
        ground = ground.model_copy(update={"terrain": terrain_file})
    if ground is not None and pipeline.level is not None and ground.level_datum is not None:
        zero = {"level_zero_m": pipeline.level.zero_m, "level_zero_std_m": pipeline.level.zero_std_m}
        ground = ground.model_copy(update={**zero, "altitude_datum": None})
    from_markers = {each.name for each in marker_landmarks(station.markers)}
    landmarks = () if live is None else tuple(each for each in live.landmarks if each.name not in from_markers)
    table = ConfigTable.from_si(
        station,
        pipeline,
        station=StationTable.from_si(pipeline),
        camera=StationCameraTable.from_contents(camera_document(pipeline.camera), model=pipeline.model),
        telemetry=None if pipeline.telemetry is None else _telemetry_table(pipeline.telemetry, station),
        ground=ground,
        images=images_table(station.images, pipeline.time_std_s),
        observations=ObservationsTable.from_si(station.observations, pipeline),
        limits=LimitsTable.from_si(pipeline),
        topics=None if station.topics == Topics() else TopicsTable.from_si(station.topics),
        known_point=tuple(
            KnownPointTable.from_si(each, name=name)
            for name, each in pipeline.points.items()
            if name not in _surveyed_points(live)
        )
        or None,
        landmark=None if live is None else tuple(map(LiveLandmarkTable.from_si, landmarks)),
        markers=None if station.markers is None else station_markers_table(station.markers),
    )
    inputs = ("station", "camera", "telemetry", "pose", "ground", "images", "observations", "limits")
    document = table.to_toml()
    return {key: document[key] for key in inputs if key in document} | outputs_document(station.outputs) | document


def _telemetry_table(settings: TelemetrySettings, station: StationConfig) -> TelemetryTable:
    """The table of how telemetry becomes a pose, with the station's link and the biases that it is corrected by."""
    table, calibration = TelemetryTable.from_si(settings, station.link), station.calibration
    if calibration is None:
        return table
    bias = bias_table(calibration, TelemetryBiasTable, calibration_id=calibration.id)
    return table.model_copy(update={"bias": bias})
