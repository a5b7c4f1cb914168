"""``aerodft measure --depth-map``: what the whole image sees of the ground, as arrays, pictures and maps."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from aerodft.adapters.georaster import write_top_view
from aerodft.adapters.images.pixels import read_camera_image
from aerodft.cli.depth_figure import draw_depth
from aerodft.cli.depth_scene import Scene, describe, ground_in_words, say_document, scene_of
from aerodft.cli.output import print_json, say
from aerodft.dft.orthophoto import Sampling, top_view
from aerodft.dft.points import to_ground_frame
from aerodft.dft.request import Setup
from aerodft.errors import InputError, NoAnswerError, UsageError
from aerodft.geometry.geodesy import lat_lon
from aerodft.geometry.outline import footprint, horizon_line, ring_area
from aerodft.model.arrays import FloatArray, ImageArray
from aerodft.model.measurement import ProjectionModel
from aerodft.model.pose import PoseSample


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
        step_m: Side of the top view's pixels, where there is one; None for the image's own sampling distance.

    Raises:
        UsageError: The paper's model was asked for.
        NoAnswerError: There is no pose, or the image shows no ground.
        InputError: The step is not above 0, the image does not fit, or the folder cannot be written.
    """
    if step_m is not None and not 0 < step_m < math.inf:
        raise InputError("--step", got=f"{step_m:g}", expected="m, above 0")
    if setup.model is not ProjectionModel.PINHOLE:
        raise UsageError("--depth-map with --model dft", expected="the pinhole model")
    hint = f"--camera has to describe this very image: {setup.camera.name} does not"
    pixels = None if image is None else read_camera_image(image, setup.camera, hint)
    scene = scene_of(setup, sample, max_range_m)
    document = describe(scene)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write_arrays(scene, folder / "depth.npz")
        title = f"Slant range to {ground_in_words(document['ground'])}"
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
        say_document(document)


def _write_arrays(scene: Scene, path: Path) -> None:
    seen = scene.seen
    east_m, north_m = seen.east_north_m()
    arrays: dict[str, Any] = {
        "range_m": seen.range_m,
        "x_m": seen.x_m,
        "y_m": seen.y_m,
        "z_m": seen.z_m,
        "east_m": east_m,
        "north_m": north_m,
        "gsd_m": seen.gsd_m,
    }
    if scene.range_std_m is not None:
        arrays["range_std_m"] = scene.range_std_m
    np.savez(path, **arrays)


def _footprint(scene: Scene, document: dict[str, Any]) -> bytes:
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


def _places(scene: Scene, corners_en_m: FloatArray) -> list[list[float]]:
    if scene.sample.origin is not None:
        return [[math.degrees(lon), math.degrees(lat)] for lat, lon in lat_lon(scene.sample.origin, corners_en_m)]
    points = np.concatenate([corners_en_m, np.zeros((len(corners_en_m), 1))], axis=-1)
    places: list[list[float]] = to_ground_frame(scene.pose, points)[:, :2].tolist()
    return places


def _write_top_view(
    scene: Scene, pixels: ImageArray, step_m: float | None, folder: Path
) -> tuple[dict[str, Any], list[str]]:
    sampling = Sampling(step_m=step_m, max_range_m=scene.max_range_m)
    level_m, ground = scene.elevation_m, scene.ground
    view = top_view(pixels, scene.camera, scene.pose, sampling, elevation_m=level_m, ground=ground, seen=scene.seen)
    if view is None:
        raise NoAnswerError("the image shows no ground", where=folder)
    if step_m is not None and view.step_m > step_m:
        say(f"aerodft: --step {step_m:g} would make too large an image: it is {view.step_m:.4g} m instead")
    about = write_top_view(view, scene.sample.origin, folder)
    names: list[str] = about.pop("files")
    return about, names
