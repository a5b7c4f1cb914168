"""``aerodft measure --depth-map``: what the whole image sees of the ground, as arrays, pictures and maps."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import orjson

from aerodft.adapters.filetype import looks_like
from aerodft.adapters.georaster import write_top_view
from aerodft.adapters.images.pixels import StillPixels
from aerodft.cli.depth_figure import draw_depth
from aerodft.cli.output import print_json, say
from aerodft.dft.depth_map import DepthMap, depth_map
from aerodft.dft.measure import Setup
from aerodft.dft.orthophoto import Sampling, top_view
from aerodft.dft.points import to_ground_frame
from aerodft.errors import InputError, NoAnswerError, UsageError
from aerodft.geometry.geodesy import lat_lon
from aerodft.geometry.ground import Ground, Plane
from aerodft.geometry.outline import footprint, horizon_line, ring_area
from aerodft.geometry.terrain import Terrain
from aerodft.model.arrays import FloatArray, ImageArray
from aerodft.model.camera import Camera
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import Pose, PoseSample
from aerodft.model.status import Status

FARTHEST_HEIGHTS: Final = 100.0
"""Ground farther than so many camera heights is left out, unless the station says how far it may be.

It lies 0.6 degrees below the horizon, where 0.3 degrees of tilt are half of the range.
"""


@dataclass(frozen=True, slots=True)
class _Scene:
    camera: Camera
    pose: Pose
    sample: PoseSample
    ground: Ground | None
    elevation_m: float
    max_range_m: float
    seen: DepthMap


def write_depth(
    setup: Setup,
    sample: PoseSample,
    folder: Path,
    image: Path | None,
    *,
    as_json: bool,
    max_range_m: float | None = None,
    step_m: float | None = None,
) -> None:
    """Write depth.npz, depth.png, footprint.geojson and, with an image, its top view; say what was written.

    Args:
        setup: The camera and the ground; pinhole only.
        sample: The pose.
        folder: Made where it is not there.
        image: The image that was taken; None for no top view.
        as_json: Whether to print one JSON document.
        max_range_m: Farther ground is left out; None for the station's limit, or ``FARTHEST_HEIGHTS``.
        step_m: Side of the top view's pixels; None for the image's own sampling distance.

    Raises:
        UsageError: The paper's model was asked for, or a step without an image.
        NoAnswerError: There is no pose, or the image shows no ground.
        InputError: A length is not above 0, the image does not fit, or the folder cannot be written.
    """
    if step_m is not None and image is None:
        raise UsageError("--step without --image", expected="both: it is the side of the top view's pixels")
    for option, length_m in (("--max-range", max_range_m), ("--step", step_m)):
        if length_m is not None and not 0 < length_m < math.inf:
            raise InputError(option, got=f"{length_m:g}", expected="m, above 0")
    if setup.model is not ProjectionModel.PINHOLE:
        raise UsageError("--depth-map with --model dft", expected="the pinhole model")
    pixels = None if image is None else _read_image(image, setup.camera)
    scene = _scene(setup, sample, max_range_m)
    document = _document(scene)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write_arrays(scene, folder / "depth.npz")
        title = f"Slant range to {_in_words(document['ground'])}"
        draw_depth(scene.seen, horizon_line(scene.camera, scene.pose), title, folder / "depth.png")
        (folder / "footprint.geojson").write_bytes(_footprint(scene, document))
    except OSError as error:
        raise InputError(
            "the depth map cannot be written",
            where=folder,
            got=error.strerror or error,
            expected="a folder to write to",
        ) from error
    names = ["depth.npz", "depth.png", "footprint.geojson"]
    if pixels is not None:
        document["top_view"], more = _write_top_view(scene, pixels, step_m, folder)
        names += more
    document["files"] = [str(folder / name) for name in names]
    if as_json:
        print_json(document)
    else:
        _say(document)


def _read_image(path: Path, camera: Camera) -> ImageArray:
    expected = f"an image of {camera.width_px} x {camera.height_px} px"
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError("the image cannot be read", where=path, got=error.strerror, expected=expected) from error
    if not data:
        raise InputError("not a readable image", where=path, got=looks_like(path), expected=expected)
    pixels = StillPixels(data, str(path))()
    height, width = pixels.shape[:2]
    if (width, height) != (camera.width_px, camera.height_px):
        hint = f"--camera has to describe this very image: {camera.name} does not"
        raise InputError(
            "the image is not the camera's", where=path, got=f"{width} x {height} px", expected=expected, hint=hint
        )
    return pixels


def _scene(setup: Setup, sample: PoseSample, max_range_m: float | None) -> _Scene:
    if sample.pose is None or sample.status is not Status.OK:
        raise NoAnswerError("no pose", got=f"{sample.status}: {'; '.join(sample.reasons)}")
    pose = sample.pose
    ground: Ground | None = getattr(setup, "ground", None)
    elevation_m: float = getattr(setup, "elevation_m", 0.0)
    limit = setup.max_range_m if max_range_m is None else max_range_m
    if limit is None:
        limit = FARTHEST_HEIGHTS * _height_above(ground, elevation_m, pose)
    seen = depth_map(setup.camera, pose, elevation_m, limit, ground)
    if np.all(np.isnan(seen.range_m)):
        hint = "the camera looks too far up, or the ground is farther"
        raise NoAnswerError(
            "the image shows no ground",
            got=f"none within {limit:.0f} m",
            hint=f"{hint}, or the terrain ends before" if isinstance(ground, Terrain) else hint,
        )
    return _Scene(setup.camera, pose, sample, ground, elevation_m, limit, seen)


def _height_above(ground: Ground | None, elevation_m: float, pose: Pose) -> float:
    """Of the camera above the ground below it; above the elevation 0 where terrain has no height there."""
    camera_m, foot_m = float(pose.position_enu_m[2]), elevation_m
    if ground is not None:
        below_m = float(ground.height_at(pose.position_enu_m[:2]))
        foot_m += 0.0 if math.isnan(below_m) else below_m
    if camera_m <= foot_m:
        raise NoAnswerError("the camera is not above the ground", got=f"{camera_m:.2f} m over ground at {foot_m:.2f} m")
    return camera_m - foot_m


def _document(scene: _Scene) -> dict[str, Any]:
    seen = scene.seen
    lines = horizon_line(scene.camera, scene.pose)
    low, middle, high = np.nanquantile(seen.gsd_m, [0.0, 0.5, 1.0]).tolist()
    return {
        "schema": "aerodft.depth/1",
        "camera": scene.camera.name,
        "ground": _about_ground(scene.ground, scene.elevation_m),
        "max_range_m": scene.max_range_m,
        "ground_share": float(np.mean(~np.isnan(seen.range_m))),
        "range_m": [float(np.nanmin(seen.range_m)), float(np.nanmax(seen.range_m))],
        "z_m": [float(np.nanmin(seen.z_m)), float(np.nanmax(seen.z_m))],
        "gsd_m": {"min": low, "median": middle, "max": high},
        "horizon_px": [line.tolist() for line in lines] or None,
        "footprint_area_m2": None,
        "top_view": None,
        "notes": _notes(scene),
        "files": [],
    }


def _about_ground(ground: Ground | None, elevation_m: float) -> dict[str, Any]:
    about: dict[str, Any] = {"kind": "level", "elevation_m": elevation_m}
    if isinstance(ground, Plane):
        east, north, up = ground.normal_enu.tolist()
        uphill = math.degrees(math.atan2(-east, -north)) % 360.0
        slope = math.degrees(math.atan2(math.hypot(east, north), up))
        about |= {"kind": "slope", "slope_deg": slope, "uphill_deg": uphill}
    elif isinstance(ground, Terrain):
        about |= {"kind": "terrain", "cell_m": ground.grid.cell_m, "refraction": ground.refraction}
    return about


def _in_words(ground: dict[str, Any]) -> str:
    if ground["kind"] == "slope":
        words = f"ground that rises by {ground['slope_deg']:.3g} deg towards azimuth {ground['uphill_deg']:.3g} deg"
    elif ground["kind"] == "terrain":
        words = f"terrain of {ground['cell_m']:.3g} m cells"
    else:
        return f"level ground at {ground['elevation_m']:g} m" if ground["elevation_m"] else "level ground"
    return f"what is {ground['elevation_m']:g} m above {words}" if ground["elevation_m"] else words


def _notes(scene: _Scene) -> list[str]:
    if scene.ground is None:
        return []
    notes = ["gsd_m is the sampling of the surface itself, footprint_area_m2 the area on the map"]
    if isinstance(scene.ground, Terrain):
        notes.append("ground that is hidden from the camera is not cut out of the footprint")
    return notes


def _write_arrays(scene: _Scene, path: Path) -> None:
    seen = scene.seen
    east_m, north_m = seen.east_north_m()
    x_m, y_m, z_m = seen.x_m, seen.y_m, seen.z_m
    np.savez(path, range_m=seen.range_m, x_m=x_m, y_m=y_m, z_m=z_m, east_m=east_m, north_m=north_m, gsd_m=seen.gsd_m)


def _footprint(scene: _Scene, document: dict[str, Any]) -> bytes:
    """GeoJSON in WGS84 where the place is known, else in the ground frame; enters the area into the document."""
    corners = footprint(scene.camera, scene.pose, scene.max_range_m, scene.elevation_m, scene.ground)
    features = []
    if corners is None:
        document["notes"].append("footprint.geojson is empty: what the image shows of the ground has no outline")
    else:
        document["footprint_area_m2"] = ring_area(corners)
        ring = _places(scene, corners)
        properties = {"camera": scene.camera.name, "area_m2": ring_area(corners), "max_range_m": scene.max_range_m}
        if scene.sample.origin is None:
            properties["coordinates"] = "ground frame: X right, Y ahead of the camera, m"
        geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    collection = {"type": "FeatureCollection", "features": features}
    return orjson.dumps(collection, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)


def _places(scene: _Scene, corners_en_m: FloatArray) -> list[list[float]]:
    if scene.sample.origin is not None:
        return [[math.degrees(lon), math.degrees(lat)] for lat, lon in lat_lon(scene.sample.origin, corners_en_m)]
    points = np.concatenate([corners_en_m, np.zeros((len(corners_en_m), 1))], axis=-1)
    places: list[list[float]] = to_ground_frame(scene.pose, points)[:, :2].tolist()
    return places


def _write_top_view(
    scene: _Scene, pixels: ImageArray, step_m: float | None, folder: Path
) -> tuple[dict[str, Any], list[str]]:
    sampling = Sampling(step_m=step_m, max_range_m=scene.max_range_m)
    level_m, ground = scene.elevation_m, scene.ground
    view = top_view(pixels, scene.camera, scene.pose, sampling, elevation_m=level_m, ground=ground, seen=scene.seen)
    if view is None:
        raise NoAnswerError("the image shows no ground", where=folder)
    about = write_top_view(view, scene.sample.origin, folder)
    names: list[str] = about.pop("files")
    return about, names


def _say(document: dict[str, Any]) -> None:
    near, far = document["range_m"]
    gsd = document["gsd_m"]
    runs = [
        f"from ({line[0][0]:.1f}, {line[0][1]:.1f}) to ({line[-1][0]:.1f}, {line[-1][1]:.1f}) px"
        for line in document["horizon_px"] or ()
    ]
    horizon = f"the horizon runs {' and '.join(runs)}" if runs else "the horizon is not in view"
    say(
        f"{100 * document['ground_share']:.0f} % of the image shows ground, {near:.4g} to {far:.4g} m away, sampled"
        f" every {gsd['median']:.3g} m in the median ({gsd['min']:.3g} to {gsd['max']:.3g}); {horizon}"
    )
    if document["ground"]["kind"] != "level":
        low, high = document["z_m"]
        say(f"the ground: {_in_words(document['ground'])}; from {low:.4g} to {high:.4g} m high where it is seen")
    for note in document["notes"]:
        say(note)
    for file in document["files"]:
        say(f"wrote {file}")
