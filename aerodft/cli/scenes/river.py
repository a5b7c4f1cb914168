"""``aerodft river``: a river's width along it, from one image with a known pose, a recording or a video."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from aerodft.adapters.images import read_camera_image
from aerodft.cli.output import print_json, say, steps
from aerodft.cli.pose_options import (
    CameraOption,
    CovarianceOption,
    GroundOptions,
    HeadingOption,
    HeightOption,
    LatOption,
    LonOption,
    MeasuredLevel,
    PoseOptions,
    RollOption,
    StdOption,
    Stds,
    TiltOption,
    given_scene,
    parse_stds,
    refuse_beside,
)
from aerodft.cli.river_document import reach_document, refusal_document, refused_reach, river_document
from aerodft.cli.river_files import check_folder, write_reach, write_river
from aerodft.cli.river_views import View, Views, filmed_views, is_recording, recorded_views
from aerodft.conventions import LARGEST
from aerodft.dft import Setup
from aerodft.errors import InputError, NoAnswerError, UsageError
from aerodft.model import Pose, PoseSample
from aerodft.vision.river import (
    LaterLook,
    NoRiver,
    ReachView,
    RiverQuestion,
    WaterNetwork,
    WaterPlane,
    find_river,
    measure_reach,
)

VIDEO_SUFFIXES: Final = frozenset({".mp4", ".mov", ".mkv", ".avi", ".ts", ".m4v", ".webm", ".mpg", ".mpeg"})
MOST_IMAGES: Final = 60
"""Images that are looked at, unless told otherwise."""


def river(
    what: Annotated[
        Path, typer.Argument(help="An image as the camera stored it, a fixed camera's video, or a recording.")
    ],
    camera: CameraOption = None,
    height: HeightOption = None,
    tilt: TiltOption = None,
    roll: RollOption = 0.0,
    heading: HeadingOption = 0.0,
    lat: LatOption = None,
    lon: LonOption = None,
    elevation: Annotated[
        float, typer.Option(help="Height of the water above the ground that --height is of, m.")
    ] = 0.0,
    max_range: Annotated[float | None, typer.Option(help="Water farther than this is left out, m.")] = None,
    std: StdOption = None,
    covariance: CovarianceOption = None,
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
    given = PoseOptions(
        height_m=height,
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
        level = MeasuredLevel.of(elevation, max_range, parse_stds(std) if std else Stds())
        document = _flight_document(recorded_views(what, config, calibration, most), level, question, output)
    else:
        if config is not None:
            raise UsageError("--config", expected="a recording: an image and a video take --camera, --height, --tilt")
        setup, sample, stds = given_scene(given, GroundOptions(), camera, calibration, None, std, says_exact=True)
        level = MeasuredLevel.of(elevation, max_range, stds)
        if what.suffix.lower() in VIDEO_SUFFIXES:
            document = _flight_document(filmed_views(what, setup, sample, most), level, question, output)
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


def _flight_document(
    views: Views, level: MeasuredLevel, question: RiverQuestion, output: Path | None
) -> dict[str, Any]:
    """Measure a river over many images; writes the folder where there is one to write.

    Raises:
        InputError: An image cannot be read, or the folder cannot be written.
    """
    asked = [_asked(each, level) for each in views.views]
    with steps("looking at the river twice in each image", 2 * len(asked)) as advance:
        found = measure_reach(asked, question, advance)
    if isinstance(found, NoRiver):
        return refused_reach(found, views)
    document = reach_document(found, views)
    if output is not None:
        write_reach(output, document, found, views)
    return document


def _asked(view: View, level: MeasuredLevel) -> ReachView:
    later = None
    if view.later is not None:
        setup = level.on(view.later.setup)
        plane = WaterPlane(setup.camera, _pose(view.later.sample), setup.elevation_m, setup.max_range_m)
        later = LaterLook(plane, view.later.copy, (view.later.sample.stamp_ns - view.sample.stamp_ns) / 1e9)
    return ReachView(level.on(view.setup), _pose(view.sample), view.pixels, later)


def _pose(sample: PoseSample) -> Pose:
    assert sample.pose is not None  # noqa: S101 - views have one, for the type checker
    return sample.pose
