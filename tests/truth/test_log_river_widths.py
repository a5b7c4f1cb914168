"""Widths of a river of known shape, seen from a recorded flight, as ``aerodft import`` gives them.

The flight is that of a simulated multicopter with a gimbal, flown by the real autopilot. Truth is its log, every sample
of it; what is imported is every second sample, with the true bank pixels +-0.5 px at every sample.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import orjson
import pytest
from numpy.testing import assert_allclose

from aerodft.adapters.images import VideoFileSource
from aerodft.adapters.timestamps import unix_ns_to_iso
from aerodft.adapters.wire.pose import POSE_SCHEMA
from aerodft.dft import Request, Setup
from aerodft.geometry import camera_angles, inverse, matrix, multiply, to_rotation_vector, yaw_pitch_roll
from aerodft.model import Camera, Image, PixelSource, Pose, PoseSample, Probe, ProbeKind, Status
from aerodft.sim import default_camera
from aerodft.sim.scenario import Scenario, scenario_from_log, write_files
from aerodft.sim.trajectory import Trajectory
from aerodft.sim.world import River
from replay.recordings import Recording, RecordingSource
from tests.commands import run_aerodft
from tests.one_image import measure

LOG = Path(__file__).parents[2].parent / "shared/data/sitl/brushless_consumer.tlog"
STD_PX = 0.5
PAN_START_S = 96.2
PAN_S = 2.0
TIME_BASE_NS = 20_000
OFF_PX = 8.0
GREY_LEVELS = 40.0
PERCENT = 0.01
MAX_TILT_DEG = 70.0
SLEW_DEG_PER_SAMPLE = 5.0
BANKING_DEG = 5.0
PANNING_DEG_PER_S = 5.0
LEGS = {(62.2, 65.2): 60.0, (66.2, 69.2): 30.0, (70.2, 73.2): 0.0}
"""Seconds after the log's first sample, at which the gimbal's pitch was held: tilt."""
TAKE_OFF_S = 34.0
WIDTHS = ("river", "width-a", "width-b", "width-c")

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(not LOG.is_file(), reason=f"{LOG} is not there: the recorded flights are kept apart"),
]


@dataclass(frozen=True)
class Truth:
    """A width as it is, its pixels without noise, and the camera's true pose."""

    value_m: float
    pixels: tuple[tuple[float, float], ...]
    tilt_deg: float
    pose: Pose


@dataclass(frozen=True)
class Width:
    """One width: how wrong it is, what 0.5 px alone would make of it, and what the camera did."""

    error: float
    noise_std: float
    inside: bool
    tilt_deg: float
    slewing: bool
    banking: bool
    panning: bool


@dataclass(frozen=True)
class Motion:
    """What the camera and the vehicle do at every sample, each ``(n,)``."""

    slewing: np.ndarray
    banking: np.ndarray
    panning: np.ndarray


def _motion(trajectory: Trajectory) -> Motion:
    camera, gimbal = trajectory.enu_wxyz_cam, trajectory.level_wxyz_gimbal
    turned_rad = np.linalg.norm(to_rotation_vector(multiply(inverse(camera[:-1]), camera[1:])), axis=1)
    fast = np.degrees(turned_rad) > SLEW_DEG_PER_SAMPLE
    yaw, _, _ = yaw_pitch_roll(gimbal)
    _, _, heading = camera_angles(camera)
    seconds = np.diff(trajectory.stamp_ns) / 1e9
    turns = np.abs(np.angle(np.exp(1j * np.diff([yaw, heading]))))
    pans = np.degrees(turns.max(axis=0)) / seconds > PANNING_DEG_PER_S
    lean = np.arccos(np.clip(matrix(trajectory.ned_wxyz_body)[:, 2, 2], -1, 1))
    return Motion(_either_side(fast), np.degrees(lean) > BANKING_DEG, _either_side(pans))


def _either_side(steps: np.ndarray) -> np.ndarray:
    """The samples at the ends of the steps between samples, ``(n - 1,)`` to ``(n,)``."""
    return np.concatenate([steps, [False]]) | np.concatenate([[False], steps])


def _truth(folder: Path) -> dict[tuple[str, int], Truth]:
    lines = map(orjson.loads, (folder / "truth.jsonl").read_bytes().splitlines())
    return {
        (line["name"], int(line["stamp_ns"])): Truth(
            value_m=line["value"],
            pixels=tuple(map(tuple, line["pixels"])),
            tilt_deg=line["pose"]["tilt_deg"],
            pose=Pose(position_enu_m=line["pose"]["position_enu_m"], wxyz=line["pose"]["enu_wxyz_cam"]),
        )
        for line in lines
        if line["name"] in WIDTHS
    }


def _import(folder: Path, *options: str, images: str, image_hz: float = 0) -> list[dict]:
    config = folder / "flight.toml"
    probes = "".join(f'[[probe]]\nname = "{name}"\nkind = "distance"\nobserved = true\n' for name in WIDTHS)
    config.write_text(
        '[station]\nname = "river"\n[camera]\nfile = "camera.toml"\n[telemetry.height]\norder = ["home"]\n'
        '[telemetry.attitude]\nfeedback = "measured"\n'  # truth is made of these reports: no camera lags behind them
        f"[images]\n{images}[record]\nimage_hz = {image_hz}\n{probes}"
    )
    files = ["--config", config, "--observations", folder / "observations.jsonl", "-o", folder / "recording"]
    done = run_aerodft("import", folder / "flight.tlog", *files, *options)
    assert done.code == 0, done.err
    return [orjson.loads(payload) for payload in Recording(folder / "recording").measurements()]


def _noise_std(camera: Camera, truth: Truth) -> float:
    """Standard deviation of the width, relative, if the pose were perfect."""
    probe = Probe(name="width", kind=ProbeKind.DISTANCE, source=PixelSource.OBSERVED)
    exact = PoseSample(stamp_ns=0, status=Status.OK, pose=truth.pose)
    (found,) = measure(Setup(camera=camera), exact, (Request(probe=probe, pixels=truth.pixels, std_px=STD_PX),))
    assert found.std is not None
    return found.std / truth.value_m


def _compared(scenario: Scenario, folder: Path, measured: list[dict]) -> list[Width]:
    truths, motion = _truth(folder), _motion(scenario.trajectory)
    assert len(measured) == len(truths)
    widths = []
    for one in measured:
        stamp_ns = int(one["stamp_ns"])
        truth = truths[one["name"], stamp_ns]
        row = int(np.searchsorted(scenario.trajectory.stamp_ns, stamp_ns))
        if one["status"] != "ok":  # a jump of the gimbal between two samples can leave no honest number
            assert one["status"] == "ILL_CONDITIONED"
            assert motion.slewing[row]
            continue
        low, high = one["ci95"]
        widths.append(
            Width(
                error=abs(one["value"] / truth.value_m - 1),
                noise_std=_noise_std(scenario.camera, truth),
                inside=low <= truth.value_m <= high,
                tilt_deg=truth.tilt_deg,
                slewing=bool(motion.slewing[row]),
                banking=bool(motion.banking[row]),
                panning=bool(motion.panning[row]),
            )
        )
    return widths


def _row(title: str, widths: list[Width]) -> str:
    error = np.array([width.error for width in widths]) / PERCENT
    median, p95, worst = np.percentile(error, [50, 95, 100])
    noise = np.median([width.noise_std for width in widths]) / PERCENT
    inside = np.mean([width.inside for width in widths])
    return f"{title:34} {len(widths):6d} {median:9.3f} {p95:9.3f} {worst:9.3f} {noise:12.3f} {inside:10.1%}"


def _print_table(rows: dict[str, list[Width]]) -> None:
    print(f"\n{'width of the river against truth, %':34} {'n':>6} {'median':>9} {'95 %':>9} {'worst':>9}", end="")
    print(f" {'0.5 px alone':>12} {'in 95 % ci':>10}")
    for title, widths in rows.items():
        print(_row(title, widths))


@pytest.fixture(scope="module")
def flight(tmp_path_factory) -> tuple[Scenario, Path]:
    folder = tmp_path_factory.mktemp("flight")
    scenario = scenario_from_log(default_camera(1920, 1080), LOG, thin=2)
    write_files(scenario, folder, video=False)
    return scenario, folder


@pytest.fixture(scope="module")
def measured(flight) -> list[dict]:
    _, folder = flight
    return _import(folder, images="rate_hz = 2\n")


def test_widths_are_within_one_percent_while_the_vehicle_banks_and_the_gimbal_pans(flight, measured):
    widths = _compared(*flight, measured)
    steep = [width for width in widths if width.tilt_deg < MAX_TILT_DEG]
    calm = [width for width in steep if not width.slewing]
    rows = {
        "tilt below 70 deg": calm,
        "  tilt 0 to 20 deg": [width for width in calm if width.tilt_deg < 20],
        "  tilt 20 to 50 deg": [width for width in calm if 20 <= width.tilt_deg < 50],
        "  tilt 50 to 70 deg": [width for width in calm if width.tilt_deg >= 50],
        "  vehicle banks more than 5 deg": [width for width in calm if width.banking],
        "  gimbal or camera pans > 5 deg/s": [width for width in calm if width.panning],
    }
    slews = [width for width in steep if width.slewing]
    _print_table({**rows, "left out: slews > 5 deg a sample": slews})
    print(f"refused, all of them in slews: {len(measured) - len(widths)}")
    for title, chosen in rows.items():
        errors = np.array([width.error for width in chosen])
        # Nobody measures better than the pixels that he is given: 3 sigma of their noise come on top, far out only.
        noise = np.array([width.noise_std for width in chosen])
        assert len(chosen) > 10, title
        assert np.percentile(errors, 95) <= PERCENT, title
        assert np.all(errors <= PERCENT + 3 * noise), title
    assert len(calm) > 0.9 * len(steep)
    assert np.mean([width.inside for width in slews]) > 0.9


def test_the_legs_show_as_tilt_and_nothing_before_take_off_has_a_number(flight, measured):
    scenario, folder = flight
    assert measured
    poses = [
        orjson.loads(message.data)
        for message in Recording(folder / "recording").messages()
        if message.channel.schema == POSE_SCHEMA
    ]
    elapsed_s = np.array([int(pose["stamp_ns"]) - scenario.trajectory.start_ns for pose in poses]) / 1e9
    for (first_s, last_s), tilt_deg in LEGS.items():
        tilts = [p["tilt_deg"] for p, s in zip(poses, elapsed_s, strict=True) if first_s <= s <= last_s]
        assert len(tilts) >= 4
        assert_allclose(tilts, tilt_deg, rtol=0, atol=0.5)
    grounded = [pose for pose, s in zip(poses, elapsed_s, strict=True) if s < TAKE_OFF_S]
    assert len(grounded) > 50
    stood_still = {"CLOCK_JUMPED"}  # the simulator that the log is from, for 0.21 s
    ready = {"NO_TELEMETRY", "NO_HEIGHT", "NO_ATTITUDE", "BELOW_MIN_HEIGHT"}
    assert {pose["status"] for pose in grounded} <= ready | stood_still
    assert "BELOW_MIN_HEIGHT" in {pose["status"] for pose in grounded}


def _over_its_own_river() -> Scenario:
    """Two and a half seconds in which the vehicle turns and its gimbal pans back, over a river laid where it looks."""
    look = scenario_from_log(default_camera(1920, 1080), LOG, interval_s=(PAN_START_S, PAN_S)).trajectory
    tilt, _, heading = camera_angles(look.enu_wxyz_cam[0])
    reach_m = look.position_enu_m[0, 2] * np.tan(tilt)
    at = look.position_enu_m[0, :2] + reach_m * np.array([np.sin(heading), np.cos(heading)])
    river = River(origin_en_m=(float(at[0]), float(at[1])), azimuth_rad=float(heading) + np.pi / 2)
    return scenario_from_log(default_camera(1920, 1080), LOG, interval_s=(PAN_START_S, PAN_S), thin=2, river=river)


def test_a_rendered_and_encoded_video_gives_its_stamps_and_widths(tmp_path):
    scenario = _over_its_own_river()
    write_files(scenario, tmp_path)
    stamps = scenario.image_stamps_ns.tolist()
    truths = _truth(tmp_path)
    _observe_by_index(tmp_path / "observations.jsonl", stamps)
    options = ("--video", str(tmp_path / "video.mp4"), "--video-start", unix_ns_to_iso(stamps[0]))
    measured = _import(tmp_path, *options, images="", image_hz=1)
    images = [each for each in RecordingSource(Recording(tmp_path / "recording")).events() if isinstance(each, Image)]
    assert_allclose([image.stamp_ns for image in images], stamps, rtol=0, atol=TIME_BASE_NS)
    for one in measured:
        one["stamp_ns"] = stamps[one["image"]]
    widths = _compared(scenario, tmp_path, measured)
    _print_table({"video, gimbal pans and vehicle turns": widths})
    assert np.mean([width.panning for width in widths]) > 0.9
    assert all(width.error <= PERCENT + 3 * width.noise_std for width in widths)
    assert np.percentile([width.error for width in widths], 95) <= PERCENT
    _see_water_between_banks(tmp_path / "video.mp4", stamps, truths)


def _observe_by_index(path: Path, stamps: list[int]) -> None:
    """Let the observations name their image by its index alone, so that the video's own stamps must be right."""
    lines = []
    for line in map(orjson.loads, path.read_bytes().splitlines()):
        line["image"] = stamps.index(int(line.pop("stamp_ns")))
        lines.append(orjson.dumps(line))
    path.write_bytes(b"\n".join(lines))


def _see_water_between_banks(video: Path, stamps: list[int], truths: dict[tuple[str, int], Truth]) -> None:
    """The pictures show what the telemetry says: blue between the true bank pixels, none beyond them."""
    for image in VideoFileSource(video, start_ns=stamps[0]).events():
        pixels = image.pixels().astype(float)
        for name in WIDTHS:
            truth = truths.get((name, stamps[image.index]))
            if truth is None:
                continue
            left, right = map(np.array, truth.pixels)
            across = (right - left) / np.linalg.norm(right - left)
            between = [_blueness(pixels, point) for point in (left + OFF_PX * across, right - OFF_PX * across)]
            beyond = [_blueness(pixels, point) for point in (left - OFF_PX * across, right + OFF_PX * across)]
            assert min(between) > max(beyond) + GREY_LEVELS, (name, image.index)


def _blueness(pixels: np.ndarray, at: np.ndarray) -> float:
    column, row = np.rint(at).astype(int).tolist()
    patch = pixels[row - 2 : row + 3, column - 2 : column + 3].mean(axis=(0, 1))
    return float(patch[0] - patch[2])
