"""Photographs' own poses against outside truth: a reconstruction, a laser rangefinder, published angles, GPS tracks."""

import csv
import json
import math
import random
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import aerodft as ad
from aerodft.adapters.photographs import photo_tags, pose_of_tags
from aerodft.app.measure import carries_pose
from aerodft.errors import AerodftError
from aerodft.geometry import camera_angles, camera_from_gimbal, matrix, pixels_from_rays
from aerodft.model import GeoOrigin
from aerodft.sim.world import River
from tests.nights import at_night
from tests.photo_writer import dji, dji_photo, exif, packet, write_photo

ROOT = Path(__file__).parents[2]
FLIGHTS = ROOT.parent / "shared" / "data" / "flights"
SAMPLE = ROOT / "samples" / "DJI_0001.JPG"
ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def present(pattern):
    """Files of a public flight, none where the folder is absent."""
    return sorted(FLIGHTS.glob(pattern)) if FLIGHTS.is_dir() else []


def named(path):
    return path.name


def angles_deg(path):
    """Tilt, roll, heading."""
    pose = pose_of_tags(photo_tags(path))
    return np.degrees([float(each) for each in camera_angles(camera_from_gimbal(pose.wxyz))])


def turned_deg(one, other):
    return (one - other + 180.0) % 360.0 - 180.0


# P4 RTK: three oblique photographs and their published reconstruction.


@pytest.mark.parametrize("path", present("p4rtk/*_0???.tif"), ids=named)
def test_p4_rtk_against_its_reconstruction(path):
    document = json.loads((FLIGHTS / "p4rtk/P4RTK_oblique_opensfm_reconstruction.json").read_text())[0]
    shot = document["shots"][path.stem.removeprefix("P4RTK_oblique_")]
    enu_r_cam = Rotation.from_rotvec(shot["rotation"]).as_matrix().T
    axis, right = enu_r_cam[:, 2], enu_r_cam[:, 0]
    true_tilt_deg = math.degrees(math.acos(-axis[2]))
    true_heading_deg = math.degrees(math.atan2(axis[0], axis[1]))
    tilt_deg, roll_deg, heading_deg = angles_deg(path)
    assert tilt_deg == pytest.approx(true_tilt_deg, abs=1.2)
    assert abs(turned_deg(heading_deg, true_heading_deg)) < 1.9
    assert roll_deg == pytest.approx(-math.degrees(math.asin(right[2])), abs=1.0)


@pytest.mark.parametrize("path", present("p4rtk/*_0???.tif"), ids=named)
def test_p4_rtk_lens_against_its_reconstruction(path):
    document = json.loads((FLIGHTS / "p4rtk/P4RTK_oblique_opensfm_reconstruction.json").read_text())[0]
    (found,) = document["cameras"].values()
    camera = ad.read_photograph(path, home_above_plane_m=0.0).camera
    assert camera.fx_px == pytest.approx(found["focal_x"] * camera.width_px, abs=3 * camera.std.focal_px)
    centre_px = 0.5 * (camera.width_px - 1) + found["c_x"] * camera.width_px
    assert camera.cx_px == pytest.approx(centre_px, abs=3 * camera.std.principal_point_px)
    assert camera.distortion[0] == pytest.approx(found["k1"], abs=3 * camera.std.distortion[0])


@pytest.mark.parametrize("path", present("p4rtk/*_0???.tif"), ids=named)
def test_p4_rtk_positions_and_ellipsoidal_altitudes(path):
    with (FLIGHTS / "p4rtk/P4RTK_oblique_lla_rpy.csv").open() as file:
        rows = {row["filename"]: row for row in csv.DictReader(file, delimiter=" ")}
    row = rows[path.name.removeprefix("P4RTK_oblique_")]
    pose = pose_of_tags(photo_tags(path))
    assert math.degrees(pose.lat_rad) == pytest.approx(float(row["latitude"]), abs=1e-8)
    assert math.degrees(pose.lon_rad) == pytest.approx(float(row["longitude"]), abs=1e-8)
    assert (pose.altitude_m, pose.datum) == (float(row["altitude"]), "ellipsoid")
    assert pose.std.horizontal_m < 0.02


@pytest.mark.parametrize("path", present("p4rtk/*_0018.tif"), ids=named)
def test_p4_rtk_over_its_surface_model_needs_the_altitude_by_hand(path):
    """The surface lies 75.6 m below the camera, where the photograph says 99.96 m above take-off."""
    with pytest.raises(ad.AerodftError, match=r"186\.57 m above the WGS84 ellipsoid"):
        ad.read_photograph(path, is_over_terrain=True)
    photo = ad.read_photograph(path, stated=ad.StatedPose(altitude_m=186.57), is_over_terrain=True)
    dsm = ad.ElevationModel(FLIGHTS / "p4rtk/P4RTK_oblique_dsm.tif")
    found = ad.measure(photo.camera, photo.pose, ad.Position([(683.5, 455.5)]), ground=dsm)
    assert found.status == "ok"
    assert found.geo[0].alt_msl_m == pytest.approx(110.96, abs=15.0)  # below the camera; it looks 44 m ahead


# A laser rangefinder's target, as the file says it: azimuth -106.46, depression 32.98 deg, 79.61 m away.


def test_h20n_laser_target(tmp_path):
    """Angles and slant range of a published photograph, in a file of the tests'; ground point against the target."""
    lat_deg, lon_deg, target_deg = 22.5961963, 114.007268, (22.5960255, 114.0066452)
    lrf = {"LRFStatus": "Normal", "LRFTargetDistance": "79.572", "LRFTargetAlt": "-0.735", "LRFTargetAbsAlt": "47.000"}
    photo = dji_photo(
        tmp_path / "H20N.jpg", yaw_deg=-106.6, pitch_deg=-32.9, relative_m=42.602, place_deg=(lat_deg, lon_deg), **lrf
    )
    tilt_deg, _, heading_deg = angles_deg(photo)
    assert abs(turned_deg(heading_deg, -106.46)) < 0.3
    assert 90.0 - tilt_deg == pytest.approx(32.98, abs=0.3)
    taken = ad.read_photograph(photo)
    found = ad.measure(taken.camera, taken.pose, [ad.Range([(31.5, 23.5)]), ad.Position([(31.5, 23.5)])])
    assert found[0].value == pytest.approx(79.61, abs=0.1)
    metres = 6_378_137.0 * math.radians(1.0)
    place = found[1].geo[0]
    north_m = (math.degrees(place.lat_rad) - target_deg[0]) * metres
    east_m = (math.degrees(place.lon_rad) - target_deg[1]) * metres * math.cos(math.radians(lat_deg))
    assert math.hypot(north_m, east_m) < 0.5


# Angles that OpenAthena publishes for the same files, as degrees down.

PUBLISHED = {
    "SkydioX2_ir_S1008521.JPG": (59.679573, 0.100350, 0.01),
    "Teal2_ir_00015.jpg": (58.19441, 319.002289, 1.7),
}
"""Degrees down, heading, and how far headings may differ: sums of Euler angles are no composed rotation (Teal)."""


@pytest.mark.parametrize("path", [each for name in PUBLISHED for each in present(f"xmp/{name}")], ids=named)
def test_published_angles(path):
    down_deg, heading_deg, apart_deg = PUBLISHED[path.name]
    found = angles_deg(path)
    assert 90.0 - found[0] == pytest.approx(down_deg, abs=0.05)
    assert abs(turned_deg(found[2], heading_deg)) < apart_deg


@pytest.mark.parametrize("path", present("xmp/Teal2_ir_00015.jpg"), ids=named)
def test_teals_angles_are_composed(path):
    """The composed rotation is right: sums neglect what the vehicle's roll of -1.04 deg does to a camera 54 deg down.

    It turns the view by sin(54 deg) / cos(58 deg) of that about the vertical: the published sum's heading is 1.61 deg
    off, its roll 0.93 deg, its tilt 0.014 deg.
    """
    vehicle, camera = (319.01593, -3.925035, -1.044397), (359.986359, -54.269375, 0.016501)
    composed = Rotation.from_euler("ZYX", vehicle, degrees=True) * Rotation.from_euler("ZYX", camera, degrees=True)
    heading_deg, pitch_deg, _ = composed.as_euler("ZYX", degrees=True)
    found = angles_deg(path)
    assert found[0] - 90.0 == pytest.approx(pitch_deg, abs=1e-4)
    assert turned_deg(found[2], heading_deg) == pytest.approx(0.0, abs=1e-4)
    assert turned_deg(found[2], 319.002289) == pytest.approx(1.61, abs=0.01)


@pytest.mark.parametrize("path", present("xmp/ParrotDisco_parrot-1.jpg"), ids=named)
def test_disco_looks_straight_down_but_for_its_pitch_and_roll(path):
    """Published: 87.946 deg down along the nose; its roll of -2.392 deg leans the view aside as well."""
    pose = pose_of_tags(photo_tags(path))
    axis = matrix(camera_from_gimbal(pose.wxyz))[:, 2]
    nose = np.array([math.sin(math.radians(18.679)), math.cos(math.radians(18.679)), 0.0])
    assert 90.0 - math.degrees(math.atan2(axis @ nose, -axis[2])) == pytest.approx(87.946, abs=0.01)
    assert math.degrees(pose.lat_rad) == pytest.approx(57.9995323, abs=1e-6)
    assert math.degrees(pose.lon_rad) == pytest.approx(25.5496375, abs=1e-6)


@pytest.mark.parametrize("path", present("xmp/XTR_yaw87_DJI_XTR.jpg"), ids=named)
def test_the_gimbals_yaw_is_not_the_aircrafts(path):
    tilt_deg, _, heading_deg = angles_deg(path)
    assert heading_deg == pytest.approx(153.6, abs=1e-3)
    assert tilt_deg == pytest.approx(81.7, abs=1e-3)


@pytest.mark.parametrize("path", present("xmp/SIYI_ZR10_IMG_0001.jpg"), ids=named)
def test_siyi_says_nothing_that_can_be_used(path):
    pose = pose_of_tags(photo_tags(path))
    assert (pose.lat_rad, pose.wxyz, pose.height_home_m) == (None, None, None)


# Two strips of nadir photographs: they look along the track that their own positions give.


@pytest.mark.parametrize("folder", [FLIGHTS / "brighton"] if present("brighton/DJI_0018.JPG") else [], ids=named)
def test_brighton_headings_follow_the_track(folder):
    photos = sorted(folder.iterdir())
    poses = [pose_of_tags(photo_tags(each)) for each in photos]
    north = np.degrees([each.lat_rad for each in poses]) * 111_195.0
    east = np.degrees([each.lon_rad for each in poses]) * 111_195.0 * math.cos(poses[0].lat_rad)
    track_deg = np.degrees(np.arctan2(np.diff(east), np.diff(north)))
    step_m = np.hypot(np.diff(east), np.diff(north))
    heading_deg = np.array([angles_deg(each)[2] for each in photos])
    along = turned_deg(heading_deg[:-1], track_deg)[(step_m > 10) & (step_m < 16)]
    assert len(along) >= 8
    assert np.median(np.abs(along)) < 8.0
    assert {round(each.height_home_m) for each in poses} == {40}


# The sample: a rendered river whose banks are known.


def test_widths_in_the_sample_hold_the_truth():
    """At 13 stations the true width lies within the interval, and within 3 std however small these are."""
    river = River(azimuth_rad=math.radians(120))
    photo = ad.read_photograph(SAMPLE, home_above_plane_m=1.5)
    origin = GeoOrigin(lat_rad=math.radians(-35.363262), lon_rad=math.radians(149.165237))
    position = np.array([-17.0, -20.0, 41.5])
    assert photo.pose.height_m == pytest.approx(41.5)
    assert photo.pose.lat_deg == pytest.approx(math.degrees(origin.lat_rad) - 20.0 / 111_000, abs=1e-5)
    enu_r_cam = matrix(photo.pose.pose().wxyz)
    for station in range(-30, 31, 5):
        banks = np.array([np.ravel(river.enu(station, float(each))) for each in river.banks_m(station)])
        pixels = pixels_from_rays(photo.camera, (banks - position) @ enu_r_cam)
        found = ad.measure(photo.camera, photo.pose, ad.Distance([tuple(each) for each in pixels]))
        assert found.value == pytest.approx(np.linalg.norm(banks[0] - banks[1]), rel=1e-3)


# Mutated files: nothing but sentences.


def mutations(rng, base, name):
    """Bytes of a damaged photograph: flipped and cut, numbers of its packet replaced, parts of two put together."""
    data = bytearray(base)
    kind = rng.randrange(5)
    if kind == 0:
        for _ in range(rng.randrange(1, 30)):
            data[rng.randrange(len(data))] = rng.randrange(256)
    elif kind == 1:
        del data[rng.randrange(len(data)) :]
    elif kind == 2:
        start = rng.randrange(len(data))
        del data[start : start + rng.randrange(1, 400)]
    else:
        xmp_at, end = data.find(b"<x:xmpmeta"), data.find(b"</x:xmpmeta>")
        if xmp_at >= 0:
            text = bytes(data[xmp_at:end])
            words = [
                b"nan",
                b"inf",
                b"-1e308",
                b"2147483647",
                b"",
                b"0",
                b"1/0",
                b"+-3",
                b"\xef\xbb\xbf",
                b"&amp;",
                b"<",
                b'"',
            ]
            at = rng.randrange(len(text))
            digits = next((k for k in range(at, len(text)) if text[k : k + 1].isdigit()), at)
            word = rng.choice(words)
            changed = text[:digits] + word + text[digits + len(word) :]
            data[xmp_at:end] = changed[: len(text)].ljust(len(text))
    del name
    return bytes(data)


@pytest.mark.parametrize("count", [200, *at_night(2000)])
def test_mutated_photographs_give_sentences_and_finite_poses(tmp_path, count):
    rng = random.Random(count)  # noqa: S311 - damage, no secret
    skydio = {
        "drone-skydio:Latitude": 32.5,
        "drone-skydio:Longitude": -110.9,
        "drone-skydio:CameraOrientationNED": {"Roll": 0.2, "Pitch": -37.5, "Yaw": 127.4},
    }
    info = exif(make="DJI", model="FC0000", focal_35mm_mm=24, place_deg=(46.8, -91.9), altitude_m=198.0)
    rtk = {"RtkFlag": "50", "RtkStdLon": "0.01", "RtkStdLat": "0.01", "RtkStdHgt": "0.02", "LRFTargetDistance": "79.5"}
    bases = [
        write_photo(tmp_path / "dji.jpg", packet(dji(**rtk)), info).read_bytes(),
        write_photo(tmp_path / "elements.jpg", packet(dji(), as_elements=True), info).read_bytes(),
        write_photo(tmp_path / "skydio.jpg", packet(skydio), exif(make="Skydio", focal_35mm_mm=20)).read_bytes(),
        write_photo(
            tmp_path / "disco.jpg", packet({"Camera:Yaw": 1.0, "Camera:Pitch": 9.0}), exif(make="PARROT")
        ).read_bytes(),
    ]
    answered = 0
    for number in range(count):
        path = tmp_path / f"mutated{number % 7}.jpg"
        path.write_bytes(mutations(rng, rng.choice(bases), number))
        try:
            photo = ad.read_photograph(path)
        except AerodftError:  # whose text is a sentence; any other exception fails
            continue
        answered += 1
        pose = photo.pose
        assert 0 < pose.height_m <= 20_000
        assert 0 <= pose.tilt_deg <= 180
        assert all(map(math.isfinite, (pose.tilt_deg, pose.roll_deg, pose.heading_deg, pose.height_m)))
        assert pose.lat_deg is None or abs(pose.lat_deg) <= 90
        ad.measure(photo.camera, pose, ad.Position([(31.5, 23.5)]))
    assert answered > count // 20


def test_what_is_no_photograph_carries_no_pose(tmp_path):
    Image.new("RGB", (8, 8)).save(tmp_path / "a.png")
    (tmp_path / "b.jpg").write_bytes(b"\xff\xd8\xff")
    assert not carries_pose(tmp_path / "a.png")
    assert not carries_pose(tmp_path / "b.jpg")
