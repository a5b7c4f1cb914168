"""Many images at once: each image's answers are the same to the last bit whichever others are measured with it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from aerodft.dft import Request, Setup, link_requests, measure
from aerodft.geometry import Plane, camera_pose
from aerodft.model import (
    Camera,
    CameraStd,
    GeoOrigin,
    PixelSource,
    PoseBatch,
    PoseSample,
    PoseStd,
    Probe,
    ProbeKind,
    ProjectionModel,
    Status,
    Zoom,
    ZoomSource,
)

CAMERA = Camera(
    name="c",
    width_px=1920,
    height_px=1080,
    fx_px=1600.0,
    fy_px=1590.0,
    cx_px=990.0,
    cy_px=500.0,
    distortion=(-0.1, 0.02, 1e-3, -1e-3, 0.0),
    std=CameraStd(focal_px=4.0, principal_point_px=2.0),
)
STD = PoseStd(height_agl_m=0.5, horizontal_m=1.0, tilt_rad=0.005, pan_rad=0.006, roll_rad=0.004, heading_rad=0.03)
PIXELS = {
    ProbeKind.POSITION: ((900.0, 800.0),),
    ProbeKind.RANGE: ((960.0, 20.0),),
    ProbeKind.DISTANCE: ((700.0, 900.0), (1200.0, 600.0)),
    ProbeKind.WIDTH: ((300.0, 820.0), (1700.0, 810.0)),
    ProbeKind.HEIGHT: ((1000.0, 900.0), (1001.0, 840.0)),
    ProbeKind.BEARING: ((400.0, 700.0), (800.0, 900.0)),
    ProbeKind.AREA: ((400.0, 700.0), (800.0, 720.0), (810.0, 900.0), (420.0, 890.0)),
    ProbeKind.LENGTH: tuple((500.0 + 60.0 * k, 700.0 + 17.0 * (k % 3)) for k in range(12)),
}
ORIGIN = GeoOrigin(lat_rad=-0.6, lon_rad=2.6, alt_msl_m=580.0)


def requests():
    probes = [
        Probe(name=f"{kind}-{turn}", kind=kind, pixels=tuple((u + 7.0 * turn, v) for u, v in pixels), elevation_m=turn)
        for kind, pixels in PIXELS.items()
        for turn in (0, 1)
    ]
    probes.append(Probe(name="roof", kind=ProbeKind.WIDTH, pixels=PIXELS[ProbeKind.WIDTH], on_top_of="height-0"))
    probes.append(Probe(name="ray", kind=ProbeKind.BEARING, pixels=((960.0, 100.0),)))
    return link_requests(
        Request(probe=probe, pixels=probe.pixels, std_px=0.5 + 0.5 * (k % 2)) for k, probe in enumerate(probes)
    )


def samples(count):
    """Poses from nadir to above the horizon, some without a place, some zoomed, some that are none."""
    rng = np.random.default_rng(3)
    found = []
    for k in range(count):
        if k % 11 == 10:
            found.append(PoseSample(stamp_ns=k, status=Status.STALE_TELEMETRY, reasons=("stale",)))
            continue
        pose = camera_pose(
            height_agl_m=float(rng.uniform(0.5, 60)),
            tilt_rad=math.radians(rng.uniform(0, 95) if k % 5 == 0 else rng.uniform(20, 60)),
            roll_rad=float(rng.normal(0, 0.05)),
            heading_rad=float(rng.uniform(0, 6)),
            std=STD,
        )
        zoom = Zoom(magnification=1.2, std=0.01, source=ZoomSource.CAMERA_SETTINGS) if k % 7 == 3 else None
        origin = None if k % 13 == 5 else ORIGIN
        found.append(PoseSample(stamp_ns=k, status=Status.OK, pose=pose, std=STD, zoom=zoom, origin=origin))
    return found


on_every_ground = pytest.mark.parametrize(
    "setup",
    [
        Setup(camera=CAMERA, max_range_m=400.0),
        Setup(camera=CAMERA, model=ProjectionModel.DFT),
        Setup(camera=CAMERA, ground=Plane.sloping([0.0, 0.0, 0.0], 0.1, 1.0)),
    ],
    ids=["level", "dft", "slope"],
)


@on_every_ground
def test_answers_do_not_depend_on_the_images_beside(setup):
    poses, asked = PoseBatch.from_samples(samples(70 if setup.ground is None else 20)), requests()
    numbers = np.arange(len(poses))
    together = measure(setup, poses, asked, numbers)
    alone = [measure(setup, poses[k : k + 1], asked, numbers[k : k + 1])[0] for k in numbers]
    assert plain(together) == plain(alone)
    some = np.sort(np.random.default_rng(5).choice(len(poses), len(poses) // 2, replace=False))
    assert plain(measure(setup, poses.rows(some), asked, some)) == plain(alone[k] for k in some)
    statuses = {measurement.status for image in together for measurement in image}
    assert {Status.OK, Status.ABOVE_HORIZON, Status.STALE_TELEMETRY} <= statuses
    assert [len(image) for image in measure(setup, poses, ())] == [0] * len(poses)


@on_every_ground
@pytest.mark.parametrize("kind", list(PIXELS))
def test_images_may_have_pixels_of_their_own(setup, kind):
    poses, rng = PoseBatch.from_samples(samples(70 if setup.ground is None else 20)), np.random.default_rng(6)
    probe = Probe(name="seen", kind=kind, source=PixelSource.OBSERVED, elevation_m=0.3, elevation_std_m=0.1)
    moved = np.array([np.array(PIXELS[kind]) + rng.normal(0.0, 15.0, 2) for _ in poses])
    together = measure(setup, poses, (Request(probe=probe, pixels=moved, std_px=0.7),))
    own = [Request(probe=probe, pixels=tuple(map(tuple, px)), std_px=0.7) for px in moved.tolist()]
    assert plain(together) == plain(measure(setup, poses[k : k + 1], (own[k],))[0] for k in range(len(poses)))
    values = {measurement.value for image in together for measurement in image if measurement.value is not None}
    assert kind == ProbeKind.POSITION or len(values) > len(poses) // 4


def plain(images):
    """Images' measurements without their poses, which are no values to compare."""
    return [[repr(replace(each, pose=None)) for each in image] for image in images]


@pytest.mark.parametrize("function", [np.sin, np.cos, np.arctan2, np.hypot, np.sqrt, np.tan])
def test_elementary_functions_do_not_depend_on_the_place_in_an_array(function):
    """What all batches rest on: the machine's vector instructions and their remainders give the same bits."""
    rng = np.random.default_rng(7)
    for count in (1, 2, 3, 5, 7, 8, 9, 31, 64, 100):
        arguments = rng.uniform(0.0, 10.0, (2 if function.nin == 2 else 1, count))
        alone = [function(*column)[()] for column in arguments.T]
        strided = np.repeat(arguments, 3, axis=1)[:, ::3]
        assert np.array_equal(function(*arguments), alone)
        assert np.array_equal(function(*strided), alone)
