"""Boxes and contours from outside: what a detector finds is measured where it stands."""

import math

import numpy as np
import pytest

from aerodft.geometry import camera_pose, inverse, matrix
from aerodft.model import Camera, Observation, PixelSource, PoseSample, PoseStd, Probe, ProbeKind, Status
from aerodft.service import Pipeline, PipelineSettings
from tests.answers import answers_of, measurements_of
from tests.batches import one_tick

CAMERA = Camera.from_fov(name="c", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.66)
STD = PoseStd(height_agl_m=0.02, tilt_rad=1e-3, roll_rad=1e-3)
POSE = camera_pose(height_agl_m=5.0, tilt_rad=math.radians(65), roll_rad=math.radians(14), std=STD)
WALKER = {"east": 1.0, "north": 9.0, "height": 1.8, "width": 0.5}


class NoTelemetry:
    rejected: dict[str, int] = {}  # noqa: RUF012 - a stub

    def decode(self, _block):
        return ()


def pixels_of(points):
    cam = (np.array(points) - POSE.position_enu_m) @ matrix(inverse(POSE.wxyz)).T
    return cam[:, :2] / cam[:, 2:] * [CAMERA.fx_px, CAMERA.fy_px] + [CAMERA.cx_px, CAMERA.cy_px]


def outline():
    foot = np.array([WALKER["east"], WALKER["north"], 0.0])
    away = foot[:2] / np.linalg.norm(foot[:2])
    half = np.append(np.array([away[1], -away[0]]) * WALKER["width"] / 2, 0.0)
    up = np.array([0, 0, WALKER["height"]])
    return pixels_of([foot - half, foot + half, foot + half + up, foot - half + up])


def measured(kind, **seen):
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=POSE, std=STD)
    probe = Probe(name="walker", kind=kind, source=PixelSource.OBSERVED)
    settings = PipelineSettings(station="s", camera=CAMERA, probes=(probe,), fixed_pose=sample)
    pipeline = Pipeline(settings, NoTelemetry())
    seen = Observation(name="walker", stamp_ns=5, arrival_ns=5, pixels=(), **seen)
    return measurements_of(answers_of(pipeline, [one_tick(10, [seen])])), pipeline.counts


def contour():
    return tuple(map(tuple, outline().tolist()))


def box():
    corners = outline()
    return (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())


TRUTH = {
    ProbeKind.HEIGHT: WALKER["height"],
    ProbeKind.WIDTH: WALKER["width"],
    ProbeKind.RANGE: math.hypot(WALKER["east"], WALKER["north"], 5.0),
    ProbeKind.BEARING: math.degrees(math.atan2(WALKER["east"], WALKER["north"])),
}


@pytest.mark.parametrize("kind", list(TRUTH))
def test_a_contour_is_measured_from_where_it_stands(kind):
    ((answer,), _) = measured(kind, contour=contour())
    assert answer.status is Status.OK, answer.reasons
    assert answer.value == pytest.approx(TRUTH[kind], abs=max(0.01 * TRUTH[kind], 0.02))
    low, high = answer.ci95
    assert low < TRUTH[kind] < high
    assert high - low < 0.3 * TRUTH[kind], "and the interval says something"


def test_a_contour_s_place_is_that_of_the_foot_and_not_of_the_centroid():
    ((answer,), _) = measured(ProbeKind.POSITION, contour=contour())
    np.testing.assert_allclose(answer.enu_m[0], [WALKER["east"], WALKER["north"], 0.0], atol=0.03)
    centroid = pixels_of([[1.0, 9.0, 0.9]])[0]
    assert np.linalg.norm(np.array(answer.pixels[0]) - centroid) > 50


@pytest.mark.parametrize("kind", [ProbeKind.HEIGHT, ProbeKind.RANGE])
def test_a_box_in_a_rolled_camera_is_measured_along_the_vertical_within_its_interval(kind):
    ((answer,), _) = measured(kind, box=box(), std_px=8.0)  # a box around what is rolled shows less
    low, high = answer.ci95
    assert low < TRUTH[kind] < high
    # The middle of the box's lower side, which a camera without roll would stand it on, is off by far.
    assert np.linalg.norm(np.array(answer.pixels[0]) - [(box()[0] + box()[2]) / 2, box()[3]]) > 20


def test_the_area_of_what_lies_on_the_ground_comes_from_its_contour():
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    circle = np.stack([1 + 0.8 * np.cos(angle), 9 + 0.8 * np.sin(angle), np.zeros(200)], axis=-1)
    ((answer,), _) = measured(ProbeKind.AREA, contour=tuple(map(tuple, pixels_of(circle).tolist())))
    assert answer.value == pytest.approx(math.pi * 0.8**2, rel=0.005)
    assert len(answer.pixels) == 64


@pytest.mark.parametrize("kind", [ProbeKind.DISTANCE, ProbeKind.LENGTH, ProbeKind.AREA])
def test_a_box_has_no_distance_no_length_and_no_area(kind):
    answers, counts = measured(kind, box=box())
    assert (answers, counts.wrong_pixel_count) == ([], 1)


@pytest.mark.parametrize(("kind", "unit"), [(ProbeKind.RIVER, "m"), (ProbeKind.AREA, "m2"), (ProbeKind.POSITION, "m")])
def test_what_was_looked_for_and_not_seen_has_a_status_and_a_reason_and_no_number(kind, unit):
    ((told,), counts) = measured(kind, unseen="NO_CONTRAST: water and bank look alike")
    assert (told.status, told.reasons) == (Status.NOT_SEEN, ("NO_CONTRAST: water and bank look alike",))
    assert (told.value, told.ci95, told.enu_m, told.pixels, told.unit) == (None, None, None, (), unit)
    ((bare,), _) = measured(kind)
    assert bare.reasons == ("it was looked for in the image, and not seen",)
    assert counts.wrong_pixel_count == 0


def test_a_tracked_probe_that_is_not_found_is_lost_and_has_no_number():
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=POSE, std=STD)
    probe = Probe(name="walker", kind=ProbeKind.DISTANCE, source=PixelSource.TRACKED, pixels=((900, 600), (1000, 600)))
    settings = PipelineSettings(station="s", camera=CAMERA, probes=(probe,), fixed_pose=sample)
    pipeline = Pipeline(settings, NoTelemetry())
    seen = [
        Observation(name="walker", stamp_ns=stamp, arrival_ns=stamp, pixels=pixels)
        for stamp, pixels in ((5, probe.pixels), (6, ()), (7, ((900.0, 600.0),)))
    ]
    found, lost = measurements_of(answers_of(pipeline, [one_tick(10, seen)]))
    assert (found.status, lost.status) == (Status.OK, Status.LOST)
    assert (lost.value, lost.enu_m, lost.pixels) == (None, None, ())
    assert lost.reasons == ("it is out of the image, or was not recognised in it",)
    assert pipeline.counts.wrong_pixel_count == 1, "one pixel is no distance"
