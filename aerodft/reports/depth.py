"""What a whole image sees of the ground, as arrays, pictures and maps: a folder of files."""

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import cv2
import matplotlib as mpl
import numpy as np
import orjson
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from pyproj import CRS, Transformer

from aerodft.adapters.files import output_folder
from aerodft.adapters.images import read_camera_image
from aerodft.dft import MAX_RELATIVE_RANGE_STD, Setup, to_ground_frame
from aerodft.dft.maps import DepthMap, Sampling, TopView, Z, depth_map, plane_at_elevation, range_std, top_view
from aerodft.errors import InputError, NoAnswerError, Reason, UsageError, os_errors_as
from aerodft.geometry import (
    Float32Array,
    Ground,
    Plane,
    Terrain,
    footprint,
    horizon_line,
    intrinsics_covariance,
    lat_lon,
    ring_area,
)
from aerodft.model import FloatArray, GeoOrigin, ImageArray, Pose, PoseSample, ProjectionModel, Status
from aerodft.reports.style import RED, styled

_LOG: Final = logging.getLogger(__name__)
_JSON: Final = orjson.OPT_APPEND_NEWLINE | orjson.OPT_INDENT_2
_MAP, _LOCAL_MAP = "footprint.geojson", "footprint_local.json"
_LOCAL: Final = {
    "schema": "aerodft.footprint_local/1",
    "unit": "m",
    "axes": "X right, Y ahead of the camera, from the ground below it",
}

FARTHEST_HEIGHTS: Final = 100.0
"""Ground farther than so many camera heights is left out where the setup has no maximum range.

It lies 0.6 degrees below the horizon, where 0.3 degrees of tilt are half of the range.
"""

_TERRAIN_STD = "range_std_m is known on level and tilted ground only"

_WIDTH_IN, _DPI = 10.0, 120
_MOST_PX = 2000  # columns that are drawn; a picture has no room for more
_CONTOURS = 8  # of the ground's height, at most
_LOG_FROM: Final = 8.0  # ratio of the ranges' ends from which equal factors, not equal metres, get equal colours

_SOUTHERNMOST_DEG, _NORTHERNMOST_DEG = -80.0, 84.0  # of UTM; the polar caps have a projection of their own
_UPS_SOUTH, _UPS_NORTH = 32761, 32661
_UTM_SOUTH, _UTM_NORTH = 32700, 32600
_FIT_POINTS: Final = 5  # on each side of the view


@dataclass(frozen=True, slots=True)
class _Scene:
    """One image's pixels on the ground.

    Attributes:
        setup: The camera, and the measured surface.
        sample: The pose, with where it came from.
        pose: The pose.
        max_range_m: Farther ground is left out.
        seen: What every pixel sees.
        range_std_m: ``(height, width)``; None on terrain, and where all is taken as exact.
    """

    setup: Setup
    sample: PoseSample
    pose: Pose
    max_range_m: float
    seen: DepthMap
    range_std_m: Float32Array | None


def _scene_of(setup: Setup, sample: PoseSample) -> _Scene:
    """Depth map of an image, with stds where these are known.

    Raises:
        NoAnswerError: There is no pose, the camera is not above the ground, or the image shows no ground.
    """
    if sample.pose is None or sample.status is not Status.OK:
        raise NoAnswerError("no pose", got=Reason(f"{sample.status}: {'; '.join(sample.reasons)}"))
    camera, pose, ground, elevation_m = setup.camera, sample.pose, setup.ground, setup.elevation_m
    height = _height_above(ground, elevation_m, pose)
    limit = FARTHEST_HEIGHTS * height if setup.max_range_m is None else setup.max_range_m
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
        std_m = range_std(camera, pose, plane_at_elevation(ground, elevation_m), setup.surface_std_m)
        std_m[np.isnan(seen.range_m)] = np.nan
    return _Scene(setup, sample, pose, limit, seen, std_m)


def _height_above(ground: Ground | None, elevation_m: float, pose: Pose) -> float:
    """Height of the camera above the ground below it; above elevation 0 where terrain has no height there."""
    camera_m, foot_m = float(pose.position_enu_m[2]), elevation_m
    if ground is not None:
        below_m = float(ground.height_at(pose.position_enu_m[:2]))
        foot_m += 0.0 if math.isnan(below_m) else below_m
    if camera_m <= foot_m:
        raise NoAnswerError("the camera is not above the ground", got=f"{camera_m:.2f} m over ground at {foot_m:.2f} m")
    return camera_m - foot_m


def _describe(scene: _Scene) -> dict[str, Any]:
    """The JSON document, before anything is written."""
    seen = scene.seen
    lines = horizon_line(scene.setup.camera, scene.pose)
    return {
        "schema": "aerodft.depth/1",
        "camera": scene.setup.camera.name,
        "ground": _about_ground(scene.setup.ground, scene.setup.elevation_m),
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


def _notes(scene: _Scene) -> list[str]:
    notes = [] if scene.range_std_m is None else list(scene.sample.reasons)
    if scene.setup.ground is not None:
        notes.append("gsd_m is the sampling of the surface itself, footprint_area_m2 the area on the map")
    if isinstance(scene.setup.ground, Terrain):
        notes += ["ground that is hidden from the camera is not cut out of the footprint", _TERRAIN_STD]
    return notes


def _ground_sentence(ground: dict[str, Any]) -> str:
    """The document's ``ground`` as people say it."""
    if ground["kind"] == "slope":
        words = f"ground that rises by {ground['slope_deg']:.3g} deg towards azimuth {ground['uphill_deg']:.3g} deg"
    elif ground["kind"] == "terrain":
        words = f"terrain of {ground['cell_m']:.3g} m cells"
    else:
        return f"level ground at {ground['elevation_m']:g} m" if ground["elevation_m"] else "level ground"
    return f"what is {ground['elevation_m']:g} m above {words}" if ground["elevation_m"] else words


def depth_sentences(document: dict[str, Any]) -> Iterator[str]:
    """The document of ``write_depth`` for people, a sentence each."""
    near, far = document["range_m"]
    gsd, std = document["gsd_m"], document["range_std_m"]
    runs = [
        f"from ({line[0][0]:.1f}, {line[0][1]:.1f}) to ({line[-1][0]:.1f}, {line[-1][1]:.1f}) px"
        for line in document["horizon_px"] or ()
    ]
    horizon = f"the horizon runs {' and '.join(runs)}" if runs else "the horizon is not in view"
    yield (
        f"{100 * document['ground_share']:.0f} % of the image shows ground, {near:.4g} to {far:.4g} m away, sampled"
        f" every {gsd['median']:.3g} m in the median ({gsd['min']:.3g} to {gsd['max']:.3g}); {horizon}"
    )
    if std is not None:
        yield (
            f"its range is known to {std['median']:.3g} m in the median ({std['min']:.3g} to {std['max']:.3g}); for"
            f" {100 * std['ill_conditioned_share']:.3g} % of it to worse than {100 * MAX_RELATIVE_RANGE_STD:.0f} %"
        )
    if document["ground"]["kind"] != "level":
        low, high = document["z_m"]
        yield f"{_ground_sentence(document['ground'])}; from {low:.4g} to {high:.4g} m high where it is seen"
    yield from document["notes"]
    yield from (f"wrote {file}" for file in document["files"])


def write_depth(
    setup: Setup, sample: PoseSample, folder: Path, image: Path | None, step_m: float | None = None
) -> dict[str, Any]:
    """Write depth.npz, depth.png, the footprint and, with an image, its top view.

    The footprint is footprint.geojson in WGS84; where nobody said where the camera stands, footprint_local.json in
    metres, as GeoJSON has none.

    Args:
        setup: The camera, the ground and the maximum range, without which ``FARTHEST_HEIGHTS`` counts; pinhole only.
        sample: The pose.
        folder: Made where it is not there.
        image: The image that was taken; None for no top view.
        step_m: Side of the top view's pixels, where there is one; None for the image's own sampling distance.

    Returns:
        The JSON document that says what was written.

    Raises:
        UsageError: The model is the paper's.
        NoAnswerError: There is no pose, or the image shows no ground.
        InputError: The step is not above 0, the image does not fit, or the folder cannot be written.
    """
    if step_m is not None and not 0 < step_m < math.inf:
        raise InputError("`step_m`", got=f"{step_m:g}", expected="m, above 0")
    if setup.model is not ProjectionModel.PINHOLE:
        raise UsageError("a depth map with `model` dft", expected="the pinhole model")
    hint = f"`camera` has to describe this very image: {setup.camera.name} does not"
    pixels = None if image is None else read_camera_image(image, setup.camera, hint)
    scene = _scene_of(setup, sample)
    document = _describe(scene)
    with output_folder(folder, "the depth map"):
        _write_arrays(scene, folder / "depth.npz")
        title = f"Slant range to {_ground_sentence(document['ground'])}"
        _draw_depth(scene.seen, horizon_line(scene.setup.camera, scene.pose), title, folder / "depth.png")
        map_name = _LOCAL_MAP if scene.sample.origin is None else _MAP
        (folder / map_name).write_bytes(_footprint(scene, document, map_name))
    names = ["depth.npz", "depth.png", map_name]
    if pixels is not None:
        document["top_view"] = _write_top_view(scene, pixels, step_m, folder)
        names += document["top_view"].pop("files")
    document["files"] = [str(folder / name) for name in names]
    return document


def _write_arrays(scene: _Scene, path: Path) -> None:
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


def _footprint(scene: _Scene, document: dict[str, Any], name: str) -> bytes:
    """GeoJSON in WGS84 where the place is known, else in the ground frame; enters the area into the document."""
    corners = footprint(scene.setup.camera, scene.pose, scene.max_range_m, scene.setup.elevation_m, scene.setup.ground)
    features = []
    if corners is None:
        document["notes"].append(f"{name} is empty: what the image shows of the ground has no outline")
    else:
        document["footprint_area_m2"] = ring_area(corners)
        ring = _places(scene, corners)
        properties = {
            "camera": scene.setup.camera.name,
            "area_m2": ring_area(corners),
            "max_range_m": scene.max_range_m,
        }
        geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    head = _LOCAL if scene.sample.origin is None else {"type": "FeatureCollection"}
    return orjson.dumps({**head, "features": features}, option=_JSON)


def _places(scene: _Scene, corners_en_m: FloatArray) -> list[list[float]]:
    if scene.sample.origin is not None:
        return [[math.degrees(lon), math.degrees(lat)] for lat, lon in lat_lon(scene.sample.origin, corners_en_m)]
    points = np.concatenate([corners_en_m, np.zeros((len(corners_en_m), 1))], axis=-1)
    places: list[list[float]] = to_ground_frame(scene.pose, points)[:, :2].tolist()
    return places


def _write_top_view(scene: _Scene, pixels: ImageArray, step_m: float | None, folder: Path) -> dict[str, Any]:
    setup, sampling = scene.setup, Sampling(step_m=step_m, max_range_m=scene.max_range_m)
    view = top_view(
        pixels, setup.camera, scene.pose, sampling, elevation_m=setup.elevation_m, ground=setup.ground, seen=scene.seen
    )
    if view is None:
        raise NoAnswerError("the image shows no ground", where=folder)
    if step_m is not None and view.step_m > step_m:
        _LOG.warning("`step_m` %g would make too large an image: it is %.4g m instead", step_m, view.step_m)
    return write_top_view(view, scene.sample.origin, folder)


@styled()
def _draw_depth(seen: DepthMap, horizon_px: tuple[FloatArray, ...], title: str, path: Path) -> None:
    """Draw slant ranges, misses in grey, with the horizon's polylines."""
    height, width = seen.range_m.shape
    step = max(1, width // _MOST_PX)
    range_m = seen.range_m[::step, ::step]
    near, far = float(np.nanmin(range_m)), float(np.nanmax(range_m))
    norm = LogNorm(near, far) if far > _LOG_FROM * near else Normalize(near, far)
    colours = mpl.colormaps["viridis_r"].with_extremes(bad="0.8")
    figure = Figure(figsize=(_WIDTH_IN, 1.0 + 0.82 * _WIDTH_IN * height / width))
    axes = figure.subplots()
    axes.grid(visible=False)
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    drawn = axes.imshow(range_m, cmap=colours, norm=norm, extent=extent, interpolation="nearest")
    if len(seen.planes) > Z:
        _draw_heights(axes, seen.z_m[::step, ::step], step)
    for line in horizon_px:
        axes.plot(line[:, 0], line[:, 1], color=RED, linewidth=1.5, label="horizon")
    if horizon_px:
        axes.legend(handles=axes.lines[:1], loc="lower right", fontsize="small")
    axes.set(xlabel="u (px)", ylabel="v (px)", title=title, xlim=extent[:2], ylim=extent[2:])
    bar = axes.inset_axes((1.02, 0.0, 0.025, 1.0))
    figure.colorbar(drawn, cax=bar, label="slant range (m)", format="{x:g}")
    figure.savefig(path, dpi=_DPI, bbox_inches="tight")


def _draw_heights(axes: Axes, z_m: Float32Array, step: int) -> None:
    """Contour lines of the ground's height, at round numbers; along the top of what hides lower ground they meet."""
    low, high = float(np.nanmin(z_m)), float(np.nanmax(z_m))
    levels = [level for level in MaxNLocator(_CONTOURS).tick_values(low, high) if low < level < high]
    if levels:
        rows, columns = (step * np.arange(count) for count in z_m.shape)
        lines = axes.contour(columns, rows, z_m, levels=levels, colors="black", linewidths=0.6, alpha=0.6)
        axes.clabel(lines, fmt="%g m", fontsize="x-small")


@dataclass(frozen=True, slots=True)
class Georeference:
    """Place of a view on the map.

    Attributes:
        crs: Its coordinate reference system; None for the station's own east and north in metres.
        affine: ``(2, 3)``: from column and row (integers at the pixels' *corners*) to x and y of it.
        misfit_m: The largest distance of a pixel from where the affine map has it.
    """

    crs: CRS | None
    affine: FloatArray
    misfit_m: float


def map_projection(origin: GeoOrigin) -> CRS:
    """The UTM zone of a place by its longitude (on WGS84); near the poles UPS."""
    lat_deg, lon_deg = math.degrees(origin.lat_rad), math.degrees(origin.lon_rad)
    if lat_deg > _NORTHERNMOST_DEG:
        return CRS.from_epsg(_UPS_NORTH)
    if lat_deg < _SOUTHERNMOST_DEG:
        return CRS.from_epsg(_UPS_SOUTH)
    zone = int((lon_deg + 180.0) // 6.0) % 60 + 1
    return CRS.from_epsg((_UTM_SOUTH if lat_deg < 0 else _UTM_NORTH) + zone)


def georeference(view: TopView, origin: GeoOrigin | None) -> Georeference:
    """Place of a view on the map; without an origin in the station's own east and north."""
    local = np.array([[view.step_m, 0.0, view.west_m], [0.0, -view.step_m, view.north_m]])
    if origin is None:
        return Georeference(None, local, 0.0)
    crs = map_projection(origin)
    height, width = view.pixels.shape[:2]
    column, row = np.meshgrid(np.linspace(0, width, _FIT_POINTS), np.linspace(0, height, _FIT_POINTS))
    places = np.stack([column.ravel(), row.ravel(), np.ones(column.size)], axis=-1)
    lat, lon = np.degrees(lat_lon(origin, places @ local.T)).T
    xy = np.stack(Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(lon, lat), axis=-1)
    centre = xy.mean(axis=0)  # millions of metres beside centimetres
    affine = np.linalg.lstsq(places, xy - centre, rcond=None)[0].T
    misfit = np.linalg.norm(places @ affine.T - (xy - centre), axis=-1)
    affine[:, 2] += centre
    return Georeference(crs, affine, float(misfit.max()))


def write_top_view(view: TopView, origin: GeoOrigin | None, folder: Path) -> dict[str, Any]:
    """Write ``topview.png`` with ``.pgw`` and ``.json``; with an origin also ``.prj`` and, if it can be, ``.tif``.

    Args:
        view: The view.
        origin: The station's ENU origin; None where its place is not known.
        folder: An existing folder.

    Returns:
        What ``topview.json`` says, with ``files``: their names.

    Raises:
        InputError: They cannot be written.
    """
    place = georeference(view, origin)
    files = {"topview.png": _png(view, folder), "topview.pgw": _world_file(place.affine)}
    if place.crs is not None:
        files["topview.prj"] = place.crs.to_wkt("WKT1_ESRI").encode()
    has_tif = place.crs is not None and find_spec("rasterio") is not None
    about: dict[str, Any] = {
        "crs": "local" if place.crs is None else place.crs.to_string(),
        "axes": "east and north of the station, m" if place.crs is None else "easting and northing, m",
        "step_m": view.step_m,
        "width_px": view.pixels.shape[1],
        "height_px": view.pixels.shape[0],
        "west_enu_m": view.west_m,
        "north_enu_m": view.north_m,
        "affine": place.affine.tolist(),
        "misfit_m": place.misfit_m,
        "files": [*files, "topview.json", *(["topview.tif"] if has_tif else [])],
    }
    files["topview.json"] = orjson.dumps(about, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)
    with os_errors_as("the top view cannot be written", where=folder):
        for file, data in files.items():
            (folder / file).write_bytes(data)
    if has_tif:
        _write_geotiff(view, place, folder / "topview.tif")
    return about


def _png(view: TopView, folder: Path) -> bytes:
    done, data = cv2.imencode(".png", view.pixels)
    if not done:
        height, width = view.pixels.shape[:2]
        raise InputError("the top view cannot be encoded", where=folder, got=f"{width} x {height} pixels")
    return data.tobytes()


def _world_file(affine: FloatArray) -> bytes:
    """Six lines, of which the last two are the *middle* of the top-left pixel."""
    (a, b, _), (d, e, _) = affine.tolist()
    c, f = (affine @ [0.5, 0.5, 1.0]).tolist()
    return "".join(f"{number:.10f}\n" for number in (a, d, b, e, c, f)).encode()


def _write_geotiff(view: TopView, place: Georeference, path: Path) -> None:
    import rasterio  # noqa: PLC0415 - an extra, and slow to load
    from rasterio.errors import RasterioError  # noqa: PLC0415

    if place.crs is None:
        raise ValueError("a GeoTIFF needs a coordinate reference system")
    height, width = view.pixels.shape[:2]
    profile = {"driver": "GTiff", "height": height, "width": width, "count": 4, "dtype": "uint8"}
    packing = {"compress": "deflate", "tiled": True, "photometric": "RGB", "alpha": "YES"}
    transform = rasterio.Affine(*place.affine.ravel().tolist())
    try:
        with rasterio.open(path, "w", **profile, **packing, crs=place.crs.to_wkt(), transform=transform) as dataset:
            dataset.write(np.moveaxis(view.pixels[..., [2, 1, 0, 3]], -1, 0))
    except (RasterioError, OSError) as error:
        path.unlink(missing_ok=True)
        raise InputError("the GeoTIFF cannot be written", where=path, got=error) from error
