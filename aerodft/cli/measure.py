"""``aerodft measure``: one pose, some pixels, measurements."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from aerodft.adapters.codec.measurement import measurement_payload
from aerodft.adapters.config.calibration import load_calibrated_pose
from aerodft.adapters.config.camera import load_camera
from aerodft.cli.calibrated import calibrated, corrected
from aerodft.cli.given import GivenGround, GivenPose, refuse_beside
from aerodft.cli.measured_table import print_budget, print_measurements
from aerodft.cli.model_table import cautions, show_models
from aerodft.cli.output import print_json, say
from aerodft.cli.probes import parse_probes
from aerodft.cli.stds import Stds, assumed_stds, parse_stds
from aerodft.cli.topics import TopicOption, parse_topics
from aerodft.conventions import LARGEST
from aerodft.dft.budget import Share, advice
from aerodft.dft.measure import Request, Setup
from aerodft.dft.measure import explain as explain_request
from aerodft.dft.measure import measure as measure_requests
from aerodft.dft.models import compare_models
from aerodft.errors import InputError, UsageError
from aerodft.model.measurement import Measurement, ProjectionModel
from aerodft.model.pose import PoseSample, PoseStd
from aerodft.model.pose_batch import PoseBatch
from aerodft.model.status import Status


def measure(
    camera: Annotated[Path | None, typer.Option(help="Camera file (TOML).")] = None,
    height: Annotated[float | None, typer.Option(help="Camera height above the ground right below it, m.")] = None,
    tilt: Annotated[float | None, typer.Option(help="Angle of the optical axis from straight down, deg.")] = None,
    roll: Annotated[float, typer.Option(help="Positive with the camera's right side down, deg.")] = 0.0,
    heading: Annotated[float, typer.Option(help="Clockwise from true north, deg.")] = 0.0,
    lat: Annotated[float | None, typer.Option(help="Camera latitude, WGS84, deg.")] = None,
    lon: Annotated[float | None, typer.Option(help="Camera longitude, WGS84, deg.")] = None,
    altitude: Annotated[
        float | None, typer.Option(help="With --terrain, instead of --height: above mean sea level, m.")
    ] = None,
    elevation: Annotated[float, typer.Option(help="Height of what is measured above the ground, m.")] = 0.0,
    slope: Annotated[float | None, typer.Option(help="Ground that rises at this angle, through the foot, deg.")] = None,
    uphill: Annotated[float | None, typer.Option(help="Where it rises, clockwise from true north, deg.")] = None,
    terrain: Annotated[Path | None, typer.Option(help="Ground of an elevation model (GeoTIFF); needs --lat.")] = None,
    max_range: Annotated[float | None, typer.Option(help="What is farther is refused, m.")] = None,
    model: Annotated[ProjectionModel | None, typer.Option(help="Projection model; else pinhole.")] = None,
    std: Annotated[
        str | None,
        typer.Option(
            help="Standard deviations: height,position,elevation,focal(px),px; tilt,pan,roll,heading,attitude."
        ),
    ] = None,
    covariance: Annotated[
        Path | None, typer.Option(help="6 x 6 covariance: position ENU (m), rotation in camera axes (rad); JSON rows.")
    ] = None,
    probe: Annotated[
        list[str] | None,
        typer.Option(help='"KIND u,v [u,v] [elevation=Z or name of a height] [name=N]"; may be repeated.'),
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Both projection models side by side, and what lies between.")
    ] = False,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Take pose and lens of a calibration file; or, where it has biases, correct --height, ... by them."
        ),
    ] = None,
    recording: Annotated[Path | None, typer.Option(help="Take camera and pose from this recording.")] = None,
    at: Annotated[
        str | None, typer.Option(help="With --recording: seconds from its start, UTC ns, or ISO 8601.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="With --recording: station configuration in place of its own.")
    ] = None,
    topic: TopicOption = None,
    depth_map: Annotated[
        Path | None,
        typer.Option(help="Write range, ground point and sampling of every pixel (to 100 heights away) here."),
    ] = None,
    image: Annotated[Path | None, typer.Option(help="With --depth-map: the image, to be seen from above.")] = None,
    step: Annotated[float | None, typer.Option(help="With --image: step of the view from above, m.")] = None,
    explain: Annotated[bool, typer.Option("--explain", help="Say where each uncertainty comes from.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print a JSON list.")] = False,
) -> None:
    r"""Measure pixels of one image with a known pose.

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
        raise UsageError("--recording and --at go together", expected="--at seconds from its start, UTC ns, ISO 8601")
    pose = GivenPose(
        height_m=height,
        altitude_m=altitude,
        tilt_deg=tilt,
        roll_deg=roll,
        heading_deg=heading,
        lat_deg=lat,
        lon_deg=lon,
        covariance=covariance,
    )
    terms = GivenGround(slope_deg=slope, uphill_deg=uphill, terrain=terrain)
    if recording is not None and at is not None:
        pose.refuse_all("--recording")
        terms.refuse_all("--recording")
        if config is not None:
            refuse_beside({"camera": camera}, "--config")
        files = {"config": config, "calibration": calibration, "camera": camera}
        setup, sample, stds = _recorded(recording, at, model, std, topic, files)
    elif calibration is not None and load_calibrated_pose(calibration) is not None:
        pose.refuse_all("--calibration")
        setup, sample, stds = calibrated(calibration, camera, model, std, terms)
    else:
        stds = _stds(std, pose)
        surface, origin = terms.ground(pose.origin)
        setup = replace(_setup(camera, model or ProjectionModel.PINHOLE, stds), ground=surface)
        sample = pose.sample(stds, origin)
        if calibration is not None:
            setup, sample = corrected(setup, sample, calibration)
    setup = replace(_limited(setup, elevation, max_range), elevation_std_m=stds.elevation_m)
    _check_model(setup, sample, model, roll, compare=compare)
    if depth_map is not None:
        from aerodft.cli.depth import write_depth  # noqa: PLC0415 - matplotlib and the video library are slow

        write_depth(setup, sample, depth_map, image, as_json=json, max_range_m=max_range, step_m=step)
        return
    requests = parse_probes(probe or [], stds, setup.elevation_m)
    if compare:
        _compare(setup, sample, requests, as_json=json)
    else:
        measurements = measure_requests(setup, PoseBatch.of([sample]), requests)[0]
        budgets = [explain_request(setup, sample, request) for request in requests] if explain else []
        _show(measurements, budgets, as_json=json)
        _finish(measurements)


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


def _stds(std: str | None, pose: GivenPose) -> Stds:
    stds = parse_stds(std) if std else None
    if pose.covariance is None:
        return stds or assumed_stds(pose.height_m or pose.altitude_m or 0.0)
    if stds is not None and stds.pose != PoseStd():
        raise UsageError("--std of the pose beside --covariance", expected="px, focal, elevation: the rest is there")
    return stds or Stds()


def _limited(setup: Setup, elevation_m: float, max_range_m: float | None) -> Setup:
    if not abs(elevation_m) <= LARGEST:
        raise InputError("--elevation", got=f"{elevation_m:g}", expected="m above the ground, finite")
    if max_range_m is None:
        return replace(setup, elevation_m=elevation_m)
    if not 0 < max_range_m <= LARGEST:
        raise InputError("--max-range", got=f"{max_range_m:g}", expected="m, above 0")
    return replace(setup, elevation_m=elevation_m, max_range_m=max_range_m)


def _recorded(
    recording: Path,
    at: str,
    model: ProjectionModel | None,
    std: str | None,
    topic: list[str] | None,
    files: dict[str, Path | None],
) -> tuple[Setup, PoseSample, Stds]:
    from aerodft.cli.recorded_pose import Instead, recorded_setup  # noqa: PLC0415 - the bus and video libraries are slow

    stds = parse_stds(std) if std else Stds()
    if stds.pose != PoseStd():
        raise UsageError("--std of the pose beside --recording", expected="px, elevation: the pose's are recorded")
    setup, sample = recorded_setup(recording, at, Instead(**files, topics=parse_topics(topic)))
    return (setup if model is None else replace(setup, model=model)), sample, stds


def _compare(setup: Setup, sample: PoseSample, requests: tuple[Request, ...], *, as_json: bool) -> None:
    differences = compare_models(setup, sample, requests)
    show_models(differences, sample, as_json=as_json)
    _finish([measurement for item in differences for measurement in (item.pinhole, item.dft)])


def _check_model(
    setup: Setup, sample: PoseSample, model: ProjectionModel | None, roll: float, *, compare: bool
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
        say(f"aerodft: {caution}")


def _setup(camera: Path | None, model: ProjectionModel, stds: Stds) -> Setup:
    if camera is None:
        raise UsageError("no --camera", expected="a camera file, e.g. configs/cameras/canon-1000d.toml")
    return Setup(camera=stds.on_camera(load_camera(camera)), model=model)


def _show(measurements: list[Measurement], budgets: list[tuple[Share, ...]], *, as_json: bool) -> None:
    """Print measurements; with budgets, one for each, also where their uncertainty comes from."""
    documents = [measurement_payload(measurement) for measurement in measurements]
    for document, budget in zip(documents, budgets, strict=False):  # no budgets where none were asked for
        document["budget"] = [{"source": part.source, "std": part.std, "share": part.share} for part in budget]
        document["advice"] = advice(budget)
    if as_json:
        print_json(documents)
        return
    print_measurements(measurements)
    for measurement, budget in zip(measurements, budgets, strict=False):
        print_budget(measurement, budget)


def _finish(measurements: list[Measurement]) -> None:
    statuses = {measurement.status for measurement in measurements}
    bad = [measurement for measurement in measurements if measurement.status is not Status.OK]
    for sentence in dict.fromkeys(f"{item.name}: {item.status}: {'; '.join(item.reasons)}" for item in bad):
        say(f"aerodft: {sentence}")
    if Status.OUT_OF_IMAGE in statuses:
        raise typer.Exit(3)
    if Status.OK not in statuses:
        raise typer.Exit(4)
