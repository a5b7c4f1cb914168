"""Stations on slopes and elevation models through the commands: closed forms, and recordings that travel."""

import json
import math
import shutil

import numpy as np
import orjson
import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pyproj import Geod

from aerodft.adapters.wire.pose import POSE_SCHEMA, decode_pose
from aerodft.app.assembly import pipeline
from aerodft.model import Status
from replay.recordings import Recording

UTC0_NS = 1_795_221_168_000_000_000
LAT, LON, ALT = -35.36, 149.16, 600.0
SPEED_MPS, HOME_M = 5.0, 60.0
RISE = 0.2  # of the ground, per metre to the east
FOCAL_PX = 32 / math.tan(math.radians(30.0))
CENTRE_PX = (31.5, 23.5)
ENDS = ((8.0, 30.0), (50.0, 27.0))
CENTIMETRE = 0.01
START = "2026-11-21T00:32:48.55Z"

FLIGHT = f"""
[station]
name = "test"
origin = {{ lat_deg = {LAT}, lon_deg = {LON}, alt_msl_m = {ALT} }}
[camera]
file = "camera.toml"
[telemetry]
horizontal_std_m = 1.0
[telemetry.height]
order = ["rangefinder"]
[telemetry.attitude]
tilt_std_deg = 0.1
pan_std_deg = 0.1
roll_std_deg = 0.1
[images]
rate_hz = 5
[[probe]]
name = "width"
kind = "width"
pixels = {[list(end) for end in ENDS]}
[[probe]]
name = "spot"
kind = "position"
pixels = [[31.5, 23.5]]
[[probe]]
name = "way"
kind = "bearing"
pixels = {[list(end) for end in ENDS]}
"""
SLOPE = f"[ground]\nslope_deg = {math.degrees(math.atan(RISE))!r}\nuphill_azimuth_deg = 90.0\n"
TERRAIN = '[ground]\nterrain = "dem.tif"\n'
FIXED = """
[station]
name = "yard"
[camera]
file = "camera.toml"
[pose]
height_agl_m = 8.0
tilt_deg = 60.0
lat_deg = -35.36
lon_deg = 149.16
heading_deg = 90.0
[ground]
slope_deg = 11.309932474020213
uphill_azimuth_deg = 90.0
"""


def east_m(boot_ms):
    return SPEED_MPS * boot_ms / 1000


def write_climb(path, seconds=3.0):
    """A flight to the east, 60 m above home, over ground that rises: the rangefinder sees less and less below it."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    half = math.radians(-60.0) / 2
    log = bytearray()
    for boot_ms in range(0, round(seconds * 1000) + 1, 100):
        lon, lat, _ = Geod(a=6378137.0 + ALT, f=1 / 298.257223563).fwd(LON, LAT, 90.0, east_m(boot_ms))
        below_cm = round(100 * (HOME_M - RISE * east_m(boot_ms)))
        messages = (
            dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3),
            dialect.MAVLink_system_time_message(UTC0_NS // 1000 + boot_ms * 1000, boot_ms),
            dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.0, 0, 0, 0),
            dialect.MAVLink_global_position_int_message(
                boot_ms,
                round(lat * 1e7),
                round(lon * 1e7),
                round(1e3 * (ALT + HOME_M)),
                round(1e3 * HOME_M),
                0,
                0,
                0,
                0,
            ),
            dialect.MAVLink_distance_sensor_message(boot_ms, 20, 12_000, below_cm, 0, 0, 25, 0),
            dialect.MAVLink_gimbal_device_attitude_status_message(
                0, 0, boot_ms, 44, [math.cos(half), 0.0, math.sin(half), 0.0], math.nan, math.nan, math.nan, 0
            ),
        )
        for message in messages:
            log.extend((UTC0_NS // 1000 + boot_ms * 1000 + 20_000).to_bytes(8, "big") + message.pack(mav))
    path.write_bytes(log)
    return path


def on_slope(pixel, above_m):
    """Where the ray of a camera so far above ground that rises to the east meets it, from the camera's foot.

    The camera looks north, 30 degrees from straight down.
    """
    east, down = (pixel[0] - CENTRE_PX[0]) / FOCAL_PX, (pixel[1] - CENTRE_PX[1]) / FOCAL_PX
    s, c = 0.5, math.sqrt(0.75)
    ray = np.array([east, s - down * c, -c - down * s])
    return np.array([0.0, 0.0, above_m]) + above_m / (RISE * ray[0] - ray[2]) * ray


def payloads(folder):
    return list(Recording(folder).measurements())


def measured(folder, name):
    return [m for m in map(orjson.loads, payloads(folder)) if m["name"] == name]


def poses(folder):
    return [decode_pose(m.data) for m in Recording(folder).messages() if m.channel.schema == POSE_SCHEMA]


def boot_ms(document):
    return (int(document["stamp_ns"]) - UTC0_NS) / 1e6


@pytest.fixture
def hill(desk):
    """A flight's log over the hill, and an elevation model of it."""
    rasterio = pytest.importorskip("rasterio", reason="the extra terrain is not installed")
    affine = pytest.importorskip("affine", reason="the extra terrain is not installed")
    write_climb(desk.folder / "climb.tlog")
    count, pixel_m = 201, 4.0
    along = (np.arange(count) - 100) * pixel_m
    heights = np.broadcast_to(ALT + RISE * along, (count, count)).astype("float32")
    profile = {
        "driver": "GTiff", "width": count, "height": count, "count": 1, "dtype": "float32",
        "crs": f"+proj=aeqd +lat_0={LAT} +lon_0={LON} +ellps=WGS84",
        "transform": affine.Affine(pixel_m, 0.0, -count / 2 * pixel_m, 0.0, -pixel_m, count / 2 * pixel_m),
    }  # fmt: skip
    with rasterio.open(desk.folder / "dem.tif", "w", **profile) as file:
        file.write(heights, 1)
    return desk


def imported(aerodft, desk, text, name="out"):
    out = desk.folder / name
    config = desk.station(text, f"{name}.toml")
    run = aerodft("import", desk.folder / "climb.tlog", "-c", config, "-o", out, "--json")
    assert run.code == 0, run.err
    return out


def recomputed(aerodft, recording, out):
    run = aerodft("recompute", recording, "-o", out)
    assert run.code == 0, run.err
    return out


@pytest.mark.parametrize("ground", [SLOPE, TERRAIN], ids=["slope", "terrain"])
def test_a_flight_over_a_hill_measures_what_is_there(aerodft, hill, ground):
    out = imported(aerodft, hill, FLIGHT + ground)
    usable = [sample for sample in poses(out) if sample.status is Status.OK]
    assert len(usable) == 15
    for sample in usable:
        assert sample.pose.position_enu_m[2] == pytest.approx(HOME_M, abs=CENTIMETRE)  # it flies level
    for width, spot, way in zip(*(measured(out, name) for name in ("width", "spot", "way")), strict=True):
        east = east_m(boot_ms(width))
        above_m = HOME_M - RISE * east
        ends = np.array([on_slope(pixel, above_m) for pixel in ENDS])
        across = ends[1] - ends[0]
        assert width["value"] == pytest.approx(math.hypot(across[0], across[1]), rel=5e-4)
        assert way["value"] == pytest.approx(math.degrees(math.atan2(across[0], across[1])), abs=0.02)
        place = on_slope(CENTRE_PX, above_m) + [east, 0.0, RISE * east]
        assert_allclose(spot["enu_m"][0], place, atol=3 * CENTIMETRE)
        assert spot["geo"][0]["alt_msl_m"] == pytest.approx(ALT + place[2], abs=3 * CENTIMETRE)


def test_on_a_slope_the_position_moves_a_spot_and_never_a_width(aerodft, hill):
    vague = imported(aerodft, hill, FLIGHT.replace("_std_m = 1.0", "_std_m = 50.0") + SLOPE, "vague")
    exact = imported(aerodft, hill, FLIGHT.replace("_std_m = 1.0", "_std_m = 0.0") + SLOPE, "exact")
    for one, other in zip(measured(vague, "width"), measured(exact, "width"), strict=True):
        assert one["std"] == pytest.approx(other["std"], rel=1e-6)
    cov = np.array(measured(vague, "spot")[0]["cov_enu_m2"])
    assert cov[2, 2] == pytest.approx((RISE * 50.0) ** 2, rel=0.02)


@pytest.mark.parametrize("ground", [SLOPE, TERRAIN], ids=["slope", "terrain"])
def test_a_recomputed_hill_is_the_same_bytes_on_another_machine(aerodft, hill, tmp_path_factory, ground):
    out = imported(aerodft, hill, FLIGHT + ground)
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    shutil.move(out, elsewhere / "flight")
    shutil.rmtree(hill.folder)
    once = recomputed(aerodft, elsewhere / "flight", elsewhere / "once")
    twice = recomputed(aerodft, once, elsewhere / "twice")
    assert payloads(once) == payloads(twice) == payloads(elsewhere / "flight")
    assert (once / "config.toml").read_bytes() == (elsewhere / "flight" / "config.toml").read_bytes()
    assert (twice / "terrain.tif").is_file() == (ground is TERRAIN)
    spot = json.dumps(measured(twice, "spot")[0]["config"])
    run = aerodft("measure", "--recording", twice, "--at", 1, "--probe", "position 31.5,23.5", "--json")
    assert run.code == 0, run.err
    assert json.dumps(run.json[0]["config"]) == spot


def test_a_recording_whose_terrain_was_changed_or_lost_says_so(aerodft, hill):
    out = imported(aerodft, hill, FLIGHT + TERRAIN)
    terrain = out / "terrain.tif"
    with terrain.open("ab") as file:
        file.write(b"\0")
    run = aerodft("recompute", out, "-o", hill.folder / "again")
    assert run.code == 3
    assert "ground.terrain: got a TIFF image with sha256 " in run.last
    assert "; put the original there, or leave ground.sha256 out to compute with this one" in run.last
    terrain.unlink()
    run = aerodft("recompute", out, "-o", hill.folder / "again")
    assert run.code == 3
    assert f"ground.terrain: got nothing at {terrain}, expected the elevation model with sha256 " in run.last
    assert not (hill.folder / "again").exists()
    shutil.copyfile(hill.folder / "dem.tif", terrain)
    assert payloads(recomputed(aerodft, out, hill.folder / "again")) == payloads(out)


def test_a_large_elevation_model_stays_where_it_is(aerodft, hill, monkeypatch):
    monkeypatch.setattr(pipeline, "travels", lambda _: False)
    out = hill.folder / "out"
    run = aerodft("import", hill.folder / "climb.tlog", "-c", hill.station(FLIGHT + TERRAIN), "-o", out)
    assert f"{hill.folder / 'dem.tif'} is not copied into the recording, which needs it to be computed anew" in run.err
    assert not (out / "terrain.tif").exists()
    assert payloads(recomputed(aerodft, out, hill.folder / "again")) == payloads(out)


def test_what_gdal_keeps_beside_an_elevation_model_travels_with_it(aerodft, hill):
    (hill.folder / "dem.tif.aux.xml").write_text("<PAMDataset></PAMDataset>")
    out = imported(aerodft, hill, FLIGHT + TERRAIN)
    names = {path.name for path in out.glob("*terrain*")}
    assert names == {"terrain.tif", "terrain.tif.aux.xml"}


def test_beyond_the_elevation_model_poses_and_measurements_say_so(aerodft, hill):
    near = hill.folder / "near.toml"
    near.write_text(FLIGHT + TERRAIN + "radius_m = 8\n")
    run = aerodft("import", hill.folder / "climb.tlog", "-c", near, "-o", hill.folder / "out", "--json")
    assert run.code == 0, run.err
    assert set(run.json["poses"]) == {"ok", "BEYOND_TERRAIN"}
    assert "0 m north of the origin, is no more elevation model" in run.json["reasons"]["BEYOND_TERRAIN"]
    lost = [m for m in measured(hill.folder / "out", "width") if m["status"] == "BEYOND_TERRAIN"]
    assert {m["value"] for m in lost} == {None}


def fixed_import(aerodft, desk, text):
    out = desk.folder / "out"
    config = desk.station(text)
    run = aerodft("import", "--video", desk.video(images=2), "--video-start", START, "-c", config, "-o", out, "--json")
    assert run.code == 0, run.err
    return out


def seen(point_m, tilt_rad):
    """The pixel of a point, ahead, to the right of and above the foot of a camera 8 m up."""
    right, ahead, up = point_m
    depth = ahead * math.sin(tilt_rad) + (8.0 - up) * math.cos(tilt_rad)
    down = (8.0 - up) * math.sin(tilt_rad) - ahead * math.cos(tilt_rad)
    return [CENTRE_PX[0] + FOCAL_PX * right / depth, CENTRE_PX[1] + FOCAL_PX * down / depth]


def test_a_fixed_camera_looks_up_a_hill_and_at_the_top_of_a_pole(aerodft, desk):
    tilt = math.radians(60.0)
    base = np.array([-1.0, 12.0, RISE * 12.0])
    top = base + [0.0, 0.0, 3.0]
    beam = [top + [0.5, 1.0, 0.0], top + [3.5, 5.0, 0.0]]  # 5 m, level with the pole's top
    probes = [
        {"name": "centre", "kind": "range", "pixels": [list(CENTRE_PX)]},
        {"name": "beam", "kind": "width", "pixels": [seen(end, tilt) for end in beam], "on_top_of": "pole"},
        {"name": "pole", "kind": "height", "pixels": [seen(base, tilt), seen(top, tilt)]},
        {"name": "way", "kind": "bearing", "pixels": [list(CENTRE_PX)]},
    ]
    text = FIXED + "".join(
        "[[probe]]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in probe.items()) + "std_px = 0.1\n"
        for probe in probes
    )
    out = fixed_import(aerodft, desk, text)
    first = {m["name"]: m for m in map(orjson.loads, payloads(out)[:4])}
    assert first["centre"]["value"] == pytest.approx(8.0 / (math.cos(tilt) + RISE * math.sin(tilt)), rel=1e-9)
    assert first["pole"]["value"] == pytest.approx(3.0, rel=1e-6)
    assert first["beam"]["value"] == pytest.approx(5.0, rel=1e-6)
    assert first["way"]["value"] == pytest.approx(90.0, abs=1e-9)
    assert payloads(recomputed(aerodft, out, desk.folder / "again")) == payloads(out)


def test_a_stated_covariance_and_the_same_as_stds_give_the_same_interval(aerodft, desk):
    probe = '[[probe]]\nname = "centre"\nkind = "range"\npixels = [[31.5, 23.5]]\n'
    level = FIXED[: FIXED.index("[ground]")]
    deg = math.radians(1.0)
    cov = np.diag([4.0, 4.0, 0.01, *3 * [deg**2]])
    plain = fixed_import(aerodft, desk, level + "std = { heading_deg = 0 }\n" + probe)
    stds = measured(plain, "centre")[0]
    shutil.rmtree(plain)
    full = fixed_import(aerodft, desk, level + f"covariance = {cov.tolist()}\n" + probe)
    assert measured(full, "centre")[0]["std"] == pytest.approx(stds["std"], rel=1e-9)
    pose = poses(full)[0]
    assert_allclose(pose.pose.cov, cov, atol=1e-18)
    assert payloads(recomputed(aerodft, full, desk.folder / "again")) == payloads(full)


def test_live_stations_know_their_ground_too(aerodft, desk):
    probe = '[[probe]]\nname = "centre"\nkind = "range"\npixels = [[31.5, 23.5]]\n'
    out = desk.folder / "out"
    config = desk.station(FIXED + "[images]\nrate_hz = 20\n[zenoh]\nenabled = false\n" + probe)
    run = aerodft("serve", config, "-o", out, "--seconds", 1.0)
    assert run.code == 0, run.err
    expected_m = 8.0 / (0.5 + RISE * math.sqrt(0.75))
    assert {round(m["value"], 9) for m in measured(out, "centre")} == {round(expected_m, 9)}
    assert payloads(recomputed(aerodft, out, desk.folder / "again")) == payloads(out)
