"""Payloads that are written together are, byte by byte, what each is alone."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import orjson
import pytest

from aerodft.adapters.codec import wire
from aerodft.adapters.codec.events import decode_images, encode_image, encode_images, image_templates
from aerodft.adapters.codec.measurement import MeasurementEncoder
from aerodft.adapters.codec.pose import encode_pose
from aerodft.adapters.codec.pose_encoder import PoseEncoder
from aerodft.adapters.codec.template import Templates
from aerodft.dft.measure import Request, Setup, measure_images, measure_rows
from aerodft.dft.request import linked
from aerodft.errors import InputError
from aerodft.geometry.poses import camera_pose, pose_covariances
from aerodft.geometry.rotation import camera_attitude
from aerodft.model.camera import Camera, Zoom, ZoomSource
from aerodft.model.image import Image, StampClock
from aerodft.model.image_rows import ImageRows
from aerodft.model.pose import GeoOrigin, GimbalSource, HeightSource, Pose, PoseSample, PoseStd
from aerodft.model.pose_columns import PoseColumns, PoseRow, PoseRows, sample_of
from aerodft.model.probe import Probe, ProbeKind
from aerodft.model.status import Status

CAMERA = Camera(name="c", width_px=1920, height_px=1080, fx_px=1600.0, fy_px=1590.0, cx_px=990.0, cy_px=500.0)
STD = PoseStd(height_agl_m=0.5, horizontal_m=1.0, tilt_rad=0.005, pan_rad=0.006, roll_rad=0.004, heading_rad=0.03)
PIXELS = {
    ProbeKind.POSITION: ((900.0, 800.0),),
    ProbeKind.RANGE: ((960.0, 300.0),),
    ProbeKind.WIDTH: ((300.0, 820.0), (1700.0, 810.0)),
    ProbeKind.HEIGHT: ((1000.0, 900.0), (1001.0, 840.0)),
    ProbeKind.BEARING: ((400.0, 700.0),),
    ProbeKind.AREA: ((400.0, 700.0), (800.0, 720.0), (810.0, 900.0), (420.0, 890.0)),
}
ORIGINS = (None, GeoOrigin(lat_rad=-0.6, lon_rad=2.6, alt_msl_m=580.0), GeoOrigin(lat_rad=0.1, lon_rad=-3.0))


def samples(count: int) -> list[PoseSample]:
    """Poses that differ in numbers, and here and there in what is known, said or zoomed; some are none."""
    rng = np.random.default_rng(11)
    found = []
    for k in range(count):
        if k % 17 == 16:
            found.append(PoseSample(stamp_ns=k, status=Status.STALE_TELEMETRY, reasons=("\x00 is no number",)))
            continue
        pose = camera_pose(
            height_agl_m=float(rng.uniform(2, 60)),
            tilt_rad=math.radians(rng.uniform(0, 95) if k % 5 == 0 else rng.uniform(20, 60)),
            heading_rad=float(rng.uniform(0, 6)),
            std=STD,
        )
        sample = PoseSample(
            stamp_ns=10**18 + k,
            status=Status.OK,
            reasons=("a \"word\" and '\\n'",) if k % 19 == 3 else (),
            pose=pose,
            std=STD,
            origin=ORIGINS[k // 40 % 3],
            height_source=HeightSource.HOME,
            height_datum="home",
            height_age_s=0.1 * k,
            attitude_source=GimbalSource.MOUNT_STATUS,
            telemetry_age_s=1e-7 * k,
        )
        place = {"lat_rad": -0.6 + 1e-7 * k, "lon_rad": 2.6, "alt_msl_m": 600.0 - k} if k % 3 else {}
        zoom = Zoom(magnification=1.2, std=0.01, source=ZoomSource.CAMERA_SETTINGS) if k % 13 == 5 else None
        found.append(replace(sample, zoom=zoom, **place))
    return found


def rows(count: int, origin: GeoOrigin | None, *, has_place: bool) -> list[PoseRow]:
    """Poses that were made together."""
    rng = np.random.default_rng(12)
    tilts_rad, headings_rad = rng.uniform(0.3, 1.1, count), rng.uniform(0, 6, count)
    wxyz = camera_attitude(tilts_rad, rng.uniform(-0.1, 0.1, count), headings_rad)
    std = rng.uniform(0.001, 0.01, (count, 7))
    position = rng.uniform(2, 60, (count, 3))
    alike = PoseSample(
        stamp_ns=0,
        status=Status.OK,
        origin=origin,
        height_source=HeightSource.HOME,
        height_datum="home",
        attitude_source=GimbalSource.MOUNT_STATUS,
    )
    columns = PoseColumns(
        stamp_ns=10**18 + np.arange(count),
        pose=Pose(
            position_enu_m=position,
            wxyz=wxyz,
            cov=pose_covariances(wxyz, std),
            velocity_enu_mps=position / 7,
            rate_cam_radps=position / 900,
            time_std_s=0.02,
        ),
        std=std,
        lat_lon_alt=rng.normal(size=(count, 3)) if has_place else None,
        height_age_s=rng.uniform(0, 1, count),
        telemetry_age_s=rng.uniform(0, 1, count),
        which=np.arange(count) % 3 // 2,
        alike=(alike, replace(alike, reasons=("turning",))),
    )
    return [PoseRow(columns, row) for row in range(count)]


def test_rows_of_columns_are_written_and_measured_as_their_samples() -> None:
    together = [each for k, origin in enumerate(ORIGINS) for each in rows(30, origin, has_place=k > 0)]
    mixed = [*together[::2], *samples(40), *together[1::2]]
    alone = [sample_of(each) for each in mixed]
    assert PoseEncoder().encode(mixed).each() == [encode_pose(each) for each in alone]
    probes = [Probe(name=str(kind), kind=kind, pixels=pixels) for kind, pixels in PIXELS.items()]
    requests = linked(Request(probe=probe, pixels=probe.pixels, std_px=0.75) for probe in probes)
    indices = list(range(len(mixed)))
    found, wanted = (measure_images(Setup(camera=CAMERA), poses, requests, indices) for poses in (mixed, alone))
    assert {status for image in found for status in image.statuses} > {Status.OK}
    written = MeasurementEncoder().images(found).each()
    assert written == [MeasurementEncoder().image(image) for image in wanted]


@pytest.mark.parametrize("limit_m", [None, 40.0])
@pytest.mark.parametrize("origin", ORIGINS)
def test_columns_of_images_are_written_as_these(origin: GeoOrigin | None, limit_m: float | None) -> None:
    """Also a part of them, and where some have no number and some no plain answer."""
    poses = rows(60, origin, has_place=origin is not None)
    poses = PoseRows(poses[0].columns, np.array([posed.row for posed in poses])[::-1][:50])
    probes = [Probe(name=str(kind), kind=kind, pixels=pixels) for kind, pixels in PIXELS.items()]
    requests = linked(Request(probe=probe, pixels=probe.pixels, std_px=0.75) for probe in probes)
    indices = [None if k % 7 == 0 else 10**15 * k - 1 for k in range(len(poses))]
    setup = Setup(camera=CAMERA, max_range_m=limit_m)
    (images,) = measure_rows(setup, poses, requests, indices)
    wanted = measure_images(setup, list(poses), requests, indices)
    assert 0 < sum(images.is_plain) < len(images) or limit_m is None
    assert images.statuses() == Counter(image.statuses for image in wanted)
    alone = [MeasurementEncoder().image(image) for image in wanted]
    assert MeasurementEncoder().columns(images).each() == alone
    assert MeasurementEncoder().columns(images.rows(11, 37)).each() == alone[11:37]
    assert PoseEncoder().encode_rows(poses).each() == [encode_pose(sample_of(each)) for each in poses]


def test_stamps_of_images() -> None:
    images = [
        Image(
            index=k,
            stamp_ns=10**18 + 7**k,
            arrival_ns=k,
            clock=(StampClock.UTC, StampClock.HOST)[k % 3 == 1],
            width_px=(None, 1920)[k % 5 == 2],
        )
        for k in range(20)
    ]
    assert encode_images(images, image_templates()).each() == list(map(encode_image, images))


def test_poses() -> None:
    poses = samples(150)
    assert PoseEncoder().encode(poses).each() == [encode_pose(each) for each in poses]


@pytest.mark.parametrize("limit_m", [None, 60.0])
def test_images(limit_m: float | None) -> None:
    probes = [Probe(name=str(kind), kind=kind, pixels=pixels) for kind, pixels in PIXELS.items()]
    requests = linked(Request(probe=probe, pixels=probe.pixels, std_px=0.75) for probe in probes)
    poses = samples(150)
    indices = [None if k % 7 == 0 else k for k in range(len(poses))]
    images = measure_images(Setup(camera=CAMERA, max_range_m=limit_m), poses, requests, indices)
    statuses = {status for image in images for status in image.statuses}
    assert len(statuses) > 2  # answers and refusals are among them
    encoder = MeasurementEncoder()
    together = encoder.images(images).each()
    assert together == [MeasurementEncoder().image(image) for image in images]
    assert together == encoder.images(images[::-1]).each()[::-1]
    assert [image.statuses for image in images] == [tuple(each.status for each in image) for image in images]


def test_any_number_is_written_as_alone() -> None:
    """Among them whole ones, which JSON tells from others: these are not written with a template."""
    rng = np.random.default_rng(5)
    values = rng.normal(size=(400, 3)) * 10.0 ** rng.integers(-300, 300, (400, 3))
    values[::7, 1], values[1::7, 2], values[2::7, 0] = np.nan, -0.0, 1e16
    rows = [("a" if k % 2 else "b", row) for k, row in enumerate(values.tolist())]

    def payload(item: tuple[str, list[float]]) -> wire.Json:
        first = item[1][0] if item[0] == "a" else round(min(item[1][0], 9.0) if item[1][0] > 0 else 0)
        whole = {"text": str(whole_of(item)), "whole": whole_of(item), "none": None}
        return {**whole, "x": [first], "rest": {"y": item[1][1:], "std_px": 2.5}}

    def whole_of(item: tuple[str, list[float]]) -> int:
        return rows.index(item) * 23_058_430_092_136_939 - 2**62

    written = Templates(whole=("text", "whole", "none"), fixed=("std_px",)).written(
        rows,
        key=lambda item: item[0],
        payload=payload,
        whole=lambda items: np.array([[whole_of(item)] * 2 for item in items]),
        numbers=lambda items: np.array([item[1] for item in items]),
    )
    assert written.each() == [wire.dump(payload(item)) for item in rows]


@pytest.mark.parametrize("clock", StampClock)
@pytest.mark.parametrize("size", [(None, None), (1920, 1080)])
@pytest.mark.parametrize("count", [1, 3, 50])
def test_images_that_differ_in_whole_numbers_only_are_columns(
    clock: StampClock, size: tuple[int | None, int | None], count: int
) -> None:
    """Read and written without one object each, exact to the last nanosecond."""
    stamps = [2**62 + k**5 for k in range(count)]
    images = [
        Image(index=2**40 + k, stamp_ns=at, arrival_ns=at + k % 2, clock=clock, width_px=size[0], height_px=size[1])
        for k, at in enumerate(stamps)
    ]
    data = [encode_image(image) for image in images]
    rows = decode_images(data)
    assert isinstance(rows, ImageRows)
    assert len(rows) == count
    assert [encode_image(image) for image in rows] == data == [encode_image(rows[k]) for k in range(count)]
    assert encode_images(rows, image_templates()).each() == data
    assert encode_images(rows[1:2], image_templates()).each() == data[1:2]


@pytest.mark.parametrize(
    "change", [{"clock": "utc"}, {"width_px": 640}, {"width_px": 1920.0}, {"height_px": None}, {"arrival_ns": "3"}]
)
def test_images_that_differ_in_more_are_none(change: dict[str, object]) -> None:
    shots = [
        Image(index=k, stamp_ns=k, arrival_ns=9 + k, clock=StampClock.HOST, width_px=1920, height_px=1080)
        for k in range(3)
    ]
    data = [encode_image(image) for image in shots]
    data[1] = wire.dump({**orjson.loads(data[1]), **change})
    found = decode_images(data)
    assert not isinstance(found, ImageRows)
    assert [encode_image(image) for image in found] == data


@pytest.mark.parametrize("index", [2**63, -(2**63), 1.0, True, None, "x"])
def test_a_number_that_is_no_whole_one_of_64_bits_is_refused(index: object) -> None:
    """Many are written as one array, which would cut them short without a word."""
    good = encode_image(Image(index=7, stamp_ns=2**62, arrival_ns=5))
    assert decode_images([good])[0].index == 7
    for key in ("index", "stamp_ns", "arrival_ns"):
        with pytest.raises(InputError, match="incomplete or wrong"):
            decode_images([good, orjson.dumps({**orjson.loads(good), key: index})])
