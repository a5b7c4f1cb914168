"""``aerodft measure``: one pose, some pixels, measurements."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from aerodft.adapters.codec.measurement import MeasurementEncoder
from aerodft.adapters.config.camera import load_camera
from aerodft.cli.model_table import cautions, show_models
from aerodft.cli.output import print_budget, print_json, print_measurements, say
from aerodft.cli.probes import parse_probe
from aerodft.cli.stds import Stds, assumed_stds, parse_stds
from aerodft.dft.budget import Share, advice
from aerodft.dft.measure import Request, Setup
from aerodft.dft.measure import explain as explain_request
from aerodft.dft.measure import measure as measure_requests
from aerodft.dft.models import compare_models
from aerodft.errors import InputError, UsageError
from aerodft.geometry.poses import camera_pose
from aerodft.model.measurement import Measurement, ProjectionModel
from aerodft.model.pose import GeoOrigin, GimbalSource, HeightSource, PoseSample, PoseStd
from aerodft.model.status import Status

_LOWEST_M = 1e-3


def measure(
    camera: Annotated[Path | None, typer.Option(help="Camera file (TOML).")] = None,
    height: Annotated[float | None, typer.Option(help="Camera height above the measured plane, m.")] = None,
    tilt: Annotated[float | None, typer.Option(help="Angle of the optical axis from straight down, deg.")] = None,
    roll: Annotated[float, typer.Option(help="Positive with the camera's right side down, deg.")] = 0.0,
    heading: Annotated[float, typer.Option(help="Clockwise from true north, deg.")] = 0.0,
    lat: Annotated[float | None, typer.Option(help="Camera latitude, WGS84, deg.")] = None,
    lon: Annotated[float | None, typer.Option(help="Camera longitude, WGS84, deg.")] = None,
    model: Annotated[ProjectionModel | None, typer.Option(help="Projection model; else pinhole.")] = None,
    std: Annotated[
        str | None,
        typer.Option(
            help="Standard deviations: height,position,elevation,focal(px),px; tilt,pan,roll,heading,attitude."
        ),
    ] = None,
    probe: Annotated[
        list[str] | None, typer.Option(help='"KIND u,v [u,v] [elevation=Z] [name=N]"; may be repeated.')
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Both projection models side by side, and what lies between.")
    ] = False,
    recording: Annotated[Path | None, typer.Option(help="Take camera and pose from this recording.")] = None,
    at: Annotated[
        str | None, typer.Option(help="With --recording: seconds from its start, UTC ns, or ISO 8601.")
    ] = None,
    depth_map: Annotated[
        Path | None, typer.Option(help="Write range, ground point and sampling of every pixel to this folder.")
    ] = None,
    image: Annotated[Path | None, typer.Option(help="With --depth-map: the image, to be seen from above.")] = None,
    explain: Annotated[bool, typer.Option("--explain", help="Say where each uncertainty comes from.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print a JSON list.")] = False,
) -> None:
    r"""Measure pixels of one image with a known pose.

    \b
    Example:
      aerodft measure --camera configs/cameras/canon-1000d.toml --height 10.48 --tilt 67 \
        --std height=0.1,tilt=0.2,px=1 --probe "range 1944,493" --json
    """
    if depth_map is not None and (probe or compare or explain):
        raise UsageError("--depth-map beside --probe, --compare or --explain", expected="one of them")
    if image is not None and depth_map is None:
        raise UsageError("--image without --depth-map", expected="both, to see the image from above")
    if compare and explain:
        raise UsageError("--explain beside --compare", expected="one of them")
    if not probe and depth_map is None:
        raise UsageError("no --probe", expected='e.g. --probe "distance 812,604.5 1377,611"')
    if (recording is None) != (at is None):
        raise UsageError("--recording and --at go together", expected="--at seconds from its start, UTC ns, ISO 8601")
    if recording is not None and at is not None:
        _refuse_pose(camera=camera, height=height, tilt=tilt, roll=roll or None, heading=heading or None, lat=lat)
        setup, sample, stds = _recorded(recording, at, model, std)
    else:
        stds = parse_stds(std) if std else assumed_stds(height or 0.0)
        setup = _setup(camera, model or ProjectionModel.PINHOLE, stds)
        sample = _sample(height, tilt, roll, heading, (lat, lon), stds)
    _check_model(setup, sample, model, roll, compare=compare)
    if depth_map is not None:
        from aerodft.cli.depth import write_depth  # noqa: PLC0415 - matplotlib and the video library are slow

        write_depth(setup, sample, depth_map, image, as_json=json)
        return
    parsed = [parse_probe(text, index, stds) for index, text in enumerate(probe or [])]
    requests = tuple(Request(probe=one, pixels=one.pixels, std_px=one.std_px) for one in parsed)
    if compare:
        _compare(setup, sample, requests, as_json=json)
    else:
        measurements = measure_requests(setup, sample, requests)
        budgets = [explain_request(setup, sample, request) for request in requests] if explain else []
        _show(measurements, budgets, as_json=json)
        _finish(measurements)


def _recorded(
    recording: Path, at: str, model: ProjectionModel | None, std: str | None
) -> tuple[Setup, PoseSample, Stds]:
    from aerodft.cli.recorded import recorded_setup  # noqa: PLC0415 - the bus and video libraries are slow

    stds = parse_stds(std) if std else Stds()
    if stds.pose != PoseStd():
        raise UsageError("--std of the pose beside --recording", expected="px, elevation: the pose's are recorded")
    setup, sample = recorded_setup(recording, at)
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
    if roll:
        option = "--compare" if compare else "--model dft"
        raise UsageError(f"--roll with {option}", got=f"{roll:g}", expected="0: the paper's camera does not roll")
    for caution in cautions(setup.camera, sample):
        say(f"aerodft: {caution}")


def _refuse_pose(**options: object) -> None:
    for name, value in options.items():
        if value is not None:
            raise UsageError(f"--{name} beside --recording", expected="one of them: the recording has camera and pose")


def _setup(camera: Path | None, model: ProjectionModel, stds: Stds) -> Setup:
    if camera is None:
        raise UsageError("no --camera", expected="a camera file, e.g. configs/cameras/canon-1000d.toml")
    return Setup(camera=stds.on_camera(load_camera(camera)), model=model)


def _sample(
    height: float | None,
    tilt: float | None,
    roll: float,
    heading: float,
    lat_lon: tuple[float | None, float | None],
    stds: Stds,
) -> PoseSample:
    height_m = _in_range("--height", height, _LOWEST_M, 100_000.0, "m above the measured plane, above 0")
    tilt_deg = _in_range("--tilt", tilt, 0.0, 180.0, "deg from straight down: 0 nadir, 90 horizon, at most 180")
    _in_range("--roll", roll, -180.0, 180.0, "deg")
    _in_range("--heading", heading, -360.0, 360.0, "deg")
    lat, lon = lat_lon
    if (lat is None) != (lon is None):
        raise UsageError("--lat and --lon go together")
    origin = None
    if lat is not None and lon is not None:
        _in_range("--lat", lat, -90.0, 90.0, "deg")
        _in_range("--lon", lon, -180.0, 360.0, "deg")
        origin = GeoOrigin(lat_rad=math.radians(lat), lon_rad=math.radians(lon))
    pose = camera_pose(
        height_agl_m=height_m,
        tilt_rad=math.radians(tilt_deg),
        roll_rad=math.radians(roll),
        heading_rad=math.radians(heading),
        std=stds.pose,
    )
    return PoseSample(
        stamp_ns=0,
        status=Status.OK,
        reasons=stds.assumptions,
        pose=pose,
        std=stds.pose,
        origin=origin,
        lat_rad=None if origin is None else origin.lat_rad,
        lon_rad=None if origin is None else origin.lon_rad,
        height_source=HeightSource.MANUAL,
        height_datum="manual",
        attitude_source=GimbalSource.MANUAL,
    )


def _in_range(option: str, value: float | None, low: float, high: float, expected: str) -> float:
    if value is None:
        raise UsageError(f"no {option}", expected=expected)
    if not low <= value <= high:
        raise InputError(option, got=f"{value:g}", expected=expected)
    return value


def _show(measurements: list[Measurement], budgets: list[tuple[Share, ...]], *, as_json: bool) -> None:
    """Print measurements; with budgets, one for each, also where their uncertainty comes from."""
    encoder = MeasurementEncoder()
    documents = [dict(encoder.payload(measurement)) for measurement in measurements]
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
