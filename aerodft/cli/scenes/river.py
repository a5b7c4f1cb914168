"""``aerodft river``: a river's width along it, from one image with a known pose, a recording or a video."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from aerodft.cli.output import print_json, progress, say
from aerodft.cli.scenes.image_options import (
    CameraOption,
    CovarianceOption,
    HeadingOption,
    HeightOption,
    LatOption,
    LonOption,
    RollOption,
    StdOption,
    TiltOption,
    parse_stds,
    refuse_beside,
    scene_of_options,
)
from aerodft.conventions import LARGEST
from aerodft.errors import NoAnswerError, UsageError

if TYPE_CHECKING:
    from aerodft.vision.river import RiverHints


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
    water: Annotated[
        list[str] | None,
        typer.Option("--water", "--seed", help="A pixel u,v in the water, or a stroke u,v;u,v;...; again for more."),
    ] = None,
    land: Annotated[
        list[str] | None, typer.Option("--land", help="A pixel u,v on land, or a stroke; again for more.")
    ] = None,
    hints: Annotated[
        Path | None, typer.Option(help="Water and land from a JSON file, or a mask image (white is water).")
    ] = None,
    spacing: Annotated[float, typer.Option(help="Of the transects along the river, m; of 1000 at the most.")] = 1.0,
    flow: Annotated[
        float | None,
        typer.Option(help="Where the river flows to, deg clockwise from north: left is then its left bank."),
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="Use this station file instead of the recorded one.")
    ] = None,
    images: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Of a recording or a video: how many images are looked at, evenly spread; else 60.",
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
    from aerodft.app.measure import MeasuredSurface
    from aerodft.app.river import (
        MOST_IMAGES,
        VIDEO_SUFFIXES,
        filmed_images,
        is_recording,
        recorded_images,
        river_question,
        survey_images,
        survey_still,
    )
    from aerodft.reports.river import check_folder
    from aerodft.vision.river import WaterNetwork

    pose: dict[str, Any] = {"height": height, "tilt": tilt, "roll": roll or None, "heading": heading or None}
    pose |= {"lat": lat, "lon": lon, "covariance": covariance}
    network = None if water_model is None else WaterNetwork.read(water_model)
    check_folder(output)
    stds, most = parse_stds(std), MOST_IMAGES if images is None else images
    question = river_question(_hints(water or [], land or [], hints), spacing, flow, network, stds.px)
    surface = MeasuredSurface(elevation, stds.elevation_m, max_range)
    if is_recording(what):
        refuse_beside(pose, "a recording")
        refuse_beside({"camera": camera}, "a recording")
        views = recorded_images(what, config, calibration, surface, most)
    else:
        if config is not None:
            raise UsageError("--config", expected="a recording: an image and a video take --camera, --height, --tilt")
        setup, sample = scene_of_options(pose, camera, calibration, std, surface)
        views = None
        if what.suffix.lower() in VIDEO_SUFFIXES:
            with progress("reading the video twice") as advance:
                views = filmed_images(what, setup, sample, most, advance)
        elif images is not None:
            raise UsageError("--images beside one image", expected="it with a recording or a video")
    if views is None:
        survey = survey_still(what, setup, sample, question)
    else:
        with progress("looking at the river twice in each image") as advance:
            survey = survey_images(views, question, advance)
    if output is not None:
        survey.save(output)
    if json:
        print_json(survey.document)
    else:
        _say(survey.document)
    if survey.status != "ok":
        raise NoAnswerError("no river width", where=what, got=f"{survey.status}: {'; '.join(survey.reasons)}")


def _hints(water: list[str], land: list[str], file: Path | None) -> "RiverHints":
    from aerodft.vision.river import RiverHints

    told = RiverHints() if file is None else RiverHints.read(file)
    more = RiverHints.of(
        *([_stroke(name, each) for each in texts] for name, texts in (("--water", water), ("--land", land)))
    )
    return RiverHints(told.water + more.water, told.land + more.land, told.mask)


def _stroke(option: str, text: str) -> list[tuple[float, float]]:
    try:
        points = [(float(u), float(v)) for u, v in (point.split(",") for point in text.split(";"))]
    except ValueError:
        points = [(math.nan, math.nan)]
    if not all(abs(u) <= LARGEST and abs(v) <= LARGEST for u, v in points):
        raise UsageError(option, got=text, expected="a pixel u,v, e.g. 960,800, or a stroke u,v;u,v;...")
    return points


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
