"""Recorded flights through ``aerodft import`` and ``recompute``, against what is known of them from elsewhere."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import orjson
import pytest
from numpy.testing import assert_allclose
from pymavlink import mavutil

from aerodft.adapters.wire.pose import POSE_SCHEMA, decode_pose
from aerodft.geometry import camera_angles
from aerodft.model import Status
from replay.recordings import Recording
from tests.commands import run_aerodft
from tests.nights import at_night
from tests.truth.recorded_station import station

DATA = Path(__file__).parents[2].parent / "shared" / "data"
SECOND = 1_000_000_000
RATE_HZ = 2
DEG = 180 / np.pi
CONSUMER, COLD, QUAD = "sitl/brushless_consumer.tlog", "sitl/cold_boot.tlog", "logs/dronekit_quad.tlog"
CUT = "sitl/brushless_cut.BIN"
HOME, EVERY = '["home"]', '["rangefinder", "terrain", "home"]'

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there: the recorded flights are kept apart")


@dataclass(frozen=True)
class Imported:
    """A flight's recording, and what the command that made it said."""

    folder: Path
    code: int
    err: str
    summary: dict

    def poses(self):
        return [decode_pose(m.data) for m in Recording(self.folder).messages() if m.channel.schema == POSE_SCHEMA]

    def measurements(self):
        return [orjson.loads(data) for data in Recording(self.folder).measurements()]


def run(*arguments):
    done = run_aerodft(*arguments)
    return done.code, done.out, done.err


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Imports a flight, once."""
    made = {}

    def flown(name, order=HOME):
        if (name, order) not in made:
            folder = tmp_path_factory.mktemp(Path(name).stem)
            (folder / "station.toml").write_text(station(rate_hz=RATE_HZ, heights=order))
            code, out, err = run(
                "import", DATA / name, "-c", folder / "station.toml", "-o", folder / "recording", "--json"
            )
            assert code in {0, 4}, err
            made[name, order] = Imported(folder / "recording", code, err, json.loads(out))
        return made[name, order]

    return flown


@pytest.fixture(scope="module")
def control():
    """What the pilot's script saw on the control link: samples with the autopilot's own UTC, and events."""
    return json.loads((DATA / "sitl/brushless_ctl.json").read_text())


def tilt_deg(sample):
    return float(camera_angles(sample.pose.wxyz)[0]) * DEG


def heading_deg(sample):
    return float(camera_angles(sample.pose.wxyz)[2]) * DEG


def nearest(poses, utc_ns):
    return min(poses, key=lambda sample: abs(sample.stamp_ns - utc_ns))


def just_before(poses, seen):
    """The last pose before the script looked: it gave its next command right after."""
    utc_ns = seen["SYSTEM_TIME"]["time_unix_usec"] * 1000
    return max((s for s in poses if s.stamp_ns <= utc_ns), key=lambda sample: sample.stamp_ns)


@pytest.mark.parametrize(("pitch", "tilt"), [("-30", 60.0), ("-60", 30.0), ("-90", 0.0)])
def test_the_gimbals_legs_show_as_tilts(flown, control, pitch, tilt):
    poses = flown(CONSUMER).poses()
    legs = [s for s in control["samples"] if s["tag"].startswith(f"gimbal cmd pitch {pitch} ")]
    assert legs
    for leg in legs:
        sample = just_before(poses, leg)
        assert sample.status is Status.OK
        assert tilt_deg(sample) == pytest.approx(tilt, abs=0.5), leg["tag"]
        assert sample.pose.position_enu_m[2] == pytest.approx(leg["rel_alt"], abs=0.3)


def test_on_the_leg_the_nose_goes_down_and_the_camera_does_not(flown, control):
    poses = flown(CONSUMER).poses()
    legs = [s for s in control["samples"] if s["tag"].startswith("leg ") and s["tag"] != "leg 2 s"]  # still turning
    assert len(legs) == 11
    assert min(leg["veh_rpy"][1] for leg in legs) < -20.0
    for leg in legs:
        sample = just_before(poses, leg)
        assert tilt_deg(sample) == pytest.approx(60.0, abs=0.5)
        assert heading_deg(sample) == pytest.approx(leg["hdg"], abs=0.5)


def test_pans_are_against_the_vehicle_and_locked_yaw_is_against_north(flown, control):
    poses = flown(CONSUMER).poses()
    pans = [s for s in control["samples"] if " yaw " in s["tag"] and "-90" not in s["tag"]]
    assert len(pans) >= 8
    for pan in pans:
        sample = just_before(poses, pan)
        expected_deg = pan["hdg"] + pan["gimbal_euler"][2]
        away_deg = (heading_deg(sample) - expected_deg + 180) % 360 - 180
        assert away_deg == pytest.approx(0.0, abs=1.0), pan["tag"]


@pytest.mark.parametrize(
    ("order", "on_the_ground"),
    [
        (HOME, "home says 0.00 m, the minimum is 1 m"),
        (EVERY, "terrain says 0.04 m, the minimum is 1 m"),
    ],
)
def test_nothing_before_take_off_yields_a_number(flown, control, order, on_the_ground):
    imported = flown(CONSUMER, order)
    armed = next(event["t"] for event in control["events"] if event["ev"] == "armed")
    sample = control["samples"][0]
    host_minus_utc_s = sample["t"] - sample["SYSTEM_TIME"]["time_unix_usec"] / 1e6
    before_ns = (armed - host_minus_utc_s) * SECOND
    early = [m for m in imported.measurements() if int(m["stamp_ns"]) < before_ns]
    assert len(early) > 60
    assert {m["value"] for m in early} == {None}
    reasons = ["NO_TELEMETRY", "NO_HEIGHT", "BELOW_MIN_HEIGHT", "CLOCK_JUMPED"]
    assert list(dict.fromkeys(m["status"] for m in early)) == reasons
    assert sum(m["status"] == "CLOCK_JUMPED" for m in early) < 20  # the simulator stood still for 0.21 s
    assert [on_the_ground] in [m["reasons"] for m in early]
    landed = imported.measurements()[-5:]
    assert {(m["status"], m["value"]) for m in landed} == {("BELOW_MIN_HEIGHT", None)}


@pytest.mark.parametrize("order", [HOME, EVERY])
def test_a_cold_boot_yields_no_number_and_says_why(flown, order):
    imported = flown(COLD, order)
    assert imported.code == 4
    assert {m["value"] for m in imported.measurements()} == {None}
    assert list(imported.summary["poses"]) == ["NO_TELEMETRY", "NO_HEIGHT", "BELOW_MIN_HEIGHT"]
    assert "no image has a usable pose: NO_TELEMETRY (no height received yet from" in imported.err
    assert "), then NO_HEIGHT (" in imported.err
    assert "), then BELOW_MIN_HEIGHT (home says 0.00 m, the minimum is 1 m); the recording is kept" in imported.err


@pytest.fixture(scope="module")
def quad_fixes():
    """UTC (ns) of every GLOBAL_POSITION_INT with a fix in the quad's log, read with pymavlink alone.

    The vehicle was switched off and on once: each of the two has its own time since boot.
    """
    log = mavutil.mavlink_connection(str(DATA / QUAD), dialect="ardupilotmega")
    boots = [([], [])]
    last_ms = 0
    while (message := log.recv_match(type=["GLOBAL_POSITION_INT", "SYSTEM_TIME"])) is not None:
        if message.time_boot_ms < last_ms - 5_000:
            boots.append(([], []))
        last_ms = message.time_boot_ms
        fixes_ns, offsets_ns = boots[-1]
        if message.get_type() == "SYSTEM_TIME":
            if message.time_unix_usec:
                offsets_ns.append(message.time_unix_usec * 1000 - message.time_boot_ms * 10**6)
        elif message.lat or message.lon:
            fixes_ns.append(message.time_boot_ms * 10**6)
    log.close()
    assert len(boots) == 2
    return np.concatenate([np.array(fixes_ns) + sorted(offsets)[len(offsets) // 2] for fixes_ns, offsets in boots])


@pytest.mark.nightly
def test_the_quads_gap_is_stale_and_so_is_all_after_its_end(flown, quad_fixes):
    poses = flown(QUAD).poses()
    longest = int(np.argmax(np.diff(quad_fixes)))
    gap = quad_fixes[longest], quad_fixes[longest + 1]
    assert (gap[1] - gap[0]) / SECOND == pytest.approx(18.8, abs=0.6)
    in_gap = [s for s in poses if gap[0] < s.stamp_ns < gap[1]]
    after = [s for s in poses if s.stamp_ns > quad_fixes[-1] + SECOND]
    assert len(in_gap) == pytest.approx(18.8 * RATE_HZ, abs=2)
    assert len(after) > 600
    assert {s.status for s in after} == {Status.STALE_TELEMETRY}
    rebooted = {s.status for s in in_gap}  # on its first two messages after the gap
    assert rebooted <= {Status.STALE_TELEMETRY, Status.CLOCK_JUMPED}
    assert all(any("on both sides of the stamp within" in reason for reason in s.reasons) for s in in_gap)


@pytest.mark.nightly
def test_the_quad_has_poses_wherever_there_is_telemetry(flown, quad_fixes):
    poses = flown(QUAD).poses()
    covered = []
    for sample in poses:
        after = int(np.searchsorted(quad_fixes, sample.stamp_ns))
        if 0 < after < len(quad_fixes) and quad_fixes[after] - quad_fixes[after - 1] <= SECOND:
            covered.append(sample)
    posed = [s for s in covered if s.pose is not None]
    share = len(posed) / len(covered)
    print(f"dronekit_quad: poses at {len(posed)} of {len(covered)} stamps between two fixes ({share:.2%})")
    assert len(covered) > 1800
    assert share > 0.99
    assert {s.attitude_source for s in posed} == {"MOUNT_STATUS"}
    assert {s.status for s in posed} == {Status.OK, Status.BELOW_MIN_HEIGHT}


def test_a_cut_on_board_log_is_imported_up_to_the_cut(flown):
    imported = flown(CUT)
    (warning,) = imported.summary["warnings"]
    assert warning == f"{DATA / CUT}: the log is cut off; everything before the cut was read"
    poses = imported.poses()
    assert poses[-1].status is Status.OK
    last_ns = max(m.log_ns for m in Recording(imported.folder).messages() if m.channel.encoding == "dataflash")
    assert 0 <= last_ns - poses[-1].stamp_ns <= SECOND


def test_the_on_board_log_and_the_radios_agree(flown):
    """The same flight twice: by the autopilot's own log with GPS time, and by telemetry with SYSTEM_TIME."""
    board, radio = flown(CUT).poses(), flown(CONSUMER).poses()
    differences = []
    for one in board:
        other = nearest(radio, one.stamp_ns)
        close = abs(other.stamp_ns - one.stamp_ns) < SECOND / RATE_HZ
        if close and one.status is Status.OK and other.status is Status.OK and one.pose.position_enu_m[2] > 45:
            differences.append(
                [tilt_deg(one) - tilt_deg(other), one.pose.position_enu_m[2] - other.pose.position_enu_m[2]]
            )
    assert len(differences) > 60
    assert_allclose(np.median(differences, axis=0), [0.0, 0.0], atol=0.1)


@pytest.mark.parametrize("name", [CONSUMER, COLD, CUT, *at_night(QUAD)])
def test_recomputed_measurements_are_the_same_bytes(flown, tmp_path, name):
    imported = flown(name)
    code, _, err = run("recompute", imported.folder, "-o", tmp_path / "again")
    assert code == imported.code, err
    assert list(Recording(tmp_path / "again").measurements()) == list(Recording(imported.folder).measurements())
