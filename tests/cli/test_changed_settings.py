"""Single keys changed on top of what a recording knows, and station files that keep the alignment of its video."""

import tomllib

import orjson
import pyarrow.parquet
import pytest

import aerodft as ad
from aerodft.app.recompute import recompute_many
from aerodft.errors import AerodftError, ConfigError, UsageError
from replay.recordings import Recording

HOME = "telemetry.height.home_above_plane_m"
HEIGHT_M = 40.0
ALIGNED = """
time_offset_s = 0.25
time_drift = 0.001
time_reference = "2026-11-21T00:32:49.55Z"
time_std_s = 0.004
"""
LAG = "[telemetry.attitude]\ndelay_s = 0.2\nlag_s = 0.05\n[images]"
START = '"2026-11-21T00:32:48.30Z"'


def measurements(folder, name="centre"):
    found = (orjson.loads(data) for data in Recording(folder).measurements())
    return [each for each in found if each["name"] == name and each["status"] == "ok"]


def config(folder):
    return tomllib.loads((folder / "config.toml").read_text())


@pytest.fixture
def synced(aerodft, desk):
    """A recording whose station has the lines of ``sync``, and the station file without them, as ``init`` wrote it."""
    video = f'video = "flight.mp4"\nstart = {START}'
    drafted = desk.config.read_text().replace("rate_hz = 5", f"{video}\ntime_std_s = 0.6")
    desk.video()
    aligned = drafted.replace("\ntime_std_s = 0.6", ALIGNED).replace("[images]", LAG)
    desk.station(drafted, "drafted.toml")
    done = aerodft("import", desk.log, "-c", desk.station(aligned, "aligned.toml"), "-o", desk.folder / "rec")
    assert done.code == 0, done.err
    return desk.folder / "rec"


@pytest.mark.parametrize(
    "options",
    [
        ("--home-above-plane", 3.0),
        ("--set", f"{HOME}=3.0"),
        ("-c", "higher.toml"),
        ("-c", "drafted.toml", "--set", f"{HOME} = 3"),
    ],
)
def test_a_corrected_home_height_keeps_the_alignment(aerodft, desk, synced, options):
    drafted = (desk.folder / "drafted.toml").read_text()
    desk.station(drafted.replace('order = ["home"]', 'order = ["home"]\nhome_above_plane_m = 3.0'), "higher.toml")
    options = [desk.folder / each if str(each).endswith(".toml") else each for each in options]
    done = aerodft("recompute", synced, *options, "-o", desk.folder / "higher")
    assert done.code == 0, done.err
    before, after = config(synced), config(desk.folder / "higher")
    assert after["telemetry"]["height"]["home_above_plane_m"] == 3.0
    for key in ("time_offset_s", "time_drift", "time_reference", "time_std_s"):
        assert after["images"][key] == before["images"][key], key
    for key in ("delay_s", "lag_s"):
        assert after["telemetry"]["attitude"][key] == before["telemetry"]["attitude"][key], key
    pairs = list(zip(measurements(synced), measurements(desk.folder / "higher"), strict=True))
    assert len(pairs) > 5
    for old, new in pairs:
        assert new["stamp_ns"] == old["stamp_ns"]
        assert new["value"] / old["value"] == pytest.approx((HEIGHT_M + 3.0) / HEIGHT_M)
    assert ("is kept" in done.err) is ("-c" in options)


def test_every_door_measures_with_the_changed_height(aerodft, desk, synced):
    settings = {HOME: 3.0}
    result = ad.recompute(synced, desk.folder / "python", settings=settings)
    assert result.provenance["settings"] == settings
    assert tomllib.loads((desk.folder / "python" / "computed_from.toml").read_text())["settings"] == settings
    said = aerodft("recompute", synced, "--home-above-plane", 3, "-o", desk.folder / "command", "--json")
    assert said.json["computed_from"]["settings"] == settings
    first, second = (list(Recording(desk.folder / name).measurements()) for name in ("python", "command"))
    assert first == second
    whole = measurements(desk.folder / "python")[4]
    asked = ("measure", "--recording", synced, "--at", whole["stamp_ns"], "--probe", "range 31.5,23.5", "--json")
    (one,) = aerodft(*asked, "--home-above-plane", 3).json
    (same,) = aerodft(*asked, "-c", desk.folder / "drafted.toml", "--set", f"{HOME}=3.0").json
    (old,) = aerodft(*asked).json
    assert one["value"] == same["value"] == pytest.approx(whole["value"], rel=1e-9)
    assert one["value"] / old["value"] == pytest.approx(43 / 40)
    rows = recompute_many([synced], desk.folder / "rows", settings=settings, workers=1)
    assert [each.sentence for each in rows] == [""]
    table = pyarrow.parquet.read_table(desk.folder / "rows").to_pylist()
    assert [each["value"] for each in table if each["name"] == "centre" and each["status"] == "ok"] == [
        each["value"] for each in measurements(desk.folder / "python")
    ]


@pytest.mark.parametrize(
    ("stated", "says"),
    [
        ("time_offset_s = 0.1", "is not kept: images.time_offset_s is stated"),
        ('video = "other.mp4"', "is not kept: it is of"),
    ],
)
def test_an_alignment_that_is_not_kept_is_said(aerodft, desk, synced, stated, says):
    drafted = (desk.folder / "drafted.toml").read_text()
    key = stated.partition(" ")[0]
    lines = [line for line in drafted.splitlines() if not line.startswith(key)]
    lines.insert(lines.index("[images]") + 1, stated)
    file = desk.station("\n".join(lines), "own.toml")
    done = aerodft("recompute", synced, "-c", file, "-o", desk.folder / "own")
    assert (done.code, says in done.err) == (0, True), done.err
    assert config(desk.folder / "own")["images"]["time_std_s"] == 0.6


def test_the_same_clock_stated_again_needs_no_remark(aerodft, desk, synced):
    done = aerodft("recompute", synced, "-c", desk.folder / "aligned.toml", "-o", desk.folder / "same")
    assert (done.code, "alignment" in done.err) == (0, False), done.err


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("telemetry.height.home_above=3", "--set: telemetry.height.home_above: unknown key; did you mean home_above"),
        (f"{HOME}=high", f'--set: {HOME}: got "high", expected a number'),
        ("probe.center.std_px=2", "--set: probe.center: no such entry: expected one of centre, width"),
        ("probe.std_px=2", "--set: probe.std_px: got a list, expected probe.NAME.KEY"),
        ("station.name.x=2", "--set: station.name: got a value, expected a table"),
        (".=2", "no key"),
    ],
)
def test_an_impossible_setting_is_refused_in_a_sentence(aerodft, desk, synced, change, says):
    done = aerodft("recompute", synced, "--set", change, "-o", desk.folder / "never")
    assert (done.code, says in done.last) == (3, True), done.err
    assert not (desk.folder / "never").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("recompute", "rec", "-o", "x", "--set", "limits.max_range_m"), "--set: got 'limits.max_range_m'"),
        (("recompute", "rec", "-o", "x", "--set", f"{HOME}=1", "--home-above-plane", "2"), "got it twice"),
        (("measure", "--height", "3", "--tilt", "3", "--probe", "range 1,1", "--set", "a=1"), "--set: expected"),
        (("river", "flight.mp4", "--home-above-plane", "3"), "--home-above-plane: expected a recording"),
    ],
)  # fmt: skip
def test_a_setting_without_its_place_is_a_usage_error(aerodft, desk, synced, options, says):
    places = {"rec": synced, "x": desk.folder / "x", "flight.mp4": desk.folder / "flight.mp4"}
    done = aerodft(*(places.get(each, each) for each in options))
    assert (done.code, says in done.last) == (2, True), done.err


def test_a_probe_and_a_camera_file_are_replaced(desk, synced, monkeypatch):
    monkeypatch.chdir(desk.folder)
    (desk.folder / "wider.toml").write_text((desk.folder / "camera.toml").read_text().replace("60.0", "70.0"))
    settings = {"camera.file": "wider.toml", "probe.centre.elevation_m": 2.0}
    ad.recompute(synced, desk.folder / "changed", settings=settings)
    old, new = config(synced), config(desk.folder / "changed")
    assert new["camera"]["fx_px"] < old["camera"]["fx_px"]
    assert {each["name"]: each["elevation_m"] for each in new["probe"]} == {"centre": 2.0, "width": 0.0}


def test_a_river_takes_settings_of_recordings_alone(desk, synced):
    camera, pose = ad.load_camera(desk.folder / "camera.toml"), ad.CameraPose(height_m=3, tilt_deg=30)
    with pytest.raises(UsageError, match="`settings` without a recording"):
        ad.survey_river(desk.folder / "flight.mp4", camera, pose, settings={HOME: 3.0})
    with pytest.raises(ConfigError, match=r"`settings`: telemetry\.height\.home: unknown key"):
        ad.survey_river(synced, settings={"telemetry.height.home": 3.0})


def test_a_fixed_camera_has_no_home(desk):
    text = '[station]\nname = "yard"\n[camera]\nfile = "camera.toml"\n[pose]\nheight_agl_m = 8.0\ntilt_deg = 60.0\n'
    text += '[images]\nvideo = "flight.mp4"\nstart = "2026-11-21T00:00:00Z"\n'
    desk.video()
    ad.import_flight(station=desk.station(text, "yard.toml"), output=desk.folder / "yard")
    with pytest.raises(AerodftError, match="got a fixed camera, which has no telemetry"):
        ad.recompute(desk.folder / "yard", desk.folder / "again", settings={HOME: 3.0})
    ad.recompute(desk.folder / "yard", desk.folder / "again", settings={"pose.height_agl_m": 9.0})
    assert config(desk.folder / "again")["pose"]["height_agl_m"] == 9.0
