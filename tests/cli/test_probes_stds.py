"""``--probe`` and ``--std`` as people write them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.app.measure import PoseStd
from aerodft.cli.scenes.image_options import Stds, parse_probes, parse_stds
from aerodft.errors import UsageError
from aerodft.model import Camera, CameraStd, ProbeKind

NUMBERS = st.floats(-1e12, 1e12)


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS)
def test_numbers_are_read_exactly(u1, v1, u2, v2, elevation_m):
    text = f"distance {u1!r},{v1!r} {u2!r},{v2!r} elevation={elevation_m!r} name=ford"
    probe = parse_probes([text], Stds(), 0.0)[0].probe
    assert (probe.name, probe.kind) == ("ford", ProbeKind.DISTANCE)
    assert probe.pixels == ((u1, v1), (u2, v2))
    assert probe.elevation_m == elevation_m


def test_what_is_left_out_has_its_default():
    _, request = parse_probes(["range 1,2 name=a", "range 1,2"], parse_stds("px=0.25,elevation=0.1"), 3.0)
    probe = request.probe
    assert (probe.name, probe.elevation_m, probe.std_px, probe.elevation_std_m) == ("range-2", 3.0, 0.25, 0.1)
    assert (request.std_px, request.on_top_of) == (0.25, None)


def test_an_elevation_may_be_the_name_of_a_height():
    top, base = parse_probes(["width 1,2 3,4 elevation=mast-1", "height 5,6 7,1 name=mast-1"], Stds(), 3.0)
    assert top.on_top_of is base
    assert (top.probe.elevation_m, base.probe.elevation_m) == (0.0, 3.0)


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (["range 1,2", "height 1,2 3,4 name=range-1"], "got the name range-1 again"),
        (["width 1,2 3,4 elevation=mast"], "probe width-1 lies on top of mast: got none"),
        (["width 1,2 3,4 elevation=mast", "range 1,2 name=mast"], "got none"),
        (["width 1,2 3,4 elevation=mats", "height 1,2 3,4 name=mast"], "got mast, expected a height"),
        (["height 1,2 3,4 elevation=height-1"], "expected a height on the ground"),
    ],
)
def test_names_that_do_not_fit_together_are_one_sentence(texts, said):
    with pytest.raises(UsageError, match="--probe") as caught:
        parse_probes(texts, Stds(), 0.0)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "got kind '', expected one of position, range, distance"),
        ("girth 1,2", "got kind 'girth'"),
        ("range", "got 0 pixels, expected 1 for range"),
        ("range 1,2 3,4", "got 2 pixels, expected 1 for range"),
        ("range 1", "got '1', expected a pixel as u,v"),
        ("range 1,2,3", "got '1,2,3', expected a pixel as u,v"),
        ("range 1,x", "got 'x', expected a finite number"),
        ("range 1,nan", "got 'nan', expected a finite number"),
        ("range 1,inf", "got 'inf', expected a finite number"),
        ("range 1,2 elevation=1e300", "got '1e300', expected a finite number"),
        ("range 1,2 hight=3", "got option 'hight', expected one of elevation, elevation_std, name"),
        ("range 1,2 name=", "got nothing, expected a value after name="),
    ],
)
def test_a_malformed_probe_is_one_sentence(text, said):
    with pytest.raises(UsageError) as caught:
        parse_probes([text], Stds(), 0.0)
    assert str(caught.value).startswith(f'--probe "{text}": ')
    assert said in str(caught.value)


def test_degrees_become_radians_and_metres_stay():
    stds = parse_stds("height=0.5, position=2,tilt=1,pan=2,roll=3,heading=4,focal=8,elevation=0.1,px=0.5")
    pose = stds.pose_std().si(50.0)
    assert (pose.height_agl_m, pose.horizontal_m, pose.time_s) == (0.5, 2.0, 0.0)
    assert [pose.tilt_rad, pose.pan_rad, pose.roll_rad, pose.heading_rad] == [math.radians(k) for k in (1, 2, 3, 4)]
    assert (stds.focal_px, stds.elevation_m, stds.px) == (8.0, 0.1, 0.5)


def test_attitude_sets_all_three_and_a_later_one_wins():
    pose = parse_stds("attitude=2,pan=0").pose_std()
    assert (pose.tilt_deg, pose.pan_deg, pose.roll_deg) == (2.0, 0.0, 2.0)


def test_what_is_not_said_is_not_stated():
    stds = parse_stds("height=0.1")
    assert (stds.pose_std().tilt_deg, stds.focal_px, stds.px) == (None, None, None)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("hight=1", "got name 'hight', expected one of height, position, tilt, pan, roll, heading, attitude, focal,"),
        ("height", "got '', expected a number of at least 0"),
        ("height=x", "got 'x'"),
        ("height=-1", "got '-1'"),
        ("height=nan", "got 'nan'"),
        ("height=inf", "got 'inf'"),
    ],
)
def test_a_malformed_std_is_one_sentence(text, said):
    with pytest.raises(UsageError) as caught:
        parse_stds(f"px=1,{text}")
    assert str(caught.value).startswith(f"--std {text}: ")
    assert said in str(caught.value)


def test_what_is_not_stated_is_assumed_by_the_height():
    std = PoseStd().with_assumed(50.0)
    assert (std.height_m, std.tilt_deg, std.pan_deg, std.roll_deg) == (0.5, 1.0, 0.3, 0.3)
    assert PoseStd(tilt_deg=0.2).with_assumed(50.0) == PoseStd(
        height_m=0.5, tilt_deg=0.2, pan_deg=0.3, roll_deg=0.3, position_m=0.0, heading_deg=0.0
    )
    assert PoseStd(height_m=0.0).si(50.0).height_agl_m == 0.0


def test_a_focal_std_overrules_the_cameras_and_nothing_else_does():
    camera = Camera(
        name="c", width_px=10, height_px=10, fx_px=9, fy_px=9, cx_px=5, cy_px=5, std=CameraStd(focal_px=2.0)
    )
    assert parse_stds("focal=3").on_camera(camera).std.focal_px == 3.0
    assert parse_stds("px=3").on_camera(camera) is camera
