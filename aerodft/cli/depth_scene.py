"""What ``aerodft measure --depth-map`` is about: one image's pixels on the ground, and how they are described."""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from aerodft.cli.output import say
from aerodft.dft.depth_map import DepthMap, depth_map, measured_plane
from aerodft.dft.depth_spread import range_std
from aerodft.dft.judging import MAX_RELATIVE_RANGE_STD
from aerodft.dft.request import Setup
from aerodft.errors import NoAnswerError
from aerodft.geometry.dense import Float32Array
from aerodft.geometry.ground import Ground, Plane
from aerodft.geometry.intrinsics import intrinsics_covariance
from aerodft.geometry.outline import horizon_line
from aerodft.geometry.terrain import Terrain
from aerodft.model.camera import Camera
from aerodft.model.pose import Pose, PoseSample
from aerodft.model.status import Status

FARTHEST_HEIGHTS: Final = 100.0
"""Ground farther than so many camera heights is left out, unless it is said how far it may be.

It lies 0.6 degrees below the horizon, where 0.3 degrees of tilt are half of the range.
"""

_TERRAIN_STD = "range_std_m is known on level and tilted ground only"


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One image's pixels on the ground.

    Attributes:
        camera: The camera.
        pose: Its pose.
        sample: The same, with where it came from.
        ground: None for level ground.
        elevation_m: Height of level ground, or above ``ground``.
        max_range_m: Farther ground is left out.
        seen: What every pixel sees.
        range_std_m: ``(height, width)``; None on terrain, and where all is taken as exact.
    """

    camera: Camera
    pose: Pose
    sample: PoseSample
    ground: Ground | None
    elevation_m: float
    max_range_m: float
    seen: DepthMap
    range_std_m: Float32Array | None


def scene_of(setup: Setup, sample: PoseSample, max_range_m: float | None) -> Scene:
    """What the image shows of the ground.

    Args:
        setup: The camera and the ground; pinhole only.
        sample: The pose.
        max_range_m: None for the station's limit, or ``FARTHEST_HEIGHTS``.

    Raises:
        NoAnswerError: There is no pose, the camera is not above the ground, or the image shows no ground.
    """
    if sample.pose is None or sample.status is not Status.OK:
        raise NoAnswerError("no pose", got=f"{sample.status}: {'; '.join(sample.reasons)}")
    camera, pose, ground, elevation_m = setup.camera, sample.pose, setup.ground, setup.elevation_m
    limit = setup.max_range_m if max_range_m is None else max_range_m
    height = _height_above(ground, elevation_m, pose)
    limit = FARTHEST_HEIGHTS * height if limit is None else limit
    seen = depth_map(camera, pose, elevation_m, limit, ground)
    if np.all(np.isnan(seen.range_m)):
        hint = "the camera looks too far up, or the ground is farther"
        raise NoAnswerError(
            "the image shows no ground",
            got=f"none within {limit:.0f} m",
            hint=f"{hint}, or the terrain ends before" if isinstance(ground, Terrain) else hint,
        )
    std_m = None
    uncertain = np.any(pose.cov) or pose.time_std_s or np.any(intrinsics_covariance(camera))
    if uncertain and (ground is None or isinstance(ground, Plane)):
        std_m = range_std(camera, pose, measured_plane(ground, elevation_m), setup.elevation_std_m)
        std_m[np.isnan(seen.range_m)] = np.nan
    return Scene(
        camera=camera,
        pose=pose,
        sample=sample,
        ground=ground,
        elevation_m=elevation_m,
        max_range_m=limit,
        seen=seen,
        range_std_m=std_m,
    )


def _height_above(ground: Ground | None, elevation_m: float, pose: Pose) -> float:
    """Of the camera above the ground below it; above the elevation 0 where terrain has no height there."""
    camera_m, foot_m = float(pose.position_enu_m[2]), elevation_m
    if ground is not None:
        below_m = float(ground.height_at(pose.position_enu_m[:2]))
        foot_m += 0.0 if math.isnan(below_m) else below_m
    if camera_m <= foot_m:
        raise NoAnswerError("the camera is not above the ground", got=f"{camera_m:.2f} m over ground at {foot_m:.2f} m")
    return camera_m - foot_m


def describe(scene: Scene) -> dict[str, Any]:
    """The JSON document, before anything is written."""
    seen = scene.seen
    lines = horizon_line(scene.camera, scene.pose)
    return {
        "schema": "aerodft.depth/1",
        "camera": scene.camera.name,
        "ground": _about_ground(scene.ground, scene.elevation_m),
        "max_range_m": scene.max_range_m,
        "ground_share": float(np.mean(~np.isnan(seen.range_m))),
        "range_m": [float(np.nanmin(seen.range_m)), float(np.nanmax(seen.range_m))],
        "range_std_m": None if scene.range_std_m is None else _about_std(scene.range_std_m, seen.range_m),
        "z_m": [float(np.nanmin(seen.z_m)), float(np.nanmax(seen.z_m))],
        "gsd_m": _spread(seen.gsd_m),
        "horizon_px": [line.tolist() for line in lines] or None,
        "footprint_area_m2": None,
        "top_view": None,
        "notes": _notes(scene),
        "files": [],
    }


def _spread(values: Float32Array) -> dict[str, float]:
    low, middle, high = np.nanquantile(values, [0.0, 0.5, 1.0]).tolist()
    return {"min": low, "median": middle, "max": high}


def _about_std(std_m: Float32Array, range_m: Float32Array) -> dict[str, float]:
    with np.errstate(invalid="ignore"):
        ill = std_m > MAX_RELATIVE_RANGE_STD * range_m
    return {**_spread(std_m), "ill_conditioned_share": float(np.mean(ill[~np.isnan(range_m)]))}


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


def _notes(scene: Scene) -> list[str]:
    notes = [] if scene.range_std_m is None else list(scene.sample.reasons)
    if scene.ground is not None:
        notes.append("gsd_m is the sampling of the surface itself, footprint_area_m2 the area on the map")
    if isinstance(scene.ground, Terrain):
        notes += ["ground that is hidden from the camera is not cut out of the footprint", _TERRAIN_STD]
    return notes


def ground_in_words(ground: dict[str, Any]) -> str:
    """The document's ``ground`` as people say it."""
    if ground["kind"] == "slope":
        words = f"ground that rises by {ground['slope_deg']:.3g} deg towards azimuth {ground['uphill_deg']:.3g} deg"
    elif ground["kind"] == "terrain":
        words = f"terrain of {ground['cell_m']:.3g} m cells"
    else:
        return f"level ground at {ground['elevation_m']:g} m" if ground["elevation_m"] else "level ground"
    return f"what is {ground['elevation_m']:g} m above {words}" if ground["elevation_m"] else words


def say_document(document: dict[str, Any]) -> None:
    """Say the document to people."""
    near, far = document["range_m"]
    gsd, std = document["gsd_m"], document["range_std_m"]
    runs = [
        f"from ({line[0][0]:.1f}, {line[0][1]:.1f}) to ({line[-1][0]:.1f}, {line[-1][1]:.1f}) px"
        for line in document["horizon_px"] or ()
    ]
    horizon = f"the horizon runs {' and '.join(runs)}" if runs else "the horizon is not in view"
    say(
        f"{100 * document['ground_share']:.0f} % of the image shows ground, {near:.4g} to {far:.4g} m away, sampled"
        f" every {gsd['median']:.3g} m in the median ({gsd['min']:.3g} to {gsd['max']:.3g}); {horizon}"
    )
    if std is not None:
        say(
            f"its range is known to {std['median']:.3g} m in the median ({std['min']:.3g} to {std['max']:.3g}); for"
            f" {100 * std['ill_conditioned_share']:.3g} % of it to worse than {100 * MAX_RELATIVE_RANGE_STD:.0f} %"
        )
    if document["ground"]["kind"] != "level":
        low, high = document["z_m"]
        say(f"{ground_in_words(document['ground'])}; from {low:.4g} to {high:.4g} m high where it is seen")
    for note in document["notes"]:
        say(note)
    for file in document["files"]:
        say(f"wrote {file}")
