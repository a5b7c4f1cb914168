"""``aerodft measure``, ``explain`` and ``depth-map``: one pose, some pixels or all of them, measurements."""

import logging
import math
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import typer

from aerodft.cli.options import JsonOption, SettingOptions, TopicOption, grouped, parse_instant, parse_topics
from aerodft.cli.output import print_json, say
from aerodft.cli.scenes.image_options import (
    GroundOptions,
    SurfaceOptions,
    given_options,
    of_uncertainty,
    parse_probes,
    refuse_beside,
)
from aerodft.conventions import SECOND_NS
from aerodft.errors import UsageError
from aerodft.model import Camera, PoseSample, ProjectionModel

if TYPE_CHECKING:
    from aerodft.dft import Setup

_LOG: Final = logging.getLogger(__name__)
_of_recording: Final = partial(typer.Option, rich_help_panel="Of a recording, instead of camera and pose")
_LEVEL_RAD: Final = math.radians(0.05)
_FIRST_UTC_NS: Final = 10**17  # a time below it counts from the recording's start


ModelOption: TypeAlias = Annotated[ProjectionModel | None, of_uncertainty(help="Projection model; else pinhole.")]
PhotoArgument: TypeAlias = Annotated[
    Path | None,
    typer.Argument(metavar="[PHOTO]", help="A drone's photograph: it says camera, pose and place that are not given."),
]
ProbeOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        help='"KIND u,v [u,v] [elevation=Z or Z,Z or name of a height] [elevation_std=S] [name=N]"; @NAME in place of'
        " u,v is a surveyed point; may be repeated."
    ),
]
LandmarksOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Surveyed points of --probe, as calibrate takes them; --calibration has those it was made from."),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedOptions(SettingOptions):
    """Options that take camera and pose from a recording."""

    recording: Annotated[Path | None, _of_recording(help="Take camera and pose from this recording.")] = None
    at: Annotated[str | None, _of_recording(help="Seconds from the first image, UTC ns, or ISO 8601.")] = None
    config: Annotated[
        Path | None,
        _of_recording("--config", "-c", help="With --recording: station configuration in place of its own."),
    ] = None
    topic: TopicOption = None

    def scene(self, instead: SurfaceOptions) -> "tuple[Setup, PoseSample] | None":
        """Camera, ground and pose of the recording; None without one."""
        if self.recording is None and (self.config is not None or self.topic):
            raise UsageError("--config and --topic are of a recording", expected="--recording and --at with them")
        if self.recording is None:
            self.refuse("--recording and --at with it", but_height=True)
        if (self.recording is None) != (self.at is None):
            expected = "--at in seconds from its first image, or UTC"
            raise UsageError("--recording and --at go together", expected=expected)
        if self.recording is None or self.at is None:
            return None
        from aerodft.app.recorded_scenes import Overrides, recorded_setup

        if self.config is not None:
            refuse_beside({"camera": instead.camera}, "--config")
        instead.stds.refuse_pose("--recording", "px, elevation: the pose's are recorded")
        time_ns = parse_instant("--at", self.at, 0)
        is_utc = time_ns >= _FIRST_UTC_NS
        setup, sample = recorded_setup(
            self.recording,
            at_s=None if is_utc else float(self.at),
            at_ns=time_ns if is_utc else None,
            overrides=Overrides(
                config=self.config,
                calibration=instead.calibration,
                camera=instead.camera,
                topics=parse_topics(self.topic),
                settings=self.settings(),
            ),
        )
        return instead.surface.on(setup), sample


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthOptions:
    """A map of every pixel, in place of probes."""

    depth_map: Annotated[Path | None, typer.Option(hidden=True, help="As depth-map --output.")] = None
    image: Annotated[Path | None, typer.Option(hidden=True, help="As depth-map --image.")] = None
    step: Annotated[float | None, typer.Option(hidden=True, help="As depth-map --step.")] = None


_NO_MAP: Final = DepthOptions()


@dataclass(frozen=True, slots=True)
class Asked:
    """Probes as they are typed, and the file of the surveyed points that they name."""

    probes: list[str] = field(default_factory=list)
    landmarks: Path | None = None


@grouped
def measure(
    photo: PhotoArgument = None,
    *,
    ground: GroundOptions,
    scene: SurfaceOptions,
    recorded: RecordedOptions,
    mapped: DepthOptions,
    model: ModelOption = None,
    probe: ProbeOption = None,
    landmarks: LandmarksOption = None,
    compare: Annotated[bool, typer.Option("--compare", hidden=True, help="As explain --compare.")] = False,
    explain: Annotated[bool, typer.Option("--explain", hidden=True, help="As the command explain.")] = False,
    json: JsonOption = False,
) -> None:
    r"""Measure pixels of one image with a known pose.

    `aerodft explain` says where the uncertainty comes from, `aerodft depth-map` measures every pixel.

    \b
    Examples:
      aerodft measure DJI_0024.JPG --home-above-plane 1.5 --probe "distance 812,604.5 1377,611"
      aerodft measure --camera configs/cameras/canon-1000d.toml --height 10.48 --tilt 67 \
        --std height=0.1,tilt=0.2,px=1 --probe "range 1944,493" --json
    """
    asked = Asked(probe or [], landmarks)
    measure_image(photo, ground, scene, recorded, model, asked, mapped, compare=compare, explain=explain, as_json=json)


@grouped
def explain(
    photo: PhotoArgument = None,
    *,
    ground: GroundOptions,
    scene: SurfaceOptions,
    recorded: RecordedOptions,
    model: ModelOption = None,
    probe: ProbeOption = None,
    landmarks: LandmarksOption = None,
    compare: Annotated[
        bool,
        typer.Option(
            "--compare",
            rich_help_panel="Uncertainty and model",
            help="Both projection models side by side, and what lies between.",
        ),
    ] = False,
    json: JsonOption = False,
) -> None:
    r"""Say where the uncertainty of a measurement comes from, and what would make it smaller.

    \b
    Examples:
      aerodft explain --camera configs/cameras/canon-1000d.toml --height 10.48 --tilt 67 \
        --probe "range 1944,493"
      aerodft explain --recording demo/recording --at 5 --probe "distance 200,300 500,300" --compare
    """
    asked = Asked(probe or [], landmarks)
    measure_image(photo, ground, scene, recorded, model, asked, compare=compare, explain=not compare, as_json=json)


@grouped
def depth_map(
    photo: PhotoArgument = None,
    *,
    ground: GroundOptions,
    scene: SurfaceOptions,
    recorded: RecordedOptions,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write to.")],
    model: ModelOption = None,
    image: Annotated[Path | None, typer.Option(help="The image, to be seen from straight above.")] = None,
    step: Annotated[float | None, typer.Option(help="With --image: step of the view from above, m.")] = None,
    json: JsonOption = False,
) -> None:
    r"""Write range, ground point and sampling distance of every pixel, to 100 heights away, and the image's outline.

    \b
    Example:
      aerodft depth-map --camera configs/cameras/canon-1000d.toml --height 10.48 --tilt 75 \
        --lat 48.1 --lon 11.5 -o depth
    """
    mapped = DepthOptions(depth_map=output, image=image or photo, step=step)
    measure_image(photo, ground, scene, recorded, model, Asked(), mapped, compare=False, explain=False, as_json=json)


def measure_image(
    photo: Path | None,
    ground: GroundOptions,
    scene: SurfaceOptions,
    recorded: RecordedOptions,
    model: ProjectionModel | None,
    asked: Asked,
    mapped: DepthOptions = _NO_MAP,
    *,
    compare: bool,
    explain: bool,
    as_json: bool,
) -> None:
    """Measure, explain or map one image, and print the answer.

    Raises:
        UsageError: Options do not go together.
        InputError: Something is impossible, or cannot be read.
        NoAnswerError: There is no pose.
        Exit: With 3 for a pixel outside the image, with 4 where nothing was measured.
    """
    _check_together(
        {"--probe": asked.probes, "--compare": compare, "--explain": explain},
        {"--depth-map": mapped.depth_map, "--image": mapped.image, "--step": mapped.step},
    )
    if recorded.recording is not None:
        refuse_beside(scene.stated_pose() | given_options(ground), "--recording")
        if photo is not None:
            raise UsageError("a photograph beside --recording", got=str(photo), expected="one of them")
    from aerodft.app.measure import known_points, with_stds_noted

    found = recorded.scene(scene)
    if found is not None:
        setup, sample = found
        setup = setup if model is None else replace(setup, model=model)
        if not as_json:
            say(_pose_sentence(sample))
    else:
        setup, sample = scene.scene(ground, model, photo, recorded.home_above_plane)
    sample = with_stds_noted(sample, scene.stds.px, setup.elevation_std_m)
    _check_model(setup, sample, model, scene.roll, compare=compare)
    if mapped.depth_map is not None:
        _write_depth(setup, sample, mapped.depth_map, mapped.image, mapped.step, as_json=as_json)
        return
    points = setup.points
    if asked.landmarks is not None and setup.ground is None and sample.level is None:
        points = {**points, **known_points(asked.landmarks, scene.calibration)}
    requests = parse_probes(asked.probes, scene.stds, scene.elevation, points)
    from aerodft.cli.scenes.measured import show_measurements, show_models

    if compare:
        show_models(setup, sample, requests, as_json=as_json)
    else:
        show_measurements(setup, sample, requests, explain=explain, as_json=as_json)


def _check_together(probing: dict[str, object], mapping: dict[str, object]) -> None:
    """Refuse options that do not go together: those of probes, and those of ``--depth-map``."""
    asked = [name for name, value in probing.items() if value]
    given = [name for name, value in mapping.items() if value is not None]
    if "--depth-map" in given:
        if asked:
            raise UsageError(f"--depth-map beside {asked[0]}", expected="one of them")
        if "--step" in given and "--image" not in given:
            raise UsageError("--step without --image", expected="both: it is the step of the image seen from above")
        return
    if given:
        raise UsageError(f"{given[0]} without --depth-map", expected="both, to see the image from above")
    if "--compare" in asked and "--explain" in asked:
        raise UsageError("--explain beside --compare", expected="one of them")
    if "--probe" not in asked:
        raise UsageError("no --probe", expected='e.g. --probe "distance 812,604.5 1377,611"')


def _source(name: str | None) -> str:
    return "" if name is None else f" ({name})"


def _pose_sentence(sample: PoseSample) -> str:
    """Sentence on a pose: its stamp, height and angles, with one std; the stamp alone where there is no pose."""
    from aerodft.adapters.wire.pose import summary_payload

    summary = summary_payload(sample)
    when = datetime.fromtimestamp(sample.stamp_ns / SECOND_NS, UTC).isoformat(timespec="milliseconds")
    said = f"{when.replace('+00:00', 'Z')}: "
    if sample.pose is None:
        return said + "no pose"
    std = summary["std"]
    parts = [
        f"height {summary['height_agl_m']:.2f} m +- {std['height_agl_m']:.2g}{_source(sample.height_source)}",
        f"tilt {summary['tilt_deg']:.2f} deg +- {std['tilt_deg']:.2g}{_source(sample.attitude_source)}",
        f"roll {summary['roll_deg']:.2f} deg, heading {summary['heading_deg']:.1f} deg",
    ]
    if (level := sample.level) is not None:
        parts.append(f"water level {level.level_m:.3f} m +- {level.std_m:.2g} ({level.datum}, {level.source})")
    if sample.telemetry_age_s is not None:
        parts.append(f"telemetry {sample.telemetry_age_s:.2f} s away")
    return said + ", ".join(parts) + " (+- one std)"


def _write_depth(
    setup: "Setup", sample: PoseSample, folder: Path, image: Path | None, step_m: float | None, *, as_json: bool
) -> None:
    """Write the depth map's files, and say what is in them."""
    from aerodft.reports.depth import depth_sentences, write_depth

    document = write_depth(setup, sample, folder, image, step_m)
    if as_json:
        print_json(document)
    else:
        for sentence in depth_sentences(document):
            say(sentence)


def _check_model(
    setup: "Setup", sample: PoseSample, model: ProjectionModel | None, roll: float | None, *, compare: bool
) -> None:
    if compare and model is not None:
        raise UsageError("--model beside --compare", expected="one of them: --compare shows both models")
    if not compare and setup.model is not ProjectionModel.DFT:
        return
    if setup.ground is not None:
        option = "--compare" if compare else "--model dft"
        raise UsageError(f"uneven ground with {option}", expected="level ground: the paper knows no other")
    if roll:
        option = "--compare" if compare else "--model dft"
        raise UsageError(f"--roll with {option}", got=f"{roll:g}", expected="0: the paper's camera does not roll")
    for caution in cautions(setup.camera, sample):
        _LOG.warning(caution)


def cautions(camera: Camera, sample: PoseSample) -> list[str]:
    """Cautions about the paper's model for this camera and pose: the horizon (Eq. 1), and roll."""
    from aerodft.dft import tilt_warning
    from aerodft.geometry import camera_angles

    if sample.pose is None:
        return []
    tilt_rad, roll_rad, _ = map(float, camera_angles(sample.pose.wxyz))
    past_horizon = tilt_warning(tilt_rad, camera.vfov_rad)
    said = [] if past_horizon is None else [past_horizon]
    if abs(roll_rad) > _LEVEL_RAD:
        said.append(
            f"the paper's camera does not roll: a roll of {math.degrees(roll_rad):.1f} deg is left out under dft"
        )
    return said
