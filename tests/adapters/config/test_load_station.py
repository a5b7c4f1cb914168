import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod

from aerodft.adapters.config.camera import load_calibration
from aerodft.adapters.config.station import (
    Device,
    Rate,
    StationConfig,
    Stills,
    StreamInput,
    VideoFile,
    load_station,
    parse_station,
    with_calibration,
)
from aerodft.adapters.config.station.station_config import Link
from aerodft.errors import ConfigError
from aerodft.model import Camera, GimbalSource, HeightSource, PixelSource, ProbeKind, ProjectionModel
from aerodft.service import HeightSettings, TelemetrySettings

CONFIGS = Path(__file__).parents[3] / "configs"
CAMERA = '[camera]\nname = "A"\nwidth_px = 100\nheight_px = 50\nhfov_deg = 90\n'
STATION = '[station]\nname = "s"\n' + CAMERA
FLIGHT = STATION + "[telemetry]\n"
FIXED = STATION + "[pose]\nheight_agl_m = 8\ntilt_deg = 60\n"
PROBE = '[[probe]]\nname = "p"\nkind = "range"\npixels = [[10, 20]]\n'


def parsed(text: str, folder: Path = Path()) -> StationConfig:
    return parse_station(text.encode(), where="x.toml", folder=folder)


def test_the_river_flight_example_says_what_its_comments_say() -> None:
    station = load_station(CONFIGS / "services" / "river-flight.toml")
    assert station.link == Link(connection="udpin:127.0.0.1:14550")
    assert station.images.source == StreamInput(url="udp://127.0.0.1:5600")
    assert station.pipeline.camera.name == "demo-1080p"
    assert station.pipeline.max_range_m == 500.0
    assert station.pipeline.fixed_pose is None
    assert [probe.kind for probe in station.pipeline.probes] == [ProbeKind.DISTANCE, ProbeKind.POSITION]
    assert station.pipeline.probes[0].source is PixelSource.OBSERVED


def test_the_examples_defaults_are_the_defaults() -> None:
    stated, bare = load_station(CONFIGS / "services" / "river-flight.toml"), parsed(FLIGHT)
    assert stated.pipeline.telemetry == bare.pipeline.telemetry
    assert (stated.outputs, stated.record) == (bare.outputs, bare.record)
    assert bare.pipeline.telemetry is not None
    assert bare.pipeline.telemetry.height == HeightSettings()
    assert bare.pipeline.telemetry.attitude.order == TelemetrySettings().attitude.order
    assert bare.pipeline.telemetry.attitude.std.tilt_rad == math.radians(1.0)
    assert bare.pipeline.telemetry.attitude.std.heading_rad == math.radians(2.0)


def test_a_configuration_names_its_calibration() -> None:
    station = parsed(FLIGHT + 'calibration = "river-calibration.toml"\n', CONFIGS / "sites")
    assert station.link is None
    assert station.calibration is not None
    assert station.calibration.id == load_calibration(CONFIGS / "sites" / "river-calibration.toml").biases.id
    assert station.calibration.bias.height_m == -0.42
    assert station.calibration.bias.tilt_rad == math.radians(0.6)
    assert station.calibration.bias_cov is not None
    wanted = np.square([0.08, *np.radians([0.05, 0.05, 0.4]), 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(station.calibration.bias_cov, np.diag(wanted), rtol=1e-15)


def test_the_fixed_camera_example_has_a_pose_and_no_telemetry() -> None:
    station = load_station(CONFIGS / "services" / "fixed-camera.toml")
    sample = station.pipeline.fixed_pose
    assert station.pipeline.telemetry is None
    assert sample is not None
    assert sample.pose is not None
    assert sample.origin is not None
    np.testing.assert_allclose(sample.pose.position_enu_m, [0, 0, 7.85])
    assert math.degrees(sample.origin.lat_rad) == pytest.approx(47.0667)
    assert sample.origin.alt_msl_m == pytest.approx(352.4 - 7.85)
    assert sample.height_source == HeightSource.MANUAL


def test_a_fixed_camera_takes_its_pose_from_a_calibration() -> None:
    path = CONFIGS / "sites" / "bridge-calibration.toml"
    station = with_calibration(load_station(CONFIGS / "services" / "fixed-camera.toml"), path)
    sample = station.pipeline.fixed_pose
    assert sample is not None
    assert sample.pose is not None
    assert sample.pose.position_enu_m[2] == 7.91
    assert sample.std.height_agl_m == 0.012
    assert sample.calibration == load_calibration(path).biases.id
    assert sample.height_source == HeightSource.CALIBRATION
    text = STATION + f'[pose]\ncalibration = "{path}"\n'
    other = parsed(text).pipeline.fixed_pose
    assert other is not None
    assert other.pose is not None
    np.testing.assert_array_equal(other.pose.wxyz, sample.pose.wxyz)


def test_a_position_and_an_origin_place_the_camera_in_the_stations_frame() -> None:
    lon, lat, _ = Geod(ellps="WGS84").fwd(15.0, 47.0, 90.0, 250.0)
    text = FIXED + f"lat_deg = {lat}\nlon_deg = {lon}\n"
    sample = parsed(text.replace('name = "s"', 'name = "s"\norigin = { lat_deg = 47, lon_deg = 15 }', 1))
    pose = sample.pipeline.fixed_pose
    assert pose is not None
    assert pose.pose is not None
    np.testing.assert_allclose(pose.pose.position_enu_m, [250.0, 0.0, 8.0], atol=0.01)


def test_a_camera_that_knows_no_north_has_no_doubt_about_it() -> None:
    without, with_heading = parsed(FIXED).fixed_pose, parsed(FIXED + "heading_deg = 0\n").fixed_pose
    assert without is not None
    assert with_heading is not None
    assert without.std.heading_rad == 0.0
    assert with_heading.std.heading_rad == math.radians(2.0)


@pytest.mark.parametrize(
    ("keys", "source"),
    [
        ("", None),
        ("rate_hz = 10", Rate(rate_hz=10.0)),
        ('device = "/dev/video0"', Device(path="/dev/video0")),
        ('video = "a.mp4"', VideoFile(path=Path("here/a.mp4"))),
        (
            'video = "a.mp4"\nstart = 2026-11-21T01:57:26.5Z',
            VideoFile(path=Path("here/a.mp4"), start_ns=1795226246500000000),
        ),
        (
            'video = "a.mp4"\nstart = 1795226246500000007',
            VideoFile(path=Path("here/a.mp4"), start_ns=1795226246500000007),
        ),
        (
            'video = "a.mp4"\nstart = "2026-11-21T02:57:26.500000007+01:00"',
            VideoFile(path=Path("here/a.mp4"), start_ns=1795226246500000007),
        ),
        (
            'stills = "/x"\npattern = "{unix_ms}.jpg"\nutc_offset = "+02:00"',
            Stills(folder=Path("/x"), pattern="{unix_ms}.jpg", utc_offset="+02:00"),
        ),
    ],
)
def test_images_come_from_one_input(keys: str, source: object) -> None:
    station = parsed(f"{FLIGHT}[images]\ntime_offset_s = -0.5\n{keys}\n", Path("here"))
    assert station.images.source == source
    assert station.images.time_offset_s == -0.5


def test_the_camera_section_chooses_the_model() -> None:
    assert parsed(FLIGHT.replace("[camera]", '[camera]\nmodel = "dft"')).pipeline.model is ProjectionModel.DFT
    assert isinstance(parsed(FLIGHT).pipeline.camera, Camera)


def test_everything_about_telemetry_reaches_the_settings() -> None:
    text = (
        FLIGHT + 'connection = "/dev/ttyUSB0"\nbaud = 921600\nsystem = 7\nwait_s = 0.25\n'
        '[telemetry.height]\norder = ["manual"]\nmanual_m = 12\nmax_gap_s = 3.5\nstd_m = { manual = 0.1 }\n'
        '[telemetry.attitude]\norder = ["MNT", "fixed"]\nfixed_mount = { pitch_deg = -90 }\nroll_std_deg = 0\n'
    )
    station = parsed(text)
    settings = station.pipeline.telemetry
    assert station.link == Link(connection="/dev/ttyUSB0", baud=921600)
    assert settings is not None
    assert (settings.system, settings.wait_ns) == (7, 250_000_000)
    assert settings.height.order == (HeightSource.MANUAL,)
    assert (settings.height.manual_m, settings.height.max_gap_ns) == (12.0, 3_500_000_000)
    assert settings.height.std_m[HeightSource.MANUAL] == 0.1
    assert settings.height.std_m[HeightSource.TERRAIN] == 3.0
    assert settings.attitude.order == (GimbalSource.DATAFLASH_MNT, GimbalSource.FIXED_MOUNT)
    assert settings.attitude.fixed_mount is not None
    assert settings.attitude.fixed_mount.pitch_rad == -math.pi / 2
    assert settings.attitude.std.roll_rad == 0.0


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (FLIGHT + "[telemetry.height]\nmin = 1\n", "x.toml: telemetry.height.min: unknown key; did you mean min_m?"),
        (
            FIXED + "height_cm = 800\n",
            "x.toml: pose.height_cm: unknown key: expected height_agl_m (in metres); write height_agl_m",
        ),
        (
            FLIGHT + "[telemetry.height]\nmax_gap_ms = 5\n",
            "telemetry.height.max_gap_ms: unknown key: expected max_gap_s (in seconds); write max_gap_s",
        ),
        (FLIGHT + "[telemetri]\n", "x.toml: telemetri: unknown key; did you mean telemetry?"),
        (FLIGHT + "[[probes]]\n", "x.toml: probes: unknown key; did you mean probe?"),
        (FLIGHT + PROBE + "std = 1\n", "x.toml: probe[0].std: unknown key; did you mean std_px?"),
        (FIXED.replace("= 8", "= -8"), "x.toml: pose.height_agl_m: got -8, expected more than 0"),
        (FIXED.replace("60", "-30"), "straight down: 0 nadir, 90 horizon; a gimbal's pitch of -30 deg is a tilt of 60"),
        (FIXED.replace("60", "300"), "x.toml: pose.tilt_deg: got 300, expected at most 180"),
        (FIXED.replace("60", '"60"'), 'x.toml: pose.tilt_deg: got "60", expected a number'),
        (FIXED + "std = { tilt_deg = -1 }\n", "x.toml: pose.std.tilt_deg: got -1, expected at least 0"),
        (FIXED + "lat_deg = 4\n", "pose.lon_deg: got nothing, expected both lat_deg and lon_deg, or none of them"),
        (FIXED + 'calibration = "c"\n', "pose.height_agl_m: it stands beside calibration, expected one of the two"),
        (STATION + "[pose]\ntilt_deg = 3\n", "pose.height_agl_m: got nothing, expected height_agl_m and tilt_deg"),
        (STATION, "x.toml: its keys: got neither of them, expected either [telemetry] or [pose]; [pose] is for a fix"),
        (FIXED + "[telemetry]\n", "got both of them, expected either [telemetry] or [pose]"),
        (FLIGHT.replace("90", "190"), "x.toml: camera.hfov_deg: got 190, expected less than 180"),
        (FLIGHT.replace("hfov_deg", "hfov"), "x.toml: camera.hfov: unknown key; did you mean hfov_deg?"),
        (FLIGHT.replace("[camera]", '[camera]\nmodel = "fish"'), 'camera.model: got "fish", expected one of'),
        (FLIGHT.replace("[camera]", '[camera]\nfile = "c"'), "x.toml: camera.name: it stands beside file, expected"),
        ('[station]\nname = "s"\n[telemetry]\n[camera]\nfile = "none.toml"\n', "none.toml: no such file; check"),
        (FLIGHT.replace('"s"', '"a/b"', 1), "x.toml: station.name: got \"a/b\", expected letters, digits, '.', '_' a"),
        (
            FLIGHT + PROBE.replace("20", "50"),
            'x.toml: probe "p" lies outside the image: got pixel (10, 50), expected within (-0.5, -0.5) to (99.5, 49',
        ),
        (FLIGHT + PROBE + PROBE, 'x.toml: probe[1].name: got "p" again, expected a name of its own'),
        (FLIGHT + PROBE.replace("range", "distance"), "probe[0].pixels: got 1 pixel, expected 2 for distance"),
        (FLIGHT + PROBE.replace("range", "volume"), 'x.toml: probe[0].kind: got "volume", expected one of '),
        (FLIGHT + PROBE + "observed = true\n", "probe[0].pixels: it stands beside observed = true, expected one of"),
        (FLIGHT + '[[probe]]\nname = "p"\nkind = "range"\n', "probe[0].pixels: got nothing, expected [[u, v], ...],"),
        (
            FLIGHT + '[telemetry.height]\norder = ["manual"]\n',
            'manual_m: got nothing, expected metres, because "manual"',
        ),
        (FLIGHT + '[telemetry.height]\norder = ["home", "home"]\n', "order: got home twice, expected each once"),
        (FLIGHT + "[telemetry.height]\norder = []\n", "telemetry.height.order: got [], expected at least 1 of them"),
        (FLIGHT + '[telemetry.height]\norder = ["baro"]\n', 'telemetry.height.order[0]: got "baro", expected one of'),
        (FLIGHT + '[telemetry.attitude]\norder = ["fixed"]\n', "attitude.fixed_mount: got nothing, expected a table"),
        (
            FLIGHT + '[images]\nvideo = "a"\nstream = "udp://x"\n',
            "images.stream: it stands beside video, expected one of",
        ),
        (FLIGHT + "[images]\nstart = 5\n", "images.start: it stands without video, expected video beside it"),
        (FLIGHT + '[images]\nvideo = "a"\nstart = 2026-11-21T01:57:26\n', "images.start: got 2026-11-21T01:57:26, exp"),
        (FLIGHT + '[images]\nvideo = "a"\nstart = "noon"\n', 'images.start: got "noon", expected like "2026-11-21T01'),
        (FLIGHT + '[images]\nstills = "a"\nutc_offset = "CET"\n', 'images.utc_offset: got "CET", expected an offset'),
        (FLIGHT + '[images]\nstream = "5600"\n', 'images.stream: got "5600", expected a URL like "udp://0.0.0.0:5600"'),
        (FLIGHT + "[images]\nrate_hz = 0\n", "images.rate_hz: got 0, expected more than 0"),
        (FLIGHT + '[zenoh]\nlisten = "7447"\n', 'zenoh.listen: got "7447", expected like "tcp/127.0.0.1:7447"'),
        (FLIGHT + "[record]\njpeg_quality = 101\n", "record.jpeg_quality: got 101, expected at most 100"),
        (FLIGHT + '[zenoh]\nenabled = "yes"\n', 'zenoh.enabled: got "yes", expected true or false'),
        (
            FLIGHT + 'calibration = "c"\n[telemetry.bias]\n',
            "telemetry.bias: it stands beside calibration, expected one",
        ),
        (FLIGHT + "wait_s = 1e300\n", "x.toml: telemetry.wait_s: got 1e+300, expected at most 1e+06"),
        (FLIGHT + "[telemetry.height]\nmax_gap_s = 1e-300\n", "max_gap_s: got 1e-300, expected at least 0.001"),
        (FLIGHT + "[images]\ntime_drift = 0.01\n", "images.time_drift: it stands without time_reference, expected"),
        (FLIGHT + '[images]\ntime_offset_s = "soon"\n', 'images.time_offset_s: got "soon", expected'),
        (
            FLIGHT + '[images]\ntime_offset_s = "auto"\ntime_reference = "2026-11-21T10:00:00Z"\n',
            'images.time_offset_s: got "auto" beside a drift, expected a number',
        ),
        (FLIGHT + "[observations]\ntime_offset_s = 1e10\n", "time_offset_s: got 10000000000.0, expected at most 1e+09"),
        (FLIGHT + PROBE.replace('"p"', '"p\\nq"'), 'probe[0].name: got "p\\nq", expected letters, digits'),
        ("a = " + 5000 * "[", "x.toml: TOML syntax: too many lists or tables within each other"),
        (STATION + 'x = "a\\u0000b"', "x.toml: TOML: a text with the character 0 in it; take it out"),
        ("a." * 2000 + "a = 1", "x.toml: TOML syntax: too many lists or tables within each other"),
        ("station = 3\n" + CAMERA, "x.toml: station: got 3, expected a table"),
    ],
)
def test_a_wrong_station_file_is_refused_in_one_sentence(text: str, sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parsed(text)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_wrong_camera_file_is_named_by_its_own_path(tmp_path: Path) -> None:
    (tmp_path / "cam.toml").write_text('name = "A"\nwidth_px = 0\n')
    with pytest.raises(ConfigError, match=r"cam\.toml: width_px: got 0, expected more than 0"):
        parsed('[station]\nname = "s"\n[telemetry]\n[camera]\nfile = "cam.toml"\n', tmp_path)


def test_a_calibration_of_the_wrong_kind_is_refused() -> None:
    flight, bridge = parsed(FLIGHT), parsed(FIXED)
    with pytest.raises(ConfigError, match=r"bridge-calibration\.toml: a fixed camera's calibration: got \[pose\]"):
        with_calibration(flight, CONFIGS / "sites" / "bridge-calibration.toml")
    with pytest.raises(ConfigError, match=r"river-calibration\.toml: no pose in this calibration: got \[bias\] alone"):
        with_calibration(bridge, CONFIGS / "sites" / "river-calibration.toml")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[other]\n", "c.toml: other: unknown key; known keys here are model, bias, pose, camera"),
        (
            "[bias]\nheight_cm = 3\n",
            "c.toml: bias.height_cm: unknown key: expected height_m (in metres); write height_m",
        ),
        ("[bias]\ntilt_deg = { value = 90 }\n", "c.toml: bias.tilt_deg.value: got 90, expected at most 45"),
        ("[bias]\ntilt_deg = { value = 1, std = -1 }\n", "c.toml: bias.tilt_deg.std: got -1, expected at least 0"),
        ("[bias]\ntilt_deg = { value = 1, sigma = 1 }\n", "c.toml: bias.tilt_deg.sigma: unknown key; known keys here"),
        ('[bias]\ntilt_deg = "1"\n', 'c.toml: bias.tilt_deg.value: got "1", expected a number'),
        ("[pose]\ntilt_deg = 1\n", "c.toml: pose.height_agl_m: got nothing, expected a value"),
    ],
)
def test_a_wrong_calibration_file_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "c.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_calibration(path)
    assert sentence in str(caught.value)


def test_a_calibration_may_hold_plain_numbers(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text("[bias]\nheight_m = -1\n[pose]\nheight_agl_m = 5\ntilt_deg = 0\n")
    found = load_calibration(path)
    calibration = found.biases
    assert calibration.bias.height_m == -1.0
    assert calibration.bias_cov is not None
    assert not calibration.bias_cov.any()
    assert found.pose is not None
    np.testing.assert_array_equal(found.pose.pose_on_level_ground().position_enu_m, [0, 0, 5])
    assert calibration.id.startswith("sha256:")
    assert len(calibration.id) == 71


def test_replacing_a_part_leaves_the_rest() -> None:
    station = parsed(FLIGHT)
    other = replace(station, images=replace(station.images, source=Rate(rate_hz=2.0)))
    assert other.pipeline is station.pipeline
