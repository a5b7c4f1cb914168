"""Where the uncertainty comes from, against turning the inputs off one by one."""

import math
from dataclasses import replace

import pytest
from numpy.testing import assert_allclose

from aerodft.dft import Request, Setup, advice, explain
from aerodft.geometry import camera_pose
from aerodft.model import Camera, CameraStd, PoseSample, PoseStd, Probe, ProbeKind, Status
from tests.one_image import measure

STD = PoseStd(height_agl_m=0.5, horizontal_m=1.0, tilt_rad=0.005, pan_rad=0.006, roll_rad=0.004, heading_rad=0.03)
CAMERA = replace(
    Camera.from_fov(name="c", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.7), std=CameraStd(focal_px=8.0)
)
TURNED_OFF = {
    "height": {"height_agl_m": 0.0},
    "tilt": {"tilt_rad": 0.0},
    "pan": {"pan_rad": 0.0},
    "roll": {"roll_rad": 0.0},
}


def sample_with(std):
    pose = camera_pose(height_agl_m=50.0, tilt_rad=0.9, roll_rad=0.1, heading_rad=2.0, std=std)
    return PoseSample(stamp_ns=0, status=Status.OK, pose=pose, std=std)


def request_of(kind, pixels):
    return Request(probe=Probe(name="p", kind=kind, pixels=pixels), pixels=pixels, std_px=1.0)


@pytest.mark.parametrize(
    "request_",
    [
        request_of(ProbeKind.DISTANCE, ((500.0, 700.0), (1500.0, 400.0))),
        request_of(ProbeKind.RANGE, ((500.0, 700.0),)),
        request_of(ProbeKind.HEIGHT, ((800.0, 700.0), (805.0, 560.0))),
        request_of(ProbeKind.AREA, ((500.0, 700.0), (1500.0, 700.0), (1500.0, 900.0), (500.0, 900.0))),
    ],
    ids=lambda request_: str(request_.probe.kind),
)
def test_a_share_is_what_is_gone_when_its_input_is_exact(request_):
    setup = Setup(camera=CAMERA)
    budget = {part.source: part for part in explain(setup, sample_with(STD), request_)}
    whole = measure(setup, sample_with(STD), (request_,))[0].std ** 2
    assert_allclose(sum(part.share for part in budget.values()), 1.0)
    for source, change in TURNED_OFF.items():
        left = measure(setup, sample_with(replace(STD, **change)), (request_,))[0].std ** 2
        share = budget[source].share if source in budget else 0.0
        assert_allclose(share, 1 - left / whole, atol=1e-9, err_msg=source)
    left = measure(Setup(camera=replace(CAMERA, std=CameraStd())), sample_with(STD), (request_,))[0].std ** 2
    assert_allclose(budget["focal"].share, 1 - left / whole, atol=1e-9)


def test_a_heading_is_no_part_of_a_width_and_motion_is_one():
    moving = replace(sample_with(STD).pose, rate_cam_radps=[0.2, 0.0, 0.0], time_std_s=0.1)
    sample = replace(sample_with(STD), pose=moving)
    budget = explain(Setup(camera=CAMERA), sample, request_of(ProbeKind.DISTANCE, ((500.0, 700.0), (1500.0, 400.0))))
    sources = {part.source: part.share for part in budget}
    assert sources.get("heading", 0.0) < 1e-9
    assert budget[0].source == "time"
    assert advice(budget).startswith(f"{100 * budget[0].share:.0f} % from time")


@pytest.mark.parametrize("correlation", [-0.99, 0.2, 0.99])
def test_inputs_that_vary_together_divide_the_variance(correlation):
    sample = sample_with(replace(STD, roll_rad=0.0, pan_rad=0.0, heading_rad=0.0, horizontal_m=0.0))
    cov = sample.pose.cov.copy()
    cov[2, 3] = cov[3, 2] = correlation * STD.height_agl_m * STD.tilt_rad
    sample, request_ = (
        replace(sample, pose=replace(sample.pose, cov=cov)),
        request_of(ProbeKind.RANGE, ((960.0, 700.0),)),
    )
    setup = Setup(camera=Camera.from_fov(name="c", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.7))
    budget = {part.source: part for part in explain(setup, sample, request_)}
    whole = measure(setup, sample, (request_,))[0].std ** 2
    assert min(part.share for part in budget.values()) > 0
    assert math.isclose(sum(part.share for part in budget.values()), 1.0)
    assert math.isclose(sum(part.std**2 for part in budget.values()), whole, rel_tol=1e-3)
    # the closed form of two inputs: the square root of their correlation matrix has these cosine and sine
    half = math.asin(correlation) / 2
    parts = [abs(by) * std for by, std in zip(slopes(setup, request_), (STD.height_agl_m, STD.tilt_rad), strict=True)]
    cos, sin = math.cos(half), math.sin(half)
    assert_allclose(budget["height"].std, abs(cos * parts[0] + sin * parts[1]), rtol=1e-3)
    assert_allclose(budget["attitude"].std, abs(sin * parts[0] + cos * parts[1]), rtol=1e-3)


def slopes(setup, request_):
    """Metres a metre of height, and metres a radian of tilt, by turning on one of the two."""
    alone = {"height_agl_m": 1e-4, "tilt_rad": 1e-6}
    exact = PoseStd(height_agl_m=0.0, horizontal_m=0.0, tilt_rad=0.0, pan_rad=0.0, roll_rad=0.0, heading_rad=0.0)
    request_ = replace(request_, std_px=1e-9)
    return [
        measure(setup, sample_with(replace(exact, **{name: std})), (request_,))[0].std / std
        for name, std in alone.items()
    ]


def test_what_has_no_answer_has_no_budget():
    setup = Setup(camera=CAMERA)
    assert explain(setup, sample_with(STD), request_of(ProbeKind.POSITION, ((500.0, 700.0),))) == ()
    assert explain(setup, sample_with(STD), request_of(ProbeKind.RANGE, ((-5.0, 700.0),))) == ()
