"""``aerodft measure``: one pose, some pixels, measurements; what ``explain`` and ``depth-map`` make of them too."""

import logging
import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from aerodft.cli.option_values import TopicOption, parse_instant, parse_topics
from aerodft.cli.output import print_json, say
from aerodft.cli.scenes.image_options import (
    CAMERA_AND_POSE,
    GROUND,
    RECORDED,
    UNCERTAINTY,
    CameraOption,
    CovarianceOption,
    HeadingOption,
    HeightOption,
    LatOption,
    LonOption,
    RollOption,
    StdOption,
    TiltOption,
    parse_probes,
    parse_stds,
    refuse_beside,
    scene_of_options,
)
from aerodft.conventions import SECOND_NS
from aerodft.errors import UsageError
from aerodft.model import Camera, PoseSample, ProjectionModel

if TYPE_CHECKING:
    from aerodft.app.measure import MeasuredSurface
    from aerodft.dft import Setup

_LOG: Final = logging.getLogger(__name__)
_LEVEL_RAD: Final = math.radians(0.05)
_FIRST_UTC_NS: Final = 10**17  # a time below it counts from the recording's start


def measure(
    camera: CameraOption = None,
    height: HeightOption = None,
    tilt: TiltOption = None,
    roll: RollOption = 0.0,
    heading: HeadingOption = 0.0,
    lat: LatOption = None,
    lon: LonOption = None,
    altitude: Annotated[
        float | None,
        typer.Option(
            rich_help_panel=CAMERA_AND_POSE, help="With --terrain, instead of --height: above mean sea level, m."
        ),
    ] = None,
    elevation: Annotated[
        float, typer.Option(rich_help_panel=GROUND, help="Height of what is measured above the ground, m.")
    ] = 0.0,
    slope: Annotated[
        float | None,
        typer.Option(rich_help_panel=GROUND, help="Ground that rises at this angle, through the foot, deg."),
    ] = None,
    uphill: Annotated[
        float | None, typer.Option(rich_help_panel=GROUND, help="Where it rises, clockwise from true north, deg.")
    ] = None,
    terrain: Annotated[
        Path | None, typer.Option(rich_help_panel=GROUND, help="Ground of an elevation model (GeoTIFF); needs --lat.")
    ] = None,
    max_range: Annotated[float | None, typer.Option(rich_help_panel=GROUND, help="Maximum range in metres.")] = None,
    model: Annotated[
        ProjectionModel | None, typer.Option(rich_help_panel=UNCERTAINTY, help="Projection model; else pinhole.")
    ] = None,
    std: StdOption = None,
    covariance: CovarianceOption = None,
    probe: Annotated[
        list[str] | None,
        typer.Option(help='"KIND u,v [u,v] [elevation=Z or name of a height] [name=N]"; may be repeated.'),
    ] = None,
    compare: Annotated[
        bool,
        typer.Option("--compare", hidden=True, help="As explain --compare."),
    ] = False,
    calibration: Annotated[
        Path | None,
        typer.Option(
            rich_help_panel=CAMERA_AND_POSE,
            help="Take pose and lens of a calibration file; or, where it has biases, correct --height, ... by them.",
        ),
    ] = None,
    recording: Annotated[
        Path | None, typer.Option(rich_help_panel=RECORDED, help="Take camera and pose from this recording.")
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(rich_help_panel=RECORDED, help="Seconds from the first image, UTC ns, or ISO 8601."),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            "-c",
            rich_help_panel=RECORDED,
            help="With --recording: station configuration in place of its own.",
        ),
    ] = None,
    topic: TopicOption = None,
    depth_map: Annotated[
        Path | None,
        typer.Option(hidden=True, help="As depth-map --output."),
    ] = None,
    image: Annotated[Path | None, typer.Option(hidden=True, help="As depth-map --image.")] = None,
    step: Annotated[float | None, typer.Option(hidden=True, help="As depth-map --step.")] = None,
    explain: Annotated[bool, typer.Option("--explain", hidden=True, help="As the command explain.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print a JSON list.")] = False,
) -> None:
    r"""Measure pixels of one image with a known pose.

    `aerodft explain` says where the uncertainty comes from, `aerodft depth-map` measures every pixel.

    \b
    Example:
      aerodft measure --camera configs/cameras/canon-1000d.toml --height 10.48 --tilt 67 \
        --std height=0.1,tilt=0.2,px=1 --probe "range 1944,493" --json
    """
    _check_together(
        {"--probe": probe, "--compare": compare, "--explain": explain},
        {"--depth-map": depth_map, "--image": image, "--step": step},
    )
    if recording is None and (config is not None or topic):
        raise UsageError("--config and --topic are of a recording", expected="--recording and --at with them")
    if (recording is None) != (at is None):
        raise UsageError("--recording and --at go together", expected="--at in seconds from its first image, or UTC")
    from aerodft.app.measure import MeasuredSurface

    pose: dict[str, Any] = {
        "height": height,
        "altitude": altitude,
        "tilt": tilt,
        "roll": roll or None,
        "heading": heading or None,
    }
    pose |= {"lat": lat, "lon": lon, "covariance": covariance}
    ground: dict[str, Any] = {"slope": slope, "uphill": uphill, "terrain": terrain}
    stds = parse_stds(std)
    surface = MeasuredSurface(elevation, stds.elevation_m, max_range)
    if recording is not None and at is not None:
        refuse_beside(pose | ground, "--recording")
        if config is not None:
            refuse_beside({"camera": camera}, "--config")
        stds.refuse_pose("--recording", "px, elevation: the pose's are recorded")
        files = {"config": config, "calibration": calibration, "camera": camera}
        setup, sample = _recorded(recording, at, topic, files, surface)
        setup = setup if model is None else replace(setup, model=model)
        if not json:
            say(_pose_sentence(sample))
    else:
        setup, sample = scene_of_options(pose, camera, calibration, std, surface, ground=ground, model=model)
        if stds.px is None:
            sample = replace(sample, reasons=(*sample.reasons, "std of pixels assumed: 1 px"))
    _check_model(setup, sample, model, roll, compare=compare)
    if depth_map is not None:
        _write_depth(setup, sample, depth_map, image, step, as_json=json)
        return
    requests = parse_probes(probe or [], stds, elevation)
    from aerodft.cli.scenes.measured import show_measurements, show_models

    if compare:
        show_models(setup, sample, requests, as_json=json)
    else:
        show_measurements(setup, sample, requests, explain=explain, as_json=json)


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


def _recorded(
    recording: Path, at: str, topic: list[str] | None, files: dict[str, Path | None], surface: "MeasuredSurface"
) -> "tuple[Setup, PoseSample]":
    from aerodft.app.measure import Overrides, recorded_setup

    time_ns = parse_instant("--at", at, 0)
    is_utc = time_ns >= _FIRST_UTC_NS
    setup, sample = recorded_setup(
        recording,
        at_s=None if is_utc else float(at),
        at_ns=time_ns if is_utc else None,
        overrides=Overrides(**files, topics=parse_topics(topic)),
    )
    return surface.on(setup), sample


def _source(name: str | None) -> str:
    return "" if name is None else f" ({name})"


def _pose_sentence(sample: PoseSample) -> str:
    """When it was, and where the camera was and looked; of a pose that there is none of the probes say why."""
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
    setup: "Setup", sample: PoseSample, model: ProjectionModel | None, roll: float, *, compare: bool
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
    """What the paper's model cannot see of this camera and pose, a sentence each: the horizon (Eq. 1), and roll."""
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
