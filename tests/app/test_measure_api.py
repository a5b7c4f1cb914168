"""Measuring from Python: the numbers of the command, in degrees and metres, and arrays of pixels."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import aerodft as ad
from aerodft.model import Camera, CameraStd
from tests.commands import run_aerodft

CANON, DEMO = "configs/cameras/canon-1000d.toml", "configs/cameras/demo-1080p.toml"
STD = ad.PoseStd(height_m=0.1, tilt_deg=0.2, pan_deg=0.1, roll_deg=0.3, heading_deg=1.0, position_m=0.5)
POSE = ad.CameraPose(height_m=10.48, tilt_deg=60, roll_deg=2, heading_deg=130, std=STD)
OPTIONS = ["--camera", CANON, "--height", 10.48, "--tilt", 60, "--roll", 2, "--heading", 130]
OPTIONS += ["--std", "height=0.1,tilt=0.2,pan=0.1,roll=0.3,heading=1,position=0.5"]
PIXELS = np.random.default_rng(3).uniform([0, 200], [3888, 2592], (7, 5, 2))


@pytest.fixture
def camera():
    return ad.load_camera(CANON)


def test_the_numbers_are_those_of_the_command(camera):
    probes = [
        ad.Width([(812, 1604), (1377, 1611)]),
        ad.Height([(1500, 1500), (1500, 1000)], name="mast"),
        ad.Distance([(1480, 1100), (1520, 1150)], on_top_of="mast"),
        ad.Position((1944, 1800), elevation_m=0.5),
    ]
    texts = ["width 812,1604 1377,1611", "height 1500,1500 1500,1000 name=mast"]
    texts += ["distance 1480,1100 1520,1150 elevation=mast", "position 1944,1800 elevation=0.5"]
    done = run_aerodft("measure", *OPTIONS, *(word for text in texts for word in ("--probe", text)), "--json")
    for found, told in zip(ad.measure(camera, POSE, probes), done.json, strict=True):
        assert (found.name, str(found.status), found.unit) == (told["name"], told["status"], told["unit"])
        assert (found.value, found.std) == (told["value"], told["std"])
        assert found.ci95 is None or list(found.ci95) == told["ci95"]


def test_one_probe_gives_one_measurement_and_a_miss_says_why(camera):
    found = ad.measure(camera, POSE, ad.Range((1944, 1)), max_range_m=20)
    assert (found.value, found.std, found.ci95) == (None, None, None)
    assert found.status != "ok"
    assert found.reasons


def test_a_measurement_prints_as_one_line(camera):
    found = ad.measure(camera, POSE, ad.Range((1944, 1296)))
    low, high = found.ci95
    assert str(found) == f"range-1: {found.value:.3f} m, 95 % {low:.3f} to {high:.3f} m"
    refused = ad.measure(camera, POSE, ad.Range((1944, 1)), max_range_m=20)
    assert str(refused) == f"range-1: {refused.status}: {'; '.join(refused.reasons)}"
    x_m, y_m, _ = ad.measure(camera, POSE, ad.Position((1944, 1296))).ground_m[0]
    assert str(ad.measure(camera, POSE, ad.Position((1944, 1296)))) == f"position-1: ({x_m:.3f}, {y_m:.3f}) m"


def test_what_nobody_says_how_well_it_is_known_is_assumed_and_said(camera):
    found = ad.measure(camera, ad.CameraPose(height_m=10, tilt_deg=60), ad.Range((1944, 1500)))
    assert any("assumed: height 0.1 m, tilt 1 deg" in reason for reason in found.reasons)


@pytest.mark.parametrize(
    ("wrong", "what"),
    [
        (lambda: ad.CameraPose(height_m=-3, tilt_deg=60), "`height_m`"),
        (lambda: ad.CameraPose(height_m=3, tilt_deg=200), "`tilt_deg`"),
        (lambda: ad.CameraPose(height_m=3, tilt_deg=20, lat_deg=3), "`lat_deg` and `lon_deg`"),
        (lambda: ad.Slope(slope_deg=89, uphill_deg=0), "`slope_deg`"),
        (lambda: ad.Width((1, 2)), "a width"),
        (lambda: ad.Range((1, math.nan)), "a range"),
        (lambda: ad.measure(None, POSE, ad.Range((1, 2))), "no camera"),
        (lambda: ad.measure(ad.load_camera(CANON), None, ad.Range((1, 2))), "no pose"),
        (lambda: ad.measure(ad.load_camera(CANON), POSE, [ad.Range((1, 2), name="a")] * 2), "probe 2"),
        (lambda: ad.measure(ad.load_camera(CANON), POSE, [(1, 2)]), "`probes`"),
        (lambda: ad.measure(ad.load_camera(CANON), POSE, ad.Range((1, 2)), model="pinole"), "`model`"),
        (lambda: ad.measure(CANON, POSE, ad.Range((1, 2))), "`camera`"),
        (lambda: ad.measure(ad.load_camera(CANON), 10.48, ad.Range((1, 2))), "`pose`"),
        (lambda: ad.ground_points(CANON, POSE, [(1, 2)]), "`camera`"),
        (lambda: ad.ground_points(ad.load_camera(CANON), 10.48, [(1, 2)]), "`pose`"),
        (lambda: ad.ground_points(ad.load_camera(CANON), POSE, [(1, 2, 3)]), "`pixels`"),
        (lambda: ad.ground_points(ad.load_camera(CANON), POSE, [(1, 2)], covariance=True, std_px=-1), "`std_px`"),
        (lambda: ad.CameraPose(height_m="3", tilt_deg=20), "`height_m`"),
        (lambda: ad.CameraPose(height_m=3, tilt_deg=20, std=0.1), "`std`"),
        (lambda: ad.PoseStd(tilt_deg=-0.1), "`tilt_deg`"),
        (lambda: ad.Width("812,1604 1377,1611"), "a width"),
        (lambda: ad.Range((1, 2), std_px=math.nan), "`std_px`"),
        (lambda: ad.survey_river("nowhere", images=0), "`images`"),
        (lambda: ad.calibrate("configs/calibration/bridge-landmarks.toml", DEMO, model="pinole"), "`model`"),
    ],
)
def test_what_is_impossible_is_an_error_that_names_the_parameter(wrong, what):
    with pytest.raises(ad.AerodftError) as caught:
        wrong()
    assert caught.value.what.startswith(what)


def test_ground_points_are_the_measured_ones_with_their_covariances(camera):
    camera = replace(camera, std=CameraStd(focal_px=4.0), distortion=(-0.1, 0.02, 0.0, 0.0, 0.0))
    pose = replace(POSE, heading_deg=0.0)
    points, covariances = ad.ground_points(camera, pose, PIXELS, covariance=True, elevation_m=1.0, elevation_std_m=0.1)
    assert points.shape == (7, 5, 3)
    assert covariances.shape == (7, 5, 3, 3)
    probes = [ad.Position(pixel, elevation_m=1.0, elevation_std_m=0.1) for pixel in PIXELS.reshape(-1, 2)]
    for found, point, covariance in zip(
        ad.measure(camera, pose, probes), points.reshape(-1, 3), covariances.reshape(-1, 3, 3), strict=True
    ):
        assert_allclose(found.ground_m[0], point, rtol=1e-9)
        if np.max(np.sqrt(np.diag(covariance))) < 0.04 * found.range_m[0]:  # first order is enough there
            assert_allclose(found.cov_enu_m2, covariance, rtol=1e-6, atol=1e-9)


def test_the_ground_frame_turns_with_the_camera():
    camera = Camera.from_fov(name="c", width_px=640, height_px=360, hfov_rad=1.2, vfov_rad=0.8)
    pixels = [(100.0, 300.0), (600.0, 200.0)]
    first, turned = (
        ad.ground_points(camera, replace(POSE, heading_deg=heading), pixels, covariance=True) for heading in (0, 130)
    )
    assert_allclose(first[0], turned[0], rtol=1e-9, atol=1e-9)
    assert_allclose(first[1], turned[1], rtol=1e-6, atol=1e-9)


def test_above_the_horizon_there_is_no_point(camera):
    points, covariances = ad.ground_points(
        camera, replace(POSE, tilt_deg=89), [(1944, 1), (1944, 2500)], covariance=True
    )
    assert np.all(np.isnan(points[0]))
    assert np.all(np.isnan(covariances[0]))
    assert np.all(np.isfinite(points[1]))


@pytest.fixture(scope="module")
def reach():
    camera = ad.load_camera("configs/cameras/demo-1080p.toml")
    pose = ad.CameraPose(height_m=7.93, tilt_deg=62.3, lat_deg=47.06, lon_deg=15.43, std=STD)
    return ad.survey_river("configs/calibration/bridge.jpg", camera, pose, spacing_m=3)


def test_a_surveyed_river_is_a_table_and_a_map(reach, tmp_path):
    assert reach.status == "ok"
    rows = reach.transects.rows()
    widths = [row["width_m"] for row in rows if row["status"] == "ok"]
    features = reach.transects.to_geojson()["features"]
    assert [each["properties"]["width_m"] for each in features] == widths
    assert {tmp_path / "result.json", tmp_path / "transects.csv"} <= {*map(tmp_path.joinpath, reach.save(tmp_path))}
    geopandas = pytest.importorskip("geopandas")
    frame = reach.transects.to_geopandas()
    assert isinstance(frame, geopandas.GeoDataFrame)
    assert frame.crs.to_epsg() == 4326
    assert list(frame["width_m"]) == widths


def test_without_geopandas_the_extra_is_named(reach, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "geopandas", None)
    with pytest.raises(ad.InputError, match=r"aerodft\[geo\]"):
        reach.transects.to_geopandas()
