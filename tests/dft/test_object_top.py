"""What lies on top of a measured object: a built scene for the value, Monte-Carlo for its standard deviation."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.dft import Request, Setup, explain
from aerodft.geometry import Plane, camera_pose, from_rotation_vector, matrix, multiply, pixels_from_rays
from aerodft.model import Camera, CameraStd, PoseSample, PoseStd, Probe, ProbeKind, Status
from tests.one_image import measure

CAMERA = Camera(
    name="c", width_px=1920, height_px=1080, fx_px=1500.0, fy_px=1500.0, cx_px=970.0, cy_px=530.0,
    distortion=(-0.1, 0.02, 1e-3, -1e-3), std=CameraStd(focal_px=6.0, principal_point_px=2.0),
)  # fmt: skip
STD = PoseStd(height_agl_m=0.3, tilt_rad=0.004, pan_rad=0.004, roll_rad=0.004)
SLOPE = Plane.sloping([0.0, 0.0, 0.0], 0.1, 1.0)
BASE_EN, TALL_M, WIDE_M = (4.0, 40.0), 6.0, 8.0
PX, DRAWS = 1.0, 4000


def scene(surface):
    """Base, top, and the two ends of a beam that lies level at the top's elevation."""
    base = np.array([*BASE_EN, 0.0 if surface is None else float(surface.height_at(np.array(BASE_EN)))])
    top = base + [0, 0, TALL_M]
    return np.array([base, top, top + [-WIDE_M / 2, 1.0, 0], top + [WIDE_M / 2, 1.0, 0]])


def pose_of(std):
    return camera_pose(height_agl_m=30.0, tilt_rad=math.radians(55), roll_rad=0.05, heading_rad=0.1, std=std)


def pixels_of(pose, points):
    return pixels_from_rays(CAMERA, (points - pose.position_enu_m) @ matrix(pose.wxyz))


def asked(pixels, elevation_std_m=0.0):
    pairs = [tuple(map(tuple, part)) for part in (pixels[:2], pixels[2:])]
    mast = Probe(name="mast", kind=ProbeKind.HEIGHT, pixels=pairs[0], elevation_std_m=elevation_std_m)
    beam = Probe(name="beam", kind=ProbeKind.WIDTH, pixels=pairs[1], on_top_of="mast")
    under = Request(probe=mast, pixels=mast.pixels, std_px=PX)
    return Request(probe=beam, pixels=beam.pixels, std_px=PX, on_top_of=under)


def answer(pose, pixels, surface=None, elevation_std_m=0.0):
    setup = Setup(camera=CAMERA, ground=surface)
    return measure(setup, PoseSample(stamp_ns=0, status=Status.OK, pose=pose), (asked(pixels, elevation_std_m),))[0]


@pytest.mark.parametrize("surface", [None, SLOPE], ids=["level", "slope"])
def test_a_beam_on_a_mast_has_its_length_and_its_place(surface):
    points, pose = scene(surface), pose_of(PoseStd())
    found = answer(pose, pixels_of(pose, points), surface)
    assert_allclose(found.value, WIDE_M, atol=1e-9)
    assert_allclose(found.enu_m, points[2:], atol=1e-9)


def drawn_beam(rng, pose, pixels):
    """One draw of a level plane at 0 +- 0.2 m, lens, pose and pixels, solved with another formula: by trigonometry."""
    shift = np.linalg.cholesky(pose.cov[:6, :6] + 1e-18 * np.eye(6)) @ rng.normal(size=6)
    eye, turn = pose.position_enu_m + shift[:3], matrix(multiply(pose.wxyz, from_rotation_vector(shift[3:])))
    zoom, centre = 1 + rng.normal() * 6.0 / 1500.0, rng.normal(size=2) * 2.0
    noisy = pixels + rng.normal(size=pixels.shape) * PX
    from_centre = (noisy - [CAMERA.cx_px, CAMERA.cy_px] - centre) / zoom + [CAMERA.cx_px, CAMERA.cy_px]
    rays = rays_of(from_centre) @ turn.T
    ground = 0.2 * rng.normal()
    base = eye + rays[0] * (ground - eye[2]) / rays[0, 2]
    away = math.hypot(*(base - eye)[:2])
    cosine = (base - eye)[:2] @ rays[1, :2] / away / math.hypot(*rays[1, :2])
    top = eye[2] + rays[1, 2] / math.hypot(*rays[1, :2]) * away * cosine
    ends = eye + rays[2:] * ((top - eye[2]) / rays[2:, 2])[:, None]
    return math.hypot(*(ends[1] - ends[0])[:2])


def rays_of(pixels):
    """By fixed-point iteration of OpenCV's model."""
    k1, k2, p1, p2 = CAMERA.distortion
    seen = (pixels - [CAMERA.cx_px, CAMERA.cy_px]) / CAMERA.fx_px
    xy = seen.copy()
    for _ in range(30):
        x, y = xy.T
        s = x * x + y * y
        bent = np.stack([2 * p1 * x * y + p2 * (s + 2 * x * x), p1 * (s + 2 * y * y) + 2 * p2 * x * y], axis=-1)
        xy = (seen - bent) / (1 + k1 * s + k2 * s * s)[:, None]
    return np.column_stack([xy, np.ones(len(xy))])


def test_its_standard_deviation_is_monte_carlos_with_every_error_shared_as_it_is():
    pose = pose_of(STD)
    pixels = pixels_of(pose, scene(None))
    rng = np.random.default_rng(3)
    widths = [drawn_beam(rng, pose, pixels) for _ in range(DRAWS)]
    found = answer(pose, pixels, elevation_std_m=0.2)
    assert_allclose(found.std, np.std(widths), rtol=0.04)
    assert_allclose(found.value, np.mean(widths), atol=3 * found.std / math.sqrt(DRAWS) + 0.01)


def test_the_budget_adds_up_to_the_variance():
    pose = pose_of(STD)
    request = asked(pixels_of(pose, scene(None)), 0.2)
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=pose, std=STD)
    parts = explain(Setup(camera=CAMERA), sample, request)
    (found,) = measure(Setup(camera=CAMERA), sample, (request,))
    assert_allclose(sum(part.std**2 for part in parts), found.std**2, rtol=1e-9)
    assert {part.source for part in parts} >= {"tilt", "height", "pixels", "elevation", "focal"}


def test_without_its_object_there_is_no_width_and_the_reason_names_it():
    pose = pose_of(PoseStd())
    pixels = pixels_of(pose, scene(None))
    upside_down = answer(pose, pixels[[1, 0, 2, 3]])
    assert upside_down.status is Status.NOT_UPRIGHT
    assert upside_down.value is None
    assert upside_down.reasons[0].startswith("it lies on top of mast: the top is seen")
