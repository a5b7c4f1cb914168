"""Every dialect, written by the tests and read back: against rotations of SciPy, and against what cannot be."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from aerodft.adapters.photographs import DIALECTS, PhotoTags, photo_tags, pose_of_tags
from aerodft.adapters.photographs.dialect import Dialect
from aerodft.geometry import camera_from_gimbal, matrix
from tests.photo_writer import dji, exif, packet, write_photo

NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
AHEAD = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Camera axes (right, down, forward) as columns in a gimbal's (front, right, down), for angles against the horizon."""
DOWN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""The same of a camera that looks along the body's down axis, with the image's top ahead (Pix4D)."""
PLACE_DEG = (46.8428646, -91.9936967)

yaws, pitches, rolls = st.floats(-180, 180), st.floats(-90, 30), st.floats(-180, 180)
fast = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def ned(yaw_deg, pitch_deg, roll_deg):
    return Rotation.from_euler("ZYX", [yaw_deg, pitch_deg, roll_deg], degrees=True).as_matrix()


def pose_of(folder: Path, values, info, **more):
    return pose_of_tags(photo_tags(write_photo(folder / "photo.jpg", packet(values, **more), info)))


def enu_of(pose):
    return matrix(camera_from_gimbal(pose.wxyz))


def assert_looks(pose, ned_r_cam):
    np.testing.assert_allclose(enu_of(pose), NED_TO_ENU @ ned_r_cam, atol=2e-4)  # tags have 0.01 deg


@fast
@given(yaws, pitches, rolls, st.booleans())
def test_dji(tmp_path, yaw, pitch, roll, as_elements):
    yaw, pitch, roll = round(yaw, 2), round(pitch, 2), round(roll, 2)
    pose = pose_of(tmp_path, dji(yaw, pitch, roll), exif(make="DJI", model="FC300S"), as_elements=as_elements)
    if not (yaw or pitch or roll):
        assert pose.wxyz is None
        return
    assert pose.dialect == "DJI"
    assert_looks(pose, ned(yaw, pitch, roll) @ AHEAD)
    assert pose.height_home_m == pytest.approx(39.9)
    assert math.degrees(pose.lat_rad) == pytest.approx(PLACE_DEG[0], abs=1e-7)
    assert math.degrees(pose.lon_rad) == pytest.approx(PLACE_DEG[1], abs=1e-7)


def test_a_roll_of_180_deg_is_a_gimbal_past_straight_down(tmp_path):
    """A gimbal at pitch -100 looks 10 deg back; cameras write it as yaw + 180, pitch -80, roll 180."""
    pose = pose_of(tmp_path, dji(40.0 - 180.0, -80.0, 180.0), exif(make="DJI"))
    assert_looks(pose, ned(40.0, -100.0, 0.0) @ AHEAD)
    image_up = -enu_of(pose)[:, 1]
    assert image_up[:2] @ [math.sin(math.radians(40)), math.cos(math.radians(40))] > 0.9


@fast
@given(yaws, pitches, rolls)
def test_skydio(tmp_path, yaw, pitch, roll):
    values = {
        "drone-skydio:Latitude": PLACE_DEG[0],
        "drone-skydio:Longitude": PLACE_DEG[1],
        "drone-skydio:AbsoluteAltitude": 1034.44,
        "drone-skydio:CameraOrientationNED": {"Roll": roll, "Pitch": pitch, "Yaw": yaw},
        "drone-skydio:CameraOrientationQuatNED": {"X": 1.0, "Y": 0.0, "Z": 0.0, "W": 0.0},
    }
    pose = pose_of(tmp_path, values, exif(make="Skydio", model="X2"))
    assert pose.dialect == "Skydio"
    assert_looks(pose, ned(yaw, pitch, roll) @ AHEAD)
    assert pose.height_home_m is None
    assert any("no height above take-off" in each for each in pose.remarks)


@fast
@given(yaws, pitches, rolls)
def test_parrot_anafi(tmp_path, yaw, pitch, roll):
    angles = {"CameraYawDegree": yaw, "CameraPitchDegree": pitch, "CameraRollDegree": roll}
    pose = pose_of(
        tmp_path,
        {f"drone-parrot:{name}": value for name, value in angles.items()},
        exif(make="Parrot", model="Anafi", place_deg=PLACE_DEG, altitude_m=79.0),
    )
    assert pose.dialect == "Parrot Anafi"
    assert_looks(pose, ned(yaw, pitch, roll) @ AHEAD)
    assert math.degrees(pose.lat_rad) == pytest.approx(PLACE_DEG[0], abs=1e-7)


PIX4D = {
    "Parrot": exif(make="PARROT", model="Disco", place_deg=PLACE_DEG),
    "senseFly": exif(make="senseFly", model="S.O.D.A.", place_deg=PLACE_DEG),
    "a drone with Pix4D's tags": exif(make="Someone", place_deg=PLACE_DEG),
}


@pytest.mark.parametrize("name", PIX4D)
@fast
@given(yaw=yaws, pitch=st.floats(-30, 90), roll=st.floats(-20, 20))
def test_pitch_0_of_pix4d_looks_straight_down(tmp_path, name, yaw, pitch, roll):
    pose = pose_of(tmp_path, {"Camera:Yaw": yaw, "Camera:Pitch": pitch, "Camera:Roll": roll}, PIX4D[name])
    assert pose.dialect == name
    assert_looks(pose, ned(yaw, pitch, roll) @ DOWN)


@fast
@given(yaws, st.floats(0, 90), st.floats(-5, 5))
def test_autel_of_older_firmware(tmp_path, yaw, pitch, roll):
    pose = pose_of(
        tmp_path,
        {"Camera:Yaw": yaw, "Camera:Pitch": pitch, "Camera:Roll": roll},
        exif(make="Autel Robotics", model="EVO II", place_deg=PLACE_DEG),
        about="Autel Robotics Meta Data",
    )
    assert pose.dialect == "Autel"
    assert_looks(pose, ned(yaw, pitch, roll) @ DOWN)


@fast
@given(yaws, st.floats(-90, -1), st.floats(-5, 5))
def test_autel_of_newer_firmware_writes_djis_tags(tmp_path, yaw, pitch, roll):
    pose = pose_of(tmp_path, dji(yaw, pitch, roll), exif(make="Autel Robotics", model="XT701"))
    assert pose.dialect.startswith("Autel")
    assert_looks(pose, ned(round(yaw, 2), round(pitch, 2), round(roll, 2)) @ AHEAD)


def test_autel_640t_counts_from_the_horizon(tmp_path):
    values = {"Camera:Yaw": 10.0, "Camera:Pitch": -40.0, "Camera:Roll": 0.0}
    pose = pose_of(tmp_path, values, exif(make="Camera", model="XL715", place_deg=PLACE_DEG))
    assert_looks(pose, ned(10.0, -40.0, 0.0) @ AHEAD)


def test_a_small_negative_pitch_of_another_autel_is_told_by_nobody(tmp_path):
    values = {"Camera:Yaw": 10.0, "Camera:Pitch": -4.0, "Camera:Roll": 0.0}
    pose = pose_of(tmp_path, values, exif(make="Autel Robotics", model="EVO", place_deg=PLACE_DEG))
    assert pose.wxyz is None
    assert any("firmware differs" in each for each in pose.remarks)


@fast
@given(st.floats(-20, 20), st.floats(-90, 0), yaws, st.floats(-15, 15), st.floats(-15, 15))
def test_teal_adds_the_vehicle(tmp_path, pan, tilt, yaw, pitch, roll):
    of = {"Camera": (pan, tilt, 0.02), "Platform": (yaw, pitch, roll)}
    values = {
        f"exif:{name}{axis}": f"{round(angle * 1e6)}/1000000"
        for name, angles in of.items()
        for axis, angle in zip(("Yaw", "Pitch", "Roll"), angles, strict=True)
    }
    pose = pose_of(tmp_path, values, exif(make="Teledyne FLIR", model="Boson 640", place_deg=PLACE_DEG))
    assert pose.dialect == "Teal"
    assert_looks(pose, ned(yaw, pitch, roll) @ ned(pan, tilt, 0.02) @ AHEAD)


def test_siyi_near_0_0_is_no_position(tmp_path):
    info = exif(make="SIYIKEJI", model="ZR10", date="1970:01:01 00:03:45", place_deg=(6.64e-06, 1.489e-04))
    pose = pose_of_tags(photo_tags(write_photo(tmp_path / "a.jpg", None, info)))
    assert (pose.dialect, pose.lat_rad, pose.wxyz) == ("SIYI", None, None)
    assert any("without a fix" in each for each in pose.remarks)


def test_a_photograph_of_no_drone_has_no_pose(tmp_path):
    assert pose_of_tags(photo_tags(write_photo(tmp_path / "a.jpg", None, exif(make="Canon")))) is None


@pytest.mark.parametrize(
    ("tags", "attribute", "said"),
    [
        ({"GimbalPitchDegree": "nan"}, "wxyz", "GimbalPitchDegree is 'nan', which cannot be"),
        ({"GimbalPitchDegree": "1e300"}, "wxyz", "GimbalPitchDegree"),
        ({"GimbalYawDegree": "north"}, "wxyz", "GimbalYawDegree is 'north'"),
        ({"GimbalRollDegree": "1/0"}, "wxyz", "GimbalRollDegree"),
        ({"RelativeAltitude": "inf"}, "height_home_m", "RelativeAltitude"),
        ({"RelativeAltitude": "2147483647"}, "height_home_m", "RelativeAltitude"),
        ({"AbsoluteAltitude": "-1e9"}, "altitude_m", "AbsoluteAltitude"),
        ({"GpsLatitude": "0.0", "GpsLongitude": "0.0"}, "lat_rad", "without a fix"),
        ({"GpsLatitude": "2147483647"}, "lat_rad", "GpsLatitude"),
        ({"GimbalYawDegree": "0.0", "GimbalPitchDegree": "+0.00", "GimbalRollDegree": "0"}, "wxyz", "all exactly 0"),
    ],
)
def test_impossible_values_are_left_out_and_said(tmp_path, tags, attribute, said):
    pose = pose_of(tmp_path, dji(**tags), exif(make="DJI"))
    assert getattr(pose, attribute) is None
    assert any(said in each for each in pose.remarks), pose.remarks


def test_contradicting_positions_are_both_left_out(tmp_path):
    pose = pose_of(tmp_path, dji(), exif(make="DJI", place_deg=(PLACE_DEG[0] + 0.01, PLACE_DEG[1])))
    assert pose.lat_rad is None
    assert any("contradict each other" in each for each in pose.remarks)
    same = pose_of(tmp_path, dji(), exif(make="DJI", place_deg=PLACE_DEG))
    assert same.lat_rad is not None


def test_an_older_spelling_of_the_longitude(tmp_path):
    values = {key.replace("GpsLongitude", "GpsLongtitude"): value for key, value in dji().items()}
    pose = pose_of(tmp_path, values, exif(make="DJI"))
    assert math.degrees(pose.lon_rad) == pytest.approx(PLACE_DEG[1], abs=1e-7)


@pytest.mark.parametrize(
    ("flag", "horizontal_m", "height_m", "datum"),
    [
        ("50", 0.0097, 0.1, "ellipsoid"),
        ("34", 0.5, 0.5, "ellipsoid"),
        ("16", 3.0, 1.5, "ellipsoid"),
        ("0", 3.0, 1.5, None),
    ],
)
def test_rtk_by_its_flag(tmp_path, flag, horizontal_m, height_m, datum):
    rtk = {"RtkFlag": flag, "RtkStdLon": "0.00970", "RtkStdLat": "0.00935", "RtkStdHgt": "0.02382"}
    pose = pose_of(tmp_path, dji(**rtk), exif(make="DJI"))
    assert pose.datum == datum
    assert pose.std.horizontal_m == pytest.approx(horizontal_m)
    assert pose.std.height_agl_m == pytest.approx(height_m, rel=0.05)


def test_an_altitude_below_the_sea(tmp_path):
    info = exif(make="Parrot", place_deg=PLACE_DEG, altitude_m=-20.2)
    pose = pose_of(tmp_path, {"Camera:Yaw": 1.0, "Camera:Pitch": 5.0}, info)
    assert pose.altitude_m == pytest.approx(-20.2)
    assert pose.datum is None


def test_tags_come_back_from_a_recording(tmp_path):
    photo = write_photo(tmp_path / "a.jpg", packet(dji()), exif(make="DJI", place_deg=PLACE_DEG))
    tags = photo_tags(photo)
    assert PhotoTags.from_json(tags.to_json()) == tags


def test_a_tiff_is_read_as_a_jpeg(tmp_path):
    photo = write_photo(tmp_path / "a.tif", packet(dji(92.9, -60.0)), exif(make="DJI"))
    assert_looks(pose_of_tags(photo_tags(photo)), ned(92.9, -60.0, 0.0) @ AHEAD)


def test_a_new_dialect_is_an_entry(tmp_path):
    def read(tags):
        own = pose_of_tags(PhotoTags(name="", width_px=1, height_px=1, xmp=dji()))
        assert tags.make == "mine"
        return own

    DIALECTS.insert(0, Dialect(name="mine", recognises=lambda tags: tags.make == "mine", read=read))
    try:
        photo = write_photo(tmp_path / "a.jpg", None, exif(make="Mine"))
        assert pose_of_tags(photo_tags(photo)).height_home_m == pytest.approx(39.9)
    finally:
        DIALECTS.pop(0)
