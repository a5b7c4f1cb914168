"""``aerodft river``: a river's width along it, from one image with a known pose, a recording or a video."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from aerodft.cli.options import ConfigOption, JsonOption, SettingOptions, grouped
from aerodft.cli.output import LOSS, print_json, progress, say
from aerodft.cli.scenes.image_options import SurfaceOptions, refuse_beside
from aerodft.conventions import LARGEST
from aerodft.errors import NoAnswerError, Reason, UsageError

if TYPE_CHECKING:
    from aerodft.reports.river import RiverImages
    from aerodft.vision.river import RiverHints, RiverQuestion


_CONTRADICTORY: Final = "CONTRADICTORY"


@dataclass(frozen=True, slots=True, kw_only=True)
class QuestionOptions:
    """Options on what is measured in each image."""

    water: Annotated[
        list[str] | None,
        typer.Option("--water", "--seed", help="A pixel u,v in the water, or a stroke u,v;u,v;...; again for more."),
    ] = None
    land: Annotated[
        list[str] | None, typer.Option("--land", help="A pixel u,v on land, or a stroke; again for more.")
    ] = None
    hints: Annotated[
        Path | None, typer.Option(help="Water and land from a JSON file, or a mask image (white is water).")
    ] = None
    spacing: Annotated[float, typer.Option(help="Of the transects along the river, m; of 1000 at the most.")] = 1.0
    flow: Annotated[
        float | None,
        typer.Option(help="Where the river flows to, deg clockwise from north: left is then its left bank."),
    ] = None
    water_model: Annotated[
        Path | None, typer.Option(help="Your own network (ONNX) that says where water is: docs/river.md.")
    ] = None

    def question(self, std_px: float | None) -> "RiverQuestion":
        """The question, with banks that are off by at least so much.

        Raises:
            UsageError: A stroke cannot be read.
            InputError: A file cannot be read.
        """
        from aerodft.app.river import river_question
        from aerodft.vision.river import WaterNetwork

        network = None if self.water_model is None else WaterNetwork.read(self.water_model)
        return river_question(self._hints(), self.spacing, self.flow, network, std_px)

    def _hints(self) -> "RiverHints":
        from aerodft.vision.river import RiverHints

        told = RiverHints() if self.hints is None else RiverHints.read(self.hints)
        water = [_stroke("--water", each) for each in self.water or ()]
        land = [_stroke("--land", each) for each in self.land or ()]
        return RiverHints([*told.water, *water], [*told.land, *land], told.mask)


@grouped
def river(
    what: Annotated[
        Path, typer.Argument(help="An image as the camera stored it, a fixed camera's video, or a recording.")
    ],
    scene: SurfaceOptions,
    asked: QuestionOptions,
    changes: SettingOptions,
    config: ConfigOption = None,
    images: Annotated[
        int | None,
        typer.Option(min=1, help="Of a recording or a video: how many images are looked at, evenly spread; else 60."),
    ] = None,
    despite_contradiction: Annotated[
        bool,
        typer.Option(
            "--despite-contradiction", help="Give widths of images that contradict their stated errors too (exit 5)."
        ),
    ] = False,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write tables, maps and a plate here.")] = None,
    json: JsonOption = False,
) -> None:
    r"""Measure a river's width at transects along it, with the banks found in the images.

    Of a recording --config takes the place of the station file that it was made with, but for the clock that sync
    found; --home-above-plane and --set change keys of either. Images that contradict each other beyond their stated
    errors give no width (exit 4).

    \b
    Examples:
      aerodft river DJI_0024.JPG --home-above-plane 1.5 -o bend
      aerodft river bend.jpg --camera cam.toml --height 40 --tilt 30 --std height=0.4,attitude=0.3 -o bend --json
      aerodft river demo/recording --spacing 2 -o reach
      aerodft river demo/recording --home-above-plane 1.2 -o reach
    """
    from aerodft.adapters.images import STILLS
    from aerodft.app.river import is_recording, survey_images, survey_still
    from aerodft.reports.river import check_folder

    check_folder(output)
    question = asked.question(scene.stds.px)
    if is_recording(what):
        views = _recorded(what, scene, config, changes.settings(), images)
    else:
        is_photo = what.suffix.lower() in STILLS
        changes.refuse("a recording: an image and a video take --height", but_height=is_photo)
        views = _filmed(what, scene, config, images)
    if views is None:
        survey = survey_still(what, *scene.scene(photo=what, home_above_plane_m=changes.home_above_plane), question)
    else:
        with progress("looking at the river twice in each image") as advance:
            survey = survey_images(views, question, advance, despite_contradiction=despite_contradiction)
    if output is not None:
        survey.save(output)
    if json:
        print_json(survey.document)
    else:
        _say(survey.document)
    if survey.status == _CONTRADICTORY and survey.width_m is not None:
        raise typer.Exit(LOSS)
    if survey.status != "ok":
        why = Reason(f"{survey.status}: {'; '.join(survey.reasons)}")
        raise NoAnswerError("no river width", where=what, got=why)


def _recorded(
    folder: Path, scene: SurfaceOptions, config: Path | None, settings: dict[str, Any], images: int | None
) -> "RiverImages | None":
    from aerodft.app.river import MOST_IMAGES, recorded_images

    refuse_beside(scene.stated_pose() | {"camera": scene.camera}, "a recording")
    return recorded_images(folder, config, scene.calibration, scene.surface, images or MOST_IMAGES, settings)


def _filmed(path: Path, scene: SurfaceOptions, config: Path | None, images: int | None) -> "RiverImages | None":
    """A video's images; None for one image."""
    from aerodft.adapters.images import VIDEO_SUFFIXES
    from aerodft.app.river import MOST_IMAGES, filmed_images

    if config is not None:
        raise UsageError("--config", expected="a recording: an image and a video take --camera, --height, --tilt")
    if path.suffix.lower() in VIDEO_SUFFIXES:
        setup, sample = scene.scene()
        with progress("reading the video twice") as advance:
            return filmed_images(path, setup, sample, images or MOST_IMAGES, advance)
    if images is not None:
        raise UsageError("--images beside one image", expected="it with a recording or a video")
    return None


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
        mark = "" if document["status"] == "ok" else f"{document['status']}: "
        say(
            f"{mark}{width['median']:.3f} m in the median of {len(used)} transects, {low:.3f} to {high:.3f} m (95 %);"
            f" {width['min']:.3f} to {width['max']:.3f} m along the river; confidence {document['confidence']:.2f}"
        )
        for reason in document["reasons"]:
            say(f"note: {reason}")
    for file in document["files"]:
        say(f"wrote {file}")
