"""Payloads that are written together are, byte by byte, what each is alone."""

import math
from dataclasses import replace

import numpy as np
import orjson
import pytest

from aerodft.adapters.wire.events import decode_images, encode_image, encode_images
from aerodft.adapters.wire.measurement import MEASUREMENTS_SCHEMA, encode_batch, encode_measurement
from aerodft.adapters.wire.packed_json import encode_payloads
from aerodft.adapters.wire.payload import Json, dump_payload
from aerodft.adapters.wire.pose import encode_poses
from aerodft.dft import NO_IMAGE, Request, Setup, link_requests, measure
from aerodft.errors import InputError
from aerodft.geometry import camera_pose
from aerodft.model import (
    Camera,
    GeoOrigin,
    GimbalSource,
    HeightSource,
    Image,
    ImageRows,
    Measurement,
    PixelSource,
    PoseBatch,
    PoseSample,
    PoseStd,
    Probe,
    ProbeKind,
    StampClock,
    Status,
    Zoom,
    ZoomSource,
)
from tests.payloads import encode_pose

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
    assert encode_images(images).each() == list(map(encode_image, images))


def test_poses() -> None:
    poses = samples(150)
    assert encode_poses(PoseBatch.from_samples(poses)).each() == [encode_pose(each) for each in poses]
    assert encode_poses(PoseBatch.from_samples([])).each() == []


@pytest.mark.parametrize("limit_m", [None, 60.0])
def test_measurements(limit_m: float | None) -> None:
    """Answers and refusals, of images with numbers and of stamps alone; any part of a batch as the whole."""
    probes = [Probe(name=str(kind), kind=kind, pixels=pixels) for kind, pixels in PIXELS.items()]
    requests = link_requests(Request(probe=probe, pixels=probe.pixels, std_px=0.75) for probe in probes)
    images = np.array([NO_IMAGE if k % 7 == 0 else 10**15 * k - 1 for k in range(150)])
    batch = measure(Setup(camera=CAMERA, max_range_m=limit_m), PoseBatch.from_samples(samples(150)), requests, images)
    assert len({each.status for image in batch for each in image}) > 2
    together = encode_batch(batch).each()
    assert together == [image_record(image) for image in batch]
    assert together[::-3] == encode_batch(batch[::-3]).each()
    assert together[16:18] == [encode_batch(batch[row : row + 1]).text(0) for row in (16, 17)]


def test_measurements_by_pixels_of_their_own() -> None:
    probe = Probe(name="seen", kind=ProbeKind.WIDTH, source=PixelSource.OBSERVED)
    pixels = np.array([((300.0 + k, 820.0), (1700.0, 810.5)) for k in range(40)])
    request = Request(probe=probe, pixels=pixels, std_px=2.0)
    batch = measure(Setup(camera=CAMERA), PoseBatch.from_samples(samples(40)), (request,))
    assert encode_batch(batch).each() == [image_record(image) for image in batch]


def image_record(measurements: list[Measurement]) -> bytes:
    """The measurements of one image, out of what each is alone."""
    own = "name kind value unit std ci95 ellipse95 status reasons pixels std_px ground_m enu_m cov_enu_m2 geo range_m"
    alone = [orjson.loads(encode_measurement(each)) for each in measurements]
    shared = {key: value for key, value in alone[0].items() if key not in {"schema", *own.split()}}
    each = [{key: one[key] for key in own.split()} for one in alone]
    return dump_payload({"schema": MEASUREMENTS_SCHEMA, **shared, "measurements": each})


def test_any_number_and_reason_is_written_as_alone() -> None:
    """Among them whole ones, which JSON tells from others: these are not written with a template."""
    rng = np.random.default_rng(5)
    values = rng.normal(size=(400, 3)) * 10.0 ** rng.integers(-300, 300, (400, 3))
    values[::7, 1], values[1::7, 2], values[2::7, 0] = np.nan, -0.0, 1e16
    is_float = np.arange(400) % 2
    whole = np.arange(400) * 23_058_430_092_136_939 - 2**62
    texts = [
        [None if row % 5 else "a, b", (), tuple(f'{number}, "{row}\n' for number in range(row % 3))]
        for row in range(400)
    ]

    def payload(row: int) -> Json:
        first, *rest = values[row].tolist()
        first = first if is_float[row] else round(min(first, 9.0) if first > 0 else 0)
        own = {"text": str(whole[row]), "whole": int(whole[row]), "none": None}
        calibration, at_top, within = texts[row]
        return {
            **own,
            "calibration": calibration,
            "reasons": at_top,
            "x": [first],
            "rest": {"y": rest, "std_px": 2.5, "reasons": within},
        }

    columns = {"text": whole, "whole": whole, "none": whole}
    written = encode_payloads(is_float[:, None], payload, columns, values, texts, fixed={"std_px"})
    assert written.each() == [dump_payload(payload(row)) for row in range(400)]


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
    assert encode_images(rows).each() == data
    assert encode_images(rows[1:2]).each() == data[1:2]


@pytest.mark.parametrize(
    "change", [{"clock": "utc"}, {"width_px": 640}, {"width_px": 1920.0}, {"height_px": None}, {"arrival_ns": "3"}]
)
def test_images_that_differ_in_more_are_none(change: dict[str, object]) -> None:
    shots = [
        Image(index=k, stamp_ns=k, arrival_ns=9 + k, clock=StampClock.HOST, width_px=1920, height_px=1080)
        for k in range(3)
    ]
    data = [encode_image(image) for image in shots]
    data[1] = dump_payload({**orjson.loads(data[1]), **change})
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
