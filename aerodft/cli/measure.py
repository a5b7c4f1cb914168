"""``aerodft measure``: one pose, some pixels, measurements; or the same pixels under both projection models."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from aerodft.adapters.codec.measurement import measurement_payload
from aerodft.cli.option_values import TopicOption, parse_topics
from aerodft.cli.output import print_json, say, tables
from aerodft.cli.pose_options import (
    CameraOption,
    CovarianceOption,
    GivenGround,
    GivenPose,
    HeadingOption,
    HeightOption,
    LatOption,
    LonOption,
    MeasuredLevel,
    RollOption,
    StdOption,
    Stds,
    TiltOption,
    given_scene,
    parse_stds,
    refuse_beside,
)
from aerodft.cli.probes import parse_probes
from aerodft.dft.budget import Share, advice
from aerodft.dft.equations import tilt_warning
from aerodft.dft.measure import Request, Setup
from aerodft.dft.measure import explain as explain_request
from aerodft.dft.measure import measure as measure_requests
from aerodft.dft.models import ModelDifference, compare_models
from aerodft.errors import UsageError
from aerodft.geometry.rotation import camera_angles
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera
from aerodft.model.measurement import Measurement, ProjectionModel
from aerodft.model.pose import PoseSample, PoseStd
from aerodft.model.pose_batch import PoseBatch
from aerodft.model.status import Status

_LEVEL_RAD: Final = math.radians(0.05)


def measure(
    camera: CameraOption = None,
    height: HeightOption = None,
    tilt: TiltOption = None,
    roll: RollOption = 0.0,
    heading: HeadingOption = 0.0,
    lat: LatOption = None,
    lon: LonOption = None,
    altitude: Annotated[
        float | None, typer.Option(help="With --terrain, instead of --height: above mean sea level, m.")
    ] = None,
    elevation: Annotated[float, typer.Option(help="Height of what is measured above the ground, m.")] = 0.0,
    slope: Annotated[float | None, typer.Option(help="Ground that rises at this angle, through the foot, deg.")] = None,
    uphill: Annotated[float | None, typer.Option(help="Where it rises, clockwise from true north, deg.")] = None,
    terrain: Annotated[Path | None, typer.Option(help="Ground of an elevation model (GeoTIFF); needs --lat.")] = None,
    max_range: Annotated[float | None, typer.Option(help="What is farther is refused, m.")] = None,
    model: Annotated[ProjectionModel | None, typer.Option(help="Projection model; else pinhole.")] = None,
    std: StdOption = None,
    covariance: CovarianceOption = None,
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
    else:
        setup, sample, stds = given_scene(pose, terms, camera, calibration, model, std)
    setup = MeasuredLevel.of(elevation, max_range, stds).on(setup)
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


def print_measurements(measurements: Iterable[Measurement]) -> None:
    """A table on stdout."""
    table = Table("probe", "kind", "value", "95 % interval", "ground X, Y (m)", "status")
    for item in measurements:
        value = "" if item.value is None else f"{item.value:.3f} {item.unit}"
        interval = "" if item.ci95 is None else f"{item.ci95[0]:.3f} ... {item.ci95[1]:.3f}"
        if item.ellipse95 is not None:
            interval = f"ellipse {item.ellipse95.semi_major_m:.3f} x {item.ellipse95.semi_minor_m:.3f} m"
        ground = "; ".join(f"{x:.2f}, {y:.2f}" for x, y, _ in item.ground_m or ())
        status = str(item.status) if item.status is Status.OK else f"{item.status}: {'; '.join(item.reasons)}"
        table.add_row(item.name, item.kind, value, interval, ground, status)
    tables().print(table)


def print_budget(measurement: Measurement, budget: Sequence[Share]) -> None:
    """Where one measurement's uncertainty comes from, the largest part first, on stdout."""
    parts = ", ".join(f"{part.source} {100 * part.share:.0f} % ({part.std:.3g} {measurement.unit})" for part in budget)
    sentence = f"{parts}. {advice(tuple(budget))}" if budget else "no single number whose uncertainty could be divided"
    tables().print(f"{measurement.name}: {sentence}", soft_wrap=True)


def model_document(differences: Sequence[ModelDifference]) -> dict[str, list[dict[str, Any]]]:
    """The JSON of ``--compare``: the measurements of both models as on the wire, and what lies between them."""
    return {
        "pinhole": [measurement_payload(item.pinhole) for item in differences],
        "dft": [measurement_payload(item.dft) for item in differences],
        "difference": [_difference(item) for item in differences],
    }


def cautions(camera: Camera, sample: PoseSample) -> list[str]:
    """What the paper's model cannot see of this camera and pose, a sentence each: the horizon (Eq. 1), and roll."""
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


def show_models(differences: Sequence[ModelDifference], sample: PoseSample, *, as_json: bool) -> None:
    """Print the comparison: a JSON document, or a table and a sentence on what Eq. 5 does at this tilt."""
    if as_json:
        print_json(model_document(differences))
        return
    table = Table("probe", "", "pinhole", "dft", "difference", "%", "by Eq. 5 (m)", "by angles (m)")
    for item in differences:
        _add(table, item)
    console = tables()
    console.print(table)
    if sample.pose is None:
        return
    tilt_rad, _, _ = camera_angles(sample.pose.wxyz)
    console.print(
        f"In the image's middle, at a tilt of {math.degrees(tilt_rad):.1f} deg, Eq. 5 gives"
        f" {math.sin(tilt_rad):.2f} of the true X; the rest is the paper's angles, linear in pixels."
    )


def _difference(item: ModelDifference) -> dict[str, Any]:
    apart, percent = _apart(item)
    return {
        "name": item.pinhole.name,
        "kind": item.pinhole.kind,
        "value": item.value,
        "unit": item.pinhole.unit,
        "percent": item.percent,
        "ground_m": _listed(item.ground_m),
        "apart_m": apart,
        "apart_percent_of_range": percent,
        "equation_5_m": _listed(item.equation_5_m),
        "angles_m": _listed(item.angles_m),
    }


def _listed(values: FloatArray | None) -> list[Any] | None:
    return None if values is None else values.tolist()


def _apart(item: ModelDifference) -> tuple[list[float] | None, list[float] | None]:
    """How far the two ground points of each pixel are apart, in m and in percent of the pinhole's slant range."""
    if item.ground_m is None or item.pinhole.range_m is None:
        return None, None
    apart = [math.hypot(*row) for row in item.ground_m.tolist()]
    return apart, [100 * m / away for m, away in zip(apart, item.pinhole.range_m, strict=True)]


def _add(table: Table, item: ModelDifference) -> None:
    pinhole, dft = item.pinhole, item.dft
    if pinhole.value is not None or item.ground_m is None:
        values = [str(m.status) if m.value is None else f"{m.value:.3f} {m.unit}" for m in (pinhole, dft)]
        table.add_row(pinhole.name, pinhole.kind, *values, _signed(item.value), _signed(item.percent, 1))
    if item.ground_m is None or pinhole.ground_m is None or dft.ground_m is None:
        return
    _, percents = _apart(item)
    for index, shift in enumerate(item.ground_m.tolist()):
        for axis, letter in enumerate("XY"):
            first = index == axis == 0 and pinhole.value is None
            table.add_row(
                pinhole.name if first else "",
                f"{letter} {index} (m)",
                f"{pinhole.ground_m[index][axis]:.3f}",
                f"{dft.ground_m[index][axis]:.3f}",
                _signed(shift[axis]),
                "" if percents is None or axis else f"{percents[index]:.1f} of range",
                "" if item.equation_5_m is None or axis else _signed(float(item.equation_5_m[index])),
                "" if item.angles_m is None else _signed(float(item.angles_m[index, axis])),
            )


def _signed(number: float | None, digits: int = 3) -> str:
    return "" if number is None else f"{number:+.{digits}f}"
