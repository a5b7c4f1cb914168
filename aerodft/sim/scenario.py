"""A simulated flight: trajectory, world, camera, telemetry and observers; and its files.

It is generated, or the motion in a recorded autopilot log is taken as the truth.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import orjson
import tomli_w

from aerodft.adapters.config.camera import camera_document
from aerodft.adapters.telemetry import TlogSource
from aerodft.adapters.telemetry.mavlink import MavlinkDecoder, headers
from aerodft.conventions import SECOND_NS
from aerodft.errors import InputError, NoAnswerError, os_errors_as
from aerodft.geometry import camera_from_gimbal, east_north, inverse, lat_lon, multiply, slerp
from aerodft.model import (
    NO_BOOT_TIME,
    Camera,
    ClockTrack,
    FloatArray,
    GeoOrigin,
    GimbalTrack,
    ImageArray,
    IntArray,
    PositionTrack,
    RawBlock,
    Track,
    VehicleTrack,
    concatenate_tracks,
)
from aerodft.service import brackets
from aerodft.sim.observations import ObserverModel, most_visible_stations, pose_document, sightings, write_lines
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.telemetry import Autopilot, Radio, datagrams, through_radio, write_tlog
from aerodft.sim.trajectory import Trajectory, heading_wxyz, survey
from aerodft.sim.video import write_video
from aerodft.sim.world import DEFAULT_ORIGIN, River, World, furnished_world

TrackT = TypeVar("TrackT", bound=Track)

MAX_GAP_NS = SECOND_NS


def trajectory_from_log(path: Path) -> Trajectory:
    """Trajectory of a telemetry log, at gimbal attitudes with position and vehicle attitude around them.

    Stamps are UTC: time since boot plus the median of SYSTEM_TIME. Heights are home-relative: the plane goes through
    home, the ENU origin.

    Raises:
        InputError: The file is missing, or not a telemetry log.
        NoAnswerError: The log lacks positions, vehicle attitudes, gimbal attitudes with their own time, or UTC.
    """
    tracks = _tracks_by_kind(path)
    clock = _track_of_kind(path, tracks, ClockTrack, "SYSTEM_TIME with UTC")
    position = _track_of_kind(path, tracks, PositionTrack, "GLOBAL_POSITION_INT")
    vehicle = _track_of_kind(path, tracks, VehicleTrack, "ATTITUDE")
    gimbal = _track_of_kind(path, tracks, GimbalTrack, "gimbal attitude")
    if NO_BOOT_TIME in gimbal.boot_ns:
        expected = "GIMBAL_DEVICE_ATTITUDE_STATUS or MOUNT_ORIENTATION"
        raise NoAnswerError(
            "its gimbal attitudes have no time of their own", where=path, got=gimbal.source, expected=expected
        )
    utc_minus_boot = int(np.median(clock.unix_ns - clock.boot_ns))
    around = [brackets(each.boot_ns, gimbal.boot_ns, MAX_GAP_NS) for each in (position, vehicle)]
    rows = np.flatnonzero((gimbal.boot_ns > 0) & around[0].is_known & around[1].is_known)
    if len(rows) < 2:  # noqa: PLR2004 (a motion has two ends)
        raise NoAnswerError("position, vehicle and gimbal attitude never come together", where=path)
    home, place = _home_and_positions(position)
    at_place, at_body = (each.rows(rows) for each in around)
    body = slerp(*at_body.ends(vehicle.wxyz), at_body.weight)
    heading, reported, in_earth = heading_wxyz(body), gimbal.wxyz[rows], gimbal.yaw_in_earth[rows]
    ned_wxyz_gimbal = np.where(in_earth[:, None], reported, multiply(heading, reported))
    return Trajectory(
        origin=home,
        stamp_ns=gimbal.boot_ns[rows] + utc_minus_boot,
        position_enu_m=np.column_stack([at_place.linear(each) for each in place.T]),
        ned_wxyz_body=body,
        level_wxyz_gimbal=multiply(inverse(heading), ned_wxyz_gimbal),
        enu_wxyz_cam=camera_from_gimbal(ned_wxyz_gimbal),
    )


def _tracks_by_kind(path: Path) -> dict[type, list[Track]]:
    """The log's tracks by kind."""
    tracks: defaultdict[type, list[Track]] = defaultdict(list)
    decoder = MavlinkDecoder()
    for event in TlogSource(path).events():
        if isinstance(event, RawBlock):
            for track in decoder.decode(event):
                tracks[type(track)].append(track)
    return tracks


def thin_log(source: Path, target: Path, *, keep_every: int) -> None:
    """Copy a telemetry log with every ``keep_every``-th frame of each message, and all of clock and heartbeat.

    Raises:
        InputError: The source is missing, or not a telemetry log.
    """
    always_kept = {0, 2}
    counts: Counter[int] = Counter()
    with target.open("wb") as file:
        for event in TlogSource(source).events():
            if not isinstance(event, RawBlock):
                continue
            rows = zip(event.arrival_ns, event.offset, event.length, headers(event)[0].tolist(), strict=True)
            for arrival, start, length, message in rows:
                counts[message] += 1
                if message in always_kept or (counts[message] - 1) % keep_every == 0:
                    file.write((int(arrival) // 1000).to_bytes(8, "big") + event.data[start : start + length])


def _track_of_kind(path: Path, tracks: dict[type, list[Track]], kind: type[TrackT], what: str) -> TrackT:
    """All rows of one kind (of its first source), ascending in time since boot, without duplicates."""
    parts = [track for track in tracks[kind] if isinstance(track, kind)]
    sources = [track.source for track in parts if isinstance(track, GimbalTrack)]
    parts = [track for track in parts if not isinstance(track, GimbalTrack) or track.source == sources[0]]
    if not parts:
        raise NoAnswerError("the log holds none", where=path, got="nothing", expected=what)
    whole = concatenate_tracks(parts)
    return whole.rows(np.unique(whole.boot_ns, return_index=True)[1])


def _home_and_positions(position: PositionTrack) -> tuple[GeoOrigin, FloatArray]:
    """Home (the first fix, at the datum of home-relative heights) and positions ``(n, 3)`` in its ENU."""
    home = GeoOrigin(
        lat_rad=float(position.lat_rad[0]),
        lon_rad=float(position.lon_rad[0]),
        alt_msl_m=float(position.alt_msl_m[0] - position.height_home_m[0]),
    )
    flat = east_north(home, position.lat_rad, position.lon_rad)
    return home, np.column_stack([flat, position.height_home_m])


EPOCH_NS = 1_795_221_278 * SECOND_NS
"""UTC at which generated flights start, unless they are live."""

STATIONS = 3
_CAMERA, _TRUTH = "camera.toml", "truth.jsonl"
_MAP_REACH_M, _MAP_STEP_M = 400.0, 2.0  # of the banks on the map
_EXPOSURE_SAMPLES = 5
_MIN_FLIGHT_HEIGHT_M = 5.0
_HOME_FROM_RIVER_M = 26.0

Progress = Callable[[int, int], None]
"""Called with the numbers of finished and of all images."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scenario:
    """All parameters of a simulated flight.

    Attributes:
        camera: The camera.
        world: The world.
        trajectory: The true motion.
        image_stamps_ns: ``(n,)`` stamps of the images, host UTC.
        fps: Nominal rate of the images.
        autopilot: Message rates and errors of the telemetry.
        radio: Delays and losses of the telemetry.
        imaging: The camera's sensor.
        exposure_ns: Exposure of an image, for motion blur; 0 is sharp.
        observing: The observer.
        log: Telemetry log that the trajectory is from; None for a generated flight.
        thin: Every how many frames of that log are kept.
    """

    camera: Camera
    world: World
    trajectory: Trajectory
    image_stamps_ns: IntArray
    fps: float
    autopilot: Autopilot = field(default_factory=Autopilot)
    radio: Radio = field(default_factory=Radio)
    imaging: SensorModel = field(default_factory=SensorModel)
    exposure_ns: int = 0
    observing: ObserverModel = field(default_factory=ObserverModel)
    log: Path | None = None
    thin: int = 1

    def shifted(self, by_ns: int) -> "Scenario":
        """The flight delayed by ``by_ns``."""
        return replace(self, trajectory=self.trajectory.shifted(by_ns), image_stamps_ns=self.image_stamps_ns + by_ns)

    def images(self) -> Iterator[tuple[int, ImageArray]]:
        """``(stamp_ns, (h, w, 3) uint8 BGR)`` of every image, rendered lazily."""
        renderer = Renderer(self.camera, self.world, self.imaging)
        for stamp in self.image_stamps_ns.tolist():
            yield stamp, self._render_image(renderer, stamp)

    def _render_image(self, renderer: Renderer, stamp_ns: int) -> ImageArray:
        """The image at a stamp, which is the middle of the exposure."""
        if self.exposure_ns == 0:
            time_s = (stamp_ns - self.trajectory.start_ns) / SECOND_NS
            return renderer.render(self.trajectory.pose(stamp_ns), time_s)
        offsets = np.linspace(-0.5, 0.5, _EXPOSURE_SAMPLES) * self.exposure_ns
        moments = [stamp_ns + round(offset) for offset in offsets.tolist()]
        times_s = [(moment - self.trajectory.start_ns) / SECOND_NS for moment in moments]
        return renderer.render_exposure([self.trajectory.pose(moment) for moment in moments], times_s)


def default_camera(width_px: int, height_px: int) -> Camera:
    """A camera 62 degrees wide with square pixels and mild distortion."""
    focal_px = width_px / 2 / float(np.tan(np.radians(31.0)))
    return Camera.of_focal(
        name=f"simulated {width_px}x{height_px}",
        width_px=width_px,
        height_px=height_px,
        focal_px=focal_px,
        distortion=(-0.08, 0.02, 0.0005, -0.0003, 0.0),
    )


def survey_scenario(
    camera: Camera, *, duration_s: float = 20.0, fps: float = 10.0, height_m: float = 40.0, seed: int = 1
) -> Scenario:
    """A survey flight along the default river from a home on its left bank."""
    river = River(origin_en_m=(0.0, -_HOME_FROM_RIVER_M))
    trajectory = survey(river, origin=DEFAULT_ORIGIN, duration_s=duration_s, height_m=height_m, start_ns=EPOCH_NS)
    step_ns = round(SECOND_NS / fps)
    stamps = np.arange(trajectory.start_ns, trajectory.end_ns, step_ns, dtype=np.int64)
    return _with_visible_stations(
        Scenario(
            camera=camera,
            world=furnished_world(river, seed=seed),
            trajectory=trajectory,
            image_stamps_ns=stamps,
            fps=fps,
            autopilot=Autopilot(seed=seed),
            radio=Radio(seed=seed),
            imaging=SensorModel(seed=seed),
            observing=ObserverModel(seed=seed),
        )
    )


def scenario_from_log(
    camera: Camera,
    log: Path,
    *,
    interval_s: tuple[float, float | None] = (0.0, None),
    fps: float | None = None,
    seed: int = 1,
    thin: int = 1,
    river: River | None = None,
) -> Scenario:
    """A recorded flight over a river, with an image at every gimbal sample.

    Args:
        camera: The camera.
        log: Telemetry log (.tlog).
        interval_s: Start after the log's first sample, and duration; None for the rest.
        fps: Approximate rate of images; None for one at every sample.
        seed: Seed of everything random.
        thin: Every how many of the log's frames are kept in the written log.
        river: The river, in ENU from home; None for one along the flight's ground track.

    Raises:
        InputError: The log cannot be read.
        NoAnswerError: The log has no flight, or none in this interval.
    """
    trajectory_of_log = trajectory_from_log(log)
    trajectory = _cut_interval(trajectory_of_log, interval_s, log)
    rate_hz = SECOND_NS / float(np.median(np.diff(trajectory.stamp_ns)))
    step = 1 if fps is None else max(round(rate_hz / fps), 1)
    scenario = Scenario(
        camera=camera,
        world=furnished_world(river or _along_track(trajectory_of_log), origin=trajectory_of_log.origin, seed=seed),
        trajectory=trajectory,
        image_stamps_ns=trajectory.stamp_ns[::step],
        fps=rate_hz / step,
        imaging=SensorModel(seed=seed),
        observing=ObserverModel(seed=seed),
        log=log,
        thin=thin,
    )
    return _with_visible_stations(scenario)


def _cut_interval(whole: Trajectory, interval_s: tuple[float, float | None], log: Path) -> Trajectory:
    start_s, duration_s = interval_s
    start_ns = whole.start_ns + round(start_s * SECOND_NS)
    end_ns = whole.end_ns + 1 if duration_s is None else start_ns + round(duration_s * SECOND_NS)
    trajectory = whole.cut(start_ns, end_ns)
    if len(trajectory.stamp_ns) < 2:  # noqa: PLR2004 (a motion has two ends)
        length_s = (whole.end_ns - whole.start_ns) / SECOND_NS
        raise NoAnswerError(
            "no flight in this interval", where=log, got=f"--start {start_s:g}", expected=f"0 to {length_s:.1f} s"
        )
    return trajectory


def _with_visible_stations(scenario: Scenario) -> Scenario:
    sample = scenario.image_stamps_ns[:: max(len(scenario.image_stamps_ns) // 200, 1)]
    stations = most_visible_stations(scenario.world, scenario.camera, scenario.trajectory, sample, STATIONS)
    return replace(scenario, observing=replace(scenario.observing, stations_m=stations))


def _along_track(trajectory: Trajectory) -> River:
    """A river along the main direction of the flight's ground track."""
    up = trajectory.position_enu_m[:, 2]
    track = trajectory.position_enu_m[up > min(_MIN_FLIGHT_HEIGHT_M, float(up.max())) - 1e-9, :2]
    middle = track.mean(axis=0)
    direction: FloatArray = np.linalg.svd(track - middle, full_matrices=False)[2][0]
    return River(
        origin_en_m=(float(middle[0]), float(middle[1])), azimuth_rad=float(np.arctan2(direction[0], direction[1]))
    )


def write_files(scenario: Scenario, folder: Path, *, video: bool = True, progress: Progress | None = None) -> None:
    """Write the flight's files.

    ``flight.tlog``, ``observations.jsonl``, ``truth.jsonl`` (the same probes without noise), ``poses.jsonl`` (every
    image's true pose), ``camera.toml``, ``world.geojson`` and, on request, ``video.mp4``.

    Raises:
        InputError: The folder holds a camera file that no simulation made, or cannot be written to.
    """
    if (folder / _CAMERA).exists() and not (folder / _TRUTH).exists():
        raise InputError("is no simulated flight", where=folder, got=f"a {_CAMERA} in it", hint="choose another folder")
    with os_errors_as("cannot be written", where=folder, hint="choose another folder"):
        folder.mkdir(parents=True, exist_ok=True)
        _write_tables(scenario, folder)
        if video:
            write_video(folder / "video.mp4", images_with_progress(scenario, progress), fps=scenario.fps)


def _write_tables(scenario: Scenario, folder: Path) -> None:
    """Write all files but the video."""
    world, trajectory, stamps_ns = scenario.world, scenario.trajectory, scenario.image_stamps_ns.tolist()
    if scenario.log is None:
        received = through_radio(datagrams(trajectory, scenario.autopilot), scenario.radio)
        write_tlog(folder / "flight.tlog", received)
    else:
        thin_log(scenario.log, folder / "flight.tlog", keep_every=scenario.thin)
    all_sightings = list(sightings(world, scenario.camera, trajectory, stamps_ns, scenario.observing))
    write_lines(folder / "observations.jsonl", (each.observation_line() for each in all_sightings))
    write_lines(folder / _TRUTH, (each.truth_line() for each in all_sightings))
    poses = ({"stamp_ns": str(stamp), "pose": pose_document(trajectory.pose(stamp))} for stamp in stamps_ns)
    write_lines(folder / "poses.jsonl", map(orjson.dumps, poses))
    (folder / _CAMERA).write_text(tomli_w.dumps(camera_document(scenario.camera)))
    (folder / "world.geojson").write_bytes(orjson.dumps(_world_document(world), option=orjson.OPT_INDENT_2))


def images_with_progress(scenario: Scenario, progress: Progress | None) -> Iterator[tuple[int, ImageArray]]:
    """The images of ``scenario``; ``progress`` is called after each."""
    total = len(scenario.image_stamps_ns)
    for done, image in enumerate(scenario.images()):
        yield image
        if progress is not None:
            progress(done + 1, total)


def _world_document(world: World) -> dict[str, Any]:
    """A GeoJSON FeatureCollection whose member ``origin`` is the ENU origin."""
    along = np.arange(-_MAP_REACH_M, _MAP_REACH_M + _MAP_STEP_M, _MAP_STEP_M)
    features = [
        _feature(world, name, "LineString", world.river.enu(along, across))
        for name, across in zip(("bank-left", "bank-right"), world.river.banks_m(along), strict=True)
    ]
    for index, island in enumerate(world.river.islands):
        stations = island.station_m + island.length_m * np.linspace(-0.499, 0.499, 41)
        left, right = (world.river.enu(stations, across) for across in world.river.shores_m(stations))
        features.append(_feature(world, f"island-{index}", "LineString", np.concatenate([left, right[::-1], left[:1]])))
    for marker in world.markers:
        properties = {"side_m": marker.side_m, "corners_enu_m": marker.corners_enu_m().tolist()}
        features.append(_feature(world, f"marker-{marker.id}", "Point", marker.centre_enu_m, properties))
    features += [
        _feature(world, post.name, "Point", post.ends_enu_m()[0], {"height_m": post.height_m}) for post in world.posts
    ]
    origin = world.origin
    return {
        "type": "FeatureCollection",
        "origin": {
            "lat_deg": math.degrees(origin.lat_rad),
            "lon_deg": math.degrees(origin.lon_rad),
            "alt_msl_m": origin.alt_msl_m,
        },
        "features": features,
    }


def _feature(
    world: World, name: str, kind: str, points_enu_m: FloatArray, properties: dict[str, Any] | None = None
) -> dict[str, Any]:
    """A GeoJSON feature: a line of points ``(n, 3)`` or a point ``(3,)``, at longitude and latitude (deg)."""
    coordinates = np.degrees(lat_lon(world.origin, points_enu_m[..., :2]))[..., ::-1].tolist()
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": {"name": name, "enu_m": points_enu_m.tolist(), **(properties or {})},
    }
