"""``aerodft river``: a river's width along it, from one image with a known pose."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from aerodft.adapters.config.calibration import load_calibrated_pose
from aerodft.adapters.config.camera import load_camera
from aerodft.adapters.images.pixels import read_camera_image
from aerodft.cli.calibrated import calibrated, corrected
from aerodft.cli.given import GivenGround, GivenPose, refuse_beside
from aerodft.cli.output import print_json, say
from aerodft.cli.river_document import refusal_document, river_document
from aerodft.cli.river_files import check_folder, write_river
from aerodft.cli.river_flight import MOST_IMAGES, VIDEO_SUFFIXES, WaterLevel, flight_document
from aerodft.cli.river_views import filmed_views, is_recording, recorded_views
from aerodft.cli.stds import Stds, assumed_stds, parse_stds
from aerodft.conventions import LARGEST
from aerodft.dft.request import Setup
from aerodft.errors import InputError, NoAnswerError, UsageError
from aerodft.model.pose import PoseSample, PoseStd
from aerodft.vision.river import NoRiver, RiverQuestion, find_river
from aerodft.vision.water_network import WaterNetwork


def river(
    what: Annotated[
        Path, typer.Argument(help="An image as the camera stored it, a fixed camera's video, or a recording.")
    ],
    camera: Annotated[Path | None, typer.Option(help="Camera file (TOML).")] = None,
    height: Annotated[float | None, typer.Option(help="Camera height above the ground right below it, m.")] = None,
    tilt: Annotated[float | None, typer.Option(help="Angle of the optical axis from straight down, deg.")] = None,
    roll: Annotated[float, typer.Option(help="Positive with the camera's right side down, deg.")] = 0.0,
    heading: Annotated[float, typer.Option(help="Clockwise from true north, deg.")] = 0.0,
    lat: Annotated[float | None, typer.Option(help="Camera latitude, WGS84, deg.")] = None,
    lon: Annotated[float | None, typer.Option(help="Camera longitude, WGS84, deg.")] = None,
    elevation: Annotated[
        float, typer.Option(help="Height of the water above the ground that --height is of, m.")
    ] = 0.0,
    max_range: Annotated[float | None, typer.Option(help="Water farther than this is left out, m.")] = None,
    std: Annotated[
        str | None,
        typer.Option(
            help="Standard deviations: height,position,elevation,focal(px),px; tilt,pan,roll,heading,attitude."
        ),
    ] = None,
    covariance: Annotated[
        Path | None, typer.Option(help="6 x 6 covariance: position ENU (m), rotation in camera axes (rad); JSON rows.")
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(help="Take pose and lens of a calibration file, or correct the options by its biases."),
    ] = None,
    seed: Annotated[str | None, typer.Option(help="A pixel u,v in the water; else the lower middle.")] = None,
    spacing: Annotated[float, typer.Option(help="Of the transects along the river, m; of 1000 at the most.")] = 1.0,
    flow: Annotated[
        float | None,
        typer.Option(help="Where the river flows to, deg clockwise from north: left is then its left bank."),
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="Of a recording: another station's than its own.")
    ] = None,
    images: Annotated[
        int | None,
        typer.Option(
            min=1,
            help=f"Of a recording or a video: how many images are looked at, evenly spread; else {MOST_IMAGES}.",
        ),
    ] = None,
    water_model: Annotated[
        Path | None, typer.Option(help="Your own network (ONNX) that says where water is: docs/river.md.")
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write tables, maps and a plate here.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    r"""Measure a river's width at transects along it, with the banks found in the images.

    \b
    Examples:
      aerodft river bend.jpg --camera cam.toml --height 40 --tilt 30 --std height=0.4,attitude=0.3 -o bend --json
      aerodft river demo/recording --spacing 2 -o reach
    """
    given = GivenPose(
        height_m=height,
        altitude_m=None,
        tilt_deg=tilt,
        roll_deg=roll,
        heading_deg=heading,
        lat_deg=lat,
        lon_deg=lon,
        covariance=covariance,
    )
    network = None if water_model is None else WaterNetwork.read(water_model)
    check_folder(output)
    question = replace(_question(seed, spacing, flow, std), network=network)
    most = MOST_IMAGES if images is None else images
    if is_recording(what):
        given.refuse_all("a recording")
        refuse_beside({"camera": camera}, "a recording")
        level = _level(elevation, max_range, parse_stds(std) if std else Stds())
        document = flight_document(recorded_views(what, config, calibration, most), level, question, output)
    else:
        if config is not None:
            raise UsageError("--config", expected="a recording: an image and a video take --camera, --height, --tilt")
        setup, sample, stds = _scene(given, camera, calibration, std)
        level = _level(elevation, max_range, stds)
        if what.suffix.lower() in VIDEO_SUFFIXES:
            document = flight_document(filmed_views(what, setup, sample, most), level, question, output)
        else:
            if images is not None:
                raise UsageError("--images beside one image", expected="it with a recording or a video")
            document = _still(what, level.on(setup), sample, question, output)
    if json:
        print_json(document)
    else:
        _say(document)
    if document["status"] != "ok":
        raise NoAnswerError("no river width", where=what, got=f"{document['status']}: {'; '.join(document['reasons'])}")


def _still(
    image: Path, setup: Setup, sample: PoseSample, question: RiverQuestion, output: Path | None
) -> dict[str, Any]:
    pixels = read_camera_image(image, setup.camera, "--camera has to describe this very image")
    assert sample.pose is not None  # noqa: S101 - given poses have one, for the type checker
    found = find_river(pixels, setup, sample.pose, question)
    if isinstance(found, NoRiver):
        return refusal_document(found)
    document = river_document(found, sample)
    if output is not None:
        write_river(output, document, found, pixels, setup, sample)
    return document


def _scene(
    given: GivenPose, camera: Path | None, calibration: Path | None, std: str | None
) -> tuple[Setup, PoseSample, Stds]:
    level = GivenGround(slope_deg=None, uphill_deg=None, terrain=None)
    if calibration is not None and load_calibrated_pose(calibration) is not None:
        given.refuse_all("--calibration")
        return calibrated(calibration, camera, None, std, level)
    stds = parse_stds(std) if std else Stds() if given.covariance else assumed_stds(given.height_m or 0.0)
    if given.covariance is not None and stds.pose != PoseStd():
        raise UsageError("--std of the pose beside --covariance", expected="px, focal, elevation: the rest is there")
    if camera is None:
        raise UsageError("no --camera", expected="a camera file, e.g. configs/cameras/canon-1000d.toml")
    setup, sample = Setup(camera=stds.on_camera(load_camera(camera))), given.sample(stds, given.origin)
    if std is not None and given.covariance is None:
        sample = replace(sample, reasons=(*sample.reasons, *_taken_as_exact(stds.pose)))
    if calibration is not None:
        setup, sample = corrected(setup, sample, calibration)
    return setup, sample, stds


def _taken_as_exact(std: PoseStd) -> Iterator[str]:
    """What ``--std`` leaves out, though widths depend on it."""
    attitude = (std.tilt_rad, std.pan_rad, std.roll_rad)
    left_out = [name for name, known in (("height", std.height_agl_m), ("attitude", any(attitude))) if not known]
    if left_out:
        yield f"--std leaves out {' and '.join(left_out)}: taken as exact"


def _level(elevation_m: float, max_range_m: float | None, stds: Stds) -> WaterLevel:
    if not abs(elevation_m) <= LARGEST:
        raise InputError("--elevation", got=f"{elevation_m:g}", expected="m above the ground, finite")
    if max_range_m is not None and not 0 < max_range_m <= LARGEST:
        raise InputError("--max-range", got=f"{max_range_m:g}", expected="m, above 0")
    return WaterLevel(elevation_m=elevation_m, elevation_std_m=stds.elevation_m, max_range_m=max_range_m)


def _question(seed: str | None, spacing_m: float, flow_deg: float | None, std: str | None) -> RiverQuestion:
    if not 0 < spacing_m <= LARGEST:
        raise InputError("--spacing", got=f"{spacing_m:g}", expected="m, above 0")
    if flow_deg is not None and not abs(flow_deg) <= 360:  # noqa: PLR2004 - one turn
        raise InputError("--flow", got=f"{flow_deg:g}", expected="-360 to 360 deg clockwise from north")
    told_px = std is not None and any(part.strip().startswith("px") for part in std.split(","))
    return RiverQuestion(
        seed_px=None if seed is None else _pixel(seed),
        spacing_m=spacing_m,
        flow_rad=None if flow_deg is None else math.radians(flow_deg),
        least_std_px=parse_stds(std).px if std is not None and told_px else RiverQuestion().least_std_px,
    )


def _pixel(text: str) -> tuple[float, float]:
    try:
        u, v = (float(part) for part in text.split(","))
    except ValueError:
        u = v = math.nan
    if not (abs(u) <= LARGEST and abs(v) <= LARGEST):
        raise UsageError("--seed", got=text, expected="a pixel u,v in the water, e.g. 960,800")
    return u, v


def _say(document: dict[str, Any]) -> None:
    width = document["width_m"]
    used = [each for each in document["transects"] if each["status"] == "ok"]
    if width is not None:
        low, high = width["ci95"]
        say(
            f"{width['median']:.3f} m in the median of {len(used)} transects, {low:.3f} to {high:.3f} m (95 %);"
            f" {width['min']:.3f} to {width['max']:.3f} m along the river; confidence {document['confidence']:.2f}"
        )
        for reason in document["reasons"]:
            say(f"note: {reason}")
    for file in document["files"]:
        say(f"wrote {file}")
